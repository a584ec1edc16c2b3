"""Popups of the palette: a cell's target, and options of a light or a material."""

from __future__ import annotations

import math

from imgui_bundle import imgui

from volspec.palette import Cell, Place, hexadecimal
from volspec.spectra import light_names
from volspec.viewer.model import lights, palette_edits
from volspec.viewer.model.light_rows import brightest_row
from volspec.viewer.model.palette_table import PaletteTable, colour_table, may_design
from volspec.viewer.model.palette_targets import DISTANCES, LIGHT, REFLECTANCE, WEIGHTS, clip_codes
from volspec.viewer.model.state import ViewState
from volspec.viewer.ui.context import UiContext, tip
from volspec.viewer.ui.palette_cells import CELL_POPUP, COLUMN_POPUP, ROW_POPUP, column_note
from volspec.viewer.ui.widgets import as_one_line, pick

# Kinds of targets by their titles: the kind, and the tip.
_KINDS = {
    "No target": ("", "Any colour"),
    "This colour": ("colour", "Pick it below"),
    "One colour with others": (
        "free",
        "All cells of a group get one colour, found by the design (metamers)",
    ),
    "Black": ("black", "Reflects nothing of this light: a metameric black"),
    "The colour of another cell": ("same", "Equal to that cell, whatever its colour"),
    "Different from another cell": ("distinct", "By at least this ΔE"),
}
_WORDS = {kind: words for words, (kind, _) in _KINDS.items()}
_LOG = imgui.SliderFlags_.logarithmic
_WIDTH = 232.0
_ENTER = imgui.InputTextFlags_.enter_returns_true
_C = imgui.ColorEditFlags_
_PICKER = _C.no_side_preview | _C.no_label | _C.display_hex | _C.no_options


def draw(state: ViewState, table: PaletteTable, ui: UiContext) -> ViewState:
    """Draw the popup that is open, if any."""
    if ui.popup:
        imgui.open_popup(ui.popup)
        ui.popup = ""
    new = state
    if imgui.is_popup_open(CELL_POPUP):
        # Next to the table, which shows the result.
        window_pos = imgui.get_window_pos()
        corner = window_pos.x - ui.px(8), window_pos.y + imgui.get_window_height() - ui.px(8)
        imgui.set_next_window_pos(corner, imgui.Cond_.always, (1.0, 1.0))
    for name, contents in ((CELL_POPUP, _cell), (COLUMN_POPUP, _light), (ROW_POPUP, _material)):
        if imgui.begin_popup(name):
            new = contents(new, table, ui)
            imgui.end_popup()
    return new


def _cell(state: ViewState, table: PaletteTable, ui: UiContext) -> ViewState:
    place, new = state.interface.pick.place, state
    if place is None or place not in table.cells:
        return state
    report, cell = table.cells[place], state.palette.targets.cells.get(place)
    number = table.index(place)
    imgui.text(f"{place[0]} under {place[1]}")
    imgui.push_item_width(ui.px(_WIDTH))
    kind = cell.kind if cell else ""
    picked = pick("##kind", _WORDS[kind], _KINDS, lambda title: tip(_KINDS[title][1], at_once=True))
    ui.note("target kind")
    if picked is not None:
        new = palette_edits.set_target_kind(new, number, _KINDS[picked][0])
    if kind in ("", "colour"):
        new = _picker(new, table, place, ui)
    elif cell is not None:
        new = _other(new, table, number, cell, ui)
    # Always shown, so that the first target does not move items under the mouse.
    imgui.begin_disabled(cell is None)
    new = _weight(new, number, cell or Cell("black"), ui)
    imgui.end_disabled()
    imgui.pop_item_width()
    far = "" if report.delta_E_2000 is None else f", ΔE {report.delta_E_2000:.1f}"
    imgui.text_disabled(f"Reached {hexadecimal(report.obtained)}{far}")
    return new


def _picker(state: ViewState, table: PaletteTable, place: Place, ui: UiContext) -> ViewState:
    """Draw the picker of a cell's target; with no target yet, picking a colour makes one."""
    cell = state.palette.targets.cells.get(place)
    codes = cell.colour if cell and cell.colour else clip_codes(table.cells[place].obtained)
    changed, picked = imgui.color_picker3("##colour", list(codes), _PICKER)
    ui.note("picker")
    if not changed:
        return state
    key = " ".join(f"{code:.5f}" for code in clip_codes((picked[0], picked[1], picked[2])))
    return palette_edits.set_target(state, table.index(place), key)


