"""Events of the window alone: what is chosen in panels, and how they are drawn.

panels, command palette -> [interface] -> Interface

No step of undo, and no picture changes.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

from volspec.viewer.model.event import Event, Reducer
from volspec.viewer.model.palette_spectra import columns
from volspec.viewer.model.palette_table import picked
from volspec.viewer.model.palette_targets import DISTANCES, Pick
from volspec.viewer.model.state import ViewState


def _logarithmic(state: ViewState, _: Event) -> ViewState:
    """The other scale of the histogram."""
    interface = state.interface
    return replace(state, interface=replace(interface, logarithmic=not interface.logarithmic))


def _open_viewing(state: ViewState, _: Event) -> ViewState:
    """With the panel in which the settings of the viewing stand."""
    panels = state.interface.panels | {"Viewing"}
    return replace(state, interface=replace(state.interface, panels=panels))


def _picking(change: Callable[[Pick, Event], Pick]) -> Reducer:
    """What wizards are told beside the place they are about."""

    def reducer(state: ViewState, event: Event) -> ViewState:
        return _with_pick(state, change(state.interface.pick, event))

    return reducer


def _with_pick(state: ViewState, pick: Pick) -> ViewState:
    return replace(state, interface=replace(state.interface, pick=pick))


def _material(state: ViewState, event: Event) -> ViewState:
    """The material that wizards are about."""
    if event.key not in state.transfer.materials:
        return state
    place = event.key, picked(state)[1]
    return _with_pick(state, replace(state.interface.pick, place=place))


def _light(state: ViewState, event: Event) -> ViewState:
    """The light that wizards are about."""
    if event.key not in columns(state.lights):
        return state
    place = picked(state)[0], event.key
    return _with_pick(state, replace(state.interface.pick, place=place))


def _distance(pick: Pick, event: Event) -> Pick:
    return replace(pick, distance=min(max(event.x, DISTANCES[0]), DISTANCES[1]))


def _values(pick: Pick, event: Event) -> Pick:
    return replace(pick, values=(min(event.x, event.y), max(event.x, event.y)))


EVENTS: dict[str, Reducer] = {
    "logarithmic": _logarithmic,
    "open-viewing": _open_viewing,
    "pick-material": _material,
    "pick-light": _light,
    "pick-like": _picking(lambda pick, event: replace(pick, like=event.key)),
    "pick-within": _picking(lambda pick, event: replace(pick, within=event.key, black=False)),
    "pick-black": _picking(lambda pick, _: replace(pick, within="", black=True)),
    "pick-distance": _picking(_distance),
    "pick-merged": _picking(
        lambda pick, event: replace(pick, materials=pick.materials ^ {event.key})
    ),
    "pick-values": _picking(_values),
    "pick-use": _picking(lambda pick, event: replace(pick, use=event.key)),
}
