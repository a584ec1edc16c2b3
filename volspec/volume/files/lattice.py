"""Lattice of a stack of slices: units of length, order, spacing, and stacking.

    readers -> [lattice] -> values, world_from_index

Slices shifted within their plane, as from a tilted gantry, form a sheared lattice, which the affine
map expresses without resampling.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any, TypeVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from volspec.errors import VolumeError
from volspec.volume.files.query import Query, Reading
from volspec.volume.metadata import NO_DEPTH, ONE_SLICE

# Fractions of the median distance: a wider or narrower gap is not jitter, but means that slices are
# missing or belong to another stack.
_WIDE, _NARROW = 1.5, 0.5
# Fraction of the step: headers round positions to a tenth of a millimetre or less.
_JITTER = 0.1
# Fraction of the step: slices farther off their even positions would be shown in another's place.
_FAR = 0.5
# Fraction of the mean distance between neighbours.
_SAME_PLACE = 0.01
Item = TypeVar("Item")
LPS_FROM_RAS = np.diag([-1.0, -1.0, 1.0, 1.0])
"""(4, 4) from right, anterior, superior to ITK's left, posterior, superior; its own inverse."""
_MM = {
    **dict.fromkeys(("angstrom", "å"), 1e-7),
    **dict.fromkeys(("pm", "picometer", "picometre"), 1e-9),
    **dict.fromkeys(("nm", "nanometer", "nanometre"), 1e-6),
    **dict.fromkeys(("um", "µm", "micron", "microns", "micrometer", "micrometre"), 1e-3),
    **dict.fromkeys(("mm", "millimeter", "millimetre"), 1.0),
    **dict.fromkeys(("cm", "centimeter", "centimetre"), 10.0),
    **dict.fromkeys(("dm", "decimeter", "decimetre"), 100.0),
    **dict.fromkeys(("m", "meter", "metre"), 1000.0),
    **dict.fromkeys(("km", "kilometer", "kilometre"), 1e6),
    **dict.fromkeys(("in", "inch", "inches"), 25.4),
}


def affine(columns: ArrayLike, origin: ArrayLike) -> NDArray[np.float64]:
    """Return the (4, 4) map from voxel index to millimetres.

    >>> affine(np.diag([1, 1, 2]), (5, 6, 7))[2].tolist()
    [0.0, 0.0, 2.0, 7.0]
    """
    world = np.eye(4)
    world[:3, :3] = columns
    world[:3, 3] = origin
    return world


def with_depth(
    values: NDArray[Any], reading: Reading, query: Query
) -> tuple[NDArray[Any], Reading]:
    """Repeat the only slice of a file behind itself, since rays need two; return others as is.

    Its two voxels are half a step before and behind its place. Values may be (Y, X), and the third
    column of the map 0: the step is then that of a pixel.
    """
    values = values[None] if values.ndim == 2 else values
    if values.ndim != 3 or min(values.shape) != 1 or sorted(values.shape)[1] < 2:
        return values, reading
    world, assumed = reading.world_from_index, (*reading.metadata.assumed, ONE_SLICE)
    world = np.diag([*(reading.spacing_mm or np.ones(3)), 1.0]) if world is None else world.copy()
    if not world[:3, 2].any():
        across, down = world[:3, :2].T
        normal = np.cross(across, down)
        pixel_mm = np.linalg.norm(world[:3, :2], axis=0).min()
        world[:3, 2] = pixel_mm * normal / (np.linalg.norm(normal) or 1.0)
        assumed = (*assumed, NO_DEPTH)
    axis = values.shape.index(1)
    step = world[:3, 2 - axis]
    scale = 1.0
    if query.spacing_mm is not None:
        scale = query.spacing_mm[2 - axis] / float(np.linalg.norm(step))
    world[:3, 3] -= scale * step / 2
    metadata = replace(reading.metadata, assumed=assumed)
    reading = replace(reading, spacing_mm=None, world_from_index=world, metadata=metadata)
    return np.repeat(values, 2, axis), reading


def group_slices(at_mm: NDArray[np.float64], normal: NDArray[np.float64]) -> list[list[int]]:
    """Group slices of one orientation by position along their normal; return lists of indices.

    ``at_mm`` (N, 3) is the centre of each slice's first voxel; slices of one position stay in
    order.

    >>> at = np.array([[0, 0, 2.5], [0, 0, 0], [0, 0, 2.5], [0, 0, 0]])
    >>> group_slices(at, np.array([0, 0, 1.0]))
    [[1, 3], [0, 2]]
    """
    positions = at_mm @ normal
    order = np.argsort(positions, kind="stable")
    gaps = np.diff(positions[order], prepend=positions[order[0]])
    min_gap = _SAME_PLACE * float(np.ptp(positions)) / max(len(order) - 1, 1)
    groups: list[list[int]] = []
    for index, gap in zip(order.tolist(), gaps, strict=True):
        if groups and gap <= min_gap:
            groups[-1].append(index)
        else:
            groups.append([index])
    return [sorted(group) for group in groups]


