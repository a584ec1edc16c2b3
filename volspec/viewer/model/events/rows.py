"""Events of the list of lights: one added, shown or renamed, and what each is made of.

panels, command palette -> [rows] -> rows
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

from volspec.errors import VolspecError, one_line
from volspec.viewer.model.events.event import Event, Reducer, guarded
from volspec.viewer.model.events.lights import only, renamed, with_last
from volspec.viewer.model.lights import lighting, parts
from volspec.viewer.model.state import ViewState


def refusal(state: ViewState, event: Event) -> str:
    """Why an event with a notation leaves a state as it is; empty where it does not.

    Parameters
    ----------
    state : ViewState
    event : Event
        ``add-light`` or ``respell``.
    """
    try:
        _NOTATIONS[event.name](state, event)
    except (VolspecError, OSError) as error:
        return one_line(error)
    return ""


def _of_rows(change: Callable[[lighting.Rows, Event], lighting.Rows]) -> Reducer:
    def reducer(state: ViewState, event: Event) -> ViewState:
        return _with(state, change(state.lights, event))

    return reducer


def _with(state: ViewState, rows: lighting.Rows) -> ViewState:
    return state if rows is state.lights else replace(state, lights=rows)


def _add(state: ViewState, event: Event) -> ViewState:
    """A light in `volspec.light`'s notation, alone and chosen."""
    document = state.document
    rows = lighting.added(state.lights, event.key, document.grid, document.folder)
    return with_last(state, rows)


def _respell(state: ViewState, event: Event) -> ViewState:
    """Another spectrum for a part of a light, in the same notation."""
    document = state.document
    rows = parts.respelled(
        *(state.lights, event.index, event.part, event.key, document.grid, document.folder)
    )
    return _with(state, rows)


def _show(state: ViewState, event: Event) -> ViewState:
    """One light alone; the chosen one stays."""
    if not 0 <= event.index < len(state.lights):
        return state
    return replace(state, lights=lighting.alone(state.lights, event.index))


def _split(state: ViewState, event: Event) -> ViewState:
    """A spectrum for each light group of the scene in place of one for all."""
    groups = tuple(group.name for group in state.shading.groups)
    return _with(state, parts.parted(state.lights, event.index, groups))


_NOTATIONS: dict[str, Reducer] = {"add-light": _add, "respell": _respell}
EVENTS: dict[str, Reducer] = {
    **{name: guarded(reducer) for name, reducer in _NOTATIONS.items()},
    "alone": lambda state, event: only(state, event.index),
    "show-light": _show,
    "rename-light": lambda state, event: renamed(state, event.index, event.key),
    "split-part": _split,
    "regroup": _of_rows(lambda rows, e: parts.regrouped(rows, e.index, e.part, e.key)),
    "add-part": _of_rows(lambda rows, e: parts.part_added(rows, e.index, e.key)),
    "remove-part": _of_rows(lambda rows, e: parts.part_removed(rows, e.index, e.part)),
}
