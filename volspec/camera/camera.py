"""Camera, and the rays of its pixels.

Axes: world millimetres, right-handed. Picture rows run downwards, the first row is the top.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, fields
from typing import Annotated

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from volspec._checks import Direction, unit
from volspec.errors import CameraError
from volspec.settings import Finite, Positive, Unit, Vector, settings
from volspec.volume import ONE_SLICE, Volume

# Components of a direction this near to 0 or ±1 are rounding errors.
_ASKEW = 1e-15


# Azimuth and elevation by name, in degrees, along the world's axes; `projection.side_deg` knows
# where a patient's left and right are.
SIDES = {
    "front": (0.0, 0.0),
    "right": (90.0, 0.0),
    "top": (0.0, 90.0),
    "isometric": (45.0, 35.264),
    "back": (180.0, 0.0),
    "left": (-90.0, 0.0),
    "bottom": (0.0, -90.0),
}
OF_PATIENT = {"anterior": "front", "posterior": "back", "superior": "top", "inferior": "bottom"}
"""Sides of a patient that have other names."""
FieldOfView = Annotated[float, Field(gt=0, lt=180), Unit("degrees")]


@settings(CameraError)
@dataclass(frozen=True, slots=True)
class Orbit:
    """A camera around a volume, or around a target."""

    azimuth_deg: Annotated[Finite, Unit("degrees")] = 30.0
    """Angle around ``up``: 0 at −y, 90 at +x."""
    elevation_deg: Annotated[Finite, Unit("degrees")] = 20.0
    """Angle towards ``up``; at ±90 the direction of azimuth is the picture's top."""
    zoom: Positive = 1.0
    """At 1 the sphere around the volume just fills the picture's height."""
    fov_deg: FieldOfView = 30.0
    """Vertical field of view."""
    orthographic: bool = False
    """Parallel rays."""
    roll_deg: Annotated[Finite, Unit("degrees")] = 0.0
    """Turns the picture clockwise."""
    target_mm: Annotated[Vector, Unit("mm")] | None = None
    """Point that the camera looks at; the volume's centre if left out."""
    up: Direction = (0.0, 0.0, 1.0)
    """Direction that points up in the picture."""

    def camera(self, volume: Volume) -> Camera:
        """Return the camera, placed for a volume."""
        return Camera.orbit(
            volume, **{field.name: getattr(self, field.name) for field in fields(Orbit)}
        )


