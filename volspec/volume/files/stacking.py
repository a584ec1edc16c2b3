"""Slices read one after the other into one array.

readers -> [stacking] -> (Z, Y, X) array
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

Item = TypeVar("Item")


def stacked(items: Sequence[Item], read: Callable[[Item], NDArray[Any]]) -> NDArray[Any]:
    """One array of all slices, of a type that holds each of theirs.

    Parameters
    ----------
    items : sequence
        What each slice is read from.
    read : callable
        Gives a slice, (Y, X); all of one shape, which the reader makes sure of.

    Returns
    -------
    (Z, Y, X) array

    Examples
    --------
    >>> stacked([1, -1], lambda n: np.full((2, 2), n, np.int16 if n < 0 else np.uint8)).dtype
    dtype('int16')
    """
    first = read(items[0])
    values = np.empty((len(items), *first.shape), first.dtype)
    values[0] = first
    for k, item in enumerate(items[1:], 1):
        one = read(item)
        if not np.can_cast(one.dtype, values.dtype):
            values = values.astype(np.result_type(values.dtype, one.dtype))
        values[k] = one
    return values
