"""Rules that a state keeps through every edit, however it was made.

state, edited state -> [rules] -> state, messages
"""

from __future__ import annotations

from volspec.viewer.model.fields import with_all_fields
from volspec.viewer.model.history import ONE_VIEW, without_cast
from volspec.viewer.model.meshes import with_own_materials
from volspec.viewer.model.room import LIGHTS, with_room_light
from volspec.viewer.model.state import ViewState

_RULES = without_cast, with_room_light, with_all_fields, with_own_materials
ONCE = ONE_VIEW, LIGHTS
"""Messages of drags, which need not be shown again while they are."""


def hold(old: ViewState, new: ViewState) -> tuple[ViewState, list[str]]:
    """Return an edited state without what its document does not allow, and messages on that."""
    messages = []
    for rule in _RULES if new.document.is_of(old.document) else ():
        new, message, _ = rule(old, new)
        messages.append(message)
    return new, list(filter(None, messages))
