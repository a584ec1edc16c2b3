"""Events and actions of the lights: weights, lux, dial, pen, solo, mute, the divide.

mouse, keys -> [lights] -> rows
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

from volspec.errors import VolspecError, one_line
from volspec.viewer.model import light_mixes, light_parts, light_states_edits, lights
from volspec.viewer.model.event import Action, Change, Event, Reducer, guarded
from volspec.viewer.model.state import ViewState


def _weight(state: ViewState, event: Event) -> ViewState:
    return replace(state, lights=lights.weighted(state.lights, event.index, event.x))


def _kelvin(state: ViewState, event: Event) -> ViewState:
    return replace(state, lights=lights.heated(state.lights, event.index, event.x))


def _lux(state: ViewState, event: Event) -> ViewState:
    return replace(
        state, lights=light_parts.lit_with(state.lights, event.index, event.x, event.part)
    )


def _part_weight(state: ViewState, event: Event) -> ViewState:
    rows = light_parts.part_weighted(state.lights, event.index, event.part, event.x)
    return replace(state, lights=rows)


def _draw(state: ViewState, event: Event) -> ViewState:
    """The pen on a light's spectrum: shares of the wavelengths' range, and power."""
    end = event.x, event.y
    rows = light_parts.drawn(state.lights, event.index, event.part, event.start or end, end)
    return replace(state, lights=rows)


def _dial(state: ViewState, event: Event) -> ViewState:
    return replace(state, lights=light_mixes.blended(state.lights, event.x, event.y))


def _solo(state: ViewState, event: Event) -> ViewState:
    return _toggled(state, event.index, "solo")


def _mute(state: ViewState, event: Event) -> ViewState:
    return _toggled(state, event.index, "muted")


def _toggled(state: ViewState, index: int, name: str) -> ViewState:
    if not 0 <= index < len(state.lights):
        return state
    on = not getattr(state.lights[index], name)
    return replace(state, lights=lights.changed(state.lights, index, **{name: on}))


def _remove(state: ViewState, event: Event) -> ViewState:
    rows = lights.removed(state.lights, event.index)
    return state if rows is state.lights else replace(state, lights=rows)


def _select(state: ViewState, event: Event) -> ViewState:
    if not 0 <= event.index < len(state.lights):
        return state
    return replace(state, interface=replace(state.interface, light=event.index))


def _divide(state: ViewState, event: Event) -> ViewState:
    return replace(state, divide=min(max(event.x, 0.02), 0.98))


def _next_light(state: ViewState) -> ViewState:
    return only(state, (lights.brightest(state.lights) + 1) % len(state.lights))


def only(state: ViewState, index: int) -> ViewState:
    """One light alone, and chosen; the state as it is where there is no such light."""
    if not 0 <= index < len(state.lights):
        return state
    return _chosen_of(state, lights.alone(state.lights, index), index)


def with_last(state: ViewState, rows: lights.Rows) -> ViewState:
    """Lights of which the last is new: it is chosen."""
    return _chosen_of(state, rows, len(rows) - 1)


def renamed(state: ViewState, index: int, name: str) -> ViewState:
    """A light under another name; the palette knows it by that."""
    rows = lights.renamed(state.lights, index, name)
    if rows is state.lights:
        return state
    board = state.board.with_light_renamed(state.lights[index].name, rows[index].name)
    return replace(state, lights=rows, board=board)


def _chosen_of(state: ViewState, rows: lights.Rows, index: int) -> ViewState:
    return replace(state, lights=rows, interface=replace(state.interface, light=index))


def _compare(state: ViewState) -> ViewState:
    """Keep the present lights at the right of a divide, or end that."""
    return replace(state, other=None if state.other else state.lights, divide=0.5)


def _swap(state: ViewState) -> ViewState:
    """The lights of both sides of the divide change places."""
    if state.other is None:
        return state
    return replace(state, lights=state.other, other=state.lights)


def _keep_mix(state: ViewState) -> ViewState:
    try:
        rows = light_mixes.with_mix(state.lights, state.document.grid, state.document.folder)
    except VolspecError:  # no room
        return state
    if rows is state.lights:
        return state
    return with_last(state, rows)


def _no_mix(state: ViewState) -> str:
    """Why no mix is kept."""
    try:
        rows = light_mixes.with_mix(state.lights, state.document.grid, state.document.folder)
    except VolspecError as error:
        return one_line(error)
    return "No light is on: there is no mix to keep" if rows is state.lights else ""


def _last_light(state: ViewState) -> str:
    """Why no light is removed."""
    return "The last light stays; add another one first" if len(state.lights) < 2 else ""


def _blend_all(state: ViewState) -> ViewState:
    return replace(state, lights=light_mixes.blended(state.lights, 0.0, 0.0))


def _reset_spectrum(state: ViewState) -> ViewState:
    """The chosen light's spectrum as it was before it was drawn."""
    return replace(state, lights=light_parts.undrawn(state.lights, state.interface.light))


