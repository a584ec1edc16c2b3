"""The room around a volume: the eye's conditions in it, and edits of its paints.

panel, commands -> [room] -> SceneRoom of the state -> relight
"""

from __future__ import annotations

from dataclasses import asdict, replace
from functools import lru_cache
from typing import TYPE_CHECKING

from volspec.basis import SpectralBasis
from volspec.relight import RelightSpec
from volspec.scene.specs import CameraSpec
from volspec.viewer.model.state import ViewState
from volspec.viewer.model.view import View

if TYPE_CHECKING:
    from volspec.scene.room import SceneRoom

PANEL = "Room"
WALLS = "walls"


def shown_spec(state: ViewState) -> RelightSpec:
    """Return the viewing conditions of the picture: in a room, those of an eye in it."""
    if state.room is None:
        return state.relight
    return _spec_in_room(state.relight, state.room, state.view)


# Few, as each keeps a room; always the same object, as caches compare specs by identity.
@lru_cache(maxsize=8)
def _spec_in_room(spec: RelightSpec, room: SceneRoom, view: View) -> RelightSpec:
    return replace(spec, viewing=room.viewing(spec.viewing, CameraSpec(**asdict(view))))


def light_names(state: ViewState) -> tuple[str, ...]:
    """Return the groups that lights may shine from: light groups, or the room's lamps."""
    if state.room is not None:
        return state.room.response.names
    return tuple(group.name for group in state.shading.groups)


def solved(state: ViewState) -> ViewState:
    """Return the state with its room solved, which takes a fraction of a second."""
    return state if state.room is None else replace(state, room=state.room.solved())


def has_walls(state: ViewState) -> bool:
    """Return True if the room is seen: a basis of materials has no channels for it."""
    basis = state.transfer.basis
    return state.room is not None and state.room.spec.walls and isinstance(basis, SpectralBasis)
