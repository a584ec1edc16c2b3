"""The panel of lights: the scrolling list, tabs, and the list of saved light states."""

from __future__ import annotations

from collections.abc import Callable
from functools import lru_cache

from imgui_bundle import imgui

from volspec.spectra.library import describe_light, library_names
from volspec.viewer.model import light_rows, light_states, lights
from volspec.viewer.model.commands import BY_NAME
from volspec.viewer.model.light_rows import light_rig
from volspec.viewer.model.light_states import MAX_SECONDS, recalled_rows
from volspec.viewer.model.state import ViewState
from volspec.viewer.ui import effects, lights_detail, lights_dial, lights_library, lights_rendition
from volspec.viewer.ui.context import UiContext, tip
from volspec.viewer.ui.light_look import adapted_colour, fill_box, raw_colour, spark
from volspec.viewer.ui.lights_spectrum import draw_mix, draw_pen
from volspec.viewer.ui.widgets import (
    as_one_line,
    key_text,
    lit_button,
    shorten,
    shown_rows,
    text_width,
)

Rename = Callable[[ViewState, int, str], ViewState]
_ROW_SWATCH, _ROW_SPARK, _BOTH = 30.0, 46.0, 48.0
# The least room for the words after a name.
_MIN_WORDS = 36.0
_T = imgui.TableFlags_
_FLAGS = _T.sizing_fixed_fit | _T.no_pad_outer_x | _T.scroll_y
# Commands in a row's context menu.
_ROW_MENU = ("alone", "solo", "mute", "rename-light", "reset-spectrum", "remove-light")


def draw_rows(state: ViewState, ui: UiContext, height: float) -> ViewState:
    """Draw the list within a height."""
    if not imgui.begin_table("lights", 5, _FLAGS, (0, height)):
        return state
    fixed, stretch = imgui.TableColumnFlags_.width_fixed, imgui.TableColumnFlags_.width_stretch
    imgui.table_setup_column("colour", fixed, ui.px(_ROW_SWATCH))
    imgui.table_setup_column("spectrum", fixed, ui.px(_ROW_SPARK))
    imgui.table_setup_column("name", stretch, 1.0)
    imgui.table_setup_column("weight", stretch, 0.65)
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
    index = state.interface.light
    if index == ui.lights.row:
        return
    ui.lights.row = index
    line = imgui.get_frame_height() + 2 * imgui.get_style().cell_padding.y
    top = index * line
    imgui.set_scroll_y(min(max(imgui.get_scroll_y(), top + line - height), top))


def _row(new: ViewState, state: ViewState, ui: UiContext, i: int, is_on: bool) -> ViewState:
    row = state.lights[i]
    imgui.table_next_column()
    _row_swatch(state, ui, i)
    imgui.table_next_column()
    if _row_spark(state, ui, i, is_on):
        new = lights.choose(new, i)
        ui.lights.to_tab = "Spectrum"
    imgui.table_next_column()
    new = _row_name(new, state, ui, i, is_on)
    imgui.table_next_column()
    imgui.set_next_item_width(-1)
    changed, weight = imgui.slider_float("##weight", row.weight, 0.0, 1.0, "%.2f")
    ui.note(f"weight {i}")
    if changed:
        new = lights.choose(lights.set_weight(new, i, weight), i)
    imgui.table_next_column()
    dark, size = state.interface.dark, (imgui.get_frame_height(), imgui.get_frame_height())
    if lit_button("S", row.solo, dark, size):
        new = lights.toggle_solo(new, i)
    ui.note(f"solo {i}", "Solo: only lights with S shine")
    imgui.same_line(0, ui.px(3))
    if lit_button("M", row.muted, dark, size):
        new = lights.toggle_mute(new, i)
    ui.note(f"mute {i}", "Mute")
    return new


