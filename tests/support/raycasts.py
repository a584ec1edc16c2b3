"""Volumes, transfer functions and views of casts with known answers, and the lengths of rays."""

import math
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from volspec._gpu.opencl import Compute
from volspec.basis import MaterialBasis
from volspec.camera import Camera
from volspec.large import Raycaster
from volspec.raycast import RaycastSpec, reference
from volspec.raycast.launch import packets
from volspec.raycast.launch.row_batches import Result
from volspec.raycast.launch.sampling import world_rays
from volspec.spectra import reflectance
from volspec.transfer import TransferFunction, TransferTable
from volspec.volume import Volume

FLAT = RaycastSpec(ambient=1, diffuse=0)
"""The plain reflectances."""
WHOLE = replace(FLAT, alpha_stop=1)
"""Rays that never end before the volume does."""


_TRIAL = packets._try  # of packets, as it is before any test replaces it


def carries_16_rays() -> bool:
    """Return True if the device carries packets of 16 rays; others may not compile them."""
    compute = Compute.open()
    if compute.info.vector_width < 16:
        return False
    return packets.Packet(16) in _TRIAL(compute.index, [packets.SAFE, packets.Packet(16)])


METALS = {name: reflectance(name) for name in ("copper", "gold")}
METAL_BASIS = MaterialBasis(METALS)


def metal_function(*points: tuple[float, float, str], **settings: Any) -> TransferFunction:
    """Opacities of copper and gold per millimetre, by value."""
    return TransferFunction(points, METALS, METAL_BASIS, **{"reference_step_mm": 1.0, **settings})


def even_gold(opacity: float) -> TransferFunction:
    """One opacity for the values 0 to 2."""
    return metal_function((0.0, opacity, "gold"), (2.0, opacity, "gold"))


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


def edit_exr(path: Path, change: Callable[[dict[str, Any], dict[str, Any]], object]) -> None:
    """Rewrite an OpenEXR file after ``change(header, channels)``."""
    import OpenEXR

    with OpenEXR.File(str(path), separate_channels=True) as file:
        header = dict(file.header())
        channels = {name: np.array(channel.pixels) for name, channel in file.channels().items()}
    header.pop("channels")
    change(header, channels)
    OpenEXR.File(header, channels).write(str(path))


def assert_matches_reference(
    volume: Volume,
    transfer: Any,
    camera: Camera,
    size: tuple[int, int],
    spec: RaycastSpec,
    lanes: int | None = None,
    tolerance: float = 2e-4,
) -> Result:
    """Compare channels, alpha, expected depth and first hits with the float64 reference's.

    ``tolerance``: float32 against float64, as the issue of fields asks for.
    """
    caster = Raycaster(volume, lanes=lanes)
    table = caster.bake(transfer)
    found = caster.cast(table, camera, size, spec)
    colour, alpha, depth, first = reference.cast(volume, table, camera, size, spec)
    assert alpha.max() > 0.9
    assert np.abs(found.coefficients - colour).max() < tolerance
    assert np.abs(found.alpha - alpha).max() < tolerance
    seen = alpha > 1e-3
    assert np.abs(found.depth_mm[seen] - depth[seen]).max() < tolerance * 40
    hit = np.isfinite(found.first_mm) & np.isfinite(first)
    assert (np.isfinite(found.first_mm) == np.isfinite(first)).mean() > 0.998
    assert np.median(np.abs(found.first_mm[hit] - first[hit])) < tolerance
    return found
