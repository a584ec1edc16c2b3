"""A room behind the volume in other paints: without a cast, and solved in the background.

    CoefficientImage, Walls, SceneRoom -> [room] -> CoefficientImage -> pictures

A group of the walls shines on nothing of the volume, so that its channels are those of the walls,
as far as the volume lets them be seen.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from copy import copy
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from volspec.camera import Camera
from volspec.errors import VolspecError, one_line
from volspec.image import CoefficientImage
from volspec.raycast import OpacityCaster, SurfaceCaster, SurfaceImage
from volspec.relight import TexturePlanes
from volspec.viewer.work.background import LatestWorker

if TYPE_CHECKING:
    from volspec.room import Backdrop
    from volspec.scene import SceneRoom

Layers = NDArray[np.float32]


@dataclass(frozen=True, slots=True, eq=False)
class Walls:
    """Visible part of a room in a picture."""

    room: SceneRoom
    backdrop: Backdrop  # that has just seen it,
    camera: Camera  # from here
    transmission: NDArray[np.float32]  # (H, W) of the volume

    def layers(self, room: SceneRoom) -> Layers:
        """Return the picture's last channels (H, W, K) with the room in other paints."""
        height, width = self.transmission.shape
        layers = self.backdrop.repainted(room.response).layers(self.camera, (width, height))
        return self.transmission[..., None] * layers

    def repaint(self, image: CoefficientImage, room: SceneRoom) -> CoefficientImage:
        """Return the picture with the room in other paints."""
        coefficients, layers = image.coefficients.copy(), self.layers(room)
        coefficients[..., -layers.shape[2] :] = layers
        return replace(image, coefficients=coefficients, alpha=np.ones_like(image.alpha))


@dataclass(slots=True, eq=False)
class WhiteWalls(SurfaceCaster):
    """A room in which each channel of the walls is 1: a cast then has what the volume lets through.

    `replaced` gives the picture its walls.
    """

    room: SceneRoom
    backdrop: Backdrop
    channels: int  # of all walls
    _cast: tuple[Camera, OpacityCaster] | None = None

    def depths_mm(self, camera: Camera, size: tuple[int, int]) -> list[Layers]:
        """Return where rays end, as `volspec.raycast.surfaces.SurfaceCaster`."""
        return self.backdrop.depths_mm(camera, size)

    def pictures(
        self,
        camera: Camera,
        size: tuple[int, int],
        opacity: OpacityCaster,
        ends_mm: Sequence[Layers],
    ) -> list[SurfaceImage]:
        """Return ones."""
        self._cast = camera, opacity
        ones = np.ones((*size[::-1], self.channels), np.float32)
        return [SurfaceImage(ones, ones[..., 0])]

    def replaced(self, image: CoefficientImage, shadows: bool) -> tuple[CoefficientImage, Walls]:
        """Return the cast with the room's walls; without new ``shadows``, with those before."""
        assert self._cast is not None
        camera, opacity = self._cast
        transmission = np.array(image.coefficients[..., -1], np.float32)
        layers = self.backdrop.layers(camera, image.size, opacity if shadows else None)
        coefficients = image.coefficients.copy()
        coefficients[..., -self.channels :] = transmission[..., None] * layers
        # The next cast looks from elsewhere.
        walls = Walls(self.room, copy(self.backdrop), camera, transmission)
        return replace(image, coefficients=coefficients), walls


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
    packed: TexturePlanes | None = None
    error: str = ""


class RoomWorker(LatestWorker[RoomJob, RoomDone]):
    """Solves rooms in a thread, always the newest next."""

    _name = "volspec-room"
    _asked: tuple[SceneRoom, Walls | None] | None = None

    def want(self, job: RoomJob) -> None:
        """Request a job, unless the last one had the same room and walls."""
        if self._asked != (job.room, job.walls):
            self._asked = job.room, job.walls
            self.request(job)

    def _results(self, job: RoomJob) -> Iterator[RoomDone]:
        try:
            room = job.room.solved()
            done = RoomDone(job, room)
            if job.image is not None and job.walls is not None and not self._is_superseded():
                image = job.walls.repaint(job.image, room)
                walls = replace(job.walls, room=room)
                done = replace(done, image=image, walls=walls, packed=TexturePlanes.of(image))
            yield done
        except (VolspecError, MemoryError) as error:
            yield RoomDone(job, job.room, error=one_line(error) or "no memory for the room")