def _row_name(new: ViewState, state: ViewState, ui: UiContext, i: int, is_on: bool) -> ViewState:
    row, panel = state.lights[i], ui.lights
    if panel.renaming == i:
        new = name_field(new, ui, "##rename", lights.rename, i)
        ui.note(f"rename {i}")
        return new
    colour = imgui.Col_.text if is_on else imgui.Col_.text_disabled
    imgui.push_style_color(imgui.Col_.text, imgui.get_style_color_vec4(colour))
    imgui.align_text_to_frame_padding()
    room = imgui.get_content_region_avail().x
    (x, y), short_name = imgui.get_cursor_screen_pos(), shorten(row.name, room)
    if imgui.selectable(f"{short_name}##name", state.interface.light == i)[0]:
        new = lights.choose(new, i)
        if panel.tab not in ("Spectrum", "Rendition"):
            panel.to_tab = "Light"
    imgui.pop_style_color()
    ui.note(f"name {i}")
    left = text_width(short_name) + ui.px(8)
    if (words := plain_words(row)) and room - left > ui.px(_MIN_WORDS):
        place = x + left, y + imgui.get_style().frame_padding.y
        dim = imgui.get_color_u32(imgui.Col_.text_disabled)
        imgui.get_window_draw_list().add_text(place, dim, shorten(words, room - left))
    lux = row.rig.total_lux
    level = f"\n{lux:.4g} lx at weight 1" if lux else ""
    tip(f"{row_tip(row)}{level}\nDouble-click: this light alone; F2: rename")
    if imgui.is_item_hovered() and imgui.is_mouse_double_clicked(0):
        new = lights.only(new, i)
    return _context_menu(new, ui, i)


def plain_words(row: light_rows.LightRow) -> str:
    """Return what a light of the library is, if its name is only the library's code.

    >>> from volspec.relight import LightRig
    >>> from volspec.spectra import light
    >>> plain_words(light_rows.LightRow("A", "", LightRig((light("A"),)), texts=("A",)))
    'tungsten lamp'
    """
    is_code = row.texts == (row.name,) and row.name in library_names()
    return describe_light(row.name).partition(",")[0] if is_code else ""


def name_field(state: ViewState, ui: UiContext, label: str, rename: Rename, i: int) -> ViewState:
    """Draw the field for a new name, and rename a light or a saved state on Enter."""
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
    """Return a light's name and its source, on separate lines."""
    name = as_one_line(row.name)
    if (before := row.before) is not None:
        texts = " + ".join(text or before.name for text in dict.fromkeys(before.texts))
        return f"{name}\nDrawn by hand, from {as_one_line(texts)}"
    return "\n".join(dict.fromkeys((name, as_one_line(row.label))))


def _context_menu(new: ViewState, ui: UiContext, i: int) -> ViewState:
    """Draw a row's context menu: the commands for the chosen light, applied to this one."""
    if not imgui.begin_popup_context_item("row"):
        return new
    for name in _ROW_MENU:
        command = BY_NAME[name]
        title = command.title.replace("the chosen ", "the ").replace("The chosen ", "This ")
        if imgui.menu_item(title, key_text(command), False)[0]:
            new = ui.run(lights.choose(new, i), command)
        ui.note(f"row {name}")
    imgui.end_popup()
    return new


def _row_swatch(state: ViewState, ui: UiContext, index: int) -> None:
    """Draw the light's colour: left unadapted, right adapted."""
    rig, corners, rounding = state.lights[index].rig, imgui.ImDrawFlags_, ui.px(3)
    x, y = imgui.get_cursor_screen_pos()
    half, height = ui.px(_ROW_SWATCH) / 2, imgui.get_frame_height()
    imgui.dummy((2 * half, height))
    top, h = y + ui.px(2), height - ui.px(4)
    fill_box((x, top, half, h), raw_colour(rig), rounding, corners.round_left)
    adapted = adapted_colour(rig, state.relight)
    fill_box((x + half, top, half, h), adapted, rounding, corners.round_right)
    border, end = imgui.get_color_u32(imgui.Col_.text_disabled, 0.7), (x + 2 * half, top + h)
    imgui.get_window_draw_list().add_rect((x, top), end, border, rounding)
    tip("White paper under this light\nleft: unadapted, right: to an adapted eye")


def _row_spark(state: ViewState, ui: UiContext, index: int, is_on: bool) -> bool:
    """Draw the small spectrum; return True if it was clicked."""
    x, y = imgui.get_cursor_screen_pos()
    width, height = ui.px(_ROW_SPARK), imgui.get_frame_height()
    clicked: bool = imgui.invisible_button("spark", (width, height))
    ui.note(f"spark {index}")
    top, end = y + ui.px(2), (x + width, y + height - ui.px(2))
    background = imgui.get_color_u32(imgui.Col_.frame_bg, 0.55)
    imgui.get_window_draw_list().add_rect_filled((x, top), end, background)
    rect = x, top, width, height - ui.px(4)
    spark(rect, state.lights[index].rig, state.document.grid, 1.0 if is_on else 0.4)
    tip("Spectrum; click to draw it")
    return clicked


