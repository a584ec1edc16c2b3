"""Edits and commands of saved light states: save, recall, rename, delete.

keys, panels -> [light_states_edits] -> state
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

from volspec.viewer.model.edit import Change, Command, Edited, edit
from volspec.viewer.model.light_states import (
    MOST_SECONDS,
    MOST_STATES,
    Fade,
    LightState,
    named_anew,
    recalled,
)
from volspec.viewer.model.lights import brightest
from volspec.viewer.model.state import ViewState


@edit
def save(state: ViewState) -> ViewState:
    """Save the present lights and viewing as a state."""
    if len(state.kept) >= MOST_STATES:
        return state
    new = LightState(named_anew(state.kept), state.lights, state.seen)
    return replace(state, kept=(*state.kept, new))


def _saved(state: ViewState) -> Edited:
    new = save(state)
    full = f"{MOST_STATES} saved states are the most; delete one first"
    return Edited(new, full if new is state else "")


@edit
def save_over(state: ViewState, index: int) -> ViewState:
    """Replace a saved state by the present lights and viewing."""
    return _with(state, index, lights=state.lights, seen=state.seen)


@edit
def rename(state: ViewState, index: int, name: str) -> ViewState:
    """Rename a saved state, if the name is one and free."""
    name = " ".join(name.split())
    if not name or any(kept.name == name for kept in state.kept):
        return state
    return _with(state, index, name=name)


@edit
def delete(state: ViewState, index: int) -> ViewState:
    """Delete a saved state."""
    if not 0 <= index < len(state.kept):
        return state
    return replace(state, kept=(*state.kept[:index], *state.kept[index + 1 :]))


@edit
def recall(state: ViewState, index: int) -> ViewState:
    """Take the lights and the viewing of a saved state; the way there is a fade."""
    if not 0 <= index < len(state.kept):
        return state
    saved = state.kept[index]
    fade = Fade(state.lights, state.seen, state.interface.fade_s)
    rows = recalled(state.lights, saved.lights)
    interface = replace(state.interface, light=brightest(rows))
    return replace(state, lights=rows, seen=saved.seen, fade=fade, interface=interface)


@edit
def set_fade(state: ViewState, seconds: float) -> ViewState:
    """Set how long fades take, in seconds."""
    seconds = min(max(seconds, 0.0), MOST_SECONDS)
    return replace(state, interface=replace(state.interface, fade_s=seconds))


def _with(state: ViewState, index: int, **changes: Any) -> ViewState:
    if not 0 <= index < len(state.kept):
        return state
    new = replace(state.kept[index], **changes)
    return replace(state, kept=(*state.kept[:index], new, *state.kept[index + 1 :]))


def _recall(index: int) -> Change:
    return lambda state: recall(state, index)


COMMANDS = (
    Command("save-state", "Light", "Save these lights as a state", ("alt+s",), _saved),
    *(
        Command(f"recall-{i}", "Light", f"Fade to state {i}", (f"alt+{i}",), _recall(i - 1))
        for i in range(1, 10)
    ),
)
