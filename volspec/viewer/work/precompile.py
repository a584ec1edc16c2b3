"""Programs that the next edit of the lights may need, built while nothing else happens.

    whole picture -> [ahead] -> child process -> drivers' caches of programs -> the next cast

A program of casts depends on how many light groups there are, and on whether some source has
shadows; a build takes one to four seconds. The child launches each once with a volume of a few
voxels, as PoCL ends a build then, and leaves it in the cache on disk; so it does with the shaders
that draw so many groups, 300 ms on llvmpipe. In the viewer's own process, casts would wait for the
compiler's lock. From the cache the viewer loads them, 50 ms each, when the child has ended.
"""

from __future__ import annotations

import os
import pickle
import subprocess
import sys
import threading
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from volspec._child import child_command
from volspec.appearance import Viewing, needs_host_lut
from volspec.camera import Camera
from volspec.errors import VolspecError
from volspec.pipeline import Raycaster
from volspec.raycast import Ambient, Directional, LightGroup, Point, RaycastSpec
from volspec.raycast.launch import Packet, Result
from volspec.relight import GLEngine, Illumination
from volspec.transfer import Tables
from volspec.viewer.work.background import LatestWorker, lower_priority
from volspec.volume import Volume

if TYPE_CHECKING:
    from volspec.viewer.work.cast_job import CastJob

# No power of two, for which llvmpipe compiles shaders of their own.
_SIZE = 19, 17
# A user who goes on within this time is not slowed down.
_REST_S = 1.0
_POLL_S = 0.1
_SERVE = "from volspec.viewer.work.precompile import serve; serve()"


@dataclass(frozen=True, slots=True, eq=False)
class Precompiler:
    """All that programs depend on, with a few voxels of all fields; ``spans`` if rays have ends."""

    volume: Volume
    device: str
    packet: Packet
    table: Tables
    spec: RaycastSpec
    spans: bool
    viewing: Viewing

    def build(self) -> Iterator[None]:
        """Build the programs of the neighbours; yield after each."""
        drawn: set[int] = set()
        for image in self.casts(None):
            channels = image.coefficients.shape[2]
            if channels not in drawn:
                drawn.add(channels)
                with suppress(VolspecError):  # without OpenGL there is nothing to draw
                    self._draw(image.coefficients, image.alpha)
            yield

    def casts(self, template: Raycaster | None) -> Iterator[Result]:
        """Cast the neighbours with the programs of a caster, or of one of its own."""
        device, packet = (None, None) if template else (self.device, self.packet)
        caster = Raycaster(self.volume, device=device, packet=packet, like=template)
        camera = Camera.orbit(self.volume)
        width, height = _SIZE
        ends = np.full((height, width, 2), np.inf, np.float32) if self.spans else None
        for neighbour in neighbours(self.spec):
            yield caster.cast(self.table, camera, _SIZE, neighbour, span_mm=ends)

    def _draw(self, coefficients: NDArray[np.float32], alpha: NDArray[np.float32]) -> None:
        """Draw a picture as small and as large ones are, by the formula and by a table of it."""
        if needs_host_lut(self.viewing.model):
            return
        matrix = np.zeros((3, coefficients.shape[2]))
        light = Illumination(matrix, np.full(3, 100.0), np.zeros(3), viewing=self.viewing)
        for by_table in (False, True):
            engine = GLEngine(coefficients, alpha, lut3d=by_table)
            engine.render(light, self.viewing, np.uint8)
            engine.close()


def few_voxels(volume: Volume) -> Volume:
    """Return the first 4³ voxels of all fields of a volume."""
    return Volume(
        volume.values[:4, :4, :4].copy(),
        world_from_index=volume.world_from_index,
        name=volume.name,
        fields=tuple(map(few_voxels, volume.fields)),
    )


def neighbours(spec: RaycastSpec) -> Iterator[RaycastSpec]:
    """Yield settings for the programs that an edit of the lights can lead to, the likeliest first.

    With one light group less, as many or one more, with shadows and without; and unshaded.
    """
    count = len(spec.groups)
    base_spec = replace(spec, crop_voxels=None, clip_planes=(), step_mm=None)

    def grouped(number: int, *sources: Ambient | Directional | Point) -> RaycastSpec:
        return replace(base_spec, groups=tuple(LightGroup(f"{n}", sources) for n in range(number)))

    shadowed = Ambient(occlusion=True), Directional((0, 0, 1), shadows=True)
    for number in (count, count + 1, count - 1):
        if number:
            yield grouped(number, *shadowed, Point((0, 0, 9), shadows=True))
            yield grouped(number, Directional((0, 0, 1)))
    yield grouped(count, Ambient())


class ProgramBuilder(LatestWorker[tuple["CastJob", Viewing], None]):
    """Has the neighbours of jobs built that have been cast and are seen under some conditions."""

    _name = "volspec-ahead"
    _built: tuple[object, ...] = ()

    def _results(self, job: tuple[CastJob, Viewing]) -> Iterator[None]:
        yield from ()
        cast, viewing = job
        document, spec = cast.document, cast.shading
        among = bool(cast.meshes) or cast.room is not None
        one = replace(spec, groups=spec.groups[:1])
        key = document.opening, type(cast.transfer), one, among, len(spec.groups)
        if document.caster is None or key == self._built or not self._wait_idle(_REST_S):
            return
        self._built = key
        caster = document.caster
        programs = Precompiler(
            few_voxels(document.volume),
            caster.device_index,
            caster.packet,
            caster.bake(cast.transfer, spec.opacities),
            spec,
            among,
            viewing,
        )
        try:
            child = subprocess.Popen(
                child_command(_SERVE), stdin=subprocess.PIPE, stderr=subprocess.DEVNULL
            )
        except (OSError, TypeError):  # the latter if the interpreter's path is unknown
            return
        assert child.stdin is not None
        try:
            pickle.dump(programs, child.stdin)
            child.stdin.flush()
            while child.poll() is None and not self._closed:
                with self._changed:
                    self._changed.wait_for(lambda: self._closed, _POLL_S)
        except OSError:
            pass  # it has ended
        finally:
            # A child that is still at work ends after its program, so that none is left half-built.
            child.stdin.close()
            child.wait()
        if self._closed or child.returncode:
            return
        with suppress(VolspecError):  # the cast that needs the program will report it
            for _ in programs.casts(caster):
                if self._closed:
                    break


def serve() -> None:
    """Build the programs that standard input describes, until it is closed."""
    lower_priority()
    programs: Precompiler = pickle.load(sys.stdin.buffer)
    until_closed = threading.Thread(target=os.read, args=(sys.stdin.fileno(), 1), daemon=True)
    until_closed.start()
    try:
        for _ in programs.build():
            if not until_closed.is_alive():
                return
    except VolspecError:
        pass  # the cast that needs the program will report it
