"""A volume with fewer voxels: the mean, or the most frequent label, of every block."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

# (N, M) blocks of M voxels -> (N,)
Summary = Callable[[NDArray[Any]], NDArray[Any]]


def block_means(blocks: NDArray[Any]) -> NDArray[Any]:
    """Mean of every row, rounded where the type is whole numbers.

    >>> block_means(np.array([[1, 2, 4, 4], [9, 9, 9, 9]], np.uint8)).tolist()
    [3.0, 9.0]
    """
    means = blocks.mean(axis=1, dtype=np.float64)
    return np.rint(means) if blocks.dtype.kind in "ui" else means


def block_modes(blocks: NDArray[Any]) -> NDArray[Any]:
    """Most frequent value of every row; of equally frequent ones the least.

    >>> block_modes(np.array([[7, 2, 7, 3], [5, 4, 5, 4]])).tolist()
    [7, 4]
    """
    ordered = np.sort(blocks, axis=1)
    best, longest = ordered[:, 0].copy(), np.ones(len(ordered), np.int32)
    run = np.ones(len(ordered), np.int32)
    for column, before in zip(ordered.T[1:], ordered.T[:-1], strict=True):
        run = np.where(column == before, run + 1, 1)
        longer = run > longest
        best[longer], longest[longer] = column[longer], run[longer]
    return best


def downsampled_values(values: NDArray[Any], factor: int, summary: Summary) -> NDArray[Any]:
    """Summarise blocks of factor³ voxels; those at the far ends may be smaller.

    Parameters
    ----------
    values : (Z, Y, X) array
    factor : int
    summary : `block_means` or `block_modes`

    Returns
    -------
    (⌈Z/factor⌉, ⌈Y/factor⌉, ⌈X/factor⌉) array of the same type

    Examples
    --------
    >>> values = np.arange(12, dtype=np.uint8).reshape(2, 2, 3)
    >>> downsampled_values(values, 2, block_means).tolist()
    [[[5, 6]]]
    """
    tops = range(0, values.shape[0], factor)
    small = np.empty((len(tops), *(-(-n // factor) for n in values.shape[1:])), values.dtype)
    # One layer of blocks at a time: the copy that sets blocks side by side stays small.
    for layer, top in zip(small, tops, strict=True):
        slab = values[top : top + factor]
        for ys, block_y, y in _whole_and_rest(slab.shape[1], factor):
            for xs, block_x, x in _whole_and_rest(slab.shape[2], factor):
                part = slab[:, ys, xs]
                shape = (len(slab), part.shape[1] // block_y, block_y, -1, block_x)
                blocks = part.reshape(shape).transpose(1, 3, 0, 2, 4)
                rows = blocks.reshape(blocks.shape[0] * blocks.shape[1], -1)
                layer[y, x] = summary(rows).reshape(blocks.shape[:2])
    return small


def _whole_and_rest(count: int, factor: int) -> list[tuple[slice, int, slice]]:
    """Voxels in whole blocks and those of the last, smaller one: where, block length, whereto."""
    whole = count // factor
    parts = [(slice(0, whole * factor), factor, slice(0, whole))]
    if rest := count - whole * factor:
        parts.append((slice(whole * factor, None), rest, slice(whole, None)))
    return [part for part in parts if part[0].stop != 0]
