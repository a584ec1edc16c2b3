"""Events and actions of the lights: weights, dial, solo, mute, the divide.

mouse, keys -> [lights] -> rows
"""

from __future__ import annotations

from dataclasses import replace

from volspec.viewer import lighting
from volspec.viewer.events.event import Action, Event, Reducer
from volspec.viewer.state import ViewState


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


def _divide(state: ViewState, event: Event) -> ViewState:
    return replace(state, divide=min(max(event.x, 0.02), 0.98))


def _next_light(state: ViewState) -> ViewState:
    index = (lighting.brightest(state.lights) + 1) % len(state.lights)
    lit = replace(state, lights=lighting.alone(state.lights, index))
    return replace(lit, interface=replace(lit.interface, light=index))


def _compare(state: ViewState) -> ViewState:
    """Keep the present lights at the right of a divide, or end that."""
    return replace(state, other=None if state.other else state.lights, divide=0.5)


EVENTS: dict[str, Reducer] = {
    "weight": _weight,
    "kelvin": _kelvin,
    "dial": _dial,
    "solo": _solo,
    "mute": _mute,
    "remove": _remove,
    "select": _select,
    "divide": _divide,
}


def _error_map(state: ViewState) -> ViewState:
    return replace(state, error_map=not state.error_map)


def _mark(state: ViewState) -> ViewState:
    """Hatch what the display cannot show, or no longer."""
    seen = state.seen
    display = replace(seen.viewing.display, mark=not seen.viewing.display.mark)
    return replace(state, seen=replace(seen, viewing=replace(seen.viewing, display=display)))


ACTIONS = (
    Action("next-light", "Light", "Next light alone", ("space",), _next_light),
    Action(
        "compare",
        "Light",
        "Keep this light beside the next",
        ("b",),
        _compare,
        lambda state: state.other is not None,
    ),
    Action("error-map", "View", "Error map", ("e",), _error_map, lambda s: s.error_map),
    Action(
        *("mark", "View", "Mark what the display cannot show", ("m",), _mark),
        lambda s: s.seen.viewing.display.mark,
    ),
)
