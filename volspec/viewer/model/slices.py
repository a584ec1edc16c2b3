"""Slices: planes, layouts, the patient's directions, edits and commands.

Volume, Slices -> [slices] -> panel, outlines
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from itertools import permutations
from typing import Any

import numpy as np
from numpy.typing import NDArray

from volspec.camera import AXES, PATIENT, is_patient
from volspec.viewer.model.cuts import with_overlays
from volspec.viewer.model.edit import Command, bind, edit, switch, with_interface
from volspec.viewer.model.state import Slices, ViewState
from volspec.viewer.model.view import clamp
from volspec.volume import Volume

# Quantiles of the voxels' values that are black and white unless these are set.
_QUANTILES = (0.005, 0.995)
# The least difference between black and white, as a fraction of the volume's range.
_NARROWEST = 0.002
# A direction gets a second letter if that component is at least this (about 15 degrees).
_LEANS = 0.26


@dataclass(frozen=True, slots=True)
class Plane:
    """A family of slices, by axes of the world; its picture's directions are (axis, sign)."""

    name: str
    normal: int
    across: tuple[int, int]
    down: tuple[int, int]


# Radiological views: from the feet, the face and the patient's left.
PLANES = (
    Plane("Axial", 2, (0, 1), (1, 1)),
    Plane("Coronal", 1, (0, 1), (2, -1)),
    Plane("Sagittal", 0, (1, 1), (2, -1)),
)


@dataclass(frozen=True, slots=True)
class SliceLayout:
    """A plane in terms of the nearest voxel axes; ``flipped`` if its picture runs against them."""

    normal: int
    across: int
    down: int
    flipped: tuple[bool, bool]


def slice_layout(volume: Volume, plane: Plane) -> SliceLayout:
    """Return the layout of a plane's slices in a volume."""
    return _layout(_directions(volume), plane)


def _directions(volume: Volume) -> tuple[float, ...]:
    """Return the matrix of the voxel axes; a cache keyed by volume would keep closed ones alive."""
    return tuple(volume.world_from_index[:3, :3].ravel().tolist())


@lru_cache(maxsize=16)
def _layout(matrix: tuple[float, ...], plane: Plane) -> SliceLayout:
    columns = np.reshape(matrix, (3, 3))
    directions = columns / np.linalg.norm(columns, axis=0)
    best = max(
        permutations(range(3)),
        key=lambda order: sum(abs(directions[world, voxel]) for world, voxel in enumerate(order)),
    )

    def runs(toward: tuple[int, int]) -> tuple[int, bool]:
        world, sign = toward
        voxel = best[world]
        return voxel, bool(sign * directions[world, voxel] < 0)

    (across, back), (down, up) = runs(plane.across), runs(plane.down)
    return SliceLayout(best[plane.normal], across, down, (back, up))


def voxel_number(volume: Volume, axis: int, fraction: float) -> int:
    """Return the voxel at a fraction of an axis."""
    return round(clamp(fraction, 0.0, 1.0) * (volume.shape_xyz[axis] - 1))


def slice_values(
    volume: Volume, layout: SliceLayout, number: int, step: int = 1
) -> NDArray[np.generic]:
    """(rows, columns) values of a slice as displayed, every ``step``-th: a view of the array."""
    index: list[int | slice] = [slice(None, None, step)] * 3
    index[2 - layout.normal] = number
    values = volume.values[tuple(index)]
    if layout.across > layout.down:  # the array's last axis is the volume's first
        values = values.T
    back, up = layout.flipped
    return values[:: -1 if up else 1, :: -1 if back else 1]


def slice_index(
    volume: Volume, layout: SliceLayout, number: int, step: int = 1
) -> NDArray[np.float64]:
    """(rows, columns, 3) indices along x, y, z of the voxels that `slice_values` returns."""
    counts, (back, up) = volume.shape_xyz, layout.flipped
    columns = np.arange(0, counts[layout.across], step)[:: -1 if back else 1]
    rows = np.arange(0, counts[layout.down], step)[:: -1 if up else 1]
    index = np.full((len(rows), len(columns), 3), float(number))
    index[..., layout.across], index[..., layout.down] = columns, rows[:, None]
    return index


