"""The view: an orbit around the volume, and what drags and keys make of it.

View -> [camera] -> Camera -> raycast
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from volspec.raycast import Camera
from volspec.volume import Volume

Vector = tuple[float, float, float]

# A drag over the picture's height turns by this much.
TURN_DEG = 180.0
ZOOMS = (0.05, 200.0)
FOVS_DEG = (5.0, 120.0)
# What a drag over the picture's height multiplies the zoom by: e to this.
ZOOM_RATE = 2.0
# What a notch of the wheel multiplies the field of view by: e to this.
FOV_RATE = 0.06
_POLE_DEG = 89.9
# So many radii from the centre a target may be panned.
_FURTHEST = 4.0
# Where one looks from, in degrees of azimuth and elevation.
VIEWS = {
    "front": (0.0, 0.0),
    "back": (180.0, 0.0),
    "right": (90.0, 0.0),
    "left": (-90.0, 0.0),
    "top": (0.0, 90.0),
    "bottom": (0.0, -90.0),
    "isometric": (45.0, 35.264),
}


@dataclass(frozen=True, slots=True)
class View:
    """An orbit around a target, as `Camera.orbit` takes it.

    Parameters
    ----------
    azimuth_deg, elevation_deg : float
    zoom : float
        1 fits the volume's sphere into the picture's height.
    fov_deg : float
    orthographic : bool
    up : (x, y, z)
        The axis to turn around.
    target_mm : (x, y, z), optional
        None is the volume's centre.
    roll_deg : float
        By how much the picture is turned clockwise.
    """

    azimuth_deg: float = 30.0
    elevation_deg: float = 20.0
    zoom: float = 1.0
    fov_deg: float = 30.0
    orthographic: bool = False
    up: Vector = (0.0, 0.0, 1.0)
    target_mm: Vector | None = None
    roll_deg: float = 0.0

    @classmethod
    def of(cls, camera: Camera, volume: Volume) -> View:
        """The orbit that stands where a camera does, turning around its up."""
        away = np.subtract(camera.position_mm, camera.target_mm) / camera.distance_mm
        azimuth_deg, elevation_deg = orbit_deg(away, camera.up)
        sine = math.sin(math.radians(camera.fov_deg) / 2)
        tall = 2 * camera.distance_mm * sine if camera.height_mm is None else camera.height_mm
        return cls(
            azimuth_deg=azimuth_deg,
            elevation_deg=elevation_deg,
            zoom=_clamped(2 * radius_mm(volume) / tall, *ZOOMS),
            fov_deg=camera.fov_deg,
            orthographic=camera.height_mm is not None,
            up=camera.up,
            target_mm=camera.target_mm,
        )

    def camera(self, volume: Volume) -> Camera:
        """The camera that stands there."""
        return Camera.orbit(
            volume,
            azimuth_deg=self.azimuth_deg,
            elevation_deg=self.elevation_deg,
            zoom=self.zoom,
            fov_deg=self.fov_deg,
            up=self.up,
            target_mm=self.target_mm,
            orthographic=self.orthographic,
            roll_deg=self.roll_deg,
        )

    def orbited(self, right: float, down: float) -> View:
        """Turned by a drag; shares of the picture's height."""
        # A picture that is rolled follows the mouse all the same.
        cosine, sine = (f(math.radians(self.roll_deg)) for f in (math.cos, math.sin))
        right, down = cosine * right + sine * down, cosine * down - sine * right
        return replace(
            self,
            azimuth_deg=math.remainder(self.azimuth_deg - TURN_DEG * right, 360.0),
            elevation_deg=_clamped(self.elevation_deg + TURN_DEG * down, -90.0, 90.0),
        )

    def zoomed(self, nearer: float) -> View:
        """Nearer by a drag; shares of the picture's height."""
        factor = math.exp(_clamped(ZOOM_RATE * nearer, -10.0, 10.0))
        return replace(self, zoom=_clamped(self.zoom * factor, *ZOOMS))

    def panned(self, right: float, down: float, volume: Volume) -> View:
        """The picture moved by a drag; shares of its height."""
        camera = self.camera(volume)
        across, upwards, _ = camera.frame()
        half = camera.distance_mm * math.tan(math.radians(camera.fov_deg) / 2)
        tall = camera.height_mm or 2 * half
        centre = volume.corners_mm.mean(axis=0)
        wanted = np.asarray(camera.target_mm) + tall * (down * upwards - right * across)
        far = wanted - centre
        most = _FURTHEST * radius_mm(volume)
        far *= min(1.0, most / max(float(np.linalg.norm(far)), 1e-12))
        return replace(self, target_mm=vector(centre + far))

    def rolled(self, degrees: float) -> View:
        """The picture turned clockwise."""
        return replace(self, roll_deg=math.remainder(self.roll_deg + degrees, 360.0))

    def widened(self, notches: float) -> View:
        """Another field of view; the target keeps its size."""
        factor = math.exp(_clamped(FOV_RATE * notches, -5.0, 5.0))
        return replace(self, fov_deg=_clamped(self.fov_deg * factor, *FOVS_DEG))

    def from_side(self, key: str) -> View:
        """One of `VIEWS`."""
        azimuth, elevation = VIEWS[key]
        return replace(self, azimuth_deg=azimuth, elevation_deg=elevation, roll_deg=0.0)

    def looking_from(self, direction: Vector) -> View:
        """The target seen from a direction of the world."""
        azimuth, elevation = orbit_deg(np.asarray(direction, dtype=np.float64), self.up)
        # Straight from above or below any azimuth will do: the front stays at the bottom.
        azimuth = 0.0 if abs(elevation) > _POLE_DEG else azimuth
        return replace(self, azimuth_deg=azimuth, elevation_deg=elevation, roll_deg=0.0)


def orbit_deg(away: NDArray[np.float64], up: Vector) -> tuple[float, float]:
    """Azimuth and elevation of a unit vector from the target to the camera."""
    axis = np.asarray(up) / np.linalg.norm(up)
    front = np.array([0.0, -1.0, 0.0]) - axis * np.dot([0.0, -1.0, 0.0], axis)
    if np.linalg.norm(front) < 1e-6:
        front = np.array([-1.0, 0.0, 0.0]) - axis * np.dot([-1.0, 0.0, 0.0], axis)
    front /= np.linalg.norm(front)
    azimuth = math.atan2(float(away @ np.cross(axis, front)), float(away @ front))
    return math.degrees(azimuth), math.degrees(math.asin(_clamped(float(away @ axis), -1.0, 1.0)))


def radius_mm(volume: Volume) -> float:
    """Of the sphere around a volume."""
    corners = volume.corners_mm
    return float(np.linalg.norm(corners - corners.mean(axis=0), axis=1).max()) or 1.0


def zoom_within(zoom: float) -> float:
    """A zoom that views may have."""
    return _clamped(zoom, *ZOOMS)


def vector(values: NDArray[np.float64]) -> Vector:
    """Three numbers as a tuple."""
    x, y, z = (float(value) for value in values)
    return x, y, z


def _clamped(value: float, low: float, high: float) -> float:
    return min(max(value, low), high)
