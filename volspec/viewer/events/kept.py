"""Events of saved light states: recalled, saved over, renamed, deleted, and how long a fade takes.

panel -> [kept] -> lightstates -> state
"""

from __future__ import annotations

from volspec.viewer.events import lightstates
from volspec.viewer.events.event import Reducer

EVENTS: dict[str, Reducer] = {
    "recall-state": lambda state, event: lightstates.recall(state, event.index),
    "save-over-state": lambda state, event: lightstates.saved_over(state, event.index),
    "rename-state": lambda state, event: lightstates.renamed(state, event.index, event.key),
    "delete-state": lambda state, event: lightstates.deleted(state, event.index),
    "fade": lambda state, event: lightstates.fade_lasting(state, event.x),
}
