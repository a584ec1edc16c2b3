"""Volumes, transfer functions and views of casts with known answers, and the lengths of rays."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from volspec.raycast import Camera, RaycastSpec
from volspec.raycast.sampling import world_rays
from volspec.transfer import TransferTable
from volspec.volume import Volume

FLAT = RaycastSpec(ambient=1, diffuse=0)
"""The plain reflectances."""
WHOLE = replace(FLAT, alpha_stop=1)
"""Rays that never end before the volume does."""


def cube(count: int, value: float = 1.0) -> Volume:
    """``count`` voxels along each side, of one value, 1 mm apart."""
    return Volume(np.full((count,) * 3, value, np.float32))


def oblique_world() -> np.ndarray:
    """A rotated lattice of unequal spacing."""
    rng = np.random.default_rng(5)
    world = np.eye(4)
    world[:3, :3] = np.linalg.qr(rng.normal(size=(3, 3)))[0] @ np.diag([1.0, 1.7, 2.5])
    world[:3, 3] = 40, -10, 5
    return world


def fog(
    opacity: float,
    channels: int = 1,
    share: float = 1.0,
    *,
    reference_step_mm: float = 1.0,
    filters: np.ndarray | None = None,
) -> TransferTable:
    """One opacity and colour for all values, 0 to 2."""
    if filters is not None:
        channels = filters.shape[1]
    weights = np.full((8, channels), share)
    return TransferTable(
        (0.0, 2.0), np.full(8, opacity), weights, reference_step_mm, filters=filters
    )


def ramp(top: float, high: float = 1.0, channels: int = 2, entries: int = 256) -> TransferTable:
    """Opacity that rises from 0 to ``top``; white."""
    opacity = np.linspace(0, top, entries)
    return TransferTable((0.0, high), opacity, np.ones((entries, channels)), 1.0)


def soft_ball(side: int) -> Volume:
    """A ball: 1.2 less the distance from the middle by half of the side, 0 to 1."""
    z, y, x = np.mgrid[-1 : 1 : side * 1j, -1 : 1 : side * 1j, -1 : 1 : side * 1j]
    return Volume(np.clip(1.2 - np.sqrt(x**2 + y**2 + z**2), 0, 1).astype(np.float32))


def labelled(opacity: list[float], materials: np.ndarray | None = None) -> TransferTable:
    """Opacities of labels 0, 1, …; a material for each."""
    count = len(opacity)
    weights = np.eye(count) if materials is None else materials
    return TransferTable((0.0, count - 1.0), np.array(opacity), weights, 1.0, labels=True)


def along_z(volume: Volume, height_mm: float = 4.0) -> Camera:
    """Parallel rays along z, through the middle."""
    x, y, z = (np.array(volume.shape_xyz) - 1) / 2
    return Camera((x, y, z + 60), (x, y, z), up=(0, 1, 0), height_mm=height_mm)


def turned(volume: Volume, azimuth_deg: float, elevation_deg: float, **more: object) -> Camera:
    """The camera of an orbit."""
    return Camera.orbit(volume, azimuth_deg=azimuth_deg, elevation_deg=elevation_deg, **more)


def chords_mm(volume: Volume, camera: Camera, size: tuple[int, int]) -> np.ndarray:
    """(H, W) length of each pixel's ray inside an upright volume's box, by slabs in the world."""
    origin, direction = world_rays(camera, *size)
    low, high = volume.corners_mm.min(axis=0), volume.corners_mm.max(axis=0)
    with np.errstate(divide="ignore"):
        a, b = (low - origin) / direction, (high - origin) / direction
    chord = np.maximum(a, b).min(axis=1) - np.maximum(np.minimum(a, b).max(axis=1), 0)
    return np.maximum(chord, 0).reshape(size[1], size[0])


def leaned(camera: Camera, across: float, down: float) -> Camera:
    """The camera that sees what is in front of its target move right and down, in degrees."""
    right, above, ahead = camera.frame()
    a, b = math.radians(across), math.radians(down)
    # Rows of the matrix that takes the old camera's coordinates to the new one's.
    first = np.array([[math.cos(a), 0, -math.sin(a)], [0, 1, 0], [math.sin(a), 0, math.cos(a)]])
    second = np.array([[1, 0, 0], [0, math.cos(b), -math.sin(b)], [0, math.sin(b), math.cos(b)]])
    axes = second @ first @ np.stack([right, -above, ahead])
    position = np.asarray(camera.target_mm) - camera.distance_mm * axes[2]
    return replace(camera, position_mm=tuple(position), up=tuple(-axes[1]))
