"""Smooth edges of surfaces: pixels through which an edge passes are a mean of several points.

what pixels see -> [edges] -> further points, the mean of each pixel's
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_array

Array = NDArray[np.float64]
# Places in such a pixel, in pixels from its middle.
_IN_PIXEL = np.array([(-1.0, -3.0), (3.0, -1.0), (1.0, 3.0), (-3.0, 1.0)]) / 8.0
POINTS = len(_IN_PIXEL)
"""Further points of each such pixel."""


def next_to(across: NDArray[np.bool_], down: NDArray[np.bool_]) -> NDArray[np.intp]:
    """Return the numbers of pixels that differ from a neighbour.

    ``across`` (H, W - 1) and ``down`` (H - 1, W) are True between those that do.
    """
    found = np.zeros((across.shape[0], down.shape[1]), np.bool_)
    found[:, 1:] |= across
    found[:, :-1] |= across
    found[1:] |= down
    found[:-1] |= down
    return np.flatnonzero(found)


def further_points(pixels: NDArray[np.intp], width: int) -> Array:
    """Return (4 E, 2) places, x and y in pixels, in E pixels."""
    middles = np.stack([pixels % width, pixels // width], axis=1)
    return (middles[:, None] + _IN_PIXEL).reshape(-1, 2)


def mean_of_points(pixels: NDArray[np.intp], count: int) -> csr_array:
    """Return weights (count, count + 4 E): of a pixel's middle, or of its further points."""
    numbers = np.full(count, 1)
    numbers[pixels] = POINTS
    ends = np.concatenate([[0], np.cumsum(numbers)])
    columns = np.repeat(np.arange(count), numbers)
    first = ends[pixels][:, None] + np.arange(POINTS)
    columns[first] = count + np.arange(first.size).reshape(first.shape)
    weights = np.repeat(1.0 / numbers, numbers).astype(np.float32)
    return csr_array((weights, columns, ends), shape=(count, count + POINTS * len(pixels)))