@settings(CameraError)
@dataclass(frozen=True, slots=True)
class Camera:
    """A pinhole or, with ``height_mm``, an orthographic camera.

    Raises
    ------
    CameraError
        If a number is not finite, the position is the target, or the camera looks along ``up``.
    """

    position_mm: Annotated[Vector, Unit("mm")]
    """Its position."""
    target_mm: Annotated[Vector, Unit("mm")]
    """Point that the camera looks at."""
    up: Direction = (0.0, 0.0, 1.0)
    """Direction that points up in the picture; stored as a unit vector."""
    fov_deg: FieldOfView = 30.0
    """Vertical field of view of the pinhole."""
    height_mm: Annotated[Positive, Unit("mm")] | None = None
    """Height of the picture in the world; makes the camera orthographic."""

    def __post_init__(self) -> None:
        if not 0 < self.distance_mm < math.inf:
            raise CameraError(
                f"the camera is {self.distance_mm:g} mm from its target",
                "move one of them",
                code="range",
                field="position_mm",
                given=self.position_mm,
            )
        if np.linalg.norm(np.cross(self._forward, self.up)) < 1e-6:
            raise CameraError(
                "the camera looks along it",
                "give another",
                code="conflict",
                field="up",
                given=self.up,
            )

    @classmethod
    def orbit(
        cls,
        volume: Volume,
        *,
        azimuth_deg: float = 30.0,
        elevation_deg: float = 20.0,
        zoom: float = 1.0,
        fov_deg: float = 30.0,
        up: Vector = (0.0, 0.0, 1.0),
        target_mm: Vector | None = None,
        orthographic: bool = False,
        roll_deg: float = 0.0,
    ) -> Camera:
        """Look at a volume's centre, or a target, from a direction around its ``up`` axis.

        At zoom 1 the sphere around the volume just fills the picture's height. Azimuth 0
        is at −y (z up), +90 at +x; an elevation of ±90 looks along ``up`` and takes the
        direction of azimuth as the picture's top. ``roll_deg`` turns the picture clockwise.

        >>> import numpy as np
        >>> camera = Camera.orbit(Volume(np.zeros((3, 3, 3))), azimuth_deg=0, elevation_deg=0)
        >>> [round(x, 3) for x in camera.position_mm]
        [1.0, -5.692, 1.0]
        """
        orbit = Orbit(
            azimuth_deg, elevation_deg, zoom, fov_deg, orthographic, roll_deg, target_mm, up
        )
        volume = Volume.of(volume)
        radius = radius_mm(volume)
        target = np.array(
            volume.corners_mm.mean(axis=0) if orbit.target_mm is None else orbit.target_mm
        )
        side, front, axis = level_axes(orbit.up)
        azimuth, elevation = (
            math.radians(math.fmod(angle, 360)) for angle in (azimuth_deg, elevation_deg)
        )
        around = math.cos(azimuth) * front + math.sin(azimuth) * side
        direction = _snap_direction(math.cos(elevation) * around + math.sin(elevation) * axis)
        top = _snap_direction(math.cos(elevation) * axis - math.sin(elevation) * around)
        if roll_deg:
            roll = math.radians(math.fmod(roll_deg, 360))
            top = _snap_direction(math.cos(roll) * top + math.sin(roll) * np.cross(direction, top))
        distance = radius / math.sin(math.radians(fov_deg) / 2) / zoom
        if not math.isfinite(distance):
            raise CameraError(
                f"with zoom {zoom:g} the camera would be infinitely far away",
                "give more",
                code="range",
                field="Camera.fov_deg",
                given=fov_deg,
            )
        if np.array_equal(target + distance * direction, target):
            raise CameraError(
                f"at {zoom:g} the camera would be at its target",
                "give less",
                code="range",
                field="Camera.zoom",
                given=zoom,
            )
        return cls(
            position_mm=tuple(target + distance * direction),
            target_mm=tuple(target),
            up=tuple(top),
            fov_deg=fov_deg,
            height_mm=2 * radius / zoom if orthographic else None,
        )

    @property
    def distance_mm(self) -> float:
        """Distance from the camera to its target."""
        return math.dist(self.target_mm, self.position_mm)

    @property
    def _forward(self) -> NDArray[np.float64]:
        return np.array(unit(np.subtract(self.target_mm, self.position_mm)))

    def frame(self) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
        """Return the picture's unit vectors (right, up, forward) in the world."""
        forward = self._forward
        right = np.cross(forward, self.up)
        right /= np.linalg.norm(right)
        return right, np.cross(right, forward), forward

    def to_world(self, direction: Vector, frame: str = "camera") -> NDArray[np.float64]:
        """Return a direction in world axes, from camera axes (right, up, back) or the world's."""
        if frame == "world":
            return np.asarray(direction)
        right, up, forward = self.frame()
        return np.asarray(direction) @ np.stack([right, up, -forward])

    def place_mm(self, position: Vector, frame: str = "camera") -> NDArray[np.float64]:
        """Return in the world a position relative to the camera, or already in the world."""
        if frame == "world":
            return np.asarray(position)
        return np.asarray(self.position_mm) + self.to_world(position)

    def ray_field(self, width: float, height: float) -> RayField:
        """Return the rays of a picture of ``width`` by ``height`` pixels."""
        right, up, forward = self.frame()
        size_mm = self.height_mm or 2 * self.distance_mm * math.tan(math.radians(self.fov_deg) / 2)
        return RayField(
            target=np.asarray(self.target_mm),
            forward=forward,
            across=right * (size_mm / height),
            down=-up * (size_mm / height),
            middle=((width - 1) / 2, (height - 1) / 2),
            distance=self.distance_mm,
            perspective=self.height_mm is None,
        )


