"""A picture to be cast, and the result of a pass of it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from volspec.camera import Camera
from volspec.image import CoefficientImage
from volspec.raycast import RaycastSpec
from volspec.raycast.pace import Pass
from volspec.relight.layers import PackedLayers
from volspec.relight.recompose import PackedOpacity
from volspec.scene.specs import MeshSpec
from volspec.transfer import Transfers
from volspec.viewer.model.document import Document
from volspec.viewer.work.nearby import NearbyViews
from volspec.viewer.work.room import Walls

if TYPE_CHECKING:
    from volspec.scene.room import SceneRoom


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
    made: Pass
    ms: float
    image: CoefficientImage | None = None
    error: str = ""
    packed: PackedLayers | None = None
    opacity: PackedOpacity | None = None  # of an image with layers
    walls: Walls | None = None  # of a room behind the volume
    nearby: NearbyViews | None = None  # of an image with layers
