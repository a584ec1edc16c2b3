"""Events of the transfer function: its points dragged, added, removed, shifted.

mouse -> [curve] -> Transfer
"""

from __future__ import annotations

from dataclasses import replace

from volspec.transfer import TransferFunction
from volspec.viewer import curves
from volspec.viewer.events.event import Action, Event, Reducer
from volspec.viewer.state import ViewState


def _point(state: ViewState, event: Event) -> ViewState:
    if not isinstance(state.transfer, TransferFunction):
        return state
    value = _within(state, event.x)
    return replace(state, transfer=curves.moved(state.transfer, event.index, value, event.y))


def _add_point(state: ViewState, event: Event) -> ViewState:
    if not isinstance(state.transfer, TransferFunction):
        return state
    return replace(state, transfer=curves.added(state.transfer, _within(state, event.x), event.y))


def _remove_point(state: ViewState, event: Event) -> ViewState:
    if not isinstance(state.transfer, TransferFunction):
        return state
    return replace(state, transfer=curves.removed(state.transfer, event.index))


def _shift(state: ViewState, event: Event) -> ViewState:
    if not isinstance(state.transfer, TransferFunction):
        return state
    low, high = state.document.volume.range
    shift = min(max(event.x, low - high), high - low)
    moved = curves.shifted(state.transfer, shift - state.shift)
    return replace(state, transfer=moved, shift=shift)


def _within(state: ViewState, value: float) -> float:
    low, high = state.document.volume.range
    return min(max(value, low), high)


def _reset(state: ViewState) -> ViewState:
    return replace(state, transfer=state.document.transfer, shift=0.0)


EVENTS: dict[str, Reducer] = {
    "point": _point,
    "add-point": _add_point,
    "remove-point": _remove_point,
    "shift": _shift,
}

ACTIONS = (Action("reset-transfer", "Edit", "The scene's own transfer function", (), _reset),)
