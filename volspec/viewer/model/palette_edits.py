"""Events and actions of the palette: wishes of cells, what may change, materials of values.

panel, menus -> [palette] -> Board, TransferFunction

A cell is named by its number, row by row of `table.table_of`; a colour by its
``#rrggbb`` or its three codes.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from typing import Any

from volspec.palette import Cell
from volspec.palette.colours import parsed_colour
from volspec.spectra import light as find_light
from volspec.transfer import TransferFunction
from volspec.viewer.model import lights as lighting
from volspec.viewer.model.event import Action, Event, Reducer, guarded
from volspec.viewer.model.lights_edits import with_last
from volspec.viewer.model.palette_spectra import columns, exact, with_new_light, with_reflectances
from volspec.viewer.model.palette_table import (
    assigned,
    first_wave,
    new_name,
    opened,
    recast,
    table_of,
)
from volspec.viewer.model.palette_targets import (
    DISTANCES,
    LIGHT,
    MOST_ROUNDS,
    REFLECTANCE,
    SMOOTHNESS,
    WEIGHTS,
    Board,
    Wishes,
    as_kind,
    clipped,
)
from volspec.viewer.model.state import ViewState

MUST = "must"


def _wishing(state: ViewState, wishes: Wishes) -> ViewState:
    """Other wishes; materials become channels, so that what answers them needs no cast."""
    if wishes is state.board.wishes:
        return state
    return replace(state, board=state.board.wishing(wishes), transfer=exact(state.transfer))


def _pick(state: ViewState, event: Event) -> ViewState:
    """Choose a cell; the picture shows its light."""
    table = table_of(state)
    place = table.place(event.index)
    if place is None:
        return state
    own, column = replace(state.interface.pick, place=place), table.columns.index(place[1])
    state = replace(state, interface=replace(state.interface, pick=own, light=column))
    if lighting.shining(state.lights)[column] > 0:
        return state
    return replace(state, lights=lighting.alone(state.lights, column))


def _cell(
    state: ViewState, event: Event, change: Callable[[Cell | None], Cell | None]
) -> ViewState:
    """Another wish at a place; its material is opened where nothing there may change."""
    place = table_of(state).place(event.index)
    if place is None:
        return state
    wishes = state.board.wishes
    own = wishes.cells.get(place)
    new = change(own)
    if new == own:
        return state
    row, column = (REFLECTANCE, place[0]), (LIGHT, place[1])
    if new is not None and not wishes.open & {row, column}:
        wishes = opened(state, row)
    return _wishing(state, wishes.with_cell(place, new))


def _wish(state: ViewState, event: Event) -> ViewState:
    codes = [float(word) for word in event.key.split()] if " " in event.key else event.key
    colour = parsed_colour(codes)

    def change(own: Cell | None) -> Cell:
        weight = own.weight if own and own.kind == "colour" else 1.0
        return Cell(colour=colour, weight=max(weight, 1.0))

    return _cell(state, event, change)


def _kind(state: ViewState, event: Event) -> ViewState:
    table = table_of(state)
    place = table.place(event.index)
    other = table.place(int(event.x))
    if place is None or place not in table.cells:
        return state
    if other == place or other is None:  # the row above, or below the first
        row, light = table.rows.index(place[0]), place[1]
        others = [name for name in table.rows if name != place[0]]
        other = (others[max(row - 1, 0)], light) if others else None
    shown = clipped(table.cells[place].obtained)
    return _cell(state, event, lambda own: as_kind(event.key, own, shown, other))


def _weight(state: ViewState, event: Event) -> ViewState:
    low, high = WEIGHTS
    weight = math.inf if event.key == MUST else min(max(event.x, low), high)
    return _cell(state, event, lambda own: own and replace(own, weight=weight))


def _group(state: ViewState, event: Event) -> ViewState:
    name = event.key.strip()

    def change(own: Cell | None) -> Cell | None:
        return replace(own, group=name) if own and own.kind == "free" and name else own

    return _cell(state, event, change)


def _distance(state: ViewState, event: Event) -> ViewState:
    distance = min(max(event.x, DISTANCES[0]), DISTANCES[1])

    def change(own: Cell | None) -> Cell | None:
        return replace(own, distance=distance) if own and own.kind == "distinct" else own

    return _cell(state, event, change)


def _open(state: ViewState, event: Event) -> ViewState:
    """A spectrum that may change from now on, or no longer."""
    names = {REFLECTANCE: tuple(state.transfer.materials), LIGHT: columns(state.lights)}
    own = names.get(event.key, ())
    if not 0 <= event.index < len(own):
        return state
    member = (event.key, own[event.index])
    if event.key == LIGHT and len(state.lights[event.index].rig.lights) > 1:
        return state
    wishes = state.board.wishes
    closing = member in wishes.open
    return _wishing(state, wishes.toggled(member) if closing else opened(state, member))


def _constant(state: ViewState, event: Event) -> ViewState:
    names = tuple(state.transfer.materials)
    if not 0 <= event.index < len(names):
        return state
    wishes = state.board.wishes
    name = names[event.index]
    constant = wishes.constant ^ {name}
    if name in constant:  # its cells would ask for colours of their own
        first = columns(state.lights)[0]
        wishes = opened(state, (REFLECTANCE, name))
        cells = {at: c for at, c in wishes.cells.items() if at[0] != name or at[1] == first}
        wishes = replace(wishes, cells=cells)
    return _wishing(state, replace(wishes, constant=constant))


def _lamp(state: ViewState, event: Event) -> ViewState:
    """A real lamp that a light may be a sum of, or no longer."""
    names = columns(state.lights)
    if not 0 <= event.index < len(names) or not event.key:
        return state
    find_light(event.key, state.document.grid)
    name = names[event.index]
    wishes = opened(state, (LIGHT, name))
    now = wishes.lamps.get(name, ())
    kept = tuple(lamp for lamp in now if lamp != event.key)
    lamps = {**wishes.lamps, name: kept if event.key in now else (*now, event.key)}
    return _wishing(state, replace(wishes, lamps={k: v for k, v in lamps.items() if v}))


def _smoothness(state: ViewState, event: Event) -> ViewState:
    low, high = SMOOTHNESS
    smoothness = 0.0 if event.x < low else min(event.x, high)
    return _criteria(state, smoothness=smoothness)


def _metric(state: ViewState, event: Event) -> ViewState:
    return _criteria(state, metric=event.key)


def _rounds(state: ViewState, event: Event) -> ViewState:
    return _criteria(state, rounds=int(min(max(event.x, 1), MOST_ROUNDS)))


def _criteria(state: ViewState, **changes: Any) -> ViewState:
    wishes = state.board.wishes
    criteria = replace(wishes.criteria, **changes)
    if criteria == wishes.criteria:
        return state
    return replace(state, board=state.board.wishing(replace(wishes, criteria=criteria)))


def _assign(state: ViewState, event: Event) -> ViewState:
    """A material, by name, for the values from x to y."""
    if not isinstance(state.transfer, TransferFunction):
        return state
    low, high = state.document.volume.range
    start, end = sorted(min(max(value, low), high) for value in (event.x, event.y))
    return replace(state, transfer=assigned(state.transfer, start, end, event.key))


def _recast(state: ViewState, event: Event) -> ViewState:
    """A material, by name, for one of the ranges."""
    if not isinstance(state.transfer, TransferFunction):
        return state
    return replace(state, transfer=recast(state.transfer, event.index, event.key))


EVENTS: dict[str, Reducer] = {
    "pick-cell": _pick,
    "wish": guarded(_wish),
    "wish-kind": guarded(_kind),
    "wish-weight": guarded(_weight),
    "wish-group": guarded(_group),
    "wish-distance": guarded(_distance),
    "open": guarded(_open),
    "constant": guarded(_constant),
    "lamp": guarded(_lamp),
    "smoothness": guarded(_smoothness),
    "metric": guarded(_metric),
    "rounds": guarded(_rounds),
    "assign": guarded(_assign),
    "recast": guarded(_recast),
}


def _anew(state: ViewState) -> ViewState:
    if not state.board.wishes.open:
        return state
    # Another object: wishes that were asked for already are not designed again.
    board = Board(replace(state.board.wishes), anew=True)
    return replace(state, board=board, transfer=exact(state.transfer))


def _nothing_open(state: ViewState) -> str:
    """Why nothing is designed from scratch."""
    return "" if state.board.wishes.open else "Nothing may change yet: wish for a colour in a cell"


def _forget(state: ViewState) -> ViewState:
    """No wishes; spectra stay as they are."""
    wishes = Wishes(criteria=state.board.wishes.criteria)
    return replace(state, board=Board(wishes, wishes))


def _own_spectra(state: ViewState) -> ViewState:
    """The scene's reflectances and lights, and no wishes."""
    document, transfer, lights = state.document, state.transfer, state.lights
    own = document.transfer.materials
    if any(transfer.materials.get(name) is not own[name] for name in own):
        transfer = with_reflectances(transfer, own)
    if [row.rig.lights for row in lights] != [row.rig.lights for row in document.lights]:
        lights = document.lights
    return replace(_forget(state), transfer=transfer, lights=lights)


