"""Time steps of the open document: shown when they are wanted, and played.

    step -> [steps] -> thread -> Document at that step -> state -> cast

While a step is shown, the next one is read, uploaded to the device, and cast with a few rays: its
empty bricks and its shadows are then known, and the cast in the window's size takes half the time.
"""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Callable, Iterator
from contextlib import suppress
from dataclasses import dataclass

from volspec.errors import OpenCLError, VolspecError, one_line
from volspec.pipeline import Raycaster, raycast
from volspec.raycast import Pass
from volspec.viewer.model.document import Document
from volspec.viewer.model.fields import shown_transfer
from volspec.viewer.model.quality import cast_spec
from volspec.viewer.model.state import ViewState
from volspec.viewer.work.background import LatestWorker
from volspec.viewer.work.notify import Notice
from volspec.volume import KEPT_BYTES, Volume

# Width and height of a cast ahead, and its pass, as of pictures that move.
_FEW, _COARSE = (16, 12), Pass(2, "voxel")


@dataclass(frozen=True, slots=True, eq=False)
class _Request:
    state: ViewState
    step: int
    ahead: bool  # only to be ready when it is shown


@dataclass(frozen=True, slots=True, eq=False)
class _Ready:
    document: Document | None
    error: str = ""


class _StepWorker(LatestWorker[_Request, _Ready]):
    """Prepares documents at their steps; the last ones stay ready."""

    _name = "volspec-steps"

    def __init__(self, wake: Callable[[], object]) -> None:
        super().__init__(wake)
        # Opening of the document, and its steps; replaced as one, as the window's thread forgets.
        self._kept: tuple[object, OrderedDict[int, Document]] = None, OrderedDict()

    def _results(self, job: _Request) -> Iterator[_Ready]:
        document = job.state.document
        try:
            stepped = self._document_at(document, job.step)
            if job.ahead:
                self._cast_ahead(job.state, stepped)
            else:
                yield _Ready(stepped)
        except VolspecError as error:
            if not job.ahead:
                yield _Ready(None, one_line(error))

    def _cast_ahead(self, state: ViewState, document: Document) -> None:
        """Cast a few rays, so that the device has what a cast of this step needs."""
        volume, caster = document.volume, document.caster
        if caster is not None and not document.fault:
            camera, spec = state.view.camera(volume), _COARSE.spec(cast_spec(state), volume)
            with suppress(VolspecError):  # shown when it is cast
                raycast(volume, shown_transfer(state), camera, _FEW, spec, caster=caster)

    def _document_at(self, document: Document, step: int) -> Document:
        """Return the document at a step, with a caster of its own."""
        of, ready = self._kept
        if of is not document.opening:
            ready = OrderedDict()
            self._kept = document.opening, ready
        if step not in ready:
            series = document.series
            assert series is not None
            volume = series[step]
            ready[step] = document.at_step(step, volume, _make_caster(document, volume, ready))
            while len(ready) > max(2, KEPT_BYTES // series.nbytes):
                ready.popitem(last=False)
        ready.move_to_end(step)
        return ready[step]

    def forget(self) -> None:
        """Release the steps of a document that is no longer open."""
        self._kept = None, OrderedDict()


def _make_caster(
    document: Document, volume: Volume, ready: OrderedDict[int, Document]
) -> Raycaster | None:
    """Return a caster of a step; if the device has no room, ``ready`` steps make some."""
    while (template := document.caster) is not None:
        try:
            return Raycaster(volume, like=template)
        except OpenCLError:
            if not ready:
                raise
            ready.popitem(last=False)
    return None


class TimeSteps:
    """Shows and plays the time steps of the open document."""

    def __init__(self, wake: Callable[[], object], notice: Notice) -> None:
        self._worker, self._notice = _StepWorker(wake), notice
        self.playing = False
        self.loops = True  # play again from the first step after the last
        self._requested: tuple[object, int] | None = None
        self._followed: Document | None = None  # the one after which another is ready
        self._due = 0.0  # when the next step is to be shown

    @property
    def busy(self) -> bool:
        """True while a step is read, or steps play."""
        return self.playing or self._worker.busy

    def show(self, state: ViewState, step: int) -> None:
        """Start showing a step, counted from 0 and beyond the last from the first again."""
        document = state.document
        if document.series is None:
            self._notice.show_warning("This volume has no time steps")
            return
        step %= len(document.series)
        self._requested = document.opening, step
        self._worker.request(_Request(state, step, ahead=False))

    def go(self, state: ViewState, by: int) -> None:
        """Start showing a later or an earlier step than the one requested last."""
        self.show(state, self.requested(state.document) + by)

    def toggle(self, state: ViewState) -> None:
        """Start or stop playing."""
        document = state.document
        if document.series is None:
            self._notice.show_warning("This volume has no time steps")
            return
        self.playing = not self.playing
        if self.playing and document.step == len(document.series) - 1 and not self.loops:
            self.show(state, 0)

    def toggle_loop(self) -> None:
        """Play once, or again and again."""
        self.loops = not self.loops

    def requested(self, document: Document) -> int:
        """Return the step of a document that was requested last, else the one that it shows."""
        opening, step = self._requested or (None, 0)
        return step if opening is document.opening else document.step

    def stop(self) -> None:
        """Stop playing."""
        self.playing = False

    def forget(self) -> None:
        """Stop, and release the steps of a document that is no longer open."""
        self.playing, self._requested, self._followed = False, None, None
        self._worker.forget()

    def patience(self, now: float) -> float:
        """Return the seconds until the next step is due; inf if none plays, or it waits."""
        return self._due - now if self.playing and self._due > now else float("inf")

    def tick(self, state: ViewState, displayed: Document | None, now: float) -> None:
        """Go on to the next step when it is due and the present one is ``displayed``.

        Until then the next one is made ready; not before, as casts take turns.
        """
        document = state.document
        if document.series is None:
            self.playing = False
        if self._requested is None and not self.playing:
            return
        if displayed is not document or document.series is None or self._worker.busy:
            return
        if self._followed is not document:
            self._followed = document
            following = (document.step + 1) % len(document.series)
            self._worker.request(_Request(state, following, ahead=True))
            return
        if not self.playing or now < self._due:
            return
        if document.step == len(document.series) - 1 and not self.loops:
            self.playing = False
            return
        # A step that came late does not make the others early.
        self._due = max(self._due + 1.0 / document.step_rate, now)
        self.show(state, document.step + 1)

    def take(self, document: Document | None) -> Document | None:
        """Return the open document at a step that is ready; None without one."""
        stepped = None
        for ready in self._worker.take():
            if ready.error:
                self.playing, self._requested = False, None
                self._notice.show_error(ready.error)
            elif ready.document and document and ready.document.is_of(document):
                stepped = ready.document
                self._notice.trace.note("step", step=stepped.step)
        return stepped

    def close(self) -> None:
        """End the thread."""
        self._worker.close(0.0)
