"""Slices and what else is drawn over the picture: planes, layouts, the patient's directions.

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

from volspec.viewer.model.cuts import toggle_aid, with_aids
from volspec.viewer.model.edit import Change, Command, edit
from volspec.viewer.model.state import Slices, ViewState
from volspec.volume import Volume

# Shares of the voxels between which greys run unless they are set.
_MOST = (0.005, 0.995)
# What the negative and the positive world axes point to in ITK's LPS frame (docs/conventions.md).
PATIENT = (("R", "L"), ("A", "P"), ("I", "S"))
AXES = (("-x", "+x"), ("-y", "+y"), ("-z", "+z"))
# A second letter where a direction leans so much, about 15 degrees.
_LEANS = 0.26


@dataclass(frozen=True, slots=True)
class Plane:
    """One family of slices, by the world's axes.

    Parameters
    ----------
    name : str
    normal : int
        The world's axis it is across.
    across, down : (axis, sign)
        Where its picture's columns and rows run to.
    """

    name: str
    normal: int
    across: tuple[int, int]
    down: tuple[int, int]


# As radiologists look: from the feet, the face and the patient's left.
PLANES = (
    Plane("Axial", 2, (0, 1), (1, 1)),
    Plane("Coronal", 1, (0, 1), (2, -1)),
    Plane("Sagittal", 0, (1, 1), (2, -1)),
)


@dataclass(frozen=True, slots=True)
class Layout:
    """A plane among a volume's own axes, those nearest to the world's.

    Parameters
    ----------
    normal, across, down : int
        Axes of the voxels: 0 is x.
    flipped : (across, down)
        Whether the picture runs against them.
    """

    normal: int
    across: int
    down: int
    flipped: tuple[bool, bool]


def layout_of(volume: Volume, plane: Plane) -> Layout:
    """How a plane's slices lie in a volume."""
    return _layout(tuple(volume.world_from_index[:3, :3].ravel().tolist()), plane)


# By the matrix, as a cache of volumes would keep those that were closed.
@lru_cache(maxsize=16)
def _layout(matrix: tuple[float, ...], plane: Plane) -> Layout:
    columns = np.reshape(matrix, (3, 3))
    directions = columns / np.linalg.norm(columns, axis=0)
    best = max(
        permutations(range(3)),
        key=lambda order: sum(abs(directions[world, own]) for world, own in enumerate(order)),
    )

    def runs(toward: tuple[int, int]) -> tuple[int, bool]:
        world, sign = toward
        own = best[world]
        return own, bool(sign * directions[world, own] < 0)

    (across, back), (down, up) = runs(plane.across), runs(plane.down)
    return Layout(best[plane.normal], across, down, (back, up))


def number_of(volume: Volume, axis: int, share: float) -> int:
    """The voxel at a share of an axis."""
    return round(min(max(share, 0.0), 1.0) * (volume.shape_xyz[axis] - 1))


def slice_values(volume: Volume, layout: Layout, number: int, step: int = 1) -> NDArray[np.generic]:
    """(rows, columns) values of a slice as it is looked at, every ``step``-th: a view."""
    at: list[int | slice] = [slice(None, None, step)] * 3
    at[2 - layout.normal] = number
    values = volume.values[tuple(at)]
    if layout.across > layout.down:  # the array's last axis is the volume's first
        values = values.T
    back, up = layout.flipped
    return values[:: -1 if up else 1, :: -1 if back else 1]


def size_mm(volume: Volume, layout: Layout) -> tuple[float, float]:
    """Width and height of what a slice shows."""
    width, height = (
        volume.shape_xyz[axis] * volume.spacing_mm[axis] for axis in (layout.across, layout.down)
    )
    return width, height


def crossing_place(volume: Volume, layout: Layout, slices: Slices) -> tuple[float, float]:
    """Where the other two slices cross this one's picture, 0 to 1 to the right and down."""
    x, y = (
        (number_of(volume, axis, slices.at[axis]) + 0.5) / volume.shape_xyz[axis]
        for axis in (layout.across, layout.down)
    )
    back, up = layout.flipped
    return 1 - x if back else x, 1 - y if up else y


