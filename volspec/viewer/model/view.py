"""The view of a state: an orbit around a target, its projection to the window, and the cube.

View -> [view] -> Camera -> raycast, handles, orientation cube, scale bar
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from volspec.errors import CameraError
from volspec.raycast import Camera
from volspec.raycast.camera import Orbit, radius_mm
from volspec.raycast.framing import ZOOMS
from volspec.settings import Vector, settings
from volspec.volume import Volume


@settings(CameraError)
@dataclass(frozen=True, slots=True)
class View(Orbit):
    """Camera orbit of a state."""

    @classmethod
    def of(cls, camera: Camera, volume: Volume) -> View:
        """Return the orbit with a camera's position and target, turning around its up vector."""
        away = np.subtract(camera.position_mm, camera.target_mm) / camera.distance_mm
        azimuth_deg, elevation_deg = orbit_deg(away, camera.up)
        sine = math.sin(math.radians(camera.fov_deg) / 2)
        tall = 2 * camera.distance_mm * sine if camera.height_mm is None else camera.height_mm
        return cls(
            azimuth_deg=azimuth_deg,
            elevation_deg=elevation_deg,
            zoom=clamp(2 * radius_mm(volume) / tall, *ZOOMS),
            fov_deg=camera.fov_deg,
            orthographic=camera.height_mm is not None,
            up=camera.up,
            target_mm=camera.target_mm,
        )


def orbit_axes(up: Vector) -> NDArray[np.float64]:
    """(3, 3) rows: right, up and front, from which an orbit's azimuth and elevation count."""
    axis = np.asarray(up) / np.linalg.norm(up)
    front = np.array([0.0, -1.0, 0.0]) - axis * np.dot([0.0, -1.0, 0.0], axis)
    if np.linalg.norm(front) < 1e-6:
        front = np.array([-1.0, 0.0, 0.0]) - axis * np.dot([-1.0, 0.0, 0.0], axis)
    front /= np.linalg.norm(front)
    return np.stack([np.cross(axis, front), axis, front])


def orbit_deg(away: NDArray[np.float64], up: Vector) -> tuple[float, float]:
    """Return azimuth and elevation of a unit vector from the target to the camera."""
    right, axis, front = orbit_axes(up)
    azimuth = math.atan2(float(away @ right), float(away @ front))
    return math.degrees(azimuth), math.degrees(math.asin(clamp(float(away @ axis), -1.0, 1.0)))


def vector(values: NDArray[np.float64]) -> Vector:
    """Return an array of three numbers as a tuple."""
    x, y, z = (float(value) for value in values)
    return x, y, z


def clamp(value: float, low: float, high: float) -> float:
    """Return the number in a range that is nearest to a value."""
    return min(max(value, low), high)


Place = tuple[float, float]
Area = tuple[float, float, float, float]
# The near plane, as a fraction of the target's distance.
NEAR = 1e-3
# A line foreshortened to this fraction counts as pointing at the camera.
_END_ON = 0.05


