"""The lights: a row each, the dial, the spectrum, and the library to add from."""

from __future__ import annotations

from dataclasses import replace

from imgui_bundle import imgui

from volspec.errors import VolspecError
from volspec.spectra import light_names
from volspec.spectra.lamps import LAMPS, PREFIX
from volspec.viewer import lighting
from volspec.viewer.events import Event, reduced
from volspec.viewer.panels import dial, spectrum
from volspec.viewer.panels.desk import Desk, kelvin_slider
from volspec.viewer.state import ViewState
from volspec.viewer.style import ACCENT

_POPUP = "add a light"


def draw(state: ViewState, desk: Desk) -> ViewState | None:
    """Draw the panel."""
    new = _rows(state, desk)
    new = _temperature(new, desk)
    imgui.spacing()
    if imgui.button("Add light", (desk.px(92), 0)):
        desk.search, desk.complaint = "", ""
        imgui.open_popup(_POPUP)
    desk.note("add light")
    imgui.same_line()
    imgui.text_disabled("Space: next light")
    new = _library(new, desk)
    imgui.spacing()
    room = imgui.get_content_region_avail()
    height = min(max(room.y, desk.px(120)), desk.px(180))
    width = min(height + desk.px(24), room.x * 0.5)
    new = dial.draw(new, desk, width, height)
    imgui.same_line()
    spectrum.draw(new, desk, height)
    return None if new is state else new


def _rows(state: ViewState, desk: Desk) -> ViewState:
    flags = imgui.TableFlags_.sizing_fixed_fit | imgui.TableFlags_.no_pad_outer_x
    if not imgui.begin_table("lights", 5, flags):
        return state
    imgui.table_setup_column("colour", imgui.TableColumnFlags_.width_fixed, desk.px(40))
    imgui.table_setup_column("name", imgui.TableColumnFlags_.width_stretch, 0.85)
    imgui.table_setup_column("weight", imgui.TableColumnFlags_.width_stretch, 1.15)
    imgui.table_setup_column("solo", imgui.TableColumnFlags_.width_fixed, desk.px(50))
    imgui.table_setup_column("remove", imgui.TableColumnFlags_.width_fixed, desk.px(16))
    shining = lighting.shining(state.lights)
    new = state
    for i, row in enumerate(state.lights):
        imgui.push_id(i)
        imgui.table_next_row()
        imgui.table_next_column()
        _swatch(state, desk, i)
        imgui.table_next_column()
        if shining[i] == 0:
            imgui.push_style_color(imgui.Col_.text, imgui.get_style_color_vec4(_DIM))
        imgui.align_text_to_frame_padding()
        if imgui.selectable(row.name, state.interface.light == i)[0]:
            new = reduced(new, Event("select", index=i))
        if shining[i] == 0:
            imgui.pop_style_color()
        _tip(f"{row.label}\nDouble-click: this light alone")
        if imgui.is_item_hovered() and imgui.is_mouse_double_clicked(0):
            new = replace(new, lights=lighting.alone(new.lights, i))
        imgui.table_next_column()
        imgui.set_next_item_width(-1)
        moved, weight = imgui.slider_float("##weight", row.weight, 0.0, 1.0, "%.2f")
        desk.note(f"weight {i}")
        if moved:
            new = reduced(new, Event("weight", weight, index=i))
            new = reduced(new, Event("select", index=i))
        imgui.table_next_column()
        if _toggle("S", row.solo, state.interface.dark, "Solo: only lights with S shine"):
            new = reduced(new, Event("solo", index=i))
        desk.note(f"solo {i}")
        imgui.same_line(0, desk.px(4))
        if _toggle("M", row.muted, state.interface.dark, "Mute"):
            new = reduced(new, Event("mute", index=i))
        imgui.table_next_column()
        if len(state.lights) > 1 and _ghost("×", "Remove from the list; Ctrl+Z brings it back"):
            new = reduced(new, Event("remove", index=i))
        imgui.pop_id()
    imgui.end_table()
    return new


_DIM = imgui.Col_.text_disabled


