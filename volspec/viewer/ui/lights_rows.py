"""The scrolling list of lights: swatch, spectrum, name, weight, solo, mute."""

from __future__ import annotations

from collections.abc import Callable

from imgui_bundle import imgui

from volspec.viewer.model import light_rows, lights
from volspec.viewer.model.commands import BY_NAME
from volspec.viewer.model.state import ViewState
from volspec.viewer.ui.context import UiContext
from volspec.viewer.ui.light_look import adapted_colour, fill_box, raw_colour, spark
from volspec.viewer.ui.widgets import as_one_line, key_text, lit_button, shorten, shown_rows, tip

Rename = Callable[[ViewState, int, str], ViewState]
_SWATCH, _SPARK, _BOTH = 30.0, 46.0, 48.0
_FLAGS = (
    imgui.TableFlags_.sizing_fixed_fit
    | imgui.TableFlags_.no_pad_outer_x
    | imgui.TableFlags_.scroll_y
)
# Commands of a right click on a row.
_MENU = ("alone", "solo", "mute", "rename-light", "reset-spectrum", "remove-light")


def draw(state: ViewState, ui: UiContext, height: float) -> ViewState:
    """Draw the list within a height."""
    if not imgui.begin_table("lights", 5, _FLAGS, (0, height)):
        return state
    fixed, stretch = imgui.TableColumnFlags_.width_fixed, imgui.TableColumnFlags_.width_stretch
    imgui.table_setup_column("colour", fixed, ui.px(_SWATCH))
    imgui.table_setup_column("spectrum", fixed, ui.px(_SPARK))
    imgui.table_setup_column("name", stretch, 1.0)
    imgui.table_setup_column("weight", stretch, 0.95)
    imgui.table_setup_column("solo", fixed, ui.px(_BOTH))
    weights, new = light_rows.effective_weights(state.lights), state
    _scroll(state, ui, height)
    for i in shown_rows(len(state.lights)):
        imgui.push_id(i)
        imgui.table_next_row()
        new = _row(new, state, ui, i, weights[i] > 0)
        imgui.pop_id()
    imgui.end_table()
    return new


def _scroll(state: ViewState, ui: UiContext, height: float) -> None:
    """Scroll to a light that was chosen since the last frame."""
    chosen = state.interface.light
    if chosen == ui.lights.row:
        return
    ui.lights.row = chosen
    line = imgui.get_frame_height() + 2 * imgui.get_style().cell_padding.y
    top = chosen * line
    imgui.set_scroll_y(min(max(imgui.get_scroll_y(), top + line - height), top))


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
        new = lights.choose(lights.set_weight(new, i, weight), i)
    imgui.table_next_column()
    dark, size = state.interface.dark, (imgui.get_frame_height(), imgui.get_frame_height())
    if lit_button("S", row.solo, dark, size):
        new = lights.toggle_solo(new, i)
    ui.note(f"solo {i}")
    tip("Solo: only lights with S shine")
    imgui.same_line(0, ui.px(3))
    if lit_button("M", row.muted, dark, size):
        new = lights.toggle_mute(new, i)
    ui.note(f"mute {i}")
    tip("Mute")
    return new


def _name(new: ViewState, state: ViewState, ui: UiContext, i: int, lit: bool) -> ViewState:
    row, panel = state.lights[i], ui.lights
    if panel.renaming == i:
        new = name_field(new, ui, "##rename", lights.rename, i)
        ui.note(f"rename {i}")
        return new
    colour = imgui.Col_.text if lit else imgui.Col_.text_disabled
    imgui.push_style_color(imgui.Col_.text, imgui.get_style_color_vec4(colour))
    imgui.align_text_to_frame_padding()
    label = f"{shorten(row.name, imgui.get_content_region_avail().x)}##name"
    if imgui.selectable(label, state.interface.light == i)[0]:
        new = lights.choose(new, i)
        if panel.tab != "Spectrum":
            panel.to_tab = "Light"
    imgui.pop_style_color()
    ui.note(f"name {i}")
    lux = row.rig.total_lux
    level = f"\n{lux:.4g} lx at weight 1" if lux else ""
    tip(f"{row_tip(row)}{level}\nDouble-click: this light alone; F2: rename")
    if imgui.is_item_hovered() and imgui.is_mouse_double_clicked(0):
        new = lights.only(new, i)
    return _context_menu(new, ui, i)