def size_mm(volume: Volume, layout: SliceLayout) -> tuple[float, float]:
    """Return width and height of a slice."""
    width, height = (
        volume.shape_xyz[axis] * volume.spacing_mm[axis] for axis in (layout.across, layout.down)
    )
    return width, height


def crossing_place(volume: Volume, layout: SliceLayout, slices: Slices) -> tuple[float, float]:
    """Return where the other two slices cross in this slice's picture, 0 to 1 right and down."""
    x, y = (
        (voxel_number(volume, axis, slices.at[axis]) + 0.5) / volume.shape_xyz[axis]
        for axis in (layout.across, layout.down)
    )
    return _flip(layout, x, y)


def _flip(layout: SliceLayout, x: float, y: float) -> tuple[float, float]:
    """Convert a place along the voxels' axes to one in the picture, or back."""
    back, up = layout.flipped
    return 1 - x if back else x, 1 - y if up else y


def crop_extent(
    volume: Volume, layout: SliceLayout, crop: Sequence[tuple[float, float]]
) -> tuple[float, float, float, float]:
    """Return the crop in a slice's picture: left, top, right and bottom, 0 to 1."""
    axes = layout.across, layout.down
    # Between the outer sides of the first and the last voxel.
    starts, ends = (
        [(crop[axis][end] + end) / volume.shape_xyz[axis] for axis in axes] for end in (0, 1)
    )
    (x0, y0), (x1, y1) = _flip(layout, *starts), _flip(layout, *ends)
    return min(x0, x1), min(y0, y1), max(x0, x1), max(y0, y1)


def direction_letters(direction: NDArray[np.float64], patient: bool) -> str:
    """Name a direction of the world by its greatest components.

    >>> [direction_letters(np.array(at), True) for at in ([-1.0, 0.0, 0.0], [0.0, 0.6, 0.8])]
    ['R', 'SP']
    """
    names = PATIENT if patient else AXES
    parts = direction / (float(np.linalg.norm(direction)) or 1.0)
    order = np.argsort(-np.abs(parts), kind="stable")
    leaning = [i for i in order[: 2 if patient else 1] if abs(parts[i]) > _LEANS]
    return "".join(names[i][int(parts[i] > 0)] for i in leaning)


def edge_letters(volume: Volume, layout: SliceLayout, patient: bool) -> tuple[str, str, str, str]:
    """Return the letters at the left, right, upper and lower edge of a slice."""
    return _edge_letters(_directions(volume), layout, patient)


@lru_cache(maxsize=16)
def _edge_letters(
    matrix: tuple[float, ...], layout: SliceLayout, patient: bool
) -> tuple[str, str, str, str]:
    across, down = (
        np.reshape(matrix, (3, 3))[:, axis] * (-1 if back else 1)
        for axis, back in zip((layout.across, layout.down), layout.flipped, strict=True)
    )
    ends = (-across, across, -down, down)
    left, right, top, bottom = (direction_letters(end, patient) for end in ends)
    return left, right, top, bottom


def outline_index(volume: Volume, axis: int, fraction: float) -> NDArray[np.float64]:
    """(4, 3) corners of the slice perpendicular to an axis of the voxels, in voxels."""
    last = np.array(volume.shape_xyz) - 1.0
    first, second = (other for other in range(3) if other != axis)
    corners = np.zeros((4, 3))
    corners[:, axis] = voxel_number(volume, axis, fraction)
    corners[1:3, first], corners[2:, second] = last[first], last[second]
    return corners


def grey_window(slices: Slices, histogram: NDArray[np.float64]) -> tuple[float, float]:
    """Return the values shown black and white, 0 to 1 of a volume's range, as set or by default."""
    if slices.greys is not None:
        return slices.greys
    # Without the background, which usually has the least value and would outweigh the rest.
    counts = np.r_[0.0, histogram[1:]]
    if not counts.any():
        return 0.0, 1.0
    below = np.cumsum(counts) / counts.sum()
    low, high = (int(np.searchsorted(below, quantile)) for quantile in _QUANTILES)
    return low / len(counts), (high + 1) / len(counts)


