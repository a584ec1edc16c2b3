"""The chosen light: weight, spectrum by notation, illuminance, temperature, light groups."""

from __future__ import annotations

from functools import lru_cache

from imgui_bundle import imgui, imgui_knobs

from volspec.relight import LightRig
from volspec.spectra import Spectrum
from volspec.viewer.model import light_parts, light_rows, lights
from volspec.viewer.model.room import light_names
from volspec.viewer.model.state import ViewState
from volspec.viewer.ui.context import UiContext, tip
from volspec.viewer.ui.light_look import fill_box, kelvin_slider, raw_colour
from volspec.viewer.ui.widgets import ACCENT, as_one_line, shorten_middle, text_width, wrap_text

_KNOB, _LABELS, _COMPLAINT = 52.0, 84.0, 320.0
# Change of weight per pixel that the mouse drags the knob.
_SPEED = 0.006
_ENTER = imgui.InputTextFlags_.enter_returns_true | imgui.InputTextFlags_.auto_select_all
_LOG = imgui.SliderFlags_.logarithmic
_ALL = "all"
_LUX_TIP = (
    "Illuminance of a surface that faces this light, at weight 1.\n"
    "Lux are used if every light that is on has them: the eye then adapts to\n"
    "their sum, and a weight scales its light's lux. Otherwise only the spectra\n"
    "count, and the eye adapts to the Viewing panel's illuminance."
)

_IN_ROOM = "At weight 1 as bright as in the room’s file"
_ROOM_TIP = "The spectrum of the room’s lamps; “room” is that of the room’s file"


def draw(state: ViewState, ui: UiContext) -> ViewState:
    """Draw the tab of the chosen light."""
    index = state.interface.light
    row = light_rows.row_at(state.lights, index)
    if row is None:
        imgui.text_disabled("Choose a light above")
        return state
    imgui.push_style_var(imgui.StyleVar_.item_spacing, (ui.px(8), ui.px(4)))
    new = _knob(state, ui, index)
    imgui.same_line(0, ui.px(12))
    imgui.begin_group()
    groups = light_names(state)
    is_single = len(groups) < 2 and len(row.rig.lights) == 1
    if is_single:
        new = _text(new, ui, index, 0, -ui.px(_LABELS))
        imgui.same_line()
        imgui.text("Spectrum")
    else:
        imgui.align_text_to_frame_padding()
        imgui.text(as_one_line(row.name))
        imgui.same_line()
        imgui.text_disabled("by light group, below" if state.room is None else "by lamp, below")
    if state.room is None:
        new = _lux(new, ui, index, is_single)
    if row.kelvin is not None:
        imgui.set_next_item_width(-ui.px(_LABELS))
        changed, kelvin = kelvin_slider("Temperature", row.kelvin)
        ui.note("temperature")
        if changed:
            new = lights.set_kelvin(new, index, kelvin)
    imgui.end_group()
    if not is_single:
        new = _parts(new, ui, index, groups)
    note, words = _IN_ROOM, _ROOM_TIP
    if state.room is None:
        note = light_rows.lux_note(state.lights, state.shading.shares(), state.relight)
        words = _LUX_TIP
    wrap_text(as_one_line(note), imgui.Col_.text_disabled)
    imgui.pop_style_var()
    tip(words)
    return new


def _knob(state: ViewState, ui: UiContext, index: int) -> ViewState:
    weight = state.lights[index].weight
    imgui.begin_group()
    _paint_knob(state.interface.dark)
    changed, value = imgui_knobs.knob(
        "##knob",
        weight,
        v_min=0.0,
        v_max=1.0,
        speed=_SPEED,
        format="%.2f",
        variant=imgui_knobs.ImGuiKnobVariant_.wiper,
        size=ui.px(_KNOB),
        flags=int(imgui_knobs.ImGuiKnobFlags_.no_title | imgui_knobs.ImGuiKnobFlags_.no_input),
    )
    ui.note("knob", "Weight: drag up or down")
    text = f"{weight:.2f}"
    x, y = imgui.get_cursor_pos()
    imgui.set_cursor_pos((x + (ui.px(_KNOB) - text_width(text)) / 2, y - ui.px(8)))
    imgui.text(text)
    imgui.end_group()
    return lights.set_weight(state, index, value) if changed else state


