"""What input does to a state: a pure function, whatever comes.

window -> Event -> [events] -> state
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace

from volspec.transfer import TransferFunction
from volspec.viewer import curves, lighting
from volspec.viewer.state import ViewState
from volspec.viewer.views import VIEWS

# Of one notch of the wheel, as a share of the picture's height.
WHEEL = 0.06


@dataclass(frozen=True, slots=True)
class Event:
    """Something that happened.

    Parameters
    ----------
    name : str
        One of `EVENTS`.
    x, y : float
        Of a drag: shares of the picture's height to the right and down. Of the dial: the place.
        Of a slider: ``x`` its value. Of the divide: ``x`` its share of the picture's width.
    index : int
        Of the light or the point that is meant.
    key : str
        As in `KEYS`.
    """

    name: str
    x: float = 0.0
    y: float = 0.0
    index: int = 0
    key: str = ""


def reduced(state: ViewState, event: Event) -> ViewState:
    """The state after an event; what makes no sense changes nothing."""
    if not (math.isfinite(event.x) and math.isfinite(event.y)):
        return state
    return EVENTS[event.name](state, event)


def _orbit(state: ViewState, event: Event) -> ViewState:
    return replace(state, view=state.view.orbited(event.x, event.y))


def _pan(state: ViewState, event: Event) -> ViewState:
    return replace(state, view=state.view.panned(event.x, event.y, state.document.volume))


def _zoom(state: ViewState, event: Event) -> ViewState:
    return replace(state, view=state.view.zoomed(-event.y))


def _wheel(state: ViewState, event: Event) -> ViewState:
    return replace(state, view=state.view.zoomed(WHEEL * event.y))


def _divide(state: ViewState, event: Event) -> ViewState:
    return replace(state, divide=min(max(event.x, 0.02), 0.98))


def _key(state: ViewState, event: Event) -> ViewState:
    return KEYS[event.key](state) if event.key in KEYS else state


def _weight(state: ViewState, event: Event) -> ViewState:
    return replace(state, lights=lighting.weighted(state.lights, event.index, event.x))


def _kelvin(state: ViewState, event: Event) -> ViewState:
    return replace(state, lights=lighting.heated(state.lights, event.index, event.x))


def _dial(state: ViewState, event: Event) -> ViewState:
    return replace(state, lights=lighting.blended(state.lights, event.x, event.y))


def _solo(state: ViewState, event: Event) -> ViewState:
    return _toggled(state, event.index, "solo")


def _mute(state: ViewState, event: Event) -> ViewState:
    return _toggled(state, event.index, "muted")


def _toggled(state: ViewState, index: int, name: str) -> ViewState:
    if not 0 <= index < len(state.lights):
        return state
    on = not getattr(state.lights[index], name)
    return replace(state, lights=lighting.changed(state.lights, index, **{name: on}))


def _remove(state: ViewState, event: Event) -> ViewState:
    return replace(state, lights=lighting.removed(state.lights, event.index))


def _select(state: ViewState, event: Event) -> ViewState:
    if not 0 <= event.index < len(state.lights):
        return state
    return replace(state, interface=replace(state.interface, light=event.index))


def _point(state: ViewState, event: Event) -> ViewState:
    if not isinstance(state.transfer, TransferFunction):
        return state
    low, high = state.document.volume.range
    value = min(max(event.x, low), high)
    return replace(state, transfer=curves.moved(state.transfer, event.index, value, event.y))


def _add_point(state: ViewState, event: Event) -> ViewState:
    if not isinstance(state.transfer, TransferFunction):
        return state
    low, high = state.document.volume.range
    value = min(max(event.x, low), high)
    return replace(state, transfer=curves.added(state.transfer, value, event.y))


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


def _from_side(key: str) -> Callable[[ViewState], ViewState]:
    return lambda state: replace(state, view=state.view.from_side(key))


def _projection(state: ViewState) -> ViewState:
    return replace(state, view=replace(state.view, orthographic=not state.view.orthographic))


def _reset(state: ViewState) -> ViewState:
    return replace(state, view=state.document.view)


def _fit(state: ViewState) -> ViewState:
    width, height = state.size
    return replace(state, view=state.view.fitted(width / height))


def _next_light(state: ViewState) -> ViewState:
    index = (lighting.brightest(state.lights) + 1) % len(state.lights)
    lit = replace(state, lights=lighting.alone(state.lights, index))
    return replace(lit, interface=replace(lit.interface, light=index))


def _compare(state: ViewState) -> ViewState:
    """Keep the present lights at the right of a divide, or end that."""
    return replace(state, other=None if state.other else state.lights, divide=0.5)


def _cheat_sheet(state: ViewState) -> ViewState:
    return replace(state, interface=replace(state.interface, keys=not state.interface.keys))


def _theme(state: ViewState) -> ViewState:
    return replace(state, interface=replace(state.interface, dark=not state.interface.dark))


KEYS: dict[str, Callable[[ViewState], ViewState]] = {
    **{key: _from_side(key) for key in VIEWS},
    "5": _projection,
    "enter": _reset,
    "f": _fit,
    "b": _compare,
    "h": _cheat_sheet,
    "space": _next_light,
    "t": _theme,
}

EVENTS: dict[str, Callable[[ViewState, Event], ViewState]] = {
    "orbit": _orbit,
    "pan": _pan,
    "zoom": _zoom,
    "wheel": _wheel,
    "divide": _divide,
    "key": _key,
    "weight": _weight,
    "kelvin": _kelvin,
    "dial": _dial,
    "solo": _solo,
    "mute": _mute,
    "remove": _remove,
    "select": _select,
    "point": _point,
    "add-point": _add_point,
    "remove-point": _remove_point,
    "shift": _shift,
}