def with_slices(state: ViewState, **changes: Any) -> ViewState:
    """Return the state with fields of its `Slices` changed."""
    return with_interface(state, slices=replace(state.interface.slices, **changes))


@edit
def move_slice(state: ViewState, plane: int, fraction: float) -> ViewState:
    """Move a plane to a fraction of its axis."""
    if not 0 <= plane < len(PLANES):
        return state
    axis = slice_layout(state.document.volume, PLANES[plane]).normal
    fractions = list(state.interface.slices.at)
    fractions[axis] = clamp(fraction, 0.0, 1.0)
    return with_slices(state, at=tuple(fractions))


@edit
def step_slice(state: ViewState, plane: int, steps: float) -> ViewState:
    """Move a plane by slices: up, to the back or to the patient's left."""
    if not 0 <= plane < len(PLANES):
        return state
    volume, which = state.document.volume, PLANES[plane]
    axis = slice_layout(volume, which).normal
    last = volume.shape_xyz[axis] - 1
    rising = volume.world_from_index[which.normal, axis] >= 0
    number = voxel_number(volume, axis, state.interface.slices.at[axis])
    return move_slice(state, plane, (number + (steps if rising else -steps)) / last)


@edit
def point_at(state: ViewState, plane: int, x: float, y: float) -> ViewState:
    """Move the other two planes to a place in one plane's picture, 0 to 1 right and down."""
    if not 0 <= plane < len(PLANES):
        return state
    volume, fractions = state.document.volume, list(state.interface.slices.at)
    layout = slice_layout(volume, PLANES[plane])
    place = _flip(layout, clamp(x, 0.0, 1.0), clamp(y, 0.0, 1.0))
    for axis, fraction in zip((layout.across, layout.down), place, strict=True):
        count = volume.shape_xyz[axis]
        fractions[axis] = clamp(round(fraction * count - 0.5), 0, count - 1) / (count - 1)
    return with_slices(state, at=tuple(fractions))


@edit
def set_greys(state: ViewState, black: float, white: float) -> ViewState:
    """Set black and white, 0 to 1 of the volume's range."""
    low = clamp(black, 0.0, 1.0 - _NARROWEST)
    return with_slices(state, greys=(low, clamp(white, low + _NARROWEST, 1.0)))


def _shows_patient(state: ViewState) -> bool:
    return is_patient(state.document.volume, state.interface.overlays.patient)


def _toggle_patient(state: ViewState) -> ViewState:
    return with_overlays(state, patient=not _shows_patient(state))


_CENTRE = Slices().at
# Each plane's name, and the directions in which page down and page up move it.
_PAGES = (
    ("Axial", (("down", "pagedown", -1.0), ("up", "pageup", 1.0))),
    ("Coronal", (("forward", "shift+pagedown", -1.0), ("backward", "shift+pageup", 1.0))),
    ("Sagittal", (("right", "ctrl+pagedown", -1.0), ("left", "ctrl+pageup", 1.0))),
)
COMMANDS = (
    switch("interface.slices.lit", "slices-lit", "Window", "Slices under the lights"),
    Command(
        "slices-middle", "Window", "Slices through the middle", (), bind(with_slices, at=_CENTRE)
    ),
    Command(
        "slices-greys", "Window", "Slices' greys by the values", (), bind(with_slices, greys=None)
    ),
    switch("interface.overlays.outlines", "outlines", "Window", "Slices' outlines in the picture"),
    Command(
        "patient", "Window", "Directions by the patient's body", (), _toggle_patient, _shows_patient
    ),
    *(
        Command(f"{plane.lower()}-{to}", "", f"{plane} slice {to}", (key,), bind(step_slice, i, by))
        for i, (plane, pages) in enumerate(_PAGES)
        for to, key, by in pages
    ),
)
