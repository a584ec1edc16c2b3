"""Frame the visible part of a volume: the zoom and target that fill a picture with it.

Volume, Transfers, RaycastSpec -> [framing] -> Orbit
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import replace
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from volspec.camera import Orbit, radius_mm
from volspec.raycast.launch.light_volume import extinction_per_mm
from volspec.raycast.launch.masks import MaskLattice
from volspec.raycast.spec import RaycastSpec
from volspec.transfer import SurfaceTable, Table, Transfers, bake_for_volume
from volspec.volume import Volume
from volspec.volume.levels import step_along

Array = NDArray[np.float64]
# Opacities below this fraction of the greatest count as haze, unless they add up to this opacity
# along an axis.
_HAZE, _SEEN = 0.02, 0.25
# Fraction of the picture's sides that a fitted view fills.
_FILLS = 0.85
# Radii of the volume that points are at least apart, to be framed.
_MIN_FRAMED = 1e-12
_ITERATIONS = 4
Bounds = tuple[float, float]
Crop = tuple[Bounds, Bounds, Bounds]
OrbitT = TypeVar("OrbitT", bound=Orbit)
ZOOMS = (0.05, 200.0)
# The fewest voxels that a crop leaves along each axis.
MIN_CROP = 1.0


def fit_view(
    view: OrbitT, volume: Volume, transfer: Transfers, shading: RaycastSpec, aspect: float
) -> OrbitT:
    """Fit a view to the visible part of a volume; ``aspect`` is the picture's width / height."""
    return fit_points(view, volume, shown_mm([volume], transfer, shading), aspect)


def fit_points(view: OrbitT, volume: Volume, points_mm: Array, aspect: float) -> OrbitT:
    """Fit a view of a volume to points (N, 3) of the world, as `fit_view`."""
    axes = np.stack(view.camera(volume).frame())
    points = points_mm @ axes.T
    middle = (points.min(axis=0) + points.max(axis=0)) / 2
    x, y, z = (points - middle).T
    tan_y = _FILLS * math.tan(math.radians(view.fov_deg) / 2)
    tan_x = tan_y * aspect
    radius = radius_mm(volume)
    minimum = _MIN_FRAMED * radius
    if view.orthographic:
        height = max(2 * float(y.max()), 2 * float(x.max()) / aspect) / _FILLS
        return _frame_view(view, 2 * radius / max(height, minimum), middle @ axes)
    distance = max(_span_within(x, z, tan_x)[0], _span_within(y, z, tan_y)[0], minimum)
    shift = [_centre_from(values, z, distance, slope) for values, slope in ((x, tan_x), (y, tan_y))]
    sine = math.sin(math.radians(view.fov_deg) / 2)
    return _frame_view(view, radius / (distance * sine), (middle + [*shift, 0.0]) @ axes)


def _frame_view(view: OrbitT, zoom: float, target_mm: Array) -> OrbitT:
    """Return a view with a zoom, within `ZOOMS`, and a target."""
    x, y, z = target_mm.tolist()
    return replace(view, zoom=min(max(zoom, ZOOMS[0]), ZOOMS[1]), target_mm=(x, y, z))


def _span_within(offsets: Array, depth: Array, slope: float) -> tuple[float, float]:
    """Return the distance at which points fit within ± a slope, and the offset to centre them."""
    high, low = float((offsets - slope * depth).max()), float((-offsets - slope * depth).max())
    return (high + low) / (2 * slope), (high - low) / 2


def _centre_from(offsets: Array, depth: Array, distance: float, slope: float) -> float:
    """Return the offset that centres the points in perspective from a distance."""
    place = 0.0
    for _ in range(_ITERATIONS):
        nearest, place = _span_within(offsets, depth, slope)
        # From further away than necessary, the points span a smaller slope.
        slope *= max(nearest / distance, 1e-3)
    return place


def shown_mm(steps: Iterable[Volume], transfer: Transfers, shading: RaycastSpec) -> Array:
    """(N, 3) points around the visible voxels of a volume, or of all time steps of a series.

    The corners if none is visible.
    """
    pieces, corners = [], np.zeros((0, 3))
    for volume in steps:
        pieces += _visible_mm(volume, transfer, shading)
        corners = volume.corners_mm
    points = np.concatenate(pieces)
    return points if len(points) else corners


def _visible_mm(volume: Volume, transfer: Transfers, shading: RaycastSpec) -> list[Array]:
    """Return (N, 3) points around the visible voxels of each field."""
    tables, shading = bake_for_volume(transfer, volume), shading.naming_fields(volume)
    pieces = []
    for name, rows in tables.by_field(volume.name).items():
        field, mask = volume.by_name[name], tables.masks.get(name)
        same = field.has_lattice_of(volume)
        field_spec = (shading if same else replace(shading, crop_voxels=None)).for_field(name)
        lattice = MaskLattice.of(volume, name, mask) if mask else None
        pieces.append(_around(field, rows, field_spec, lattice))
    return pieces