def _paint_knob(dark: bool) -> None:
    """Set the knob's colours to the window's greys and its accent."""
    grey = imgui.get_style_color_vec4
    body, track = grey(imgui.Col_.button_active), grey(imgui.Col_.frame_bg)
    colours = ACCENT[dark], (body.x, body.y, body.z, 1.0), (track.x, track.y, track.z, 1.0)
    sets = (imgui_knobs.color_set(imgui.ImColor(*colour)) for colour in colours)
    imgui_knobs.set_knob_colors(imgui_knobs.KnobColors(*sets))


def _lux(state: ViewState, ui: UiContext, index: int, is_single: bool) -> ViewState:
    """Draw the illuminance: a slider, or the sum of several spectra."""
    rig, viewing = state.lights[index].rig, state.relight.viewing
    has_lux = rig.illuminance_lux is not None
    pressed, on = imgui.checkbox("##given", has_lux)
    ui.note("lux given", _LUX_TIP)
    if pressed:
        return light_parts.set_lux(state, index, viewing.illuminance_lux if on else 0.0)
    imgui.same_line(0, ui.px(4))
    if not is_single:
        facing = light_rows.facing_lux(rig, state.shading.shares())
        words = f"{facing:.4g} lx facing all groups" if facing else "Illuminance not given"
        imgui.text_disabled(words)
        return state
    imgui.set_next_item_width(-ui.px(_LABELS))
    imgui.begin_disabled(not has_lux)
    now = rig.illuminance_lux[0] if rig.illuminance_lux else viewing.illuminance_lux
    text = "%.4g lx" if has_lux else "not given"
    changed, lux = imgui.slider_float("Illuminance##lux", now, *light_rows.LUX, text, _LOG)
    imgui.end_disabled()
    ui.note("lux")
    return light_parts.set_lux(state, index, lux) if changed and has_lux else state


def _text(state: ViewState, ui: UiContext, index: int, part: int, width: float) -> ViewState:
    """Draw the field with a spectrum's notation."""
    panel, row, name = ui.lights, state.lights[index], f"text {part}"
    typing = panel.text_of == (row.name, part)
    notation = panel.text if typing else row.texts[part] or ""
    imgui.set_next_item_width(width)
    entered, text = imgui.input_text_with_hint(f"##{name}", "drawn", notation, _ENTER)
    ui.note(name)
    if not imgui.is_item_active():
        _shorten_field(notation)
    if complaint := panel.complaint_at((index, part), state.lights):
        _complaint(complaint, ui, name)
    else:
        tip(
            f"{as_one_line(notation or row.name)}\n\n"
            "D65, planck:3200, daylight:6500, lamp:candle-1900,\n"
            "FILE.csv, D65*0.7+A*0.3; Enter applies it"
        )
    if imgui.is_item_edited():
        panel.complaint = ""
    if imgui.is_item_active():
        panel.text, panel.text_of = text, (row.name, part)
    elif typing and not entered:
        panel.text_of = ("", 0)
    if not entered:
        return state
    panel.text_of = ("", 0)
    new, refusal, _ = light_parts.respell(state, index, part, text)
    if refusal:
        panel.complain(refusal, (index, part), state.lights)
    return new


def _shorten_field(text: str) -> None:
    """Draw a notation that is longer than its field, the last item, without its middle."""
    (left, top), (right, low) = imgui.get_item_rect_min(), imgui.get_item_rect_max()
    style = imgui.get_style()
    short = shorten_middle(text, right - left - 2 * style.frame_padding.x)
    if short == text:
        return
    paint = imgui.get_window_draw_list()
    under = imgui.get_color_u32(imgui.Col_.window_bg), imgui.get_color_u32(imgui.Col_.frame_bg)
    for colour in under:  # the latter is translucent
        paint.add_rect_filled((left, top), (right, low), colour, style.frame_rounding)
    place = left + style.frame_padding.x, top + style.frame_padding.y
    paint.add_text(place, imgui.get_color_u32(imgui.Col_.text), short)


def _complaint(text: str, ui: UiContext, name: str) -> None:
    """Draw the error in a notation below its field, until a click."""
    if imgui.is_mouse_clicked(0):
        ui.lights.complaint = ""
        return
    x, y, _, height = ui.areas[name]
    width, edge = ui.px(_COMPLAINT), imgui.get_main_viewport().size.x - ui.px(8)
    padding = 2 * imgui.get_style().window_padding.x
    imgui.set_next_window_pos((min(float(x), edge - width - padding), y + height + ui.px(4)))
    if imgui.begin_tooltip():
        imgui.push_text_wrap_pos(width)
        imgui.text(text)
        imgui.pop_text_wrap_pos()
        imgui.end_tooltip()