_SWATCH, _SPARK = 16.0, 46.0
_MENU = "state menu"
# Always the same rig, as the caches of its colours require.
_rig_of_saved = lru_cache(maxsize=128)(light_rig)


def draw_states(state: ViewState, ui: UiContext) -> ViewState:
    """Draw the tab of saved states."""
    new = state
    if imgui.button("Save state"):
        new = ui.run(new, "save-state")
    ui.note("save state", "Save all lights and the viewing (Alt+S)")
    imgui.same_line()
    imgui.set_next_item_width(-ui.px(40))
    text = "at once" if state.interface.fade_s <= 0 else "%.1f s"
    changed, seconds = imgui.slider_float("Fade", state.interface.fade_s, 0.0, MAX_SECONDS, text)
    ui.note("fade")
    if changed:
        new = light_states.set_fade(new, seconds)
    if not state.saved_lights:
        imgui.text_disabled("No saved states yet. Alt+1 … Alt+9 fade to them.")
        return new
    for i in range(len(state.saved_lights)):
        imgui.push_id(i)
        new = _line(new, state, ui, i)
        imgui.pop_id()
    return new


def _line(new: ViewState, state: ViewState, ui: UiContext, i: int) -> ViewState:
    if ui.lights.naming == i:
        new = name_field(new, ui, "##name", light_states.rename, i)
        ui.note("state name")
        return new
    saved = state.saved_lights[i]
    corner = imgui.get_cursor_screen_pos()
    side, width = imgui.get_frame_height(), imgui.get_content_region_avail().x
    recalled = recalled_rows(state.lights, saved.lights)
    current = saved.relight == state.relight and recalled == state.lights
    pressed, _ = imgui.selectable("##recall", current, size=(width - side - ui.px(6), side))
    ui.note(f"state {i}", f"Fade to {as_one_line(saved.name)}{f' (Alt+{i + 1})' if i < 9 else ''}")
    if pressed:
        new = light_states.recall(new, i)
    _contents(state, ui, i, (corner.x, corner.y))
    imgui.same_line(width - side)
    if imgui.button("…", (side, 0)):
        imgui.open_popup(_MENU)
    ui.note(f"more {i}")
    return _menu(new, state, ui, i)


def _contents(state: ViewState, ui: UiContext, i: int, corner: tuple[float, float]) -> None:
    """Draw a saved state's number, colour, spectrum and name."""
    (x, y), saved, draw_list = corner, state.saved_lights[i], imgui.get_window_draw_list()
    height, inset = imgui.get_frame_height(), ui.px(3)
    top = y + (height - imgui.get_font_size()) / 2
    dim = imgui.get_color_u32(imgui.Col_.text_disabled)
    draw_list.add_text((x + ui.px(4), top), dim, f"{i + 1}")
    left = x + ui.px(22)
    rig = _rig_of_saved(saved.lights)
    if rig is not None:
        swatch_height = height - 2 * inset
        fill_box((left, y + inset, ui.px(_SWATCH), swatch_height), raw_colour(rig), ui.px(3))
        rect = left + ui.px(_SWATCH + 6), y + inset, ui.px(_SPARK), swatch_height
        spark(rect, rig, state.document.grid)
    left += ui.px(_SWATCH + _SPARK + 14)
    room = x + imgui.get_content_region_avail().x - height - ui.px(12) - left
    text = imgui.get_color_u32(imgui.Col_.text)
    draw_list.add_text((left, top), text, shorten(saved.name, room))


def _menu(new: ViewState, state: ViewState, ui: UiContext, i: int) -> ViewState:
    if not imgui.begin_popup(_MENU):
        return new
    if imgui.menu_item("Rename", "", False)[0]:
        panel = ui.lights
        panel.naming, panel.name, panel.focus = i, state.saved_lights[i].name, True
    ui.note("rename state")
    if imgui.menu_item("Save the current lights here", "", False)[0]:
        new = light_states.save_over(new, i)
    if imgui.menu_item("Delete", "", False)[0]:
        new = light_states.delete(new, i)
    imgui.end_popup()
    return new


