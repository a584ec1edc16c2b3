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

from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from functools import partial
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

from volspec.raycast.spec import RaycastSpec
from volspec.transfer import SurfaceTable, Table

BRICK = 4
# Codes up to here are distances; from STRIDES on they are strides (rays.clh).
FURTHEST, STRIDES = 63, 248
Of = Callable[[NDArray[Any]], NDArray[Any]]


def brick_ranges(values: NDArray[Any], *, alone: bool = False) -> tuple[NDArray[Any], NDArray[Any]]:
    """Return each brick's least and greatest value, (⌈Z/n⌉, ⌈Y/n⌉, ⌈X/n⌉), of (Z, Y, X) values.

    Both are found at a time, unless ``alone`` on a core.
    """
    if alone:
        return _reduce(values, np.minimum), _reduce(values, np.maximum)
    with ThreadPoolExecutor(1) as other:
        low = other.submit(_reduce, values, np.minimum)
        high = _reduce(values, np.maximum)
        return low.result(), high


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
    count = np.concatenate([[0], np.cumsum(visible)]).astype(np.int32)
    first, last = _entries(domain, len(visible))
    is_visible = _visibility(low.dtype, lambda v: count[first(v)], lambda v: count[last(v) + 1])
    mask = np.empty(low.shape, np.bool_)
    for plane, *ends in zip(mask, low, high, strict=True):  # in a core's cache
        plane[:] = is_visible(*ends)
    return mask


def _visibility(
    dtype: np.dtype[Any], before: Of, up_to: Of
) -> Callable[[NDArray[Any], NDArray[Any]], NDArray[np.bool_]]:
    """Return a function of bricks' ends: whether more is visible through the high end than before.

    Both rise with the value. Of small integers, the least sufficient high end is tabulated.
    """
    if dtype.kind not in "ui" or dtype.itemsize > 2:
        return lambda low, high: up_to(high) > before(low)
    span = np.iinfo(dtype)
    values = np.arange(span.min, span.max + 1)
    sufficient = span.min + np.searchsorted(up_to(values), before(values), side="right")
    # Negative values are indices from the table's end.
    table = np.roll(sufficient, span.min).astype(np.int32)
    return lambda low, high: high >= table.take(low)


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
    first_entry, last_entry = _entries(domain, rows.shape[1])
    first, last = first_entry(low), last_entry(high)
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


def _entries(domain: tuple[float, float], size: int) -> tuple[Of, Of]:
    """Return functions of values: the first and last table entry that samples there can read."""
    scale = (size - 1) / (domain[1] - domain[0])

    def entry(values: NDArray[Any], rounded: np.ufunc) -> NDArray[np.intp]:
        place = rounded((values.astype(np.float64) - domain[0]) * scale)
        return np.clip(place, 0, size - 1).astype(np.intp)

    return partial(entry, rounded=np.floor), partial(entry, rounded=np.ceil)


def chessboard_distance(visible: NDArray[np.bool_]) -> NDArray[np.uint8]:
    """Return the chessboard distance, in bricks up to `FURTHEST`, to the nearest visible brick.

    A shortest way is steps along y, each with or without one along z and x, then along z, with or
    without x, then along x: so one pass along each axis, there and back, suffices.
    """
    # scipy.ndimage has this, too, but is slower and takes a quarter of a second to import.
    z, y, x = visible.shape
    # Whole planes are shifted as one line: its rows are so far apart that no shortest way leads
    # from one to the next. A gap is restored before lines are made of other rows.
    padded = np.full((z, y, x + FURTHEST), FURTHEST, np.uint8)
    distances, gaps = padded[..., :x], padded[..., x:]
    np.multiply(~visible, np.uint8(FURTHEST), out=distances)
    for line in padded.reshape(z, -1):
        for step in (1, 2, 4, 8, 16, 32):  # whose sums are all distances
            ahead, trailing = line[step:], line[:-step]
            np.minimum(ahead, trailing + np.uint8(step), out=ahead)
            np.minimum(trailing, ahead + np.uint8(step), out=trailing)
    gaps[:] = FURTHEST
    _pass_on(padded)
    gaps[:] = FURTHEST
    _pass_on(padded.swapaxes(0, 1), among_rows=True)
    return np.ascontiguousarray(distances)


def _pass_on(layers: NDArray[np.uint8], among_rows: bool = False) -> None:
    """Lower distances to one more than the least near by in the layer before or after."""
    for ordered in (layers, layers[::-1]):
        for one, other in pairwise(ordered):
            near = np.ascontiguousarray(one)
            if among_rows:
                near = _least_near(near)
            near = _least_near(near.reshape(-1)).reshape(one.shape)
            near += np.uint8(1)
            np.minimum(other, near, out=other)


def _least_near(distances: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """Return the least of each item and its two neighbours along the first axis."""
    minimum = distances.copy()
    np.minimum(minimum[1:], distances[:-1], out=minimum[1:])
    np.minimum(minimum[:-1], distances[1:], out=minimum[:-1])
    return minimum


def visible_by_table(low: NDArray[Any], high: NDArray[Any], table: Table) -> NDArray[np.bool_]:
    """Return the bricks (z, y, x) in which a table may show something."""
    if isinstance(table, SurfaceTable):
        return straddled_bricks(low, high, table.values)
    sides = (table,) if table.left is None else (table, table.left_limits)
    # Rows as of a table of gradients: any of them counts.
    opacity = np.concatenate([np.atleast_2d(side.opacity) for side in sides])
    return visible_bricks(low, high, table.domain, opacity, table.labels)


def brick_codes(
    low: NDArray[Any],
    high: NDArray[Any],
    tables: Sequence[Table],
    spec: RaycastSpec,
    step_mm: float,
    rows: tuple[NDArray[np.uint8], NDArray[np.uint8]] | None = None,
) -> NDArray[Any]:
    """Return each brick's code for the kernels (see rays.clh); for projections, its maximum.

    A field has a table, or one by row of its mask; then ``rows`` are the least and the greatest in
    each brick: any row between may be there. In a brick of strides, opacity per ``step_mm`` varies
    by less than ``spec.adaptive``.
    """
    if spec.mode != "composite":
        return high
    table = tables[0]
    if rows is None:
        visible = visible_by_table(low, high, table)
    else:
        visible = np.zeros(low.shape, np.bool_)
        for row, one in enumerate(tables):
            here = ~visible & (rows[0] <= row) & (row <= rows[1])
            if here.any():
                visible[here] = visible_by_table(low[here][None], high[here][None], one)[0]
    codes = chessboard_distance(visible)
    if spec.adaptive > 0 and not isinstance(table, SurfaceTable):
        sides = (table,) if table.left is None else (table, table.left_limits)
        opacity = np.concatenate([np.atleast_2d(side.step_opacity(step_mm)) for side in sides])
        spread = opacity_spread(low, high, table.domain, opacity, table.labels)
        codes[visible & (spread < spec.adaptive)] = STRIDES
        codes[visible & (spread < spec.adaptive / 4)] = STRIDES + 1
    return codes
