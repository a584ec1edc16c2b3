"""Edits and commands of the palette: targets of cells, free spectra, materials of values.

    panels, menus -> [palette_edits] -> PaletteState, TransferFunction

Cells are numbered row by row, as in `palette_table.Table.place`.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from typing import Any

from volspec.palette import Cell, parse_colour
from volspec.spectra import light as find_light
from volspec.transfer import TransferFunction
from volspec.viewer.model import light_rows, palette_targets
from volspec.viewer.model.edit import Command, Edited, edit, with_field, with_interface
from volspec.viewer.model.lights import with_last
from volspec.viewer.model.materials import with_material_basis, with_reflectances
from volspec.viewer.model.palette_table import (
    colour_table,
    column_names,
    initial_spectrum,
    may_design,
    new_name,
    with_designed_light,
    with_free_spectrum,
    with_material_range,
    with_range_material,
    wizard_place,
)
from volspec.viewer.model.state import ViewState
from volspec.viewer.model.view import clamp


def _with_targets(state: ViewState, targets: palette_targets.DesignTargets) -> ViewState:
    """Set the targets, and make materials the channels, so that designs need no cast."""
    return replace(
        state,
        palette=state.palette.with_targets(targets),
        transfer=with_material_basis(state.transfer),
    )


@edit
def choose_cell(state: ViewState, number: int) -> ViewState:
    """Choose a cell, and light the picture with its light."""
    table = colour_table(state)
    place = table.place(number)
    if place is None:
        return state
    pick, column = replace(state.interface.pick, place=place), table.columns.index(place[1])
    state = with_interface(state, pick=pick, light=column)
    if light_rows.effective_weights(state.lights)[column] > 0:
        return state
    return replace(state, lights=light_rows.only_row(state.lights, column))


def _with_cell(
    state: ViewState, number: int, change: Callable[[Cell | None], Cell | None]
) -> ViewState:
    """Change a cell's target; if neither of its spectra is free, its material becomes free."""
    place = colour_table(state).place(number)
    if place is None:
        return state
    targets = state.palette.targets
    old = targets.cells.get(place)
    new = change(old)
    if new == old:
        return state
    row, column = (palette_targets.REFLECTANCE, place[0]), (palette_targets.LIGHT, place[1])
    if new is not None and not targets.free & {row, column}:
        targets = with_free_spectrum(state, row)
    cells = {key: cell for key, cell in targets.cells.items() if key != place}
    if new is not None:
        cells[place] = new
    return _with_targets(state, replace(targets, cells=cells))


@edit
def set_target(state: ViewState, number: int, text: str) -> ViewState:
    """Set a cell's target to a colour: ``#rrggbb``, or three codes from 0 to 1."""
    try:
        codes = [float(word) for word in text.split()] if " " in text else text
    except ValueError:
        return state
    colour = parse_colour(codes)

    def change(old: Cell | None) -> Cell:
        weight = old.weight if old and old.kind == "colour" else 1.0
        return Cell(colour=colour, weight=max(weight, 1.0))

    return _with_cell(state, number, change)


@edit
def set_target_kind(state: ViewState, number: int, kind: str, other: int = -1) -> ViewState:
    """Set the kind of a cell's target, and the cell to compare with (default: in the row above)."""
    table = colour_table(state)
    place = table.place(number)
    reference = table.place(other)
    if place is None or place not in table.cells:
        return state
    if reference == place or reference is None:  # the row above; for the first, the row below
        row, light = table.rows.index(place[0]), place[1]
        other_rows = [name for name in table.rows if name != place[0]]
        reference = (other_rows[max(row - 1, 0)], light) if other_rows else None
    obtained = palette_targets.clip_codes(table.cells[place].obtained)
    return _with_cell(
        state, number, lambda cell: palette_targets.as_kind(kind, cell, obtained, reference)
    )


