"""Edits and commands of the palette: targets of cells, free spectra, materials of values.

    panels, menus -> [palette_edits] -> PaletteState, TransferFunction

A cell is named by its number, row by row of `palette_table.table_of`; a colour by its ``#rrggbb``
or its three codes.
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
from volspec.viewer.model import light_rows
from volspec.viewer.model.edit import Command, Edited, edit, tolerant
from volspec.viewer.model.lights import with_last
from volspec.viewer.model.materials import with_material_basis, with_reflectances
from volspec.viewer.model.palette_table import (
    column_names,
    initial_spectrum,
    new_name,
    table_of,
    with_free_spectrum,
    with_material_range,
    with_new_light,
    with_range_material,
    wizard_place,
)
from volspec.viewer.model.palette_targets import (
    DISTANCES,
    LIGHT,
    MOST_ROUNDS,
    REFLECTANCE,
    SMOOTHNESS,
    WEIGHTS,
    DesignTargets,
    PaletteState,
    as_kind,
    clipped,
)
from volspec.viewer.model.state import ViewState


def _with_targets(state: ViewState, targets: DesignTargets) -> ViewState:
    """Other targets; materials become channels, so that what answers them needs no cast."""
    if targets is state.palette.targets:
        return state
    return replace(
        state,
        palette=state.palette.with_targets(targets),
        transfer=with_material_basis(state.transfer),
    )


@edit
def choose_cell(state: ViewState, number: int) -> ViewState:
    """Choose a cell; the picture shows its light."""
    table = table_of(state)
    place = table.place(number)
    if place is None:
        return state
    own, column = replace(state.interface.pick, place=place), table.columns.index(place[1])
    state = replace(state, interface=replace(state.interface, pick=own, light=column))
    if light_rows.effective_weights(state.lights)[column] > 0:
        return state
    return replace(state, lights=light_rows.only_row(state.lights, column))


def _with_cell(
    state: ViewState, number: int, change: Callable[[Cell | None], Cell | None]
) -> ViewState:
    """Another target at a place; its material is opened where nothing there may change."""
    place = table_of(state).place(number)
    if place is None:
        return state
    targets = state.palette.targets
    own = targets.cells.get(place)
    new = change(own)
    if new == own:
        return state
    row, column = (REFLECTANCE, place[0]), (LIGHT, place[1])
    if new is not None and not targets.open & {row, column}:
        targets = with_free_spectrum(state, row)
    return _with_targets(state, targets.with_cell(place, new))


@tolerant
def set_target(state: ViewState, number: int, text: str) -> ViewState:
    """Ask for a colour in a cell: ``#rrggbb``, or three codes."""
    codes = [float(word) for word in text.split()] if " " in text else text
    colour = parsed_colour(codes)

    def change(own: Cell | None) -> Cell:
        weight = own.weight if own and own.kind == "colour" else 1.0
        return Cell(colour=colour, weight=max(weight, 1.0))

    return _with_cell(state, number, change)


@tolerant
def set_target_kind(state: ViewState, number: int, kind: str, other: int = -1) -> ViewState:
    """Ask for a kind of target in a cell, relative to another one or to the next row."""
    table = table_of(state)
    place = table.place(number)
    reference = table.place(other)
    if place is None or place not in table.cells:
        return state
    if reference == place or reference is None:  # the row above, or below the first
        row, light = table.rows.index(place[0]), place[1]
        others = [name for name in table.rows if name != place[0]]
        reference = (others[max(row - 1, 0)], light) if others else None
    shown = clipped(table.cells[place].obtained)
    return _with_cell(state, number, lambda own: as_kind(kind, own, shown, reference))


@tolerant
def set_target_weight(state: ViewState, number: int, weight: float | None) -> ViewState:
    """Set how much a target counts; None is that it must be met."""
    low, high = WEIGHTS
    count = math.inf if weight is None else min(max(weight, low), high)
    return _with_cell(state, number, lambda own: own and replace(own, weight=count))


@tolerant
def set_target_group(state: ViewState, number: int, name: str) -> ViewState:
    """Name the group of a free cell."""
    name = name.strip()

    def change(own: Cell | None) -> Cell | None:
        return replace(own, group=name) if own and own.kind == "free" and name else own

    return _with_cell(state, number, change)