def _swatch(state: ViewState, desk: Desk, index: int) -> None:
    """Left as the light is, right as an adapted eye sees it."""
    raw, adapted = desk.swatch(state.lights[index].rig, state.seen)
    x, y = imgui.get_cursor_screen_pos()
    width, height = desk.px(38), imgui.get_frame_height()
    imgui.dummy((width, height))
    draw_list, round_by = imgui.get_window_draw_list(), desk.px(3)
    half, inset = x + width / 2, desk.px(2)
    for left, right, colour, corners in (
        (x, half, raw, imgui.ImDrawFlags_.round_left),
        (half, x + width, adapted, imgui.ImDrawFlags_.round_right),
    ):
        packed = imgui.color_convert_float4_to_u32((*colour, 1.0))
        draw_list.add_rect_filled(
            (left, y + inset), (right, y + height - inset), packed, round_by, corners
        )
    _tip("White paper under this light\nleft: as it is, right: to an eye adapted to it")


def _temperature(state: ViewState, desk: Desk) -> ViewState:
    index = state.interface.light
    now = state.lights[index].kelvin if index < len(state.lights) else None
    if now is None:
        return state
    imgui.set_next_item_width(-desk.px(86))
    moved, kelvin = kelvin_slider("Temperature", now)
    desk.note("temperature")
    return reduced(state, Event("kelvin", kelvin, index=index)) if moved else state


def _library(state: ViewState, desk: Desk) -> ViewState:
    imgui.set_next_window_size((desk.px(300), 0))
    if not imgui.begin_popup(_POPUP):
        return state
    new, wanted = state, ""
    if imgui.is_window_appearing():
        imgui.set_keyboard_focus_here()
    imgui.set_next_item_width(-1)
    entered, desk.search = imgui.input_text_with_hint(
        "##search", "D50, FL, LED, D65*0.7+A*0.3, FILE.csv", desk.search, _ENTER
    )
    found = matching(desk.search)
    if imgui.begin_child("found", (0, desk.px(190))):
        for name in found:
            if imgui.selectable(name, False)[0]:
                wanted = name
        if not found:
            imgui.text_disabled("Enter takes it as a mix or a file")
    imgui.end_child()
    if entered and desk.search.strip():
        exact = desk.search.strip()
        wanted = found[0] if len(found) == 1 else exact
    imgui.separator()
    imgui.set_next_item_width(-desk.px(64))
    _, desk.kelvin = kelvin_slider("##planck", desk.kelvin)
    imgui.same_line()
    if imgui.button("Planck", (-1, 0)):
        wanted = f"planck:{desk.kelvin:.0f}"
    if wanted:
        try:
            rows = lighting.added(state.lights, wanted, state.document.grid)
            shown = replace(state.interface, light=len(rows) - 1)
            new, desk.complaint = replace(state, lights=rows, interface=shown), ""
            imgui.close_current_popup()
        except (VolspecError, OSError) as error:
            desk.complaint = str(error)
    if desk.complaint:
        imgui.push_text_wrap_pos(0)
        imgui.text(desk.complaint)
        imgui.pop_text_wrap_pos()
    imgui.end_popup()
    return new


_ENTER = imgui.InputTextFlags_.enter_returns_true


def matching(search: str) -> list[str]:
    """Names of the library that hold every word of a search, those that start with it first."""
    words = search.casefold().split()
    names = [*light_names(), *(f"{PREFIX}:{name}" for name in LAMPS)]
    found = [name for name in names if all(word in name.casefold() for word in words)]
    return sorted(found, key=lambda name: not name.casefold().startswith(search.casefold()))


def _toggle(label: str, on: bool, dark: bool, tip: str) -> bool:
    if on:
        imgui.push_style_color(imgui.Col_.button, ACCENT[dark])
        imgui.push_style_color(imgui.Col_.text, (0.05, 0.05, 0.05, 1.0))
    side = imgui.get_frame_height()
    pressed: bool = imgui.button(label, (side, side))
    if on:
        imgui.pop_style_color(2)
    _tip(tip)
    return pressed


def _ghost(label: str, tip: str) -> bool:
    imgui.push_style_color(imgui.Col_.button, (0.0, 0.0, 0.0, 0.0))
    imgui.push_style_color(imgui.Col_.text, imgui.get_style_color_vec4(_DIM))
    pressed: bool = imgui.button(label, (-1, 0))
    imgui.pop_style_color(2)
    _tip(tip)
    return pressed


def _tip(text: str) -> None:
    if imgui.is_item_hovered(imgui.HoveredFlags_.delay_normal):
        imgui.set_tooltip(text)
