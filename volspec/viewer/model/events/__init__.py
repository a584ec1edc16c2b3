"""What input does to a state: pure functions, whatever comes.

window -> Event -> [events] -> state

One module for each part of the state; each has its ``EVENTS`` by name and its ``ACTIONS``.
"""

from __future__ import annotations

import math

from volspec.viewer.model.events import (
    camera,
    curve,
    cuts,
    interface,
    lights,
    lightstates,
    palette,
    rows,
    slices,
    viewing,
)
from volspec.viewer.model.events.event import Event, Reducer
from volspec.viewer.model.state import ViewState

__all__ = ["EVENTS", "Event", "reduced"]

EVENTS: dict[str, Reducer] = {
    **camera.EVENTS,
    **lights.EVENTS,
    **rows.EVENTS,
    **lightstates.EVENTS,
    **viewing.EVENTS,
    **curve.EVENTS,
    **cuts.EVENTS,
    **slices.EVENTS,
    **palette.EVENTS,
    **interface.EVENTS,
}


def reduced(state: ViewState, event: Event) -> ViewState:
    """The state after an event; what makes no sense changes nothing."""
    if not (math.isfinite(event.x) and math.isfinite(event.y)):
        return state
    return EVENTS[event.name](state, event)