def level_axes(up: Vector) -> tuple[NDArray[np.float64], ...]:
    """Return the directions of azimuth 90 and 0 around ``up``, and the unit vector of ``up``.

    Azimuth 0, the front, is −y made perpendicular to up, or −x if up is ±y.
    """
    axis = np.array(up)
    front = np.array([0.0, -1.0, 0.0])
    front -= front.dot(axis) * axis
    if np.linalg.norm(front) < 1e-6:
        front = np.array([-1.0, 0.0, 0.0])
    front /= np.linalg.norm(front)
    return np.cross(axis, front), front, axis


def slice_view(volume: Volume) -> Orbit | None:
    """Return the view straight at a volume of one slice, upright; None of any other volume.

    The first row is at the top, except of slices along z. A patient is upright: axial slices are
    seen from the feet, coronal ones from the front, sagittal ones from the left.
    """
    if ONE_SLICE not in volume.metadata.assumed:
        return None
    steps = volume.world_from_index[:3, :3] / volume.spacing_mm
    axis = next(k for k in (2, 1, 0) if volume.shape_xyz[k] == 2)
    x, y, z = frame = np.eye(3) if volume.metadata.is_patient else steps.T
    plane = int(np.abs(frame @ steps[:, axis]).argmax())
    right, up = ((y, z), (x, z), (x, -y))[plane]
    normal = steps[:, axis]
    back = normal if normal @ np.cross(right, up) > 0 else -normal
    rows = np.delete(steps, axis, axis=1).T
    top = max((*rows, *-rows), key=lambda row: float(row @ up))
    side, front, _ = level_axes(tuple(top))
    azimuth = math.degrees(math.atan2(back @ side, back @ front))
    i, j, k = (top.round(12) + 0.0).tolist()
    return Orbit(round(azimuth, 9), 0.0, orthographic=True, up=(i, j, k))


def _snap_direction(direction: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return a unit vector without the 6e-17 that rounding leaves of cos(π/2).

    A ray tilted by that little leaves a face that an exactly parallel ray follows to its end.
    """
    near = np.rint(direction)
    return np.where(np.abs(direction - near) < _ASKEW, near, direction)


@dataclass(frozen=True, slots=True, eq=False)
class RayField:
    """Rays as offsets in the plane through the camera's target, perpendicular to its view.

    Pixel (x, y) passes the plane at ``target + r``, r = (x − x₀) across + (y − y₀) down, with
    direction ``forward * distance + r`` (perspective) or ``forward``. Anchoring rays at the
    target keeps float32 coordinates as small as the volume, however far away the camera is.
    """

    target: NDArray[np.float64]
    forward: NDArray[np.float64]
    across: NDArray[np.float64]
    down: NDArray[np.float64]
    middle: tuple[float, float]
    distance: float
    perspective: bool

    @property
    def pitch_mm(self) -> float:
        """Distance between pixels in the target's plane."""
        return float(np.linalg.norm(self.across))

    @property
    def nearness(self) -> float:
        """1 / distance, or 0 for parallel rays."""
        return 1 / self.distance if self.perspective else 0.0

    def cosines(self, width: int, height: int) -> NDArray[np.float64]:
        """Return (H, W) cosines of the rays' angles to the view."""
        u, v = np.arange(width) - self.middle[0], np.arange(height) - self.middle[1]
        slant = self.pitch_mm * self.nearness
        return np.asarray(1 / np.sqrt(1 + slant**2 * (u**2 + v[:, None] ** 2)))


def radius_mm(volume: Volume) -> float:
    """Return the radius of the sphere around a volume."""
    corners = volume.corners_mm
    return float(np.linalg.norm(corners - corners.mean(axis=0), axis=1).max()) or 1.0