def _alone(state: ViewState) -> ViewState:
    return only(state, state.interface.light)


def _chosen(reducer: Reducer) -> Change:
    """What an event does to the chosen light."""
    return lambda state: reducer(state, Event("", index=state.interface.light))


EVENTS: dict[str, Reducer] = {
    "weight": _weight,
    "kelvin": _kelvin,
    "dial": _dial,
    "solo": _solo,
    "mute": _mute,
    "select": _select,
    "divide": _divide,
    "lux": _lux,
    "part-weight": _part_weight,
    "draw": _draw,
}


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
        "Compare: keep these lights at the right",
        ("b",),
        _compare,
        lambda state: state.other is not None,
    ),
    Action(
        *("mark", "View", "Mark what the display cannot show", ("m",), _mark),
        lambda s: s.seen.viewing.display.mark,
    ),
    Action("swap", "Light", "Swap the two sides", ("x",), _swap),
    Action("alone", "Light", "The chosen light alone", (), _alone),
    Action("solo", "Light", "Solo the chosen light", (), _chosen(_solo)),
    Action("mute", "Light", "Mute the chosen light", (), _chosen(_mute)),
    Action("blend-all", "Light", "All lights alike", (), _blend_all),
    Action("keep-mix", "Light", "Keep this mix as a light", ("k",), _keep_mix, refusal=_no_mix),
    Action(
        "reset-spectrum", "Light", "Undo the drawing of the chosen spectrum", (), _reset_spectrum
    ),
    Action("rename-light", "Light", "Rename the chosen light", ("f2",)),
    Action(
        *("remove-light", "Light", "Remove the chosen light", (), _chosen(_remove)),
        refusal=_last_light,
    ),
    *light_states_edits.ACTIONS,
)


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


def _of_rows(change: Callable[[lights.Rows, Event], lights.Rows]) -> Reducer:
    def reducer(state: ViewState, event: Event) -> ViewState:
        return _with(state, change(state.lights, event))

    return reducer


def _with(state: ViewState, rows: lights.Rows) -> ViewState:
    return state if rows is state.lights else replace(state, lights=rows)


def _add(state: ViewState, event: Event) -> ViewState:
    """A light in `volspec.light`'s notation, alone and chosen."""
    document = state.document
    rows = lights.added(state.lights, event.key, document.grid, document.folder)
    return with_last(state, rows)


def _respell(state: ViewState, event: Event) -> ViewState:
    """Another spectrum for a part of a light, in the same notation."""
    document = state.document
    rows = light_parts.respelled(
        *(state.lights, event.index, event.part, event.key, document.grid, document.folder)
    )
    return _with(state, rows)


def _show(state: ViewState, event: Event) -> ViewState:
    """One light alone; the chosen one stays."""
    if not 0 <= event.index < len(state.lights):
        return state
    return replace(state, lights=lights.alone(state.lights, event.index))


def _split(state: ViewState, event: Event) -> ViewState:
    """A spectrum for each light group of the scene in place of one for all."""
    groups = tuple(group.name for group in state.shading.groups)
    return _with(state, light_parts.parted(state.lights, event.index, groups))


_NOTATIONS: dict[str, Reducer] = {"add-light": _add, "respell": _respell}
ROW_EVENTS: dict[str, Reducer] = {
    **{name: guarded(reducer) for name, reducer in _NOTATIONS.items()},
    "alone": lambda state, event: only(state, event.index),
    "show-light": _show,
    "rename-light": lambda state, event: renamed(state, event.index, event.key),
    "split-part": _split,
    "regroup": _of_rows(lambda rows, e: light_parts.regrouped(rows, e.index, e.part, e.key)),
    "add-part": _of_rows(lambda rows, e: light_parts.part_added(rows, e.index, e.key)),
    "remove-part": _of_rows(lambda rows, e: light_parts.part_removed(rows, e.index, e.part)),
}
