"""Events and actions of what is cut away: the crop's box and the clip planes.

mouse, keys -> [cuts] -> RaycastSpec
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

from volspec.viewer.model import cuts
from volspec.viewer.model.camera import Vector, vector
from volspec.viewer.model.event import Action, Change, Event, Reducer
from volspec.viewer.model.state import ViewState

# Beyond this no volume reaches, and float64 keeps its digits.
_MOST = 1e9


def _crop(state: ViewState, event: Event) -> ViewState:
    at = min(max(event.x, -_MOST), _MOST)
    volume = state.document.volume
    return replace(state, shading=cuts.cropped(state.shading, volume, event.index, at))


def _shift(state: ViewState, event: Event) -> ViewState:
    volume = state.document.volume
    return replace(state, shading=cuts.shifted(state.shading, volume, event.index, event.x))


def _tilt(state: ViewState, event: Event) -> ViewState:
    volume, shading = state.document.volume, state.shading
    elevation = min(max(event.y, -90.0), 90.0)
    tilted = cuts.tilted(shading, volume, event.index, event.x, elevation)
    return replace(state, shading=tilted)


def _flip(state: ViewState, event: Event) -> ViewState:
    return replace(state, shading=cuts.flipped(state.shading, event.index))


def _remove(state: ViewState, event: Event) -> ViewState:
    return replace(state, shading=cuts.changed(state.shading, event.index, None))


def _select(state: ViewState, event: Event) -> ViewState:
    if not 0 <= event.index < len(state.shading.clip_planes):
        return state
    return with_aids(state, plane=event.index)


def with_aids(state: ViewState, **changes: Any) -> ViewState:
    """Other things over the picture."""
    aids = replace(state.interface.aids, **changes)
    return replace(state, interface=replace(state.interface, aids=aids))


def flipped(name: str) -> Change:
    """Shows or hides something over the picture."""
    return lambda state: with_aids(state, **{name: not getattr(state.interface.aids, name)})


def _added(state: ViewState, normal: Vector) -> ViewState:
    shading = cuts.with_plane(state.shading, state.document.volume, normal)
    if shading is state.shading:
        return state
    chosen = with_aids(state, plane=len(shading.clip_planes) - 1, planes=True)
    return replace(chosen, shading=shading)


def _facing(state: ViewState) -> Vector:
    """What is before the middle is cut away."""
    return vector(state.view.camera(state.document.volume).frame()[2])


def _along(axis: int) -> Callable[[ViewState], Vector]:
    """Across an axis of the voxels, which are those of the slices."""
    return lambda state: vector(state.document.volume.world_from_index[:3, axis])


def _adding(
    name: str, title: str, keys: tuple[str, ...], normal: Callable[[ViewState], Vector]
) -> Action:
    """Adds a plane with the normal that a state gives."""

    def refusal(state: ViewState) -> str:
        return cuts.no_plane(state.shading, state.document.volume, normal(state))

    def change(state: ViewState) -> ViewState:
        return _added(state, normal(state))

    return Action(name, "Cut", title, keys, change, refusal=refusal)


def _uncropped(state: ViewState) -> ViewState:
    return replace(state, shading=replace(state.shading, crop_voxels=None))


def _planeless(state: ViewState) -> ViewState:
    return replace(state, shading=replace(state.shading, clip_planes=()))


def _of_chosen(name: str) -> Change:
    """What an event does, to the plane that stands out."""

    def change(state: ViewState) -> ViewState:
        return EVENTS[name](state, Event(name, index=state.interface.aids.plane))

    return change


EVENTS: dict[str, Reducer] = {
    "crop": _crop,
    "plane-shift": _shift,
    "plane-tilt": _tilt,
    "plane-flip": _flip,
    "plane-remove": _remove,
    "plane-select": _select,
}

ACTIONS = (
    Action("crop", "Cut", "Crop box", ("c",), flipped("crop"), lambda s: s.interface.aids.crop),
    Action("reset-crop", "Cut", "Undo the crop", ("ctrl+shift+x",), _uncropped),
    _adding("plane-facing", "Add a clip plane facing you", ("p",), _facing),
    *(
        _adding(f"plane-{axis}", f"Add a clip plane across {axis}", (), _along(i))
        for i, axis in enumerate("xyz")
    ),
    Action("flip-plane", "Cut", "Flip the clip plane", (), _of_chosen("plane-flip")),
    Action("remove-plane", "Cut", "Remove the clip plane", (), _of_chosen("plane-remove")),
    Action("remove-planes", "Cut", "Remove all clip planes", (), _planeless),
    Action(
        *("planes", "Cut", "Clip planes' handles", (), flipped("planes")),
        lambda s: s.interface.aids.planes,
    ),
)