def draw_material_colour(state: ViewState, ui: UiContext, name: str) -> ViewState:
    """Draw the picker of a material's colour under the brightest light, in a popup of its own."""
    table = colour_table(state)
    place = name, table.columns[brightest_row(state.lights)]
    imgui.text(f"{as_one_line(name)} under {as_one_line(place[1])}")
    if place not in table.cells:
        imgui.text_wrapped(table.complaint)
        return state
    imgui.push_item_width(ui.px(_WIDTH))
    new = _picker(state, table, place, ui)
    imgui.pop_item_width()
    imgui.text_disabled("A target of the Palette panel")
    return new


def _other(
    state: ViewState, table: PaletteTable, number: int, cell: Cell, ui: UiContext
) -> ViewState:
    """Draw the settings of a target other than a colour: a group, or another cell."""
    if cell.kind == "free":
        entered, name = imgui.input_text("##group", cell.group, _ENTER)
        tip("Cells with this group name get one colour", at_once=True)
        return palette_edits.set_target_group(state, number, name) if entered else state
    new = state
    if cell.other is not None:
        places = {" under ".join(place): table.index(place) for place in table.cells}
        other_places = [words for words, index in places.items() if index != number]
        picked = pick("##other", " under ".join(cell.other), other_places)
        ui.note("target other")
        if picked is not None:
            new = palette_edits.set_target_kind(new, number, cell.kind, places[picked])
    if cell.kind == "distinct":
        edited, far = imgui.slider_float("##distance", cell.distance, *DISTANCES, "ΔE %.0f or more")
        if edited:
            new = palette_edits.set_target_distance(new, number, far)
    return new


def _weight(state: ViewState, number: int, cell: Cell, ui: UiContext) -> ViewState:
    must, new = math.isinf(cell.weight), state
    imgui.begin_disabled(must)
    now = 1.0 if must else cell.weight
    changed, weight = imgui.slider_float("##weight", now, *WEIGHTS, "Weight %.2g", _LOG)
    ui.note("target weight")
    imgui.end_disabled()
    tip("Weight relative to the other targets")
    if changed and not must:
        new = palette_edits.set_target_weight(new, number, weight)
    if cell.kind != "distinct":
        pressed, must = imgui.checkbox("Must be met", must)
        tip("Meet it exactly, or refuse the design")
        if pressed:
            new = palette_edits.set_target_weight(new, number, None if must else 1.0)
    return new


def _light(state: ViewState, table: PaletteTable, ui: UiContext) -> ViewState:
    kind, index = ui.member
    if kind != LIGHT or index >= len(table.columns):
        return state
    name, new = table.columns[index], state
    imgui.text(name)
    imgui.text_disabled(state.lights[index].label or "light")
    if note := column_note(state.lights[index]):
        imgui.text_disabled(note)
    imgui.separator()
    if imgui.menu_item("Show in the picture", "", False)[0]:
        new = lights.show_alone(new, index)
    ui.note("show light")
    opened = (LIGHT, name) in state.palette.targets.free
    single = may_design(state, index)
    if imgui.menu_item("May change", "", opened, single)[0]:
        new = palette_edits.toggle_free(new, LIGHT, index)
    if imgui.begin_menu("A sum of real lamps", single):
        ticked = state.palette.targets.lamps.get(name, ())
        imgui.text_disabled("None ticked: any spectrum")
        if imgui.begin_child("lamps", (ui.px(230), ui.px(220))):
            for lamp in light_names():
                if imgui.checkbox(lamp, lamp in ticked)[0]:
                    new = palette_edits.toggle_lamp(new, index, lamp)
        imgui.end_child()
        imgui.end_menu()
    return new


def _material(state: ViewState, table: PaletteTable, ui: UiContext) -> ViewState:
    kind, index = ui.member
    if kind != REFLECTANCE or index >= len(table.rows):
        return state
    name, new = table.rows[index], state
    imgui.text(name)
    imgui.text_disabled("reflectance, 0 to 1")
    imgui.separator()
    opened = (REFLECTANCE, name) in state.palette.targets.free
    if imgui.menu_item("May change", "", opened)[0]:
        new = palette_edits.toggle_free(new, REFLECTANCE, index)
    constant = name in state.palette.targets.constant
    if imgui.menu_item("One colour under every light", "", constant)[0]:
        new = palette_edits.toggle_constant(new, index)
    for action, title in (("hide", "Hide …"), ("reveal", "Reveal …"), ("keep", "Keep its colour")):
        if imgui.menu_item(f"{title}##{action}", "", False)[0]:
            new = palette_edits.pick_material(new, name)
            ui.request(action)
    return new
