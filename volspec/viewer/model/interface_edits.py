"""Edits of the window alone: what is chosen in panels, and how they are drawn.

    panels, command palette -> [interface_edits] -> Interface

They are no steps of undo, and no picture changes.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

from volspec.viewer.model.edit import Change, edit
from volspec.viewer.model.palette_spectra import columns
from volspec.viewer.model.palette_table import picked
from volspec.viewer.model.palette_targets import DISTANCES
from volspec.viewer.model.state import ViewState


def toggled(name: str) -> Change:
    """Return an edit that turns a part of the interface on or off."""

    def change(state: ViewState) -> ViewState:
        other: dict[str, Any] = {name: not getattr(state.interface, name)}
        return replace(state, interface=replace(state.interface, **other))

    return change


@edit
def open_viewing(state: ViewState) -> ViewState:
    """Open the panel of the viewing's settings."""
    panels = state.interface.panels | {"Viewing"}
    return replace(state, interface=replace(state.interface, panels=panels))


def _with_pick(state: ViewState, **changes: Any) -> ViewState:
    """Change what wizards are about."""
    pick = replace(state.interface.pick, **changes)
    return replace(state, interface=replace(state.interface, pick=pick))


@edit
def pick_material(state: ViewState, name: str) -> ViewState:
    """Pick the material that wizards are about."""
    if name not in state.transfer.materials:
        return state
    return _with_pick(state, place=(name, picked(state)[1]))


@edit
def pick_light(state: ViewState, name: str) -> ViewState:
    """Pick the light that wizards are about."""
    if name not in columns(state.lights):
        return state
    return _with_pick(state, place=(picked(state)[0], name))


@edit
def pick_like(state: ViewState, name: str) -> ViewState:
    """Pick the light that a new one is to be like; none by an empty name."""
    return _with_pick(state, like=name)


@edit
def pick_within(state: ViewState, name: str) -> ViewState:
    """Pick the material to hide in; an empty name is what surrounds it."""
    return _with_pick(state, within=name, black=False)


@edit
def pick_black(state: ViewState) -> ViewState:
    """Have a material hidden in black."""
    return _with_pick(state, within="", black=True)


@edit
def pick_distance(state: ViewState, distance: float) -> ViewState:
    """Set how far a revealed material is to stand out."""
    return _with_pick(state, distance=min(max(distance, DISTANCES[0]), DISTANCES[1]))


@edit
def toggle_merged(state: ViewState, name: str) -> ViewState:
    """Merge a material with others, or no longer."""
    return _with_pick(state, materials=state.interface.pick.materials ^ {name})


@edit
def pick_values(state: ViewState, first: float, last: float) -> ViewState:
    """Pick the values that a material is assigned to."""
    return _with_pick(state, values=(min(first, last), max(first, last)))


@edit
def pick_use(state: ViewState, name: str) -> ViewState:
    """Pick the material that is assigned to values."""
    return _with_pick(state, use=name)
