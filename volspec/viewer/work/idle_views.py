"""Pictures from the layers of the last cast: at once, and once nothing moves.

    CastDone with layers, Look -> [idle_views] -> IdlePictures, CoefficientImage -> pictures

Both eyes' pictures, one with a focus, and one to be read take longer than other looks.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterator, Mapping
from dataclasses import replace
from typing import Any

from volspec.errors import VolspecError, one_line
from volspec.image import CoefficientImage, OpacityLayers
from volspec.relight import Look, Stereo, StereoViews, TexturePlanes, error_map
from volspec.viewer.model.depth import focused_depth, shown_look, shown_stereo
from volspec.viewer.model.light_rows import light_rig
from volspec.viewer.model.quality import opacity_scales
from volspec.viewer.model.room import shown_spec
from volspec.viewer.model.state import ViewState
from volspec.viewer.work.background import LatestWorker, Tasks
from volspec.viewer.work.cast_job import CastDone
from volspec.viewer.work.notify import Notice
from volspec.viewer.work.pictures import IdlePictures, Pictures

# Pixels by which the error of other opacities is estimated, and the 99.9th percentile, CIEDE2000,
# from which on they are cast. An estimate is a mean of what may be lost: three times as much, about
# 2 codes of 255, is lost in the worst pixel of a thousand.
_ESTIMATED, VISIBLE = 20_000, 0.2
_ENDED = object()
_Callback = Callable[[], object]
# A picture's layers, and their look.
Recomposed = tuple[OpacityLayers, Look]
# An image with layers, and its look with both eyes, or a focus.
IdleJob = tuple[CoefficientImage, Look]
# A job, its pictures or an error's message, and the time in milliseconds.
IdleDone = tuple[IdleJob, IdlePictures | str, float]


class IdleWorker(LatestWorker[IdleJob, IdleDone]):
    """Reprojects pictures with layers to both eyes, or focuses them, once nothing moves.

    It has a device of its own: the casts' would have two threads.
    """

    _name = "volspec-idle"
    _views: StereoViews | None = None

    def _results(self, job: IdleJob) -> Iterator[IdleDone]:
        outcome: IdlePictures | str
        started = time.perf_counter()
        try:
            images = self._images(job)
            outcome = IdlePictures(job[1].stereo, images, tuple(map(TexturePlanes.of, images)))
        except MemoryError:
            outcome = "no memory for both eyes' pictures, or a focus"
        except VolspecError as refused:
            outcome = one_line(refused)
        yield job, outcome, 1e3 * (time.perf_counter() - started)

    def _images(self, job: IdleJob) -> tuple[CoefficientImage, ...]:
        image, look = job
        if look.stereo is None:
            return look.views(image)
        if self._views is None or self._views.image is not image:
            before = None if self._views is None else self._views.compute
            self._views = StereoViews(image, before)
        size = look.stereo.eye_size(image.size)
        return self._views.views(look.stereo, look.opacities, look.depth, size)


def _scales_in(layered: CastDone) -> Mapping[str, float]:
    """Return the scales of opacities that a picture's layers were cast with."""
    return layered.job.shading.opacities if layered.cast_pass.baked else {}


def can_show(layered: CastDone, state: ViewState) -> bool:
    """Return True unless a picture's layers lack a material that is to be seen."""
    scales = opacity_scales(state)
    return all(
        scales.get(n, 1.0) == 0.0 for n, scale in _scales_in(layered).items() if scale == 0.0
    )


