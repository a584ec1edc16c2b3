"""The rows of the lights: swatch, spectrum, name, weight, solo, mute; a list that scrolls."""

from __future__ import annotations

from imgui_bundle import imgui

from volspec.viewer.model import light_rows, lights
from volspec.viewer.model.commands import BY_NAME
from volspec.viewer.model.state import ViewState
from volspec.viewer.ui.context import UiContext
from volspec.viewer.ui.light_look import adapted_colour, raw_colour, spark
from volspec.viewer.ui.widgets import (
    as_one_line,
    key_text,
    lit_button,
    name_field,
    pack_colour,
    shorten,
    tip,
)

_SWATCH, _SPARK, _BOTH = 30.0, 46.0, 48.0
_FLAGS = (
    imgui.TableFlags_.sizing_fixed_fit
    | imgui.TableFlags_.no_pad_outer_x
    | imgui.TableFlags_.scroll_y
)
# What a right click on a row offers, beside what its buttons do.
_MENU = ("alone", "solo", "mute", "rename-light", "reset-spectrum", "remove-light")


def draw(state: ViewState, ui: UiContext, height: float) -> ViewState:
    """Draw them within a height."""
    if not imgui.begin_table("lights", 5, _FLAGS, (0, height)):
        return state
    fixed, stretch = imgui.TableColumnFlags_.width_fixed, imgui.TableColumnFlags_.width_stretch
    imgui.table_setup_column("colour", fixed, ui.px(_SWATCH))
    imgui.table_setup_column("spectrum", fixed, ui.px(_SPARK))
    imgui.table_setup_column("name", stretch, 1.0)
    imgui.table_setup_column("weight", stretch, 0.95)
    imgui.table_setup_column("solo", fixed, ui.px(_BOTH))
    shining = light_rows.effective_weights(state.lights)
    new = state
    _scroll(state, ui, height)
    clipper = imgui.ListClipper()
    clipper.begin(len(state.lights))
    while clipper.step():
        for i in range(clipper.display_start, clipper.display_end):
            imgui.push_id(i)
            imgui.table_next_row()
            new = _row(new, state, ui, i, shining[i] > 0)
            imgui.pop_id()
    clipper.end()
    imgui.end_table()
    return new


def _scroll(state: ViewState, ui: UiContext, height: float) -> None:
    """Bring a light into view that has been chosen since the last frame."""
    chosen = state.interface.light
    if chosen == ui.lights.row:
        return
    ui.lights.row = chosen
    line = imgui.get_frame_height() + 2 * imgui.get_style().cell_padding.y
    imgui.set_scroll_y(scroll_to(imgui.get_scroll_y(), chosen * line, line, height))


def scroll_to(scroll: float, top: float, line: float, height: float) -> float:
    """Where a list is to be scrolled to so that a line of it is seen.

    >>> scroll_to(0.0, 250.0, 25.0, 100.0), scroll_to(60.0, 25.0, 25.0, 100.0)
    (175.0, 25.0)
    """
    return min(max(scroll, top + line - height), top)


def _row(new: ViewState, state: ViewState, ui: UiContext, i: int, lit: bool) -> ViewState:
    row = state.lights[i]
    imgui.table_next_column()
    _swatch(state, ui, i)
    imgui.table_next_column()
    if _spark(state, ui, i, lit):
        new = lights.choose(new, i)
        ui.lights.to_tab = "Spectrum"
    imgui.table_next_column()
    new = _name(new, state, ui, i, lit)
    imgui.table_next_column()
    imgui.set_next_item_width(-1)
    moved, weight = imgui.slider_float("##weight", row.weight, 0.0, 1.0, "%.2f")
    ui.note(f"weight {i}")
    if moved:
        new = lights.set_weight(new, i, weight)
        new = lights.choose(new, i)
    imgui.table_next_column()
    if _toggle("S", row.solo, state, "Solo: only lights with S shine"):
        new = lights.toggle_solo(new, i)
    ui.note(f"solo {i}")
    imgui.same_line(0, ui.px(3))
    if _toggle("M", row.muted, state, "Mute"):
        new = lights.toggle_mute(new, i)
    ui.note(f"mute {i}")
    return new


