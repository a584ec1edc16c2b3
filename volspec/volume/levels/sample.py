"""Range, histogram and a sample of all voxels of a volume.

    values, box by box -> [sample] -> Sample -> transfer (presets), raycast (framing)

A volume that is larger than memory is framed and given its colours by this, as if it were in it.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

SIDE = 64
"""The most voxels of a `VoxelSample` along each axis."""
BINS = 256
"""Bins of a histogram."""
# About the most voxels that a histogram counts.
_COUNTED = 2**24
# Values by which scanners and programs fill what was not measured, at more than a fraction of the
# others' range from them; farther than some ranges away, any value does.
_FILLS = (-2000, -2048, -3000, -3024, -4096, -9999, -32767, -32768, 32767, 65535)
_APART, _FAR = 0.1, 3.0
# The fewest voxels of a sample that have it, and their fraction.
_MIN, _REPEATED = 8, 1e-3


@dataclass(frozen=True, slots=True, eq=False)
class VoxelSample:
    """Range, histogram and some voxels of a volume, or of the finest level of one.

    Attributes
    ----------
    range : (low, high)
        Least and greatest of the finite values.
    histogram : (`BINS`,)
        Number of voxels by value from ``low`` to ``high``; of a large volume, of some of them.
    voxels : (z, y, x)
        Every n-th voxel along an axis of N, n as `step_along`.
    """

    range: tuple[float, float]
    histogram: NDArray[np.float64]
    voxels: NDArray[Any]


def step_along(count: int) -> int:
    """Return the step between the voxels of a `VoxelSample` along an axis.

    >>> step_along(64), step_along(65)
    (1, 2)
    """
    return -(-count // SIDE)


def counted_step(size: int) -> int:
    """Return the step along each axis between the voxels that a histogram counts.

    >>> counted_step(256**3), counted_step(1024**3)
    (1, 4)
    """
    return max(1, round((size / _COUNTED) ** (1 / 3)))


def typical_range(voxels: NDArray[Any], span: tuple[float, float]) -> tuple[float, float]:
    """Return the range of a volume's values without those that fill what was not measured.

    ``voxels`` are a sample of those within the range, ``span``. A value that fills is the least or
    the greatest, and often repeated: it lies more than three ranges of the others away from them,
    or is one of `_FILLS`, such as -2000 around a CT's circle. A background of 0 is measured.

    >>> rows = np.array([-32768.0] * 40 + [*range(-1000, 1000)])
    >>> typical_range(rows, (-32768.0, 999.0)), typical_range(rows[40:], (-1000.0, 999.0))
    ((-1000.0, 999.0), (-1000.0, 999.0))
    """
    low, high = span
    inside = np.sort(voxels[(voxels >= low) & (voxels <= high)], axis=None)
    min_count = max(_MIN, int(_REPEATED * inside.size))
    for _ in range(2):  # both ends
        above = inside[np.searchsorted(inside, low, "right") :]
        if low != 0 and inside.size - above.size >= min_count and _fills(low, above):
            low, inside = float(above[0]), above
        below = inside[: np.searchsorted(inside, high, "left")]
        if inside.size - below.size >= min_count and _fills(high, below):
            high, inside = float(below[-1]), below
    return low, high


def _fills(value: float, values: NDArray[Any]) -> bool:
    """Return True if a repeated value, beyond all others, fills what was not measured."""
    if not values.size or values[0] == values[-1]:
        return False
    first, last = float(values[0]), float(values[-1])
    gap = max(first - value, value - last)
    return gap > _FAR * (last - first) or (value in _FILLS and gap > _APART * (last - first))


def histogram_of_values(values: NDArray[Any], span: tuple[float, float]) -> NDArray[np.float64]:
    """Count values in (`BINS`,) bins over a span; others are left out."""
    if not _is_counted_by_value(values.dtype):
        return _bin_values(values, span)
    codes = np.iinfo(values.dtype)
    return _bin_values(np.arange(codes.min, codes.max + 1), span, _by_value(values))


def _is_counted_by_value(dtype: np.dtype[Any]) -> bool:
    return dtype.kind in "iu" and dtype.itemsize <= 2


def _by_value(values: NDArray[Any]) -> NDArray[np.intp]:
    """Count whole numbers of up to 16 bits by value, from the least of their type."""
    codes = np.iinfo(values.dtype)
    count = codes.max - codes.min + 1
    counts = np.zeros(count, np.intp)
    for plane in values:
        counts += np.bincount(plane.ravel().astype(np.intp) - codes.min, minlength=count)
    return counts


def _bin_values(
    values: NDArray[Any], span: tuple[float, float], weights: NDArray[np.intp] | None = None
) -> NDArray[np.float64]:
    low, high = span
    # Shifted to 0: far from 0, float32 is too coarse to separate the bins' edges.
    above = np.subtract(values, low, dtype=np.float64)
    counts, _ = np.histogram(above, bins=BINS, range=(0.0, high - low), weights=weights)
    return counts.astype(np.float64)


class VoxelSampler:
    """Makes the `VoxelSample` of voxels (Z, Y, X) that are read box by box."""

    def __init__(self, shape: tuple[int, int, int], dtype: np.dtype[Any]) -> None:
        self._step = counted_step(math.prod(shape))
        self._steps = [step_along(n) for n in shape]
        sides = [-(-n // step) for n, step in zip(shape, self._steps, strict=True)]
        self._voxels = np.zeros(sides, dtype)
        self._span = math.inf, -math.inf
        # Numbers by value; or, of other types, the values themselves.
        self._counts: NDArray[np.intp] | None = None
        self._counted: list[NDArray[Any]] = []

    def add(self, values: NDArray[Any], box: tuple[tuple[int, int], ...]) -> None:
        """Add the voxels of a box, of the type that was given."""
        finite = values if values.dtype.kind in "iu" else values[np.isfinite(values)]
        if finite.size:
            low, high = self._span
            self._span = min(low, float(finite.min())), max(high, float(finite.max()))
        counted = values[tuple(slice(-low % self._step, None, self._step) for low, _ in box)]
        if _is_counted_by_value(values.dtype):
            more = _by_value(counted)
            self._counts = more if self._counts is None else self._counts + more
        else:
            self._counted.append(counted[np.isfinite(counted)])
        pairs = [*zip(box, self._steps, strict=True)]
        of_box = tuple(slice(-low % step, None, step) for (low, _), step in pairs)
        to = tuple(slice(-(-low // step), -(-high // step)) for (low, high), step in pairs)
        self._voxels[to] = values[of_box]

    def sample(self) -> VoxelSample | None:
        """Return the sample of the boxes; None if no value is finite."""
        if self._span[0] > self._span[1]:
            return None
        if self._counts is None:
            histogram = _bin_values(np.concatenate(self._counted), self._span)
        else:
            codes = np.iinfo(self._voxels.dtype)
            values = np.arange(codes.min, codes.max + 1)
            histogram = _bin_values(values, self._span, self._counts)
        return VoxelSample(self._span, histogram, self._voxels)
