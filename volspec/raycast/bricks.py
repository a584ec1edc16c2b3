"""Value ranges of a volume's bricks, and the codes by which kernels skip bricks.

A brick covers n³ cells, n = `BRICK`: positions [nb, nb + n) along each axis, so its bounds include
the first voxel of the next brick and no trilinear sample inside can leave them. For a given volume,
codes depend only on the transfer function and are rebuilt in milliseconds; the kernel skips ahead
by the chessboard distance to the nearest visible brick [1].

References
----------
[1] Zuiderveld, Koning, Viergever (1992), "Acceleration of ray-casting using 3-D distance
    transforms", Proc. SPIE 1808, 324-335.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from volspec.raycast.spec import RaycastSpec
from volspec.transfer import SurfaceTable, TransferTable

BRICK = 4
# Codes from here on are strides (rays.clh).
STRIDES = 248


def brick_ranges(values: NDArray[Any]) -> tuple[NDArray[Any], NDArray[Any]]:
    """Return each brick's least and greatest value, (⌈Z/n⌉, ⌈Y/n⌉, ⌈X/n⌉), of (Z, Y, X) values."""
    return _reduce(values, np.minimum), _reduce(values, np.maximum)


def _reduce(values: NDArray[Any], extreme: np.ufunc) -> NDArray[Any]:
    bricks = np.empty([-(-n // BRICK) for n in values.shape], values.dtype)
    # One layer of bricks at a time, z first and x last: whole slices are reduced to one that fits
    # the CPU's cache, and only the small rest is transposed to reduce along x.
    for k, layer in enumerate(bricks):
        plane = extreme.reduce(values[k * BRICK : (k + 1) * BRICK + 1], axis=0)
        rows = _reduce_first_axis(plane, extreme)
        layer.T[:] = _reduce_first_axis(np.ascontiguousarray(rows.T), extreme)
    return bricks


def _reduce_first_axis(plane: NDArray[Any], extreme: np.ufunc) -> NDArray[Any]:
    starts = np.arange(0, len(plane), BRICK)
    reduced = extreme.reduceat(plane, starts, axis=0)
    extreme(reduced[:-1], plane[starts[1:]], out=reduced[:-1])
    return reduced


def visible_bricks(
    low: NDArray[Any],
    high: NDArray[Any],
    domain: tuple[float, float],
    opacity: NDArray[np.floating],
    labels: bool = False,
) -> NDArray[np.bool_]:
    """Return the bricks (z, y, x) in which a table's opacity can be above 0.

    ``low`` and ``high`` are from `brick_ranges`, ``domain`` the values of the table's first and
    last entry, ``opacity`` (N,) or (G, N): of G rows by gradient the greatest counts. With
    ``labels`` any visible entry between a brick's least and greatest value counts, and values
    beyond the table are transparent; otherwise they use its nearest end.
    """
    domain, rows = _rows(domain, opacity, labels)
    visible = rows.max(axis=0) > 0
    first, last = _entries(low, high, domain, len(visible))
    count = np.concatenate([[0], np.cumsum(visible)])
    return count[last + 1] > count[first]


def straddled_bricks(
    low: NDArray[Any], high: NDArray[Any], levels: NDArray[np.floating]
) -> NDArray[np.bool_]:
    """Return the bricks (z, y, x) that an isosurface of one of the levels can cross.

    Levels may be in any order; they are rounded to float32, in which kernels compare them.
    """
    ordered = np.sort(np.asarray(levels, np.float32))
    below = np.searchsorted(ordered, low.astype(np.float32), side="left")
    return np.searchsorted(ordered, high.astype(np.float32), side="right") > below


def opacity_spread(
    low: NDArray[Any],
    high: NDArray[Any],
    domain: tuple[float, float],
    opacity: NDArray[np.floating],
    labels: bool = False,
) -> NDArray[np.float32]:
    """Return how much a table's opacity varies in each brick, 0 if it is homogeneous.

    Arguments are those of `visible_bricks`.
    """
    domain, rows = _rows(domain, opacity, labels)
    rows = rows.astype(np.float32)
    first, last = _entries(low, high, domain, rows.shape[1])
    greatest = _reduce_ranges(rows.max(axis=0), first, last, np.maximum)
    return greatest - _reduce_ranges(rows.min(axis=0), first, last, np.minimum)


def _rows(
    domain: tuple[float, float], opacity: NDArray[np.floating], labels: bool
) -> tuple[tuple[float, float], NDArray[np.floating]]:
    """Return the domain and (G, N) opacities; for labels, add a transparent entry at each end."""
    rows = np.atleast_2d(opacity)
    if not labels:
        return domain, rows
    return (domain[0] - 1, domain[1] + 1), np.pad(rows, ((0, 0), (1, 1)))


def _reduce_ranges(
    table: NDArray[np.float32], first: NDArray[Any], last: NDArray[Any], extreme: np.ufunc
) -> NDArray[np.float32]:
    """Reduce table[first … last] for each pair, by runs of 2^k entries: two cover any range."""
    power = np.frexp(last - first + 1)[1] - 1
    result = np.empty(first.shape, np.float32)
    run = table
    for k in range(int(power.max()) + 1):
        here = power == k
        result[here] = extreme(run[first[here]], run[last[here] + 1 - 2**k])
        run = extreme(run[: -(2**k)], run[2**k :])
    return result


def _entries(
    low: NDArray[Any], high: NDArray[Any], domain: tuple[float, float], size: int
) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """Return the first and last table entry that values from low to high can read."""
    scale = (size - 1) / (domain[1] - domain[0])
    first = np.floor((low.astype(np.float64) - domain[0]) * scale)
    last = np.ceil((high.astype(np.float64) - domain[0]) * scale)
    return np.clip(first, 0, size - 1).astype(np.intp), np.clip(last, 0, size - 1).astype(np.intp)


def chessboard_distance(visible: NDArray[np.bool_]) -> NDArray[np.uint8]:
    """Return the chessboard distance, in bricks up to 255, to the nearest visible brick."""
    # scipy.ndimage has this, too, but is no faster and takes a quarter of a second to import.
    distances = np.where(visible, 0, 255).astype(np.uint8)
    reached = visible
    for distance in range(1, 255):
        grown = _grown(reached)
        new = grown > reached
        if not new.any():
            break
        distances[new] = distance
        reached = grown
    return distances


def _grown(bricks: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Return the bricks and all bricks that touch them at a face, an edge or a corner."""
    for axis in range(bricks.ndim):
        before = np.moveaxis(bricks, axis, 0)
        bricks = bricks.copy()
        after = np.moveaxis(bricks, axis, 0)
        after[1:] |= before[:-1]
        after[:-1] |= before[1:]
    return bricks


def brick_codes(
    low: NDArray[Any],
    high: NDArray[Any],
    table: TransferTable | SurfaceTable,
    spec: RaycastSpec,
    step_mm: float,
) -> NDArray[Any]:
    """Return each brick's code for the kernels (see rays.clh); for projections, its maximum.

    In a brick of strides, opacity per ``step_mm`` varies by less than ``spec.adaptive``.
    """
    if spec.mode != "composite":
        return high
    if isinstance(table, SurfaceTable):
        visible = straddled_bricks(low, high, table.values)
        return np.minimum(chessboard_distance(visible), STRIDES - 1)
    visible = visible_bricks(low, high, table.domain, table.opacity, table.labels)
    codes = np.minimum(chessboard_distance(visible), STRIDES - 1)
    if spec.adaptive > 0:
        opacity = table.step_opacity(step_mm)
        spread = opacity_spread(low, high, table.domain, opacity, table.labels)
        codes[visible & (spread < spec.adaptive)] = STRIDES
        codes[visible & (spread < spec.adaptive / 4)] = STRIDES + 1
    return codes
