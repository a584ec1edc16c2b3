"""The view of a state: an orbit around a target.

View -> [view] -> Camera -> raycast
"""

from __future__ import annotations

import math
from dataclasses import dataclass, fields
from typing import Any

import numpy as np
from numpy.typing import NDArray

from volspec.raycast import Camera
from volspec.volume import Volume

Vector = tuple[float, float, float]

ZOOMS = (0.05, 200.0)


@dataclass(frozen=True, slots=True)
class View:
    """An orbit around a target: the arguments of `Camera.orbit`."""

    azimuth_deg: float = 30.0
    elevation_deg: float = 20.0
    zoom: float = 1.0  # 1 fits the volume's sphere into the picture's height
    fov_deg: float = 30.0
    orthographic: bool = False
    up: Vector = (0.0, 0.0, 1.0)  # the axis to turn around
    target_mm: Vector | None = None  # None is the volume's centre
    roll_deg: float = 0.0  # of the picture, clockwise

    @classmethod
    def of(cls, camera: Camera, volume: Volume) -> View:
        """Return the orbit with a camera's position and target, turning around its up."""
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

    def camera(self, volume: Volume) -> Camera:
        """Return the view's camera."""
        given: dict[str, Any] = {each.name: getattr(self, each.name) for each in fields(self)}
        return Camera.orbit(volume, **given)


def orbit_deg(away: NDArray[np.float64], up: Vector) -> tuple[float, float]:
    """Return azimuth and elevation of a unit vector from the target to the camera."""
    axis = np.asarray(up) / np.linalg.norm(up)
    front = np.array([0.0, -1.0, 0.0]) - axis * np.dot([0.0, -1.0, 0.0], axis)
    if np.linalg.norm(front) < 1e-6:
        front = np.array([-1.0, 0.0, 0.0]) - axis * np.dot([-1.0, 0.0, 0.0], axis)
    front /= np.linalg.norm(front)
    azimuth = math.atan2(float(away @ np.cross(axis, front)), float(away @ front))
    return math.degrees(azimuth), math.degrees(math.asin(clamp(float(away @ axis), -1.0, 1.0)))


def radius_mm(volume: Volume) -> float:
    """Return the radius of the sphere around a volume."""
    corners = volume.corners_mm
    return float(np.linalg.norm(corners - corners.mean(axis=0), axis=1).max()) or 1.0


def vector(values: NDArray[np.float64]) -> Vector:
    """Return an array of three numbers as a tuple."""
    x, y, z = (float(value) for value in values)
    return x, y, z


def clamp(value: float, low: float, high: float) -> float:
    """Return the number of a range that is nearest to a value."""
    return min(max(value, low), high)
