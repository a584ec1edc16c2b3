"""Buttons for effects of light on materials, in the Lights panel and in the picture's menu."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from imgui_bundle import imgui

from volspec.viewer.model import depth, effects, palette_table
from volspec.viewer.model.edit import with_interface
from volspec.viewer.model.effects import EFFECT
from volspec.viewer.model.light_rows import brightest_row
from volspec.viewer.model.state import ViewState
from volspec.viewer.ui.context import UiContext, tip
from volspec.viewer.ui.widgets import as_one_line, pack_colour, wrap_text
from volspec.viewer.work.probe import material_at

_PICTURE = "picture menu"
_GAP = 6.0
# Name of a request, title of its button, its list's heading, and its tooltip.
_BUTTONS = (
    (
        effects.DIFFERENCE,
        "Show a difference",
        "Show the difference of",
        "Find the light under which two materials look most different",
    ),
    (
        "hide",
        "Hide in daylight",
        "Hide in daylight",
        "Make a material look like its surroundings in daylight; other lights show it",
    ),
    (
        "merge",
        "Make alike",
        "Make alike in daylight",
        "Give two materials one colour in daylight; other lights show both",
    ),
)


def draw(state: ViewState, ui: UiContext) -> ViewState:
    """Draw the buttons, and what the last one did."""
    new, names = state, tuple(state.transfer.materials)
    imgui.begin_disabled(len(names) < 2 or bool(ui.results.design.busy))
    for number, (name, title, heading, text) in enumerate(_BUTTONS):
        if number:
            imgui.same_line(0, ui.px(_GAP))
        if imgui.button(title):
            imgui.open_popup(name)
        ui.note(f"effect {name}")
        tip(text if len(names) > 1 else "Needs at least two materials", greyed=True)
        if imgui.begin_popup(name):
            imgui.text_disabled(heading)
            new = _list(new, ui, name, names)
            imgui.end_popup()
    imgui.end_disabled()
    for line in _results(ui):
        wrong = line == ui.results.design.complaint
        wrap_text(line, imgui.Col_.check_mark if wrong else imgui.Col_.text)
    ui.note("effect result")
    return new


def lines(ui: UiContext) -> float:
    """Return the height of the buttons and the text below them."""
    width, spacing = imgui.get_content_region_avail().x, imgui.get_style().item_spacing.y
    heights = [imgui.calc_text_size(line, wrap_width=width).y + spacing for line in _results(ui)]
    return imgui.get_frame_height_with_spacing() + sum(heights)


def _results(ui: UiContext) -> list[str]:
    """Return what the last button did, or that it is at work."""
    news = ui.results.design
    lines = (news.busy,) if news.busy else (news.complaint, *news.reached[:2])
    return [line for line in lines if line]


def _list(state: ViewState, ui: UiContext, name: str, materials: Sequence[str]) -> ViewState:
    """Draw a list of materials, or of pairs of them, and request what is picked."""
    new = state
    for number, first in enumerate(materials):
        if name == "hide":
            new = _item(new, ui, name, (first,))
        elif len(materials) == 2:
            if not number:
                new = _item(new, ui, name, (materials[0], materials[1]))
        elif imgui.begin_menu(f"{as_one_line(first)}##{number}"):
            imgui.text_disabled("and")
            for second in materials:
                if second != first:
                    new = _item(new, ui, name, (first, second), second)
            imgui.end_menu()
        ui.note(f"effect first {number}")
    return new


def _item(
    state: ViewState, ui: UiContext, name: str, materials: tuple[str, ...], title: str = ""
) -> ViewState:
    """Draw a row; return the state with its materials picked, if it was pressed."""
    text = as_one_line(title or " and ".join(materials))
    _swatch(state, materials[-1], ui)
    pressed = imgui.menu_item(text, "", False)[0]
    ui.note(f"effect {name} {' '.join(materials)}")
    return _request(state, ui, name, materials) if pressed else state


def _request(state: ViewState, ui: UiContext, name: str, materials: tuple[str, ...]) -> ViewState:
    new = effects.prepare(state, materials)
    ui.request(name, EFFECT)
    return with_interface(new, panels=new.interface.panels | {"Lights"})


def _swatch(state: ViewState, material: str, ui: UiContext) -> None:
    """Draw a material's colour under the brightest light, before its name."""
    table = palette_table.colour_table(state)
    light = palette_table.column_names(state.lights)[brightest_row(state.lights)]
    report = table.cells.get((material, light))
    side = imgui.get_text_line_height()
    x, y = imgui.get_cursor_screen_pos()
    imgui.dummy((side, side))
    if report is not None:
        codes = np.clip(report.obtained, 0.0, 1.0).tolist()
        colour = pack_colour(codes)
        imgui.get_window_draw_list().add_rect_filled((x, y), (x + side, y + side), colour, ui.px(2))
    imgui.same_line(0, ui.px(_GAP))


def draw_picture_menu(state: ViewState, ui: UiContext) -> ViewState | None:
    """Draw the menu of a right click into the picture: what can be done with the material there."""
    if ui.clicked is not None:
        ui.picked, ui.picked_mm = _met_at(state, ui, ui.clicked)
        ui.clicked = None
        if ui.picked:
            imgui.open_popup(_PICTURE)
    new = state
    if imgui.begin_popup(_PICTURE):
        material = ui.picked
        if material in state.transfer.materials:
            new = _material_items(new, ui, material)
        if ui.picked_mm is not None and depth.can_be_set(state) and depth.can_focus(state):
            imgui.separator()
            if imgui.menu_item("Focus here", "", False)[0]:
                new = depth.set_focus(new, ui.picked_mm)
            ui.note("picture focus")
        imgui.end_popup()
    return None if new is state else new


def _material_items(state: ViewState, ui: UiContext, material: str) -> ViewState:
    new = state
    other_names = [name for name in state.transfer.materials if name != material]
    _swatch(state, material, ui)
    imgui.text(as_one_line(material))
    imgui.separator()
    imgui.begin_disabled(not other_names or bool(ui.results.design.busy))
    if imgui.menu_item("Hide this in daylight", "", False)[0]:
        new = _request(new, ui, "hide", (material,))
    ui.note("picture hide")
    for name, title in (
        ("merge", "Make it look like"),
        (effects.DIFFERENCE, "Show its difference from"),
    ):
        if len(other_names) == 1:
            if imgui.menu_item(f"{title} {as_one_line(other_names[0])}", "", False)[0]:
                new = _request(new, ui, name, (material, other_names[0]))
        elif imgui.begin_menu(title):
            for other in other_names:
                new = _item(new, ui, name, (material, other), other)
            imgui.end_menu()
        ui.note(f"picture {name}")
    imgui.end_disabled()
    return new


def _met_at(
    state: ViewState, ui: UiContext, place: tuple[float, float]
) -> tuple[str, float | None]:
    """Return the material at a place of the picture, 0 to 1, and its depth; none if it is empty."""
    image = ui.results.image
    if image is None:
        return "", None
    width, height = image.size
    pixel = min(int(place[0] * width), width - 1), min(int(place[1] * height), height - 1)
    name = material_at(image, state.transfer, pixel)
    return name, depth.distance_mm(image, pixel) if name else None