def slice_step_mm(
    at_mm: NDArray[np.float64], names: list[str], query: Query, pixel_mm: tuple[float, float]
) -> NDArray[np.float64]:
    """Return the (3,) step of an even lattice through the first and the last of (N, 3) positions.

    ``pixel_mm`` is the spacing within the slices, for the message.

    Raises VolumeError if slices are missing, belong to another stack, or lie more than half a step
    off the lattice, unless the query has a spacing.
    """
    step: NDArray[np.float64] = (at_mm[-1] - at_mm[0]) / (len(at_mm) - 1)
    if query.spacing_mm is not None:
        return step
    gaps = np.linalg.norm(np.diff(at_mm, axis=0), axis=1)
    usual = float(np.sort(gaps)[(len(gaps) - 1) // 2])  # of two gaps the smaller
    odd = int(np.argmax(np.maximum(gaps / usual, usual / gaps)))
    off, mean = _offset_mm(at_mm), float(np.linalg.norm(step))
    if not _NARROW * usual <= gaps[odd] <= _WIDE * usual:
        is_gap = bool(gaps[odd] > usual)
        cause = "slices are missing" if is_gap else "they are unevenly spaced"
        pair = f"{names[odd]} and {names[odd + 1]} lie {gaps[odd]:.4g} mm apart"
        fault = f"{pair}, others {usual:.4g} mm: {cause}; complete the series"
    elif off > _FAR * mean:
        is_gap, usual = False, mean
        where = f"slices lie up to {off:.3g} mm off a line with steps of {mean:.4g} mm"
        fault = f"{where}: several stacks; put each into a file or folder of its own"
    else:
        return step
    even = query.example(spacing=spacing_text(*pixel_mm, usual))
    problem = f"{query.path}: {fault}, or treat the slices as even with {even}"
    raise VolumeError(problem, code="missing" if is_gap else "conflict")


def spacing_text(*mm: float) -> str:
    """Return a spacing as the option ``spacing=`` has it.

    >>> spacing_text(0.5, 0.5, 2.0)
    '0.5,0.5,2'
    """
    return ",".join(f"{length:.6g}" for length in mm)


def _offset_mm(at_mm: NDArray[np.float64]) -> float:
    """Return the greatest distance of positions from even ones between the first and the last."""
    even = np.linspace(at_mm[0], at_mm[-1], len(at_mm))
    return float(np.linalg.norm(at_mm - even, axis=1).max())


def unevenness(at_mm: NDArray[np.float64]) -> str:
    """Return a note on slices off their even positions; empty if the offset is invisible."""
    off = _offset_mm(at_mm)
    step = float(np.linalg.norm(at_mm[-1] - at_mm[0])) / (len(at_mm) - 1)
    if off <= _JITTER * step:
        return ""
    return f"slices lie up to {off:.3g} mm off even positions {step:.4g} mm apart; shown as even"


def stack_slices(items: Sequence[Item], read: Callable[[Item], NDArray[Any]]) -> NDArray[Any]:
    """Read slices (Y, X) of one shape into an array (Z, Y, X) of a type for all their values.

    >>> stack_slices([1, -1], lambda n: np.full((2, 2), n, np.int16 if n < 0 else np.uint8)).dtype
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


def mm_per_unit(unit: str | None) -> float | None:
    """Return the millimetres in a unit; None if it is not a length, such as ``pixel``.

    >>> mm_per_unit("micrometer"), mm_per_unit("\\u03bcm"), mm_per_unit("pixel")
    (0.001, 0.001, None)
    >>> mm_per_unit("pm"), mm_per_unit("decimeters"), mm_per_unit("km")
    (1e-09, 100.0, 1000000.0)
    """
    # Greek mu and the micro sign look alike, and ImageJ writes the latter escaped.
    name = (unit or "").strip().replace("\u03bc", "\u00b5").replace("\\u00B5", "\u00b5")
    name = name.casefold().replace("\u03bc", "\u00b5")
    return _MM.get(name, _MM.get(name.removesuffix("s")))