def crop_extent(
    volume: Volume, layout: Layout, crop: Sequence[tuple[float, float]]
) -> tuple[float, float, float, float]:
    """What a crop leaves of a slice's picture: left, top, right and bottom, 0 to 1."""
    edges = []
    for axis, back in zip((layout.across, layout.down), layout.flipped, strict=True):
        # From the outer sides of the first and the last voxel that are left.
        low, high = crop[axis][0], crop[axis][1] + 1.0
        ends = low / volume.shape_xyz[axis], high / volume.shape_xyz[axis]
        edges.append((1 - ends[1], 1 - ends[0]) if back else ends)
    (left, right), (top, bottom) = edges
    return left, top, right, bottom


def shares_pointed_at(
    volume: Volume, layout: Layout, slices: Slices, x: float, y: float
) -> tuple[float, float, float]:
    """`Slices.at` when the other two go where a slice's picture is pointed at."""
    at = list(slices.at)
    back, up = layout.flipped
    for axis, share in ((layout.across, 1 - x if back else x), (layout.down, 1 - y if up else y)):
        count = volume.shape_xyz[axis]
        number = min(max(round(share * count - 0.5), 0), count - 1)
        at[axis] = number / (count - 1)
    return at[0], at[1], at[2]


def is_patient(volume: Volume, said: bool | None) -> bool:
    """Whether directions are a patient's: what was said, or whether a file gave an orientation.

    Files without one have their first voxel at the origin and their axes along the world's.
    """
    if said is not None:
        return said
    matrix = volume.world_from_index
    return not np.array_equal(matrix[:3], np.diag([*volume.spacing_mm, 1.0])[:3])


def direction_letters(direction: NDArray[np.float64], patient: bool) -> str:
    """Where a direction of the world points, by its greatest parts.

    >>> [direction_letters(np.array(at), True) for at in ([-1.0, 0.0, 0.0], [0.0, 0.6, 0.8])]
    ['R', 'SP']
    """
    names = PATIENT if patient else AXES
    parts = direction / max(float(np.linalg.norm(direction)), 1e-12)
    order = np.argsort(-np.abs(parts), kind="stable")
    leaning = [i for i in order[: 2 if patient else 1] if abs(parts[i]) > _LEANS]
    return "".join(names[i][int(parts[i] > 0)] for i in leaning)


def edge_letters(volume: Volume, layout: Layout, patient: bool) -> tuple[str, str, str, str]:
    """At the left, right, upper and lower edge of a slice."""
    matrix = tuple(volume.world_from_index[:3, :3].ravel().tolist())
    return _edge_letters(matrix, layout, patient)


@lru_cache(maxsize=16)
def _edge_letters(
    matrix: tuple[float, ...], layout: Layout, patient: bool
) -> tuple[str, str, str, str]:
    columns, said = np.reshape(matrix, (3, 3)), []
    for axis, back in zip((layout.across, layout.down), layout.flipped, strict=True):
        toward = columns[:, axis] * (-1 if back else 1)
        said += [direction_letters(-toward, patient), direction_letters(toward, patient)]
    return said[0], said[1], said[2], said[3]


def outline_index(volume: Volume, axis: int, share: float) -> NDArray[np.float64]:
    """(4, 3) corners of the slice across an axis of the voxels, in voxels."""
    last = np.array(volume.shape_xyz) - 1.0
    first, second = (other for other in range(3) if other != axis)
    corners = np.zeros((4, 3))
    corners[:, axis] = number_of(volume, axis, share)
    corners[1:3, first], corners[2:, second] = last[first], last[second]
    return corners


def window_of(slices: Slices, histogram: NDArray[np.float64]) -> tuple[float, float]:
    """What is black and white, 0 to 1 of a volume's range: as set, or where most values lie."""
    if slices.greys is not None:
        return slices.greys
    # What surrounds things, mostly of the least value, would else be most.
    counts = np.r_[0.0, histogram[1:]]
    if not counts.any():
        return 0.0, 1.0
    below = np.cumsum(counts) / counts.sum()
    low, high = (int(np.searchsorted(below, share)) for share in _MOST)
    return low / len(counts), (high + 1) / len(counts)