@tolerant
def set_target_distance(state: ViewState, number: int, distance: float) -> ViewState:
    """Set how far a cell is to be from another."""
    distance = min(max(distance, DISTANCES[0]), DISTANCES[1])

    def change(own: Cell | None) -> Cell | None:
        return replace(own, distance=distance) if own and own.kind == "distinct" else own

    return _with_cell(state, number, change)


@tolerant
def toggle_free(state: ViewState, kind: str, index: int) -> ViewState:
    """Let a spectrum change, or no longer."""
    names = {REFLECTANCE: tuple(state.transfer.materials), LIGHT: column_names(state.lights)}
    own = names.get(kind, ())
    if not 0 <= index < len(own):
        return state
    member = (kind, own[index])
    if kind == LIGHT and len(state.lights[index].rig.lights) > 1:
        return state
    targets = state.palette.targets
    closing = member in targets.open
    return _with_targets(
        state, targets.toggled(member) if closing else with_free_spectrum(state, member)
    )


@tolerant
def toggle_constant(state: ViewState, index: int) -> ViewState:
    """Ask for one colour of a material under all lights, or no longer."""
    names = tuple(state.transfer.materials)
    if not 0 <= index < len(names):
        return state
    targets = state.palette.targets
    name = names[index]
    constant = targets.constant ^ {name}
    if name in constant:  # its cells would ask for colours of their own
        first = column_names(state.lights)[0]
        targets = with_free_spectrum(state, (REFLECTANCE, name))
        cells = {at: c for at, c in targets.cells.items() if at[0] != name or at[1] == first}
        targets = replace(targets, cells=cells)
    return _with_targets(state, replace(targets, constant=constant))


@tolerant
def toggle_lamp(state: ViewState, index: int, lamp: str) -> ViewState:
    """Let a light be a sum of this real lamp and others, or no longer."""
    names = column_names(state.lights)
    if not 0 <= index < len(names) or not lamp:
        return state
    find_light(lamp, state.document.grid)
    name = names[index]
    targets = with_free_spectrum(state, (LIGHT, name))
    now = targets.lamps.get(name, ())
    others = tuple(each for each in now if each != lamp)
    lamps = {**targets.lamps, name: others if lamp in now else (*now, lamp)}
    return _with_targets(state, replace(targets, lamps={k: v for k, v in lamps.items() if v}))


@tolerant
def set_smoothness(state: ViewState, smoothness: float) -> ViewState:
    """Set how smooth designed spectra are; 0 below the least."""
    low, high = SMOOTHNESS
    smoothness = 0.0 if smoothness < low else min(smoothness, high)
    return _criteria(state, smoothness=smoothness)


@tolerant
def set_metric(state: ViewState, name: str) -> ViewState:
    """Set the colour difference of a design."""
    return _criteria(state, metric=name)


@tolerant
def set_iterations(state: ViewState, count: float) -> ViewState:
    """Set the most iterations of a design."""
    return _criteria(state, rounds=int(min(max(count, 1), MOST_ROUNDS)))


def _criteria(state: ViewState, **changes: Any) -> ViewState:
    targets = state.palette.targets
    criteria = replace(targets.criteria, **changes)
    if criteria == targets.criteria:
        return state
    return replace(state, palette=state.palette.with_targets(replace(targets, criteria=criteria)))


@tolerant
def assign(state: ViewState, first: float, last: float, material: str) -> ViewState:
    """Assign a material to a range of values."""
    if not isinstance(state.transfer, TransferFunction):
        return state
    low, high = state.document.volume.range
    start, end = sorted(min(max(value, low), high) for value in (first, last))
    return replace(state, transfer=with_material_range(state.transfer, start, end, material))


@tolerant
def recast_range(state: ViewState, index: int, material: str) -> ViewState:
    """Give one of the ranges another material."""
    if not isinstance(state.transfer, TransferFunction):
        return state
    return replace(state, transfer=with_range_material(state.transfer, index, material))


def _from_scratch(state: ViewState) -> Edited:
    if not state.palette.targets.open:
        return Edited(state, "Nothing may change yet: wish for a colour in a cell")
    # Another object: targets that were asked for already are not designed again.
    board = PaletteState(replace(state.palette.targets), from_scratch=True)
    return Edited(replace(state, palette=board, transfer=with_material_basis(state.transfer)))