@dataclass(frozen=True, slots=True, eq=False)
class Projection:
    """Projection by a camera whose picture covers an area (x, y, width, height) of the window."""

    camera: Camera
    area: Area
    # Millimetres in the plane through the target that a pixel of the window covers.
    mm_per_px: float = field(init=False)
    # Columns: right and down in pixels, forward as a fraction of the target's distance.
    _window_from_world: NDArray[np.float64] = field(init=False)
    _middle: NDArray[np.float64] = field(init=False)

    def __post_init__(self) -> None:
        camera, (x, y, width, height) = self.camera, self.area
        half = camera.distance_mm * math.tan(math.radians(camera.fov_deg) / 2)
        mm_per_px = (camera.height_mm or 2 * half) / max(height, 1)
        right, up, forward = camera.frame()
        depth = forward / camera.distance_mm if camera.height_mm is None else np.zeros(3)
        columns = np.stack([right / mm_per_px, -up / mm_per_px, depth], axis=1)
        object.__setattr__(self, "mm_per_px", mm_per_px)
        object.__setattr__(self, "_window_from_world", columns)
        object.__setattr__(self, "_middle", np.array([x + width / 2, y + height / 2]))

    def _homogeneous(self, offsets: NDArray[np.float64], place: float) -> NDArray[np.float64]:
        """(…, 3) right, down, divisor of offsets from the target (directions: ``place`` 0)."""
        at = np.asarray(offsets @ self._window_from_world)
        at[..., 2] += place
        return at

    def to_window(self, points_mm: NDArray[np.float64]) -> NDArray[np.float64]:
        """(…, 3) x and y in the window, and depth relative to the target's; 1 if orthographic."""
        points = np.asarray(points_mm, dtype=np.float64)
        at = self._homogeneous(points - self.camera.target_mm, 1.0)
        divisor = np.where(np.abs(at[..., 2:]) < NEAR, NEAR, at[..., 2:])
        return np.concatenate([at[..., :2] / divisor + self._middle, at[..., 2:]], axis=-1)

    def segments(
        self, starts_mm: NDArray[np.float64], ends_mm: NDArray[np.float64]
    ) -> list[tuple[Place, Place] | None]:
        """Return the ends of (N, 3) lines in the window, clipped at the camera; None behind it."""
        ends = np.stack([starts_mm, ends_mm], axis=1)
        depth = self._homogeneous(ends - self.camera.target_mm, 1.0)[..., 2]
        for i in np.nonzero((depth.min(axis=1) < NEAR) & (depth.max(axis=1) > NEAR))[0]:
            back = int(depth[i].argmin())
            share = (NEAR - depth[i, back]) / (depth[i, 1 - back] - depth[i, back])
            # Slightly further, so that rounding leaves it in front.
            ends[i, back] += min(share * 1.001, 1.0) * (ends[i, 1 - back] - ends[i, back])
        in_front = depth.max(axis=1) > NEAR
        drawn = self.to_window(ends)[..., :2].tolist()
        return [
            ((x0, y0), (x1, y1)) if shown else None
            for ((x0, y0), (x1, y1)), shown in zip(drawn, in_front, strict=True)
        ]

    def nearest_on_line(
        self, anchor_mm: NDArray[np.float64], direction: NDArray[np.float64], place: Place
    ) -> float:
        """Return the point of a line whose projection is nearest to a place, in mm from an anchor.

        The anchor is in front of the camera, and the direction a unit vector; (3,) each.
        """
        start = self._homogeneous(anchor_mm - np.asarray(self.camera.target_mm), 1.0)
        change = self._homogeneous(np.asarray(direction), 0.0)
        depth = max(float(start[2]), NEAR)
        wanted = np.asarray(place) - self._middle - start[:2] / depth
        slope = (change[:2] - start[:2] / depth * change[2]) / depth
        length = float(np.linalg.norm(slope))
        if length * self.mm_per_px < _END_ON:
            # The line points at the camera: up in the window is away from it.
            return float(-wanted[1] * self.mm_per_px * depth)
        shift = float(wanted @ slope) / length
        # The projected line ends at its vanishing point, which it never reaches.
        divisor = length - shift * float(change[2]) / depth
        return shift / max(divisor, 0.05 * length)


# Half an edge of the cube, and its centre's distance from the picture's sides; pixels at 96 dpi.
HALF, CORNER = 21.0, 48.0


def face_normal(face: int) -> NDArray[np.float64]:
    """(3,) outer normal of a cube's face: 2 · axis against an axis of the world, + 1 along it."""
    axis, far = divmod(face, 2)
    normal = np.zeros(3)
    normal[axis] = 1.0 if far else -1.0
    return normal


def cube_faces(camera: Camera) -> list[tuple[int, NDArray[np.float64], float]]:
    """Return the visible faces of a cube with edges of 2: (number, corners, cosine to the eye).

    The (4, 2) corners are right and down of the cube's centre.
    """
    right, up, forward = camera.frame()
    found = []
    for face in range(6):
        normal = face_normal(face)
        towards = float(-normal @ forward)
        if towards < 1e-3:
            continue
        first, second = (np.eye(3)[other] for other in range(3) if other != face // 2)
        ring = [normal + a * first + b * second for a, b in ((-1, -1), (1, -1), (1, 1), (-1, 1))]
        corners = np.array(ring)
        found.append((face, np.stack([corners @ right, -(corners @ up)], axis=1), towards))
    return found


def cube_middle(projection: Projection, scale: float) -> Place:
    """Return the cube's centre in the window."""
    x, y, width, _ = projection.area
    return x + width - CORNER * scale, y + CORNER * scale


def face_at(projection: Projection, place: Place, scale: float) -> int | None:
    """Return the face at a place in the window, or None."""
    centre = cube_middle(projection, scale)
    at = np.subtract(place, centre) / (HALF * scale)
    if np.abs(at).max() > 2:
        return None
    for face, corners, _ in cube_faces(projection.camera):
        edges = np.roll(corners, -1, axis=0) - corners
        to = at - corners
        side = edges[:, 0] * to[:, 1] - edges[:, 1] * to[:, 0]
        if (side >= 0).all() or (side <= 0).all():
            return face
    return None
