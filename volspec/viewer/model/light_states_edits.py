"""Saved light states: kept, recalled with a fade, renamed, deleted.

keys, panels -> [lightstates] -> state
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

from volspec.viewer.model.event import Action, Change, Reducer
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


def saved(state: ViewState) -> ViewState:
    """The present lights and viewing as one saved state more."""
    if len(state.kept) >= MOST_STATES:
        return state
    new = LightState(named_anew(state.kept), state.lights, state.seen)
    return replace(state, kept=(*state.kept, new))


def _full(state: ViewState) -> str:
    """Why no more is saved."""
    if len(state.kept) < MOST_STATES:
        return ""
    return f"{MOST_STATES} saved states are the most; delete one first"


def saved_over(state: ViewState, index: int) -> ViewState:
    """The present lights and viewing in place of those of a saved state."""
    return _with(state, index, lights=state.lights, seen=state.seen)


def renamed(state: ViewState, index: int, name: str) -> ViewState:
    """A saved state under another name, if that is one and free."""
    name = " ".join(name.split())
    if not name or any(kept.name == name for kept in state.kept):
        return state
    return _with(state, index, name=name)


def deleted(state: ViewState, index: int) -> ViewState:
    """Without one of the saved states."""
    if not 0 <= index < len(state.kept):
        return state
    return replace(state, kept=(*state.kept[:index], *state.kept[index + 1 :]))


def recall(state: ViewState, index: int) -> ViewState:
    """The lights and the viewing of a saved state; the way there is shown as a fade."""
    if not 0 <= index < len(state.kept):
        return state
    saved = state.kept[index]
    fade = Fade(state.lights, state.seen, state.interface.fade_s)
    rows = recalled(state.lights, saved.lights)
    interface = replace(state.interface, light=brightest(rows))
    return replace(state, lights=rows, seen=saved.seen, fade=fade, interface=interface)


def fade_lasting(state: ViewState, seconds: float) -> ViewState:
    """How long fades take from now on."""
    seconds = min(max(seconds, 0.0), MOST_SECONDS)
    return replace(state, interface=replace(state.interface, fade_s=seconds))


def _with(state: ViewState, index: int, **changes: Any) -> ViewState:
    if not 0 <= index < len(state.kept):
        return state
    new = replace(state.kept[index], **changes)
    return replace(state, kept=(*state.kept[:index], new, *state.kept[index + 1 :]))


EVENTS: dict[str, Reducer] = {
    "recall-state": lambda state, event: recall(state, event.index),
    "save-over-state": lambda state, event: saved_over(state, event.index),
    "rename-state": lambda state, event: renamed(state, event.index, event.key),
    "delete-state": lambda state, event: deleted(state, event.index),
    "fade": lambda state, event: fade_lasting(state, event.x),
}


def _recall(index: int) -> Change:
    return lambda state: recall(state, index)


ACTIONS = (
    Action(
        *("save-state", "Light", "Save these lights as a state", ("alt+s",), saved),
        refusal=_full,
    ),
    *(
        Action(f"recall-{i}", "Light", f"Fade to state {i}", (f"alt+{i}",), _recall(i - 1))
        for i in range(1, 10)
    ),
)