class IdleViews:
    """The last cast with layers, in other looks; ``changed`` is called if it is to be drawn."""

    def __init__(
        self, pictures: Pictures, wake: _Callback, changed: _Callback, notice: Notice
    ) -> None:
        self._pictures, self._changed, self._notice = pictures, changed, notice
        self._worker, self._tasks = IdleWorker(wake), Tasks(wake)
        self.cast: CastDone | None = None  # None if the state is to be cast first
        self._look = Look()  # opacities and effects of depth that the picture shows
        self._loading: Iterator[None] | None = None  # of layers
        # The picture recomposed with it, to be read, and the one that was asked for.
        self._recomposed: tuple[Recomposed, CoefficientImage] | None = None
        self._asked_for: tuple[Any, ...] | None = None
        self._off: Recomposed | None = None  # of which a cast would look different
        self._requested: IdleJob | None = None

    @property
    def busy(self) -> bool:
        """True while layers are uploaded, or pictures are made."""
        return self.loading or self._worker.busy or self._tasks.busy

    @property
    def loading(self) -> bool:
        """True while layers are uploaded, a step at each `tick`."""
        return self._loading is not None

    def take_cast(self, done: CastDone, look: Look, is_whole: bool) -> bool:
        """Take a cast with layers, to be shown in a look; return False if the picture stays.

        It does if it ``is_whole`` and was cast in this look; `tick` then uploads the layers. Raises
        ImageError if a scale of an opacity is refused.
        """
        loading = self._upload(done)
        if is_whole and not done.cast_pass.baked and self._look == look:
            self._loading = loading
            return False
        for _ in loading:
            pass
        self._pictures.recompose(self._of_layers(look))
        self.begin(look)
        return True

    def begin(self, look: Look) -> None:
        """Begin with another picture, which has a look."""
        self._look, self._asked_for = look, None

    def _upload(self, done: CastDone) -> Iterator[None]:
        """Upload a picture's layers, step by step; then they can be shown."""
        assert done.image is not None
        yield from self._pictures.take_layers(done.image, done.packed, done.opacity)
        self.cast = replace(done, packed=None, opacity=None)

    def _load(self) -> None:
        """Do a step of an upload of layers."""
        if self._loading is None:
            return
        try:
            if next(self._loading, _ENDED) is _ENDED:
                self._loading = None
        except VolspecError as error:
            self._loading = None
            self._notice.show(one_line(error), kind="error")

    def recomposes(self, state: ViewState) -> bool:
        """Return True if a state is shown without a cast; ends an upload of layers."""
        while self._loading is not None:
            self._load()
        return self.cast is not None and can_show(self.cast, state)

    def _of_layers(self, look: Look) -> Look:
        """Return a look as that of the layers, which may have some opacities baked in."""
        baked = {} if self.cast is None else _scales_in(self.cast)
        names, scales = {*look.opacities, *baked}, look.opacities
        of = {name: scales.get(name, 1.0) / (baked.get(name) or 1.0) for name in names}
        of = {name: scale for name, scale in of.items() if scale != 1.0 and baked.get(name) != 0}
        return replace(look, opacities=of)

    @property
    def look(self) -> Look:
        """Look of the layers that the picture shows."""
        return self._of_layers(self._look)

    def forget(self) -> None:
        """Recompose no more: a change needs a cast."""
        self.cast = self._loading = None

    def forget_document(self) -> None:
        """Forget the picture, which belongs to another document."""
        self.forget()
        self.hide()
        self._recomposed = None

    def recompose(self, state: ViewState) -> bool:
        """Show the state's look at the next relight; return True if it is another one.

        Both eyes' pictures, or a focus, disappear unless they are the state's.
        """
        look = shown_look(state)
        recomposes = self.cast is not None and look != self._look
        if recomposes:
            self._look = look
            try:
                self._pictures.recompose(self.look)
            except VolspecError as error:  # as long as the state has it
                self._notice.show(one_line(error), kind="error")
                recomposes = False
        if self._pictures.idle is not None and self._requested != self._job(state):
            self.hide()
        return recomposes

    def hide(self) -> None:
        """Show the picture that is drawn at once."""
        self._requested = None
        if self._pictures.idle is not None:
            self._pictures.show_idle(None)
            self._changed()

    def _job(self, state: ViewState) -> IdleJob | None:
        """Return what makes both eyes' pictures, or a focus; None without, or without layers."""
        layout, depth = shown_stereo(state), focused_depth(state)
        if self.cast is None or self.cast.image is None or self.loading:
            return None
        if layout:
            return self.cast.image, replace(self.look, stereo=Stereo(layout))
        if depth.focus_mm is None:
            return None
        return self.cast.image, replace(self.look, depth=depth)

    def tick(self, state: ViewState, held: bool) -> None:
        """Do a step of an upload; start what is shown and read once nothing is ``held``."""
        self._load()
        if held:
            return
        job = self._job(state)
        if job is not None and job != self._requested:
            self._requested = job
            self._worker.request(job)
        self._read(state)

    def _read(self, state: ViewState) -> None:
        """Start to recompose the picture, to be read, and to estimate its error."""
        image, key = self._pictures.image, self._key
        rig, spec = light_rig(state.lights, state.room), shown_spec(state)
        asked = key, state.lights, shown_stereo(state)
        if image is None or key is None or rig is None or self._asked_for == asked:
            return
        self._asked_for = asked
        _, look = key
        stride = max(1, round((image.alpha.size / _ESTIMATED) ** 0.5))

        def compute() -> tuple[Recomposed, CoefficientImage, float]:
            error = 0.0
            if look.opacities and (look.depth.changes or asked[-1]):  # which other layers show
                error = math.inf
            elif look.opacities:
                how = spec.mode, spec.backdrop, stride
                errors = error_map(image, rig, *how, against="cast", opacities=look.opacities)
                error = errors.p999
            (picture,) = look.views(image)
            return key, picture, error

        self._tasks.start("picture", compute)

    @property
    def _key(self) -> Recomposed | None:
        """Layers and look that make the picture; None if it is shown as it was cast."""
        image, look = self._pictures.image, self.look
        if image is None or image.opacity_layers is None or look == Look():
            return None
        return image.opacity_layers, look

    @property
    def is_estimated(self) -> bool:
        """True if the picture has other opacities than those it was cast with."""
        return self._key is not None and bool(self._key[1].opacities)

    def take(self) -> bool:
        """Take pictures and errors that are done; return True if there are any."""
        pictures, readings = self._worker.take(), self._tasks.take()
        for job, news, ms in pictures:
            if isinstance(news, str):
                self._notice.show(news, kind="error")
            elif job is self._requested:
                stage = "stereo" if news.stereo else "focus"
                self._notice.trace.note(stage, stage, ms)
                self._pictures.show_idle(news)
                self._changed()
        for outcome in readings:
            if outcome.result is None:
                self._notice.show(outcome.error, kind="error")
                continue
            key, image, error = outcome.result
            self._recomposed = key, image
            self._off = key if error > VISIBLE else None
            if math.isfinite(error):  # else the layers lack a fade, and are cast with it
                self._notice.trace.note("opacity-error", None, delta_e=error)
        return bool(pictures or readings)

    def wants_cast(self) -> bool:
        """Return True, once, if a cast with the opacities that are shown would look different."""
        wants = self._off is not None and self._off == self._key
        self._off = None if wants else self._off
        return wants

    def readable(self) -> CoefficientImage | None:
        """Return the picture in its look, to be read; None until it is recomposed."""
        image, key = self._pictures.image, self._key
        focused = self._pictures.focused()
        if focused is not None or image is None or key is None:
            return focused or image
        if self._recomposed is None or self._recomposed[0] != key:
            return None
        picture = self._recomposed[1]
        if picture.basis is not image.basis:
            picture = replace(picture, basis=image.basis)
            self._recomposed = key, picture
        return picture

    def close(self) -> None:
        """End, without waiting for pictures."""
        self._worker.close(0.0)