def _forget(state: ViewState) -> ViewState:
    """No targets; spectra stay as they are."""
    targets = DesignTargets(criteria=state.palette.targets.criteria)
    return replace(state, palette=PaletteState(targets, targets))


def _own_spectra(state: ViewState) -> ViewState:
    """The scene's reflectances and lights, and no targets."""
    document, transfer, rows = state.document, state.transfer, state.lights
    own = document.transfer.materials
    if any(transfer.materials.get(name) is not own[name] for name in own):
        transfer = with_reflectances(transfer, own)
    if [row.rig.lights for row in rows] != [row.rig.lights for row in document.lights]:
        rows = document.lights
    return replace(_forget(state), transfer=transfer, lights=rows)


def _new_light(state: ViewState) -> Edited:
    """Add a light to be designed; the picture shows it."""
    name = new_name(state)
    wave = initial_spectrum(state.document.grid, len(state.lights))
    rows = with_new_light(state.lights, name, "designed light", replace(wave, name=name))
    if rows is state.lights:
        return Edited(state, f"{light_rows.MOST_ROWS} lights are the most; remove one first")
    targets = state.palette.targets
    targets = replace(targets, open=targets.open | {(LIGHT, name)})
    return Edited(with_last(_with_targets(state, targets), rows))


COMMANDS = (
    Command("palette-light", "Palette", "New light to be designed", (), _new_light),
    Command("palette-anew", "Palette", "Design the palette from scratch", (), _from_scratch),
    Command("palette-forget", "Palette", "Forget all wishes, keep the spectra", (), _forget),
    Command("palette-own", "Palette", "The scene's own spectra", (), _own_spectra),
    Command("hide", "Palette", "Hide the chosen material under the chosen light"),
    Command("reveal", "Palette", "Reveal the chosen material under the chosen light"),
    Command("keep", "Palette", "Keep the chosen material's colour under all lights"),
    Command("merge", "Palette", "Merge the ticked materials under the chosen light"),
    Command("palette-load", "Palette", "Load a palette …"),
    Command("palette-save", "Palette", "Save the palette …"),
)


def _with_pick(state: ViewState, **changes: Any) -> ViewState:
    """Change what wizards are about."""
    pick = replace(state.interface.pick, **changes)
    return replace(state, interface=replace(state.interface, pick=pick))


@edit
def pick_material(state: ViewState, name: str) -> ViewState:
    """Pick the material that wizards are about."""
    if name not in state.transfer.materials:
        return state
    return _with_pick(state, place=(name, wizard_place(state)[1]))


@edit
def pick_light(state: ViewState, name: str) -> ViewState:
    """Pick the light that wizards are about."""
    if name not in column_names(state.lights):
        return state
    return _with_pick(state, place=(wizard_place(state)[0], name))


@edit
def pick_like(state: ViewState, name: str) -> ViewState:
    """Pick the light that a new one is to be like; none by an empty name."""
    return _with_pick(state, like=name)


@edit
def pick_within(state: ViewState, name: str) -> ViewState:
    """Pick the material to hide in; an empty name is what surrounds it."""
    return _with_pick(state, within=name, black=False)


@edit
def pick_black(state: ViewState) -> ViewState:
    """Have a material hidden in black."""
    return _with_pick(state, within="", black=True)


@edit
def pick_distance(state: ViewState, distance: float) -> ViewState:
    """Set how far a revealed material is to stand out."""
    return _with_pick(state, distance=min(max(distance, DISTANCES[0]), DISTANCES[1]))


@edit
def toggle_merged(state: ViewState, name: str) -> ViewState:
    """Merge a material with others, or no longer."""
    return _with_pick(state, materials=state.interface.pick.materials ^ {name})


@edit
def pick_values(state: ViewState, first: float, last: float) -> ViewState:
    """Pick the values that a material is assigned to."""
    return _with_pick(state, values=(min(first, last), max(first, last)))


@edit
def pick_use(state: ViewState, name: str) -> ViewState:
    """Pick the material that is assigned to values."""
    return _with_pick(state, use=name)
