"""Projection of the world to a picture, and what its marks need: lengths and directions.

Camera, area -> [projection] -> pixels -> scale bar, orientation cube, handles, annotations
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from volspec.camera.camera import SIDES, Camera
from volspec.volume import Volume

Place = tuple[float, float]
Area = tuple[float, float, float, float]
# The near plane, as a fraction of the target's distance.
NEAR = 1e-3
_UNITS_MM = {
    "km": 1e6,
    "m": 1e3,
    "cm": 10.0,
    "mm": 1.0,
    "µm": 1e-3,
    "nm": 1e-6,
    "pm": 1e-9,
    "fm": 1e-12,
}
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
        # The picture may be shifted, or a part of a larger one.
        rays = camera.ray_field(width, max(height, 1))
        across, down = (vector / rays.pitch_mm**2 for vector in (rays.across, rays.down))
        columns = np.stack([across, down, rays.forward * rays.nearness], axis=1)
        object.__setattr__(self, "mm_per_px", rays.pitch_mm)
        object.__setattr__(self, "_window_from_world", columns)
        object.__setattr__(self, "_middle", np.add(rays.middle, (x + 0.5, y + 0.5)))

    def _homogeneous(self, offsets: NDArray[np.float64], place: float) -> NDArray[np.float64]:
        """(…, 3) right, down, divisor of offsets from the target (directions: ``place`` 0)."""
        # Quicker than BLAS, whose threads wait for each other over so small a matrix.
        xyw = np.einsum("...c,cd->...d", offsets, self._window_from_world)
        xyw[..., 2] += place
        return xyw

    def to_window(self, points_mm: NDArray[np.float64]) -> NDArray[np.float64]:
        """(…, 3) x and y in the window, and depth relative to the target's; 1 if orthographic."""
        points = np.asarray(points_mm, dtype=np.float64)
        xyw = self._homogeneous(points - self.camera.target_mm, 1.0)
        divisor = np.where(np.abs(xyw[..., 2:]) < NEAR, NEAR, xyw[..., 2:])
        return np.concatenate([xyw[..., :2] / divisor + self._middle, xyw[..., 2:]], axis=-1)

    def shows(self, points_mm: NDArray[np.float64]) -> bool:
        """Return False if a body with these corners (N, 3) is certainly out of the picture."""
        x, y, depth = self.to_window(points_mm).T
        if not (depth > NEAR).all():
            return bool((depth > NEAR).any())
        left, top, width, height = self.area
        across, down = x.max() >= left and x.min() <= left + width, y.max() >= top
        return bool(across and down and y.min() <= top + height)

    def segments(
        self, starts_mm: NDArray[np.float64], ends_mm: NDArray[np.float64]
    ) -> list[tuple[Place, Place] | None]:
        """Return the ends of (N, 3) lines in the window, clipped at the camera; None behind it."""
        ends = np.stack([starts_mm, ends_mm], axis=1)
        depth = self._homogeneous(ends - self.camera.target_mm, 1.0)[..., 2]
        for i in np.nonzero((depth.min(axis=1) < NEAR) & (depth.max(axis=1) > NEAR))[0]:
            back = int(depth[i].argmin())
            fraction = (NEAR - depth[i, back]) / (depth[i, 1 - back] - depth[i, back])
            # Slightly further, so that rounding leaves it in front.
            ends[i, back] += min(fraction * 1.001, 1.0) * (ends[i, 1 - back] - ends[i, back])
        in_front = depth.max(axis=1) > NEAR
        drawn = self.to_window(ends)[..., :2].tolist()
        return [
            ((x0, y0), (x1, y1)) if visible else None
            for ((x0, y0), (x1, y1)), visible in zip(drawn, in_front, strict=True)
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
        offset = np.asarray(place) - self._middle - start[:2] / depth
        slope = (change[:2] - start[:2] / depth * change[2]) / depth
        length = float(np.linalg.norm(slope))
        if length * self.mm_per_px < _END_ON:
            # The line points at the camera: up in the window is away from it.
            return float(-offset[1] * self.mm_per_px * depth)
        shift = float(offset @ slope) / length
        # The projected line ends at its vanishing point, which it never reaches.
        divisor = length - shift * float(change[2]) / depth
        return shift / max(divisor, 0.05 * length)


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
    faces = []
    for face in range(6):
        normal = face_normal(face)
        towards = float(-normal @ forward)
        if towards < 1e-3:
            continue
        first, second = (np.eye(3)[other] for other in range(3) if other != face // 2)
        ring = [normal + a * first + b * second for a, b in ((-1, -1), (1, -1), (1, 1), (-1, 1))]
        corners = np.array(ring)
        faces.append((face, np.stack([corners @ right, -(corners @ up)], axis=1), towards))
    return faces


# Directions of the negative and positive world axes in ITK's LPS frame (docs/conventions.md).
PATIENT = (("R", "L"), ("A", "P"), ("I", "S"))
AXES = (("-x", "+x"), ("-y", "+y"), ("-z", "+z"))


def is_patient(volume: Volume, override: bool | None) -> bool:
    """Return True if directions are a patient's: as chosen, or as the volume's file states."""
    return volume.metadata.is_patient if override is None else override


def place_unit(volume: Volume, override: bool | None) -> str:
    """Return the unit of coordinates; a patient's are in the frame LPS."""
    return "mm LPS" if is_patient(volume, override) else "mm"


def place_text(volume: Volume, place_mm: NDArray[np.float64]) -> str:
    """Return coordinates as text, of which those of neighbouring voxels differ."""
    decimals = max(1, -math.floor(math.log10(min(volume.spacing_mm))))
    return "  ".join(f"{mm:.{decimals}f}" for mm in place_mm)


def side_deg(side: str, volume: Volume, override: bool | None = None) -> tuple[float, float]:
    """Return azimuth and elevation of the camera at a side; a patient's left is their own.

    ``override`` is as for `is_patient`.

    >>> volume = Volume(np.zeros((3, 3, 3)))
    >>> side_deg("left", volume), side_deg("left", volume, True)
    ((-90.0, 0.0), (90.0, 0.0))
    """
    azimuth, elevation = SIDES[side]
    # In LPS, +x is the patient's left.
    mirrored = side in ("left", "right") and is_patient(volume, override)
    return -azimuth if mirrored else azimuth, elevation


def cube_label(face: int, patient: bool) -> str:
    """Return the direction that is written on a face."""
    return (PATIENT if patient else AXES)[face // 2][face % 2]


def length_mm(mm_per_px: float, longest_px: float) -> float:
    """Return the greatest of 1, 2, 5, 10, … mm that is at most this many pixels long.

    >>> length_mm(0.5, 130), length_mm(0.001, 130)
    (50.0, 0.1)
    """
    longest_mm = mm_per_px * longest_px
    decade = math.floor(math.log10(longest_mm))
    lengths = [float(f"{step}e{power}") for power in (decade - 1, decade) for step in (1, 2, 5)]
    return max(length for length in lengths if length <= longest_mm * (1 + 1e-9))


def length_text(mm: float, digits: int = 6) -> str:
    """Return a length in the unit that suits it, from fm to km.

    >>> [length_text(mm) for mm in (2e-5, 0.02, 5.0, 50.0, 2000.0, 1e6, 5e12)]
    ['20 nm', '20 µm', '5 mm', '5 cm', '2 m', '1 km', '5,000,000 km']
    """
    suiting = (unit for unit, size in _UNITS_MM.items() if mm > 0.999999 * size)
    unit = next(suiting, "fm")
    number = float(f"{mm / _UNITS_MM[unit]:.{digits}g}")
    return f"{number:,.0f} {unit}" if number >= 10_000.0 else f"{number:.{digits}g} {unit}"


def scale_text(mm: float, volume: Volume) -> str:
    """Return the text of a scale bar: its length, and if the volume's lengths are assumed."""
    return length_text(mm) + " (assumed)" * bool(volume.metadata.assumed_lengths)
