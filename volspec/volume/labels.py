"""Labels of a segmentation: which volumes hold labels, their numbers, names and colours.

    values, header, tables of labels -> [labels] -> Volume.labels

A volume holds labels if its header or a table of labels says so, or if its values look like it:
whole numbers from 0 (the background), few enough to be names, and mostly the same from voxel to
voxel.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

# Greatest value of a voxel that is a label, as in a transfer table.
_MAX = 65535
# More labels than these lie in one place each, as cells do: their mean extent is less than this
# fraction of the longest side, and this one of their borders is with the background. Scans that
# were enlarged without interpolation have less background.
_CELLS, _EXTENT, _BACKGROUND = 1024, 0.5, 0.2
# Fraction of neighbouring voxels, not both background, with the same value. Label maps of 1 or 2 mm
# have 0.57 to 0.9 of them, scans 0 to 0.25.
_SAME = 0.45
# Phantoms have few values far apart, such as 0, 100 and 1000; label numbers are nearly consecutive,
# or many.
_DENSE, _MANY = 0.25, 24
# With this many labels or more, most borders are not between consecutive numbers, as those of an
# image of few grey levels are.
_ORDERED_FROM, _BY_ONE = 8, 0.6
# Fraction of the values that a table names, if it is the volume's.
NAMED = 0.9
# Least number below 0 of what some programs leave without a label; scans go further down.
_UNASSIGNED = -9
# Voxels sampled for these tests.
_SAMPLES = 1 << 21


@dataclass(frozen=True, slots=True)
class Label:
    """Name and colour of a label; either may be unknown."""

    name: str = ""
    colour: tuple[float, float, float] | None = None  # sRGB codes, 0 to 1


Labels = Mapping[int, Label]


def find_labels(
    values: NDArray[Any],
    span: tuple[float, float],
    names: Labels,
    certain: bool,
    ids: Sequence[int] = (),
) -> dict[int, Label]:
    """Return the labels of a volume without the background; empty if it holds none.

    The values' ``span`` is (least, greatest); ``ids`` are the labels' numbers by value, if they
    were renumbered. ``names`` are those of the header or tables; ``certain`` says that one of
    them states that the values are labels. Otherwise they are if they look like it, or if nearly
    all of them have a name.
    """
    alike = certain or bool(ids) or looks_like_labels(values, span)
    if span[1] < 1 or not (alike or names) or not are_whole(values, span):
        return {}
    numbers = [ids[value] if ids else value for value in label_numbers(values) if value]
    named = sum(number in names and names[number].name != "" for number in numbers)
    if not alike and not (len(numbers) > 1 and named >= NAMED * len(numbers)):
        return {}
    return {number: names.get(number, Label()) for number in numbers}


def renumber_labels(values: NDArray[Any], certain: bool) -> tuple[NDArray[Any], tuple[int, ...]]:
    """Return labels of which some are above 65535 as consecutive values, and their numbers.

    These are by value. Other values are returned as they are, without numbers; so are measurements,
    unless ``certain`` says that the values are labels.

    >>> ids = np.kron([[[0, 0, 70000], [0, 997, 614454272]]] * 2, np.ones((4, 4, 4), np.uint32))
    >>> found, numbers = renumber_labels(ids, False)
    >>> numbers, found.dtype.name, int(found.max())
    ((0, 997, 70000, 614454272), 'uint16', 3)
    """
    if values.ndim != 3 or values.dtype.kind not in "uif" or values.dtype.itemsize < 4:
        return values, ()
    some = values[:: max(1, len(values) // 8)]  # mostly enough to see that they are no labels
    if values.dtype.kind == "f" and not (some == np.rint(some)).all():
        return values, ()
    if not (values.size and values.max() > _MAX and values.min() >= 0):
        return values, ()
    numbers: NDArray[Any] = np.zeros(1, values.dtype)
    for layer in values:
        numbers = np.union1d(numbers, layer)
        integral = values.dtype.kind in "ui" or bool((layer == np.rint(layer)).all())
        if not integral or len(numbers) > _MAX + 1:
            return values, ()
    codes = np.stack([np.searchsorted(numbers, layer) for layer in values]).astype(np.uint16)
    if not certain and not looks_like_labels(codes, (0.0, float(codes.max()))):
        return values, ()
    return codes, tuple(int(number) for number in numbers)


def why_no_labels(
    values: NDArray[Any], span: tuple[float, float], certain: bool, larger: bool = False
) -> str:
    """Return what keeps whole numbers from being labels that look like it, or are as is certain.

    Empty if nothing does, or they do not look like it. ``larger`` says that the values are of a
    volume that is larger than memory.

    >>> why_no_labels(np.kron([[[-1, 0], [1, 2]]] * 2, np.ones((8, 8, 8), int)), (-1, 2), False)
    'numbers go down to -1; make those 0'
    """
    low, high = span
    some = np.maximum(values[:: max(1, len(values) // 8)], low)  # missing voxels are below
    if (some != np.rint(some)).any() or (low < _UNASSIGNED and not certain):
        return ""
    ranks: NDArray[Any] = some - min(low, 0.0)
    if high > _MAX:
        ranks = np.unique(some, return_inverse=True)[1].reshape(some.shape)
    if not (certain or looks_like_labels(ranks, (float(ranks.min()), float(ranks.max())), False)):
        return ""
    if low < 0:
        return f"numbers go down to {low:g}; make those 0"
    if high > _MAX and larger:
        return f"numbers go up to {high:.0f}, above {_MAX} only in memory; take a coarser level"
    if high > _MAX and (kinds := len(np.unique(values))) > _MAX:
        return f"{kinds} numbers are more than {_MAX}; crop it, or merge some"
    return "many numbers may be measured, too; if they are labels, give their table, ?labels=FILE"


def are_whole(values: NDArray[Any], span: tuple[float, float]) -> bool:
    """Return True if every value is a whole number that can be a label."""
    if span[0] < 0 or span[1] > _MAX:
        return False
    return values.dtype.kind in "ui" or all((layer == np.rint(layer)).all() for layer in values)


def label_numbers(values: NDArray[Any]) -> list[int]:
    """Return the sorted numbers in a volume of whole numbers from 0 to 65535."""
    counts = np.zeros(_MAX + 1, np.int64)
    for layer in values:
        layer = layer[layer >= 0]  # missing voxels are below
        counts += np.bincount(layer.ravel().astype(np.int64), minlength=len(counts))
    return [int(number) for number in np.flatnonzero(counts)]


def looks_like_labels(
    values: NDArray[Any], span: tuple[float, float], background: bool = True
) -> bool:
    """Return True if whole numbers are labels rather than measurements, judged from a sample.

    Two values are a mask or a phantom, not labels. Very many need a ``background`` between them.

    >>> blocks = np.kron([[[0, 0, 1], [0, 2, 3]]] * 2, np.ones((4, 4, 4), np.uint8))
    >>> looks_like_labels(blocks, (0, 3)), looks_like_labels(100 * blocks, (0, 300))
    (True, False)
    """
    if span[0] not in (0, 1):  # 1 without a background
        return False
    step = max(1, -(-values.size // _SAMPLES))
    layers = values[:: min(step, max(1, len(values) // 8))]
    left, right = layers[..., :-1].ravel(), layers[..., 1:].ravel()
    matter = (left != 0) | (right != 0)
    differences = np.abs(right[matter].astype(np.float32) - left[matter])
    if not len(differences) or np.count_nonzero(differences == 0) < _SAME * len(differences):
        return False
    kinds = len(np.unique(np.concatenate([layers[..., 0].ravel(), right]))) - 1
    if kinds < 2 or (kinds < _DENSE * span[1] and kinds < _MANY):
        return False
    borders = differences[differences > 0]
    if kinds > _CELLS:
        outer = np.count_nonzero(matter & ((left == 0) | (right == 0)))
        if _mean_extent(layers) > _EXTENT or (background and outer < _BACKGROUND * len(borders)):
            return False
    by_one = np.count_nonzero(borders == 1)
    return kinds < _ORDERED_FROM or bool(by_one < _BY_ONE * len(borders))


def _mean_extent(values: NDArray[Any]) -> float:
    """Return the extent of all voxels of a value along the longest axis, a fraction of its length.

    It is the mean over the voxels that are not 0.
    """
    layers = np.moveaxis(values, int(np.argmax(values.shape)), 0)
    flat, places = layers.ravel(), np.repeat(np.arange(len(layers)), layers[0].size)
    order = np.flatnonzero(flat)[np.argsort(flat[flat != 0], kind="stable")]
    starts = np.flatnonzero(np.diff(flat[order], prepend=0))
    places = places[order]
    extents = np.maximum.reduceat(places, starts) - np.minimum.reduceat(places, starts)
    counts = np.diff(np.append(starts, len(order)))
    return float((extents * counts).sum() / counts.sum() / len(layers))
