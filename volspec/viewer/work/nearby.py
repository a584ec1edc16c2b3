"""Pictures of nearby views from the layers of the last cast, while the view is turned.

image with layers -> [nearby] -> CoefficientImage of another camera
"""

from __future__ import annotations

from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass, replace
from typing import Self

import numpy as np

from volspec.errors import VolspecError
from volspec.pipeline import Raycaster
from volspec.raycast import Camera, CoefficientImage
from volspec.raycast.reproject import Reprojector
from volspec.viewer.work.pictures import crop

# Cameras whose views differ by more than this angle, or this ratio of distances, are not near.
_MOST_DEG, _MOST_RATIO = 10.0, 1.3
# Pictures with more pixels are seen in every n-th row and column.
_MOST_PIXELS = 200_000


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
            found = cls(every, image.camera, Reprojector(part, compute=caster.compute))
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
