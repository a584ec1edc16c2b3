"""A room behind the volume in other paints: without a cast, and solved in the background.

    CoefficientImage, Walls, SceneRoom -> [room] -> CoefficientImage -> pictures

A group of the walls shines on nothing of the volume, so that its channels are those of the walls,
as far as the volume lets them be seen.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from volspec.errors import VolspecError, one_line
from volspec.raycast import Camera, CoefficientImage
from volspec.relight.layers import PackedLayers
from volspec.viewer.work.background import LatestWorker

if TYPE_CHECKING:
    from volspec.scene.backdrop import Backdrop
    from volspec.scene.room import SceneRoom

Layers = NDArray[np.float32]


@dataclass(frozen=True, slots=True, eq=False)
class Walls:
    """Visible part of a room in a picture."""

    room: SceneRoom
    backdrop: Backdrop
    camera: Camera
    transmission: NDArray[np.float32]  # (H, W) of the volume
    layers: Layers  # (H, W, K) without the volume

    def repainted(self, room: SceneRoom) -> Walls:
        """Return the walls of the same room in other paints."""
        height, width = self.transmission.shape
        backdrop = self.backdrop.repainted(room.response)
        layers = backdrop(self.camera, (width, height))
        return replace(self, room=room, backdrop=backdrop, layers=layers)

    def behind(self, image: CoefficientImage) -> CoefficientImage:
        """Return the picture with these walls, which may replace others."""
        found = image.coefficients.copy()
        self.put(found)
        return replace(image, coefficients=found, alpha=np.ones_like(image.alpha))

    def put(self, coefficients: Layers, every: int = 1) -> None:
        """Write the walls into a picture's last channels, of every n-th row and column."""
        part = slice(None, None, every), slice(None, None, every)
        shown = self.transmission[part][..., None] * self.layers[part]
        coefficients[..., -shown.shape[2] :] = shown


@dataclass(frozen=True, slots=True, eq=False)
class RoomJob:
    """A room to solve, and the picture that it is to be seen in."""

    room: SceneRoom
    image: CoefficientImage | None = None
    walls: Walls | None = None


@dataclass(frozen=True, slots=True, eq=False)
class RoomDone:
    """The solved room and its picture; or the error's message."""

    job: RoomJob
    room: SceneRoom
    image: CoefficientImage | None = None
    walls: Walls | None = None
    packed: PackedLayers | None = None
    error: str = ""


class RoomWorker(LatestWorker[RoomJob, RoomDone]):
    """Solves rooms in a thread, always the newest next."""

    _name = "volspec-room"

    def __init__(self, wake: Callable[[], object]) -> None:
        super().__init__(wake)

    def _results(self, job: RoomJob) -> Iterator[RoomDone]:
        try:
            room = job.room.solved()
            done = RoomDone(job, room)
            if job.image is not None and job.walls is not None and not self._is_superseded():
                walls = job.walls.repainted(room)
                image = walls.behind(job.image)
                done = replace(done, image=image, walls=walls, packed=PackedLayers.of(image))
            yield done
        except (VolspecError, MemoryError) as error:
            yield RoomDone(job, job.room, error=one_line(error) or "no memory for the room")
