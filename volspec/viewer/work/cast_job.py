"""A picture to be cast, the result of a pass of it, and views nearby without another cast."""

from __future__ import annotations

from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Self

import numpy as np

from volspec.camera import Camera
from volspec.errors import VolspecError
from volspec.image import CoefficientImage, Reprojector
from volspec.pipeline import Raycaster
from volspec.raycast import Pass, RaycastSpec
from volspec.relight import PackedOpacity, TexturePlanes
from volspec.scene.tables import MeshSpec
from volspec.transfer import Transfers
from volspec.viewer.model.document import Document
from volspec.viewer.work.pictures import crop
from volspec.viewer.work.room import Walls

if TYPE_CHECKING:
    from volspec.scene import SceneRoom

# Cameras whose views differ by more than this angle, or this ratio of distances, are not near.
_MAX_DEG, _MAX_RATIO = 10.0, 1.3
# Pictures with more pixels are seen in every n-th row and column.
_MAX_PIXELS = 120_000


@dataclass(frozen=True, slots=True, eq=False)
class NearbyViews:
    """Views near that of a cast with layers, in every n-th row and column."""

    stride: int
    camera: Camera
    _reprojector: Reprojector

    @classmethod
    def of(
        cls, image: CoefficientImage, caster: Raycaster | None, scales: Mapping[str, float]
    ) -> Self | None:
        """Prepare the layers on a caster's device; None without one, or without memory."""
        if image.camera is None or caster is None:
            return None
        stride = int(np.ceil((image.alpha.size / _MAX_PIXELS) ** 0.5))
        some = slice(None, None, stride)
        part = replace(crop(image, some, some), camera=image.camera) if stride > 1 else image
        with suppress(VolspecError):
            views = cls(stride, image.camera, Reprojector(part, parts=1, compute=caster.compute))
            views.view(image.camera, scales)  # arranges the layers, and builds the program
            return views
        return None

    def shows(self, camera: Camera) -> bool:
        """Return True if a camera is near enough."""
        one, other = self.camera, camera
        if (one.fov_deg, one.height_mm) != (other.fov_deg, other.height_mm):
            return False
        cosine = float(one.frame()[2] @ other.frame()[2])
        ratio = one.distance_mm / other.distance_mm
        near = max(ratio, 1 / ratio) <= _MAX_RATIO
        return near and cosine >= np.cos(np.radians(_MAX_DEG))

    def view(self, camera: Camera, scales: Mapping[str, float]) -> CoefficientImage:
        """Return the picture of a camera, with the materials' opacities scaled."""
        return self._reprojector.view(camera, scales)


@dataclass(frozen=True, slots=True, eq=False)
class CastJob:
    """A picture to be cast."""

    document: Document
    transfer: Transfers
    camera: Camera
    shading: RaycastSpec
    size: tuple[int, int]  # width and height of the whole picture
    passes: tuple[Pass, ...]
    room: SceneRoom | None = None  # to be seen behind the volume
    meshes: tuple[MeshSpec, ...] = ()  # to be seen in and around it
    nearby: NearbyViews | None = None  # to be seen first

    @property
    def scales(self) -> dict[str, float]:
        """Scales of the opacities."""
        return dict(self.shading.opacities)


@dataclass(frozen=True, slots=True, eq=False)
class CastDone:
    """Result of a pass: an image, an error's message, or neither if it was cancelled."""

    job: CastJob
    cast_pass: Pass
    ms: float
    image: CoefficientImage | None = None
    error: str = ""
    packed: TexturePlanes | None = None
    opacity: PackedOpacity | None = None  # of an image with layers
    walls: Walls | None = None  # of a room behind the volume
    nearby: NearbyViews | None = None  # of an image with layers
