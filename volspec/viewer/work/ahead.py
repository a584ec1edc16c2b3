"""Programs of casts that the next edit of the lights may need, built while nothing else happens.

    whole picture -> [ahead] -> device's cache of programs -> the next cast

A program depends on how many light groups there are, and on whether some source has shadows; a
build takes one to four seconds. A caster of a few voxels launches it once, as PoCL ends a build
then, and leaves it in the cache on disk, from where the volume's own caster has it in 50 ms.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from volspec.errors import VolspecError
from volspec.pipeline import Raycaster
from volspec.raycast import Ambient, Camera, Directional, LightGroup, Point, RaycastSpec
from volspec.viewer.model.document import Document
from volspec.viewer.work.background import LatestWorker, lower_priority

if TYPE_CHECKING:
    from volspec.viewer.work.casts import CastJob

SIZE = 16, 16
# A user who goes on within this time is not slowed down.
REST_S = 1.0


def neighbours(spec: RaycastSpec) -> Iterator[RaycastSpec]:
    """Yield settings for the programs that an edit of the lights can lead to, the likeliest first.

    With one light group less, as many or one more, with shadows and without; and unshaded.
    """
    count = len(spec.groups)
    plain = replace(spec, crop_voxels=None, clip_planes=(), step_mm=None)

    def grouped(number: int, *sources: Ambient | Directional | Point) -> RaycastSpec:
        return replace(plain, groups=tuple(LightGroup(f"{n}", sources) for n in range(number)))

    lit = Ambient(occlusion=True), Directional((0, 0, 1), shadows=True)
    for number in (count, count + 1, count - 1):
        if number:
            yield grouped(number, *lit, Point((0, 0, 9), shadows=True))
            yield grouped(number, Directional((0, 0, 1)))
    yield grouped(count, Ambient())


class ProgramBuilder(LatestWorker["CastJob", None]):
    """Builds the neighbours of a job that has been cast."""

    _name = "volspec-ahead"
    _small: tuple[Document, Raycaster] | None = None
    _built: tuple[object, ...] = ()

    def _results(self, job: CastJob) -> Iterator[None]:
        yield from ()
        document, spec = job.document, job.shading
        among = bool(job.meshes) or job.room is not None
        kind = document, type(job.transfer), replace(spec, groups=spec.groups[:1]), among
        wanted = *kind, len(spec.groups)
        if document.caster is None or wanted == self._built or not self._wait_idle(REST_S):
            return
        lower_priority()
        spans = np.full((*SIZE, 2), np.inf, np.float32) if among else None
        try:
            if self._small is None or self._small[0] is not document:
                self._small = document, document.caster.of_few_voxels()
            small = self._small[1]
            camera, table = Camera.orbit(small.volume), small.bake(job.transfer)
            for each in neighbours(spec):
                if self._is_superseded():
                    return
                small.cast(table, camera, SIZE, each, span_mm=spans)
        except VolspecError:
            pass  # the cast that needs the program will report it
        self._built = wanted