def _name(new: ViewState, state: ViewState, ui: UiContext, i: int, lit: bool) -> ViewState:
    row = state.lights[i]
    if ui.lights.renaming == i:
        return _rename(new, ui, i)
    colour = imgui.Col_.text if lit else imgui.Col_.text_disabled
    imgui.push_style_color(imgui.Col_.text, imgui.get_style_color_vec4(colour))
    imgui.align_text_to_frame_padding()
    room = imgui.get_content_region_avail().x
    label = f"{shorten(row.name, room)}##name"
    if imgui.selectable(label, state.interface.light == i)[0]:
        new = lights.choose(new, i)
        if ui.lights.tab != "Spectrum":
            ui.lights.to_tab = "Light"
    imgui.pop_style_color()
    ui.note(f"name {i}")
    lux = row.rig.total_lux
    level = f"\n{lux:.4g} lx at weight 1" if lux else ""
    tip(f"{row_tip(row)}{level}\nDouble-click: this light alone; F2: another name")
    if imgui.is_item_hovered() and imgui.is_mouse_double_clicked(0):
        new = lights.only(new, i)
    return _context(new, ui, i)


def row_tip(row: light_rows.LightRow) -> str:
    """What a light is, in lines: its name, and what it was made from."""
    name = as_one_line(row.name)
    if row.before is not None:
        was = row.before
        whole = " + ".join(text or was.name for text in dict.fromkeys(was.texts))
        return f"{name}\nDrawn by hand, from {as_one_line(whole)}"
    return "\n".join(dict.fromkeys((name, as_one_line(row.label))))


def _rename(new: ViewState, ui: UiContext, i: int) -> ViewState:
    """The name's field, in its place."""
    panel = ui.lights
    entered, ended = name_field("##rename", panel)
    ui.note(f"rename {i}")
    if entered:
        new = lights.rename(new, i, panel.name)
    if ended:
        panel.renaming, panel.name = -1, ""
    return new


def _context(new: ViewState, ui: UiContext, i: int) -> ViewState:
    """What a right click offers: actions of the chosen light, for this one."""
    if not imgui.begin_popup_context_item("row"):
        return new
    for name in _MENU:
        action = BY_NAME[name]
        title = action.title.replace("the chosen ", "the ").replace("The chosen ", "This ")
        if imgui.menu_item(title, key_text(action), False)[0]:
            new = ui.run(lights.choose(new, i), action)
        ui.note(f"row {name}")
    imgui.end_popup()
    return new


def _swatch(state: ViewState, ui: UiContext, index: int) -> None:
    """Left as the light is, right as an adapted eye sees it."""
    rig = state.lights[index].rig
    raw, adapted = raw_colour(rig), adapted_colour(rig, state.relight)
    x, y = imgui.get_cursor_screen_pos()
    width, height = ui.px(_SWATCH), imgui.get_frame_height()
    imgui.dummy((width, height))
    draw_list, round_by = imgui.get_window_draw_list(), ui.px(3)
    half, inset = x + width / 2, ui.px(2)
    for left, right, colour, corners in (
        (x, half, raw, imgui.ImDrawFlags_.round_left),
        (half, x + width, adapted, imgui.ImDrawFlags_.round_right),
    ):
        ends = (left, y + inset), (right, y + height - inset)
        draw_list.add_rect_filled(*ends, pack_colour(colour), round_by, corners)
    border = imgui.get_color_u32(imgui.Col_.text_disabled, 0.7)
    draw_list.add_rect((x, y + inset), (x + width, y + height - inset), border, round_by)
    tip("White paper under this light\nleft: as it is, right: to an eye adapted to it")


def _spark(state: ViewState, ui: UiContext, index: int, lit: bool) -> bool:
    """The spectrum in small; whether it was clicked."""
    x, y = imgui.get_cursor_screen_pos()
    width, height = ui.px(_SPARK), imgui.get_frame_height()
    clicked: bool = imgui.invisible_button("spark", (width, height))
    ui.note(f"spark {index}")
    inset = ui.px(2)
    rect = x, y + inset, width, height - 2 * inset
    draw_list, grid = imgui.get_window_draw_list(), state.document.grid
    ends = (x, y + inset), (x + width, y + height - inset)
    draw_list.add_rect_filled(*ends, imgui.get_color_u32(imgui.Col_.frame_bg, 0.55))
    spark(draw_list, rect, state.lights[index].rig, grid, 1.0 if lit else 0.4)
    tip("Its spectrum; a click opens it to be drawn")
    return clicked


def _toggle(label: str, on: bool, state: ViewState, what: str) -> bool:
    side = imgui.get_frame_height()
    pressed = lit_button(label, on, state.interface.dark, (side, side))
    tip(what)
    return pressed
