"""What input does to a state: pure functions, whatever comes.

window -> Event -> [events] -> state

One module for each part of the state; each has its ``EVENTS`` by name and its ``ACTIONS``.
"""

from __future__ import annotations

import math

from volspec.viewer.model import (
    camera_edits,
    cuts_edits,
    interface_edits,
    light_states_edits,
    lights_edits,
    palette_edits,
    slices_edits,
    transfer_edits,
    viewing,
)
from volspec.viewer.model.event import Event, Reducer
from volspec.viewer.model.state import ViewState

__all__ = ["EVENTS", "Event", "reduced"]

EVENTS: dict[str, Reducer] = {
    **camera_edits.EVENTS,
    **lights_edits.EVENTS,
    **lights_edits.ROW_EVENTS,
    **light_states_edits.EVENTS,
    **viewing.EVENTS,
    **transfer_edits.EVENTS,
    **cuts_edits.EVENTS,
    **slices_edits.EVENTS,
    **palette_edits.EVENTS,
    **interface_edits.EVENTS,
}


def reduced(state: ViewState, event: Event) -> ViewState:
    """The state after an event; what makes no sense changes nothing."""
    if not (math.isfinite(event.x) and math.isfinite(event.y)):
        return state
    return EVENTS[event.name](state, event)