def name_field(state: ViewState, ui: UiContext, label: str, rename: Rename, i: int) -> ViewState:
    """Draw the field of a new name, and rename a light or a saved state on Enter."""
    panel, new = ui.lights, state
    if panel.focus:
        imgui.set_keyboard_focus_here()
        panel.focus = False
    imgui.set_next_item_width(-1)
    flags = imgui.InputTextFlags_.enter_returns_true | imgui.InputTextFlags_.auto_select_all
    entered, panel.name = imgui.input_text(label, panel.name, flags)
    if entered:
        new = rename(new, i, panel.name)
    if entered or imgui.is_item_deactivated():
        panel.renaming, panel.naming, panel.name = -1, -1, ""
    return new


def row_tip(row: light_rows.LightRow) -> str:
    """Return a light's name and its source, in lines."""
    name = as_one_line(row.name)
    if (before := row.before) is not None:
        texts = " + ".join(text or before.name for text in dict.fromkeys(before.texts))
        return f"{name}\nDrawn by hand, from {as_one_line(texts)}"
    return "\n".join(dict.fromkeys((name, as_one_line(row.label))))


def _context_menu(new: ViewState, ui: UiContext, i: int) -> ViewState:
    """Draw the menu of a right click: commands of the chosen light, for this one."""
    if not imgui.begin_popup_context_item("row"):
        return new
    for name in _MENU:
        command = BY_NAME[name]
        title = command.title.replace("the chosen ", "the ").replace("The chosen ", "This ")
        if imgui.menu_item(title, key_text(command), False)[0]:
            new = ui.run(lights.choose(new, i), command)
        ui.note(f"row {name}")
    imgui.end_popup()
    return new


def _swatch(state: ViewState, ui: UiContext, index: int) -> None:
    """Draw the light's colour: left unadapted, right adapted."""
    rig, corners, rounding = state.lights[index].rig, imgui.ImDrawFlags_, ui.px(3)
    x, y = imgui.get_cursor_screen_pos()
    half, height = ui.px(_SWATCH) / 2, imgui.get_frame_height()
    imgui.dummy((2 * half, height))
    top, tall = y + ui.px(2), height - ui.px(4)
    fill_box((x, top, half, tall), raw_colour(rig), rounding, corners.round_left)
    adapted = adapted_colour(rig, state.relight)
    fill_box((x + half, top, half, tall), adapted, rounding, corners.round_right)
    border, end = imgui.get_color_u32(imgui.Col_.text_disabled, 0.7), (x + 2 * half, top + tall)
    imgui.get_window_draw_list().add_rect((x, top), end, border, rounding)
    tip("White paper under this light\nleft: unadapted, right: to an adapted eye")


def _spark(state: ViewState, ui: UiContext, index: int, lit: bool) -> bool:
    """Draw the small spectrum; return True if it was clicked."""
    x, y = imgui.get_cursor_screen_pos()
    width, height = ui.px(_SPARK), imgui.get_frame_height()
    clicked: bool = imgui.invisible_button("spark", (width, height))
    ui.note(f"spark {index}")
    top, end = y + ui.px(2), (x + width, y + height - ui.px(2))
    background = imgui.get_color_u32(imgui.Col_.frame_bg, 0.55)
    imgui.get_window_draw_list().add_rect_filled((x, top), end, background)
    rect = x, top, width, height - ui.px(4)
    spark(rect, state.lights[index].rig, state.document.grid, 1.0 if lit else 0.4)
    tip("Spectrum; click to draw it")
    return clicked