# Least heights of the tabs and the buttons; the tabs' fraction of the panel if the list is long.
_MIN_TABS, _BUTTONS, _TABS_FRACTION = 134.0, 34.0, 0.4
_MIN_ROWS = 3
# Least width of the spectrum next to the dial; from this height on, it is below the dial.
_MIN_MIX, _TALL = 84.0, 300.0
TABS = ("Dial", "Light", "Spectrum", "Rendition", "States")


def draw(state: ViewState, ui: UiContext) -> ViewState | None:
    """Draw the panel."""
    line = imgui.get_frame_height() + 2 * imgui.get_style().cell_padding.y
    height = imgui.get_content_region_avail().y
    buttons = ui.px(_BUTTONS) + effects.lines(ui)
    room = height - max(ui.px(_MIN_TABS), _TABS_FRACTION * height) - buttons
    rows = min(len(state.lights), max(int(room / line), _MIN_ROWS))
    new = draw_rows(state, ui, rows * line + ui.px(2))
    new = _buttons(new, ui)
    new = effects.draw(new, ui)
    if imgui.begin_tab_bar("light tabs"):
        for name in TABS:
            requested = ui.lights.to_tab == name
            flags = imgui.TabItemFlags_.set_selected if requested else imgui.TabItemFlags_.none
            opened, _ = imgui.begin_tab_item(name, None, flags)
            ui.note(f"tab {name}")
            if opened:
                ui.lights.tab = name
                if requested:
                    ui.lights.to_tab = ""
                new = _tab(name, new, ui)
                imgui.end_tab_item()
        imgui.end_tab_bar()
    return None if new is state else new


def _tab(name: str, state: ViewState, ui: UiContext) -> ViewState:
    min_height = ui.px(_MIN_TABS) - 1.5 * imgui.get_frame_height_with_spacing()
    height = max(imgui.get_content_region_avail().y, min_height)
    if name == "Dial":
        return _dial(state, ui, height)
    if name == "Spectrum":
        return draw_pen(state, ui, height)
    new = state
    if imgui.begin_child(f"tab {name}", (0, height)):
        if name == "Light":
            new = lights_detail.draw(state, ui)
        elif name == "Rendition":
            lights_rendition.draw(state, ui, height)
        else:
            new = draw_states(state, ui)
    imgui.end_child()
    return new


def _dial(state: ViewState, ui: UiContext, height: float) -> ViewState:
    width = imgui.get_content_region_avail().x
    gap = imgui.get_style().item_spacing.x
    if height > ui.px(_TALL):
        new = lights_dial.draw(state, ui, width, height * 0.62)
        draw_mix(new, ui, width, height * 0.38 - gap)
        return new
    dial = max(lights_dial.width_for(state, ui, height), width * 0.6)
    dial = min(dial, width - ui.px(_MIN_MIX))
    new = lights_dial.draw(state, ui, dial, height)
    imgui.same_line()
    draw_mix(new, ui, width - dial - gap, height)
    return new


def _buttons(state: ViewState, ui: UiContext) -> ViewState:
    if imgui.button("Add"):
        imgui.open_popup(lights_library.POPUP)
    ui.note("add light", "Add a light from the library, a file, or a mix")
    new = lights_library.draw(state, ui)
    one = len(state.lights) < 2
    new = _button(new, ui, "remove-light", "Remove", "Remove the chosen light from the list", one)
    dark = light_rig(state.lights) is None
    new = _button(new, ui, "keep-mix", "Add mix", "Add the current mix as a light", dark)
    new = _button(new, ui, "compare", "Compare", "Compare these lights with others, side by side")
    if state.other is not None:
        new = _button(new, ui, "swap", "Swap", "Swap the lights of the two sides")
    return new


def _button(
    state: ViewState, ui: UiContext, name: str, title: str, text: str, disabled: bool = False
) -> ViewState:
    """Draw a command's button next to the last one; highlighted if the command is on."""
    command = BY_NAME[name]
    imgui.same_line(0, ui.px(6))
    on = command.on is not None and command.on(state)
    imgui.begin_disabled(disabled)
    pressed = lit_button(title, on, state.interface.dark)
    imgui.end_disabled()
    ui.note(f"button {name}")
    key = key_text(command)
    tip(f"{text} ({key})" if key else text)
    return ui.run(state, command) if pressed else state
