"""Pictures from the layers of the last cast: while it is turned, of both eyes, and with a focus.

image with layers -> [nearby] -> CoefficientImage of another camera, of two, or of a lens
"""

from __future__ import annotations

import time
from collections.abc import Iterator, Mapping
from contextlib import suppress
from dataclasses import dataclass, replace
from typing import Self

import numpy as np

from volspec.camera import Camera
from volspec.errors import VolspecError, one_line
from volspec.image import CoefficientImage
from volspec.image.reproject import Reprojector
from volspec.pipeline import Raycaster
from volspec.relight.layers import PackedLayers
from volspec.relight.look import Look
from volspec.relight.stereo import StereoViews
from volspec.viewer.work.background import LatestWorker
from volspec.viewer.work.pictures import RestPictures, crop

# Cameras whose views differ by more than this angle, or this ratio of distances, are not near.
_MOST_DEG, _MOST_RATIO = 10.0, 1.3
# Pictures with more pixels are seen in every n-th row and column.
_MOST_PIXELS = 120_000


@dataclass(frozen=True, slots=True, eq=False)
class NearbyViews:
    """Views near that of a cast with layers, in every n-th row and column."""

    every: int
    camera: Camera
    _reprojector: Reprojector

    @classmethod
    def of(
        cls, image: CoefficientImage, caster: Raycaster | None, scales: Mapping[str, float]
    ) -> Self | None:
        """Prepare the layers on a caster's device; None without one, or without memory."""
        if image.camera is None or caster is None:
            return None
        every = int(np.ceil((image.alpha.size / _MOST_PIXELS) ** 0.5))
        some = slice(None, None, every)
        part = replace(crop(image, some, some), camera=image.camera) if every > 1 else image
        with suppress(VolspecError):
            found = cls(every, image.camera, Reprojector(part, parts=1, compute=caster.compute))
            found.view(image.camera, scales)  # arranges the layers, and builds the program
            return found
        return None

    def shows(self, camera: Camera) -> bool:
        """Return True if a camera is near enough."""
        one, other = self.camera, camera
        if (one.fov_deg, one.height_mm) != (other.fov_deg, other.height_mm):
            return False
        cosine = float(one.frame()[2] @ other.frame()[2])
        ratio = one.distance_mm / other.distance_mm
        near = max(ratio, 1 / ratio) <= _MOST_RATIO
        return near and cosine >= np.cos(np.radians(_MOST_DEG))

    def view(self, camera: Camera, scales: Mapping[str, float]) -> CoefficientImage:
        """Return the picture of a camera, with the materials' opacities scaled."""
        return self._reprojector.view(camera, scales)


@dataclass(frozen=True, slots=True)
class RestJob:
    """Both eyes' pictures, or one with a focus, that are wanted once nothing moves."""

    image: CoefficientImage  # with layers
    look: Look


@dataclass(frozen=True, slots=True, eq=False)
class RestDone:
    """The pictures that were wanted, or an error's message."""

    job: RestJob
    ms: float
    pictures: RestPictures | None = None
    error: str = ""


class RestWorker(LatestWorker[RestJob, RestDone]):
    """Reprojects pictures with layers to both eyes, or focuses them, once nothing moves.

    It has a device of its own: the casts' would have two threads.
    """

    _name = "volspec-rest"
    _views: StereoViews | None = None

    def _results(self, job: RestJob) -> Iterator[RestDone]:
        done, started = RestDone(job, 0.0), time.perf_counter()
        try:
            images = self._images(job)
            packed = tuple(map(PackedLayers.of, images))
            done = replace(done, pictures=RestPictures(job.look.stereo, images, packed))
        except MemoryError:
            done = replace(done, error="no memory for both eyes' pictures, or a focus")
        except VolspecError as refused:
            done = replace(done, error=one_line(refused))
        yield replace(done, ms=1e3 * (time.perf_counter() - started))

    def _images(self, job: RestJob) -> tuple[CoefficientImage, ...]:
        look = job.look
        if look.stereo is None:
            return look.views(job.image)
        if self._views is None or self._views.image is not job.image:
            before = None if self._views is None else self._views.compute
            self._views = StereoViews(job.image, before)
        size = look.stereo.eye_size(job.image.size)
        return self._views.views(look.stereo, look.opacities, look.depth, size)
