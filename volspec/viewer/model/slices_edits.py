"""Edits and commands of the slices: moved, pointed at, lit or grey.

mouse, keys -> [slices_edits] -> Slices
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

from volspec.viewer.model.cuts_edits import flipped, with_aids
from volspec.viewer.model.edit import Change, Command, edit
from volspec.viewer.model.slices import PLANES, Slices, is_patient, layout_of, number_of, pointed
from volspec.viewer.model.state import ViewState

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
        state, at=pointed(volume, layout, state.interface.slices, _share(x), _share(y))
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
        *("outlines", "Window", "Slices' outlines in the picture", (), flipped("outlines")),
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