@edit
def set_target_weight(state: ViewState, number: int, weight: float | None) -> ViewState:
    """Set the weight of a target; None if it must be met."""
    own_weight = math.inf if weight is None else clamp(weight, *palette_targets.WEIGHTS)
    return _with_cell(state, number, lambda cell: cell and replace(cell, weight=own_weight))


@edit
def set_target_group(state: ViewState, number: int, name: str) -> ViewState:
    """Set the group of a free cell; an empty name changes nothing."""
    group = name.strip()
    return _with_kind(state, number, "free", group=group) if group else state


@edit
def set_target_distance(state: ViewState, number: int, distance: float) -> ViewState:
    """Set the ΔE of a distinct cell from another."""
    delta_e = clamp(distance, *palette_targets.DISTANCES)
    return _with_kind(state, number, "distinct", distance=delta_e)


def _with_kind(state: ViewState, number: int, kind: str, **changes: Any) -> ViewState:
    """Change fields of a cell's target, if it is of a kind."""
    return _with_cell(
        state, number, lambda cell: replace(cell, **changes) if cell and cell.kind == kind else cell
    )


@edit
def toggle_free(state: ViewState, kind: str, index: int) -> ViewState:
    """Free a spectrum for designs, or fix it."""
    names = {
        palette_targets.REFLECTANCE: tuple(state.transfer.materials),
        palette_targets.LIGHT: column_names(state.lights),
    }
    members = names.get(kind, ())
    if not 0 <= index < len(members):
        return state
    if kind == palette_targets.LIGHT and not may_design(state, index):
        return state
    member, targets = (kind, members[index]), state.palette.targets
    if member in targets.free:
        return _with_targets(state, replace(targets, free=targets.free - {member}))
    return _with_targets(state, with_free_spectrum(state, member))


@edit
def toggle_constant(state: ViewState, index: int) -> ViewState:
    """Toggle whether a material keeps one colour under all lights."""
    names = tuple(state.transfer.materials)
    if not 0 <= index < len(names):
        return state
    name, targets = names[index], state.palette.targets
    constant = targets.constant ^ {name}
    if name in constant:  # targets of its other cells would contradict it
        first = column_names(state.lights)[0]
        targets = with_free_spectrum(state, (palette_targets.REFLECTANCE, name))
        cells = {key: c for key, c in targets.cells.items() if key[0] != name or key[1] == first}
        targets = replace(targets, cells=cells)
    return _with_targets(state, replace(targets, constant=constant))


@edit
def toggle_lamp(state: ViewState, index: int, lamp: str) -> ViewState:
    """Add a real lamp to those that a designed light may be a sum of, or remove it."""
    names = column_names(state.lights)
    if not 0 <= index < len(names) or not lamp:
        return state
    find_light(lamp, state.document.grid)
    name = names[index]
    targets = with_free_spectrum(state, (palette_targets.LIGHT, name))
    now = targets.lamps.get(name, ())
    kept = tuple(other for other in now if other != lamp)
    lamps = {**targets.lamps, name: kept if lamp in now else (*now, lamp)}
    return _with_targets(state, replace(targets, lamps={k: v for k, v in lamps.items() if v}))


@edit
def set_criterion(state: ViewState, name: str, value: Any) -> ViewState:
    """Set a criterion of a design; smoothness below the slider's is 0."""
    if name == "smoothness" and value < palette_targets.MIN_SMOOTHNESS:
        value = 0.0
    targets = state.palette.targets
    criteria = with_field(targets.criteria, name, value, palette_targets.CRITERIA.get(name))
    if criteria is targets.criteria:
        return state
    return replace(state, palette=state.palette.with_targets(replace(targets, criteria=criteria)))


@edit
def assign(state: ViewState, first: float, last: float, material: str) -> ViewState:
    """Assign a material to a range of values."""
    if not isinstance(state.transfer, TransferFunction):
        return state
    start, end = sorted(clamp(value, *state.document.volume.range) for value in (first, last))
    return replace(state, transfer=with_material_range(state.transfer, start, end, material))


