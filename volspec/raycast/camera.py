"""Where a picture is taken from: the camera and the rays of its pixels.

Axes: world millimetres, right-handed. Picture rows run downwards, the first row is the top.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from volspec.errors import CameraError
from volspec.raycast.checks import Vector, number, positive, unit, unit_vector, vector
from volspec.volume import Volume

# Components of a direction so near to 0 or ±1 are rounding.
_ASKEW = 1e-15


@dataclass(frozen=True, slots=True)
class Camera:
    """A pinhole or, where ``height_mm`` is given, an orthographic camera.

    Parameters
    ----------
    position_mm, target_mm : (x, y, z)
        Where it stands and what it looks at.
    up : (x, y, z)
        A direction that shall point upwards in the picture; kept as a unit vector.
    fov_deg : float
        Vertical field of view of the pinhole, above 0 and below 180.
    height_mm : float, optional
        Height of the picture in the world; makes the camera orthographic.

    Raises
    ------
    CameraError
        If a number is not finite, the camera stands on its target, or looks along ``up``.
    """

    position_mm: Vector
    target_mm: Vector
    up: Vector = (0.0, 0.0, 1.0)
    fov_deg: float = 30.0
    height_mm: float | None = None

    def __post_init__(self) -> None:
        for name, taken in (("position_mm", vector), ("target_mm", vector), ("up", unit_vector)):
            given = getattr(self, name)
            object.__setattr__(self, name, taken(f"camera: {name}", given, CameraError))
        _check_fov(self.fov_deg)
        if self.height_mm is not None:
            positive("camera: height_mm", self.height_mm, CameraError)
        if self.distance_mm == 0:
            raise CameraError(f"camera: stands on its target {self.target_mm}; move one of them")
        if not math.isfinite(self.distance_mm):
            raise CameraError(
                f"camera: position_mm is {self.position_mm}, too far from its target "
                f"{self.target_mm}; move one of them"
            )
        if np.linalg.norm(np.cross(self._forward, self.up)) < 1e-6:
            raise CameraError(f"camera: looks along its up direction {self.up}; choose another up")

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
        stands at −y (z up), +90 at +x; an elevation of ±90 looks along ``up`` and takes the
        direction of azimuth as the picture's top. ``roll_deg`` turns the picture clockwise.

        >>> import numpy as np
        >>> camera = Camera.orbit(Volume(np.zeros((3, 3, 3))), azimuth_deg=0, elevation_deg=0)
        >>> [round(x, 3) for x in camera.position_mm]
        [1.0, -5.692, 1.0]
        """
        volume = Volume.of(volume)
        angles = {"azimuth_deg": azimuth_deg, "elevation_deg": elevation_deg, "roll_deg": roll_deg}
        for name, angle in angles.items():
            number(f"camera: {name}", angle, CameraError)
        positive("camera: zoom", zoom, CameraError)
        _check_fov(fov_deg)
        corners = volume.corners_mm
        centre = corners.mean(axis=0)
        radius = float(np.linalg.norm(corners - centre, axis=1).max()) or 1.0
        target = centre if target_mm is None else target_mm
        target = np.array(vector("camera: target_mm", target, CameraError))
        axis = np.array(unit_vector("camera: up", up, CameraError))
        # The front: −y, made perpendicular to up; where up is ±y, −x.
        front = np.array([0.0, -1.0, 0.0])
        front -= front.dot(axis) * axis
        if np.linalg.norm(front) < 1e-6:
            front = np.array([-1.0, 0.0, 0.0])
        front /= np.linalg.norm(front)
        side = np.cross(axis, front)
        azimuth, elevation = (
            math.radians(math.fmod(angle, 360)) for angle in (azimuth_deg, elevation_deg)
        )
        around = math.cos(azimuth) * front + math.sin(azimuth) * side
        direction = _snapped(math.cos(elevation) * around + math.sin(elevation) * axis)
        top = _snapped(math.cos(elevation) * axis - math.sin(elevation) * around)
        if roll_deg:
            roll = math.radians(math.fmod(roll_deg, 360))
            top = _snapped(math.cos(roll) * top + math.sin(roll) * np.cross(direction, top))
        distance = radius / math.sin(math.radians(fov_deg) / 2) / zoom
        if not math.isfinite(distance):
            raise CameraError(
                f"camera: fov_deg is {fov_deg} and zoom {zoom}; the camera would stand endlessly "
                "far away, give more"
            )
        if np.array_equal(target + distance * direction, target):
            raise CameraError(
                f"camera: zoom is {zoom:g}, too large: the camera would stand on its target; "
                "give less"
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
        """From the camera to its target."""
        return math.dist(self.target_mm, self.position_mm)

    @property
    def _forward(self) -> NDArray[np.float64]:
        return np.array(unit(np.subtract(self.target_mm, self.position_mm)))

    def frame(self) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
        """Unit vectors (right, up, forward) of the picture in the world."""
        forward = self._forward
        right = np.cross(forward, self.up)
        right /= np.linalg.norm(right)
        return right, np.cross(right, forward), forward

    def to_world(self, direction: Vector, frame: str = "camera") -> NDArray[np.float64]:
        """A direction in (right, up, back) of the camera, or the world's already, in the world."""
        if frame == "world":
            return np.asarray(direction)
        right, up, forward = self.frame()
        return np.asarray(direction) @ np.stack([right, up, -forward])

    def place_mm(self, position: Vector, frame: str = "camera") -> NDArray[np.float64]:
        """A place counted from the camera's, or the world's already, in the world."""
        if frame == "world":
            return np.asarray(position)
        return np.asarray(self.position_mm) + self.to_world(position)

    def ray_field(self, width: int, height: int) -> RayField:
        """The rays of a picture of so many pixels."""
        right, up, forward = self.frame()
        tall = self.height_mm or 2 * self.distance_mm * math.tan(math.radians(self.fov_deg) / 2)
        return RayField(
            target=np.asarray(self.target_mm),
            forward=forward,
            across=right * (tall / height),
            down=-up * (tall / height),
            middle=((width - 1) / 2, (height - 1) / 2),
            distance=self.distance_mm,
            perspective=self.height_mm is None,
        )


def _snapped(direction: NDArray[np.float64]) -> NDArray[np.float64]:
    """A unit vector without the 6e-17 that π/2 leaves of a cosine.

    A ray askew by so little leaves a face that one along it would see whole.
    """
    near = np.rint(direction)
    return np.where(np.abs(direction - near) < _ASKEW, near, direction)


def _check_fov(degrees: float) -> None:
    if not 0 < number("camera: fov_deg", degrees, CameraError) < 180:
        raise CameraError(f"camera: fov_deg is {degrees}; give degrees between 0 and 180")


@dataclass(frozen=True, slots=True, eq=False)
class RayField:
    """Rays as offsets in the plane through the camera's target, square to its view.

    Pixel (x, y) passes the plane at ``target + r``, r = (x − x₀) across + (y − y₀) down, with
    direction ``forward * distance + r`` (perspective) or ``forward``. Anchoring rays at the
    target keeps single-precision coordinates as small as the volume, however far the camera.
    """

    target: NDArray[np.float64]
    forward: NDArray[np.float64]
    across: NDArray[np.float64]
    down: NDArray[np.float64]
    middle: tuple[float, float]
    distance: float
    perspective: bool