# The least part of the range between black and white.
_NARROWEST = 0.002


def with_slices(state: ViewState, **changes: Any) -> ViewState:
    """Other slices."""
    slices = replace(state.interface.slices, **changes)
    return replace(state, interface=replace(state.interface, slices=slices))


@edit
def move_slice(state: ViewState, plane: int, share: float) -> ViewState:
    """Move a plane to a share of its axis."""
    if not 0 <= plane < len(PLANES):
        return state
    axis = layout_of(state.document.volume, PLANES[plane]).normal
    at = list(state.interface.slices.at)
    at[axis] = min(max(share, 0.0), 1.0)
    return with_slices(state, at=tuple(at))


@edit
def step_slice(state: ViewState, plane: int, steps: float) -> ViewState:
    """Move a plane by slices: up, to the back or to the patient's left."""
    if not 0 <= plane < len(PLANES):
        return state
    volume, which = state.document.volume, PLANES[plane]
    axis = layout_of(volume, which).normal
    last = volume.shape_xyz[axis] - 1
    rising = volume.world_from_index[which.normal, axis] >= 0
    number = number_of(volume, axis, state.interface.slices.at[axis])
    return move_slice(state, plane, (number + (steps if rising else -steps)) / last)


@edit
def point_at(state: ViewState, plane: int, x: float, y: float) -> ViewState:
    """Move the other two planes to a place in one's picture, in shares of its sides."""
    if not 0 <= plane < len(PLANES):
        return state
    volume = state.document.volume
    layout = layout_of(volume, PLANES[plane])
    return with_slices(
        state, at=shares_pointed_at(volume, layout, state.interface.slices, _share(x), _share(y))
    )


@edit
def set_greys(state: ViewState, black: float, white: float) -> ViewState:
    """Set black and white, in shares of the volume's range."""
    low = min(_share(black), 1.0 - _NARROWEST)
    return with_slices(state, greys=(low, max(_share(white), low + _NARROWEST)))


def _share(value: float) -> float:
    return min(max(value, 0.0), 1.0)


def _lit(state: ViewState) -> ViewState:
    return with_slices(state, lit=not state.interface.slices.lit)


def _all_greys(state: ViewState) -> ViewState:
    return with_slices(state, greys=None)


def _centred(state: ViewState) -> ViewState:
    return with_slices(state, at=Slices().at)


def _patient(state: ViewState) -> ViewState:
    now = is_patient(state.document.volume, state.interface.aids.patient)
    return with_aids(state, patient=not now)


def _stepping(plane: int, steps: float) -> Change:
    return lambda state: step_slice(state, plane, steps)


# Up or down a page, with these held; the plane's name, and what it then moves to.
_PAGES = (
    ("", "Axial", ("down", "up")),
    ("shift+", "Coronal", ("forward", "backward")),
    ("ctrl+", "Sagittal", ("right", "left")),
)
COMMANDS = (
    Command(
        *("slices-lit", "Window", "Slices under the lights", (), _lit),
        lambda s: s.interface.slices.lit,
    ),
    Command("slices-middle", "Window", "Slices through the middle", (), _centred),
    Command("slices-greys", "Window", "Slices' greys by the values", (), _all_greys),
    Command(
        *("outlines", "Window", "Slices' outlines in the picture", (), toggle_aid("outlines")),
        lambda s: s.interface.aids.outlines,
    ),
    Command(
        *("patient", "Window", "Directions by the patient's body", (), _patient),
        lambda s: is_patient(s.document.volume, s.interface.aids.patient),
    ),
    *(
        Command(
            *(f"{plane.lower()}-{to}", "", f"{plane} slice {to}", (f"{held}page{key}",)),
            _stepping(i, by),
        )
        for i, (held, plane, names) in enumerate(_PAGES)
        for to, key, by in zip(names, ("down", "up"), (-1.0, 1.0), strict=True)
    ),
)
