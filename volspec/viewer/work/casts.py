"""Casts of the newest state in a background thread, first coarse and then whole.

    state -> [casts] -> CoefficientImage -> pictures

The device's own threads have a lower priority than the window's.
"""

from __future__ import annotations

import time
import warnings
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from typing import TYPE_CHECKING

from volspec.basis import Basis
from volspec.errors import CastCancelled, OpenCLError, VolspecError, VolspecWarning, one_line
from volspec.pipeline import Raycaster, raycast
from volspec.raycast import WHOLE, Pace, Pass
from volspec.relight import PackedOpacity, TexturePlanes
from volspec.viewer.model.depth import needs_layers
from volspec.viewer.model.fields import shown_transfer
from volspec.viewer.model.quality import LAYERS, cast_spec
from volspec.viewer.model.room import has_walls
from volspec.viewer.model.state import ViewState
from volspec.viewer.work.background import LatestWorker, lower_priority
from volspec.viewer.work.cast_job import CastDone, CastJob, NearbyViews
from volspec.viewer.work.precompile import ProgramBuilder
from volspec.viewer.work.room import WhiteWalls
from volspec.volume import Volume

if TYPE_CHECKING:
    from volspec.room import Backdrop
    from volspec.scene import SceneRoom


def make_caster(volume: Volume, device: str | None) -> tuple[Raycaster | None, str]:
    """Make a volume's caster, or return None and the reason why this machine cannot cast.

    Raises OpenCLError if a device is named that cannot cast.
    """
    try:
        # On Linux the device's threads, which outlive this one, inherit its priority.
        with ThreadPoolExecutor(1, "volspec-yielding", initializer=lower_priority) as pool:
            return pool.submit(Raycaster, volume, device=device).result(), ""
    except OpenCLError as error:
        if device is not None:
            raise
        warnings.warn(one_line(error), VolspecWarning, stacklevel=2)
        return None, one_line(error)


