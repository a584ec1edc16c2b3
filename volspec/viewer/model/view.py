"""The view of a state: an orbit around a target, and the place of the orientation cube.

View -> [view] -> Camera -> raycast, projection
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from volspec.camera import Camera, Orbit, Place, Projection, cube_faces, radius_mm
from volspec.errors import CameraError
from volspec.raycast import framing
from volspec.settings import Vector, settings
from volspec.volume import Volume


@settings(CameraError)
@dataclass(frozen=True, slots=True)
class View(Orbit):
    """Camera orbit of a state."""

    @classmethod
    def of(cls, camera: Camera, volume: Volume) -> View:
        """Return the orbit with a camera's position and target, turning around its up vector."""
        direction = np.subtract(camera.position_mm, camera.target_mm) / camera.distance_mm
        azimuth_deg, elevation_deg = orbit_deg(direction, camera.up)
        sine = math.sin(math.radians(camera.fov_deg) / 2)
        height_mm = 2 * camera.distance_mm * sine if camera.height_mm is None else camera.height_mm
        return cls(
            azimuth_deg=azimuth_deg,
            elevation_deg=elevation_deg,
            zoom=clamp(2 * radius_mm(volume) / height_mm, *framing.ZOOMS),
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


def orbit_deg(direction: NDArray[np.float64], up: Vector) -> tuple[float, float]:
    """Return azimuth and elevation of a unit vector from the target to the camera."""
    right, axis, front = orbit_axes(up)
    azimuth = math.atan2(float(direction @ right), float(direction @ front))
    return math.degrees(azimuth), math.degrees(math.asin(clamp(float(direction @ axis), -1.0, 1.0)))


def vector(values: NDArray[np.float64]) -> Vector:
    """Return an array of three numbers as a tuple."""
    x, y, z = (float(value) for value in values)
    return x, y, z


def clamp(value: float, low: float, high: float) -> float:
    """Return the number in a range that is nearest to a value."""
    return min(max(value, low), high)


# Half an edge of the cube, and its centre's distance from the picture's sides; pixels at 96 dpi.
HALF, CORNER = 21.0, 48.0


def cube_middle(projection: Projection, scale: float) -> Place:
    """Return the cube's centre in the window."""
    x, y, width, _ = projection.area
    return x + width - CORNER * scale, y + CORNER * scale


def face_at(projection: Projection, place: Place, scale: float) -> int | None:
    """Return the face at a place in the window, or None."""
    centre = cube_middle(projection, scale)
    offset = np.subtract(place, centre) / (HALF * scale)
    if np.abs(offset).max() > 2:
        return None
    for face, corners, _ in cube_faces(projection.camera):
        edges = np.roll(corners, -1, axis=0) - corners
        to = offset - corners
        side = edges[:, 0] * to[:, 1] - edges[:, 1] * to[:, 0]
        if (side >= 0).all() or (side <= 0).all():
            return face
    return None