def _around(
    volume: Volume,
    tables: Sequence[Table],
    shading: RaycastSpec,
    lattice: MaskLattice | None = None,
) -> Array:
    """Return the points of a field with a table, or with one by row of its mask.

    Some voxels along each axis are enough: the error is below one percent of the picture.
    """
    volume, values = _sample_voxels(volume)
    k, j, i = steps = tuple(step_along(size) for size in volume.values.shape)
    visible, depth_per_mm = np.zeros(values.shape, bool), np.zeros(values.shape)
    nearest = 0 if lattice is None else lattice.nearest_to_voxels((k, j, i))
    for row, table in enumerate(tables):
        mask, depths = _visible_voxels(values, table)
        visible |= (nearest == row) & mask
        depth_per_mm += (nearest == row) * depths
    crop = crop_bounds(shading.for_lattice(volume), volume)
    for axis, (low, high) in enumerate(reversed(crop)):
        positions = np.arange(values.shape[axis]) * steps[axis]
        outside = (slice(None),) * axis + ((positions < low - 1) | (positions > high + 1),)
        visible[outside], depth_per_mm[outside] = False, 0.0
    cell_mm = np.multiply(steps, volume.spacing_mm[::-1])
    for axis, mm in enumerate(cell_mm):
        thick = -np.expm1(-mm * depth_per_mm.sum(axis=axis, keepdims=True)) > _SEEN
        visible |= (depth_per_mm > 0) & thick
    rows = visible.any(axis=2)
    first = visible.argmax(axis=2)[rows]
    last = values.shape[2] - 1 - visible[..., ::-1].argmax(axis=2)[rows]
    k_rows, j_rows = np.nonzero(rows)
    places = np.concatenate([np.stack([ends, j_rows, k_rows], axis=1) for ends in (first, last)])
    # A visible voxel may reach half way to the next sampled one.
    halves = np.array(list(np.ndindex(2, 2, 2))) - 0.5
    index = ((places[:, None] + halves) * [i, j, k]).reshape(-1, 3)
    points = world_mm(volume, np.clip(index, *np.transpose(crop)))
    for plane in shading.clip_planes:
        points = points[(points - plane.point_mm) @ np.asarray(plane.normal) >= 0]
    return points


def _sample_voxels(volume: Volume) -> tuple[Volume, NDArray[Any]]:
    """Return the lattice of a volume's finest level that is known, and every n-th voxel of it."""
    if volume.pyramid is not None and volume.pyramid.sample is not None:
        return volume.at_level(0), volume.pyramid.sample.voxels
    k, j, i = map(step_along, volume.values.shape)
    return volume, np.ascontiguousarray(volume.values[::k, ::j, ::i])


def _visible_voxels(values: NDArray[np.generic], table: Table) -> tuple[NDArray[np.bool_], Array]:
    """Return (z, y, x) True if a voxel is no haze, or near a surface; and its extinction per mm."""
    if isinstance(table, SurfaceTable):
        layer = np.searchsorted(np.sort(table.values), values)
        visible = np.zeros(values.shape, bool)
        for axis in range(3):
            passed = np.diff(layer, axis=axis) != 0
            ahead = (slice(None),) * axis
            visible[(*ahead, slice(1, None))] |= passed
            visible[(*ahead, slice(None, -1))] |= passed
        return visible, np.zeros(values.shape)
    sides = (np.atleast_2d(side.opacity) for side in (table, table.left_limits))
    opacity = np.concatenate(list(sides)).max(axis=0)
    low, high = table.domain
    index = np.rint((values.astype(np.float64) - low) / (high - low) * (len(opacity) - 1))
    opaque = opacity > _HAZE * opacity.max()
    if table.labels:
        opaque = np.append(opaque, False)
        index = np.where((index < 0) | (index >= len(opacity)), len(opacity), index)
        opacity = np.append(opacity, 0.0)
    entries = np.clip(index, 0, len(opaque) - 1).astype(np.int32)
    return opaque[entries], extinction_per_mm(opacity, table.reference_step_mm)[entries]


def crop_bounds(shading: RaycastSpec, volume: Volume) -> Crop:
    """Return the crop's bounds along each axis, in voxels; the whole volume if there is none."""
    last = np.array(volume.shape_xyz) - 1.0
    low, high = np.transpose(shading.crop_voxels or [(0.0, end) for end in last])
    # A scene's crop may reach beyond the volume, or miss it.
    low = np.clip(low, 0.0, last - MIN_CROP)
    high = np.clip(high, low + MIN_CROP, last)
    x, y, z = zip(low.tolist(), high.tolist(), strict=True)
    return x, y, z


def world_mm(volume: Volume, index: Array) -> Array:
    """(…, 3) world coordinates of voxel indices (x, y, z)."""
    return np.asarray(index @ volume.world_from_index[:3, :3].T + volume.world_from_index[:3, 3])