class CastWorker(LatestWorker[CastJob, CastDone]):
    """Casts in a thread of its own.

    A newer job cancels the passes of the previous one, except the first if that is coarse: with a
    mouse that moves faster than the cast, nothing would ever be shown.
    """

    _name = "volspec-cast"
    # The opened document and the basis of a room's picture, which caches what the last camera sees.
    _backdrop: tuple[object, Basis, Backdrop] | None = None

    def _results(self, job: CastJob) -> Iterator[CastDone]:
        if (image := job.document.image) is not None:
            cast = replace(job, size=image.size)
            layers = image.opacity_layers
            opacity = None if layers is None else PackedOpacity.of(layers)
            yield CastDone(cast, WHOLE, 0.0, image, packed=TexturePlanes.of(image), opacity=opacity)
            return
        for number, cast_pass in enumerate(job.passes):
            done = self._cast(job, cast_pass, spared=number == 0 and cast_pass.divisor > 1)
            yield done
            if done.image is None:
                break

    def _cast(self, job: CastJob, cast_pass: Pass, spared: bool) -> CastDone:
        if job.document.fault:
            return CastDone(job, cast_pass, 0.0, error=job.document.fault)
        width, height = (-(-side // cast_pass.divisor) for side in job.size)
        done = CastDone(job, cast_pass, 0.0)
        started = time.perf_counter()
        try:
            surfaces = job.document.surfaces(job.meshes, job.transfer)
            white = None if job.room is None else self._white_walls(job, job.room)
            image = raycast(
                job.document.volume,
                job.transfer,
                job.camera,
                (width, height),
                cast_pass.spec(job.shading, job.document.volume),
                cancel=(lambda: self._closed) if spared else self._is_superseded,
                caster=job.document.caster,
                behind=(*surfaces, *(() if white is None else (white,))),
            )
            if white is not None:
                image, walls = white.replaced(image, cast_pass.divisor == 1)
                done = replace(done, walls=walls)
            # In this thread, as it would cost the window's thread 20 to 40 ms.
            done = replace(done, image=image, packed=TexturePlanes.of(image))
            if image.opacity_layers is not None:
                # Views are made of layers with the transfer function's own opacities.
                nearby = None
                if not (cast_pass.baked and job.scales):
                    nearby = NearbyViews.of(image, job.document.caster, job.scales)
                opacity = PackedOpacity.of(image.opacity_layers)
                done = replace(done, opacity=opacity, nearby=nearby)
        except CastCancelled:
            pass
        except MemoryError:
            done = replace(done, error="no memory for the picture; make the window smaller")
        except VolspecError as refused:
            done = replace(done, error=one_line(refused))
        except Exception as failed:  # e.g. a lost device; the thread goes on
            message = f"the cast failed: {one_line(failed)}"
            done = replace(done, error=f"{message}; open the file again, or see volspec doctor")
        return replace(done, ms=1e3 * (time.perf_counter() - started))

    def _white_walls(self, job: CastJob, room: SceneRoom) -> WhiteWalls:
        """Return the room to cast a volume in.

        Raises SceneError if the volume is not in it.
        """
        document, basis = job.document, job.transfer.basis
        if self._backdrop is None or self._backdrop[:2] != (document.opening, basis):
            backdrop = room.behind(document.volume, basis)
            assert backdrop is not None
        else:
            backdrop = self._backdrop[2]
            if backdrop.response is not room.response:
                backdrop = backdrop.repainted(room.response)
        self._backdrop = document.opening, basis, backdrop
        return WhiteWalls(room, backdrop, len(room.response.names) * basis.size)


class NearbyWorker(LatestWorker[CastJob, CastDone]):
    """Shows views by an earlier cast's layers, while a later one ends and is packed."""

    _name = "volspec-nearby"

    def _results(self, job: CastJob) -> Iterator[CastDone]:
        assert job.nearby is not None
        done, started = CastDone(job, Pass(job.nearby.stride, "none"), 0.0), time.perf_counter()
        try:
            image = job.nearby.view(job.camera, job.scales)
            done = replace(done, image=image, packed=TexturePlanes.of(image))
        except VolspecError as refused:
            done = replace(done, error=one_line(refused))
        yield replace(done, ms=1e3 * (time.perf_counter() - started))


# A drag rests if the mouse is still for this long.
REST_S = 0.15


class CastScheduler:
    """Turns changes of state into casts."""

    def __init__(self, wake: Callable[[], object]) -> None:
        self._worker, self._nearby_worker = CastWorker(wake), NearbyWorker(wake)
        self._builder = ProgramBuilder(wake)
        self._pace = Pace()
        self._first = True  # the first cast, which includes the kernel's build
        self._state: ViewState | None = None
        self._changed_at = 0.0
        self._whole_wanted = False
        self.layers_wanted = False  # cast with layers of opacity when nothing moves
        self._layers_asked = False  # for the present state
        self._job: CastJob | None = None  # the newest
        self._last_job: CastJob | None = None  # the last of which a pass has ended
        self._nearby: NearbyViews | None = None  # of the last cast with layers

    @property
    def busy(self) -> bool:
        """True while a cast is in progress, or will be without a further change."""
        return self._whole_wanted or self.working

    @property
    def working(self) -> bool:
        """True while a thread is at work, or its results were not taken."""
        return self._worker.busy or self._nearby_worker.busy

    def change(
        self, state: ViewState, now: float, held: bool, plays: bool = False, turned: bool = False
    ) -> None:
        """Cast a state: coarse now, and whole when it rests or no mouse button is ``held``.

        While a series ``plays``, steps are of a voxel at any size: others would first be estimated.
        If only the view was ``turned``, layers of an earlier cast show it first.
        """
        if self._state is None or not state.document.is_of(self._state.document):
            self._pace, self._first = Pace(), True
        self._state, self._changed_at = state, now
        self._layers_asked = False
        self._nearby = self._nearby if turned else None
        if self._nearby and self._nearby.shows(state.view.camera(state.document.volume)):
            self._whole_wanted = held
            self._request(state, () if held else self._to_whole(state), self._nearby)
            return
        moving = self._pace.moving
        if moving == WHOLE and (plays or state.document.volume.pyramid is not None):
            moving = Pass(1, "voxel")
        self._whole_wanted = held and moving != WHOLE
        ends = held or moving == WHOLE
        self._request(state, (moving,) if ends else (moving, *self._to_whole(state)))

    def tick(self, now: float, held: bool) -> None:
        """Request the whole picture if nothing moves any more."""
        rests = not held or now - self._changed_at >= REST_S
        if self._whole_wanted and rests and self._state is not None:
            self._whole_wanted = False
            self._request(self._state, self._to_whole(self._state))
        if self.layers_wanted and not (held or self._layers_asked or self.busy) and self._state:
            self._layers_asked = True
            layers = self._state.shading.layers or LAYERS
            self._request(self._state, (Pass(1, layers=layers),))

    def cast_opacities(self, state: ViewState) -> None:
        """Cast the opacities of a state whose layers show them visibly wrong, or may."""
        if state.document.image is None:
            layers = Pass(1, layers=state.shading.layers or LAYERS, baked=True)
            self._request(state, (layers if needs_layers(state) else WHOLE,))

    def follow(self, state: ViewState) -> None:
        """Take a state that differs from the last in what needs no cast, for later ones."""
        self._state = state

    def is_newest(self, done: CastDone) -> bool:
        """Return True if a cast is of the newest request; an opened image is of every one."""
        job, newest = done.job, self._job
        if newest is None or job.document.image is None:
            return job is newest
        return job.document is newest.document

    def take(self, plays: bool = False) -> list[CastDone]:
        """Return the casts that have ended, in order; their times change the pace.

        ``plays`` is True while a series does.
        """
        taken = self._worker.take()
        self._last_job = taken[-1].job if taken else self._last_job
        # What layers show comes first, or not at all.
        nearby = [done for done in self._nearby_worker.take() if done.job is not self._last_job]
        taken = [*nearby, *taken]
        for done in taken:
            latest = self._state
            if done.image is None or latest is None or not done.job.document.is_of(latest.document):
                continue
            if done.nearby is not None and done.job is self._job:
                self._nearby = done.nearby
            if done.cast_pass == WHOLE:
                self._builder.request((done.job, latest.relight.viewing))
            if not self._first and not done.cast_pass.layers and done.cast_pass.steps != "none":
                self._pace = self._pace.after(done.cast_pass, done.ms, plays)
            self._first = False
        return taken

    def close(self) -> None:
        """End the threads."""
        self._worker.close()
        self._nearby_worker.close()
        self._builder.close(0.0)

    def _to_whole(self, state: ViewState) -> tuple[Pass, ...]:
        if state.document.volume.pyramid is not None:
            return Pass(1, "fast"), WHOLE  # finer levels are read for the second
        return self._pace.to_whole(state.shading.quality)

    def _request(
        self, state: ViewState, passes: tuple[Pass, ...], nearby: NearbyViews | None = None
    ) -> None:
        camera = state.view.camera(state.document.volume)
        self._job = CastJob(
            state.document,
            shown_transfer(state),
            camera,
            cast_spec(state),
            state.size,
            passes,
            state.room if has_walls(state) else None,
            state.meshes,
            nearby,
        )
        if nearby is not None:
            self._nearby_worker.request(self._job)
        self._worker.request(self._job)
