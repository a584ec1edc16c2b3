"""Minimum and maximum of every brick of a volume, and what is empty under a transfer function.

A brick covers 8³ cells: positions [8b, 8b + 8) along each axis, so its bounds include the
first voxel of the next brick and no trilinear sample inside can leave them. Which bricks are
empty changes with the transfer function only and is rebuilt in milliseconds; the kernel leaps
by the chessboard distance to the nearest brick that is not [1].

References
----------
[1] Zuiderveld, Koning, Viergever (1992), "Acceleration of ray-casting using 3-D distance
    transforms", Proc. SPIE 1808, 324-335.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

BRICK = 8


def brick_ranges(values: NDArray[Any]) -> tuple[NDArray[Any], NDArray[Any]]:
    """Least and greatest value each brick can yield.

    Parameters
    ----------
    values : (Z, Y, X) array

    Returns
    -------
    low, high : (⌈Z/8⌉, ⌈Y/8⌉, ⌈X/8⌉) arrays of the same type

    Examples
    --------
    >>> low, high = brick_ranges(np.arange(16).reshape(1, 1, 16))
    >>> low.ravel().tolist(), high.ravel().tolist()
    ([0, 8], [8, 15])
    """
    return _reduced(values, np.minimum), _reduced(values, np.maximum)


def _reduced(values: NDArray[Any], least: np.ufunc) -> NDArray[Any]:
    # z first: the reduction then runs over whole contiguous slices.
    for axis in range(3):
        starts = np.arange(0, values.shape[axis], BRICK)
        inside = least.reduceat(values, starts, axis=axis)
        first = values.take(starts[1:], axis=axis)
        body = [slice(None)] * 3
        body[axis] = slice(0, len(starts) - 1)
        inside[tuple(body)] = least(inside[tuple(body)], first)
        values = inside
    return values


def leap_distances(
    low: NDArray[Any],
    high: NDArray[Any],
    domain: tuple[float, float],
    opacity: NDArray[np.floating],
) -> NDArray[np.uint8]:
    """Chessboard distance, in bricks, to the nearest brick that a table makes visible.

    Parameters
    ----------
    low, high : (z, y, x) arrays
        From `brick_ranges`.
    domain : (float, float)
        Values of the table's first and last entry.
    opacity : (N,)
        The table's opacities.

    Returns
    -------
    (z, y, x) uint8
        0 where something may be seen; d where all bricks nearer than d are empty.
    """
    from scipy.ndimage import distance_transform_cdt

    last = len(opacity) - 1
    scale = last / (domain[1] - domain[0])
    first = np.clip(np.floor((low.astype(np.float64) - domain[0]) * scale), 0, last).astype(int)
    end = np.clip(np.ceil((high.astype(np.float64) - domain[0]) * scale), 0, last).astype(int)
    seen = np.concatenate([[0], np.cumsum(np.asarray(opacity) > 0)])
    empty = seen[end + 1] == seen[first]
    if empty.all():
        return np.full(empty.shape, 255, np.uint8)
    distance = distance_transform_cdt(empty, metric="chessboard")
    return np.minimum(distance, 255).astype(np.uint8)