def _new_light(state: ViewState) -> ViewState:
    """One more light to be designed; the picture shows it."""
    name = new_name(state)
    wave = first_wave(state.document.grid, len(state.lights))
    rows = with_new_light(state.lights, name, "designed light", replace(wave, name=name))
    if rows is state.lights:
        return state
    wishes = state.board.wishes
    wishes = replace(wishes, open=wishes.open | {(LIGHT, name)})
    return with_last(_wishing(state, wishes), rows)


def _no_room(state: ViewState) -> str:
    """Why there is no new light."""
    if len(state.lights) < lighting.MOST_ROWS:
        return ""
    return f"{lighting.MOST_ROWS} lights are the most; remove one first"


ACTIONS = (
    Action(
        *("palette-light", "Palette", "New light to be designed", (), _new_light), refusal=_no_room
    ),
    Action(
        *("palette-anew", "Palette", "Design the palette from scratch", (), _anew),
        refusal=_nothing_open,
    ),
    Action("palette-forget", "Palette", "Forget all wishes, keep the spectra", (), _forget),
    Action("palette-own", "Palette", "The scene's own spectra", (), _own_spectra),
    Action("hide", "Palette", "Hide the chosen material under the chosen light"),
    Action("reveal", "Palette", "Reveal the chosen material under the chosen light"),
    Action("keep", "Palette", "Keep the chosen material's colour under all lights"),
    Action("merge", "Palette", "Merge the ticked materials under the chosen light"),
    Action("palette-load", "Palette", "Load a palette …"),
    Action("palette-save", "Palette", "Save the palette …"),
)