def _parts(state: ViewState, ui: UiContext, index: int, groups: tuple[str, ...]) -> ViewState:
    """Draw a line per spectrum: group, colour, notation, weight."""
    rig, new = state.lights[index].rig, state
    flags = imgui.TableFlags_.sizing_fixed_fit | imgui.TableFlags_.no_pad_outer_x
    fixed, stretch = imgui.TableColumnFlags_.width_fixed, imgui.TableColumnFlags_.width_stretch
    if imgui.begin_table("parts", 6 if rig.illuminance_lux else 5, flags):
        imgui.table_setup_column("group", fixed, ui.px(66))
        imgui.table_setup_column("colour", fixed, ui.px(14))
        imgui.table_setup_column("spectrum", stretch, 1.2)
        imgui.table_setup_column("weight", stretch, 0.8)
        if rig.illuminance_lux:
            imgui.table_setup_column("lux", stretch, 0.8)
        imgui.table_setup_column("less", fixed, ui.px(20))
        for j in range(len(rig.lights)):
            imgui.push_id(j)
            imgui.table_next_row()
            new = _part(new, state, ui, index, j, groups)
            imgui.pop_id()
        imgui.end_table()
    return _part_buttons(new, ui, index, groups)


def _part(
    new: ViewState, state: ViewState, ui: UiContext, index: int, j: int, groups: tuple[str, ...]
) -> ViewState:
    rig = state.lights[index].rig
    imgui.table_next_column()
    imgui.set_next_item_width(-1)
    names = ["", *groups]
    now = names.index(rig.groups[j]) if rig.groups[j] in names else -1
    picked, number = imgui.combo("##group", now, [as_one_line(name) or _ALL for name in names])
    ui.note(f"group {j}")
    if picked:
        new = light_parts.regroup(new, index, j, names[number])
    imgui.table_next_column()
    x, y = imgui.get_cursor_screen_pos()
    w, h, inset = ui.px(14), imgui.get_frame_height(), ui.px(3)
    imgui.dummy((w, h))
    fill_box((x, y + inset, w, h - 2 * inset), raw_colour(_single_rig(rig.lights[j])), inset)
    imgui.table_next_column()
    new = _text(new, ui, index, j, -1)
    imgui.table_next_column()
    imgui.set_next_item_width(-1)
    top = max(1.0, rig.weights[j])
    changed, weight = imgui.slider_float("##weight", rig.weights[j], 0.0, top, "%.2f")
    ui.note(f"part {j}")
    if changed:
        new = light_parts.set_part_weight(new, index, j, weight)
    tip("Weight relative to this light's other spectra")
    if rig.illuminance_lux:
        imgui.table_next_column()
        imgui.set_next_item_width(-1)
        lux = rig.illuminance_lux[j]
        changed, lux = imgui.drag_float("##lux", lux, 0.01 * lux, *light_rows.LUX, "%.4g lx")
        ui.note(f"part lux {j}", "Lux on a surface facing it, if all groups shone like this one")
        if changed:
            new = light_parts.set_lux(new, index, lux, j)
    imgui.table_next_column()
    if len(rig.lights) > 1 and imgui.button("×", (-1, 0)):
        new = light_parts.remove_part(new, index, j)
    return new


def _part_buttons(
    state: ViewState, ui: UiContext, index: int, groups: tuple[str, ...]
) -> ViewState:
    """Draw buttons that light a dark group, or give each group a spectrum of its own."""
    rig, new = state.lights[index].rig, state
    if "" in rig.groups:
        if imgui.button(f"A spectrum for each {'group' if state.room is None else 'lamp'}"):
            new = light_parts.split_part(new, index)
        ui.note("part groups")
        return new
    for i, name in enumerate(name for name in groups if name not in rig.groups):
        if i:
            imgui.same_line()
        if imgui.button(f"Light {name}"):
            new = light_parts.add_part(new, index, name)
        tip(f"Nothing shines from {name} in this light")
    return new


@lru_cache(maxsize=128)
def _single_rig(light: Spectrum) -> LightRig:
    """Return a spectrum's rig; always the same object, as the colour cache requires."""
    return LightRig((light,))
