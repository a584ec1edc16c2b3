"""Events and actions of the slices: moved, pointed at, lit or grey.

mouse, keys -> [slices] -> Slices
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

from volspec.viewer.model.cuts_edits import flipped, with_aids
from volspec.viewer.model.event import Action, Change, Event, Reducer
from volspec.viewer.model.slices import PLANES, Slices, is_patient, layout_of, number_of, pointed
from volspec.viewer.model.state import ViewState

# The least part of the range between black and white.
_NARROWEST = 0.002


def with_slices(state: ViewState, **changes: Any) -> ViewState:
    """Other slices."""
    slices = replace(state.interface.slices, **changes)
    return replace(state, interface=replace(state.interface, slices=slices))


def _moved(state: ViewState, event: Event) -> ViewState:
    """One plane at another share of its axis."""
    if not 0 <= event.index < len(PLANES):
        return state
    axis = layout_of(state.document.volume, PLANES[event.index]).normal
    at = list(state.interface.slices.at)
    at[axis] = min(max(event.x, 0.0), 1.0)
    return with_slices(state, at=tuple(at))


def _stepped(state: ViewState, event: Event) -> ViewState:
    """One plane on by so many slices; up, to the back or to the patient's left."""
    if not 0 <= event.index < len(PLANES):
        return state
    volume, plane = state.document.volume, PLANES[event.index]
    axis = layout_of(volume, plane).normal
    last = volume.shape_xyz[axis] - 1
    rising = volume.world_from_index[plane.normal, axis] >= 0
    number = number_of(volume, axis, state.interface.slices.at[axis])
    share = (number + (event.x if rising else -event.x)) / last
    return _moved(state, replace(event, x=share))


def _pointed(state: ViewState, event: Event) -> ViewState:
    """The other two planes where one of the pictures is pointed at."""
    if not 0 <= event.index < len(PLANES):
        return state
    volume = state.document.volume
    layout = layout_of(volume, PLANES[event.index])
    return with_slices(
        state, at=pointed(volume, layout, state.interface.slices, _share(event.x), _share(event.y))
    )


def _greys(state: ViewState, event: Event) -> ViewState:
    low = min(_share(event.x), 1.0 - _NARROWEST)
    return with_slices(state, greys=(low, max(_share(event.y), low + _NARROWEST)))


def _share(value: float) -> float:
    return min(max(value, 0.0), 1.0)


def _lit(state: ViewState) -> ViewState:
    return with_slices(state, lit=not state.interface.slices.lit)


def _all_greys(state: ViewState) -> ViewState:
    return with_slices(state, greys=None)


def _centred(state: ViewState) -> ViewState:
    return with_slices(state, at=Slices().at)


def _patient(state: ViewState) -> ViewState:
    now = is_patient(state.document.volume, state.interface.aids.patient)
    return with_aids(state, patient=not now)


def _after(name: str, index: int, x: float) -> Change:
    return lambda state: EVENTS[name](state, Event(name, x, index=index))


EVENTS: dict[str, Reducer] = {
    "slice": _moved,
    "slice-step": _stepped,
    "slice-point": _pointed,
    "slice-greys": _greys,
}

# Up or down a page, with these held; the plane's name, and what it then moves to.
_PAGES = (
    ("", "Axial", ("down", "up")),
    ("shift+", "Coronal", ("forward", "backward")),
    ("ctrl+", "Sagittal", ("right", "left")),
)
ACTIONS = (
    Action(
        *("slices-lit", "Window", "Slices under the lights", (), _lit),
        lambda s: s.interface.slices.lit,
    ),
    Action("slices-middle", "Window", "Slices through the middle", (), _centred),
    Action("slices-greys", "Window", "Slices' greys by the values", (), _all_greys),
    Action(
        *("outlines", "Window", "Slices' outlines in the picture", (), flipped("outlines")),
        lambda s: s.interface.aids.outlines,
    ),
    Action(
        *("patient", "Window", "Directions by the patient's body", (), _patient),
        lambda s: is_patient(s.document.volume, s.interface.aids.patient),
    ),
    *(
        Action(
            *(f"{plane.lower()}-{to}", "", f"{plane} slice {to}", (f"{held}page{key}",)),
            _after("slice-step", i, by),
        )
        for i, (held, plane, names) in enumerate(_PAGES)
        for to, key, by in zip(names, ("down", "up"), (-1.0, 1.0), strict=True)
    ),
)