@edit
def recast_range(state: ViewState, index: int, material: str) -> ViewState:
    """Give one of the ranges another material."""
    if not isinstance(state.transfer, TransferFunction):
        return state
    return replace(state, transfer=with_range_material(state.transfer, index, material))


def _design_from_scratch(state: ViewState) -> Edited:
    if not state.palette.targets.free:
        return Edited(state, "No spectrum may change yet; set a target colour in a cell")
    # A new object, as the same object of targets would not be designed again.
    board = palette_targets.PaletteState(replace(state.palette.targets), from_scratch=True)
    return Edited(replace(state, palette=board, transfer=with_material_basis(state.transfer)))


def _drop_targets(state: ViewState) -> ViewState:
    """Remove the targets; spectra stay."""
    targets = palette_targets.DesignTargets(criteria=state.palette.targets.criteria)
    return replace(state, palette=palette_targets.PaletteState(targets, targets))


def _own_spectra(state: ViewState) -> ViewState:
    """Restore the scene's reflectances and lights, and remove the targets."""
    document, transfer, rows = state.document, state.transfer, state.lights
    originals = document.transfer.materials
    if any(transfer.materials.get(name) is not originals[name] for name in originals):
        transfer = with_reflectances(transfer, originals)
    if [row.rig.lights for row in rows] != [row.rig.lights for row in document.lights]:
        rows = document.lights
    return replace(_drop_targets(state), transfer=transfer, lights=rows)


def _new_light(state: ViewState) -> Edited:
    """Add a light to design, which alone lights the picture."""
    name = new_name(state)
    wave = initial_spectrum(state.document.grid, len(state.lights))
    rows = with_designed_light(state.lights, name, "designed light", replace(wave, name=name))
    if rows is state.lights:
        return Edited(state, f"The limit is {light_rows.MAX_ROWS} lights; remove one first")
    targets = state.palette.targets
    targets = replace(targets, free=targets.free | {(palette_targets.LIGHT, name)})
    return Edited(with_last(_with_targets(state, targets), rows))


COMMANDS = (
    Command("palette-light", "Palette", "New light to be designed", (), _new_light),
    Command(
        "palette-restart", "Palette", "Design the palette from scratch", (), _design_from_scratch
    ),
    Command("palette-forget", "Palette", "Remove all targets, keep the spectra", (), _drop_targets),
    Command("palette-own", "Palette", "The scene's own spectra", (), _own_spectra),
    Command("hide", "Palette", "Hide the chosen material under the chosen light"),
    Command("reveal", "Palette", "Reveal the chosen material under the chosen light"),
    Command("keep", "Palette", "Keep the chosen material's colour under all lights"),
    Command("merge", "Palette", "Merge the ticked materials under the chosen light"),
    Command("palette-load", "Palette", "Load a palette …"),
    Command("palette-save", "Palette", "Save the palette …"),
)


def with_pick(state: ViewState, **changes: Any) -> ViewState:
    """Change the panel's choices, a `Pick`."""
    return with_interface(state, pick=replace(state.interface.pick, **changes))


@edit
def pick_material(state: ViewState, name: str) -> ViewState:
    """Pick the material that wizards redesign."""
    if name not in state.transfer.materials:
        return state
    return with_pick(state, place=(name, wizard_place(state)[1]))


@edit
def pick_light(state: ViewState, name: str) -> ViewState:
    """Pick the light that wizards redesign for."""
    if name not in column_names(state.lights):
        return state
    return with_pick(state, place=(wizard_place(state)[0], name))


@edit
def pick_distance(state: ViewState, distance: float) -> ViewState:
    """Set the ΔE by which a material is revealed."""
    return with_pick(state, distance=clamp(distance, *palette_targets.DISTANCES))


@edit
def toggle_merged(state: ViewState, name: str) -> ViewState:
    """Add a material to those to merge, or remove it."""
    return with_pick(state, materials=state.interface.pick.materials ^ {name})
