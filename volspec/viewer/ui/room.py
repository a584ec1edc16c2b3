"""The room panel: the paints of its surfaces, and what the eye adapts to in it."""

from __future__ import annotations

from functools import lru_cache, partial
from typing import TYPE_CHECKING

from imgui_bundle import imgui

from volspec.appearance.display import encode_sRGB, linear_sRGB_from_XYZ
from volspec.palette import hexadecimal
from volspec.relight import RelightSpec
from volspec.viewer.model import room as edits
from volspec.viewer.model.light_rows import Rows, facing_light
from volspec.viewer.model.state import ViewState
from volspec.viewer.ui.context import UiContext, tip
from volspec.viewer.ui.light_look import (
    Colour,
    adapting_transform,
    as_colour,
    fill_box,
    white_from_rig,
)
from volspec.viewer.ui.widgets import as_one_line, focus_if_wanted, shorten, text_width, wrap_text

if TYPE_CHECKING:
    from volspec.scene import SceneRoom

SETTINGS = ("Paint",)
"""Labels of the items that `UiContext.item` can focus."""
_SWATCH, _PICKER_WIDTH = 30.0, 232.0
_POPUP = "paint"
_C = imgui.ColorEditFlags_
_PICKER = _C.no_side_preview | _C.no_label | _C.display_hex | _C.no_options
_ENTER = imgui.InputTextFlags_.enter_returns_true | imgui.InputTextFlags_.auto_select_all
_HIDDEN = (
    "The walls are not seen: the palette has made the materials the picture’s channels, "
    "and these have none for walls."
)


def draw(state: ViewState, ui: UiContext) -> ViewState | None:
    """Draw the panel."""
    room = state.room
    if room is None:
        return None
    imgui.push_style_var(imgui.StyleVar_.item_spacing, (ui.px(8), ui.px(4)))
    new = state
    colours = _colours(room, state.lights, edits.shown_spec(state))
    focus_if_wanted("Paint", ui)
    for number, surface in enumerate(edits.paintable(room)):
        imgui.push_id(surface)
        new = _row(new, room, ui, surface, colours[number])
        imgui.pop_id()
    imgui.separator()
    wrap_text(_conditions(state, room), imgui.Col_.text_disabled)
    tip("Light where most falls on the volume, and what an eye in the room adapts to")
    if room.spec.walls and not edits.has_walls(state):
        wrap_text(_HIDDEN, imgui.Col_.text_disabled)
    imgui.begin_disabled(room is state.document.room)
    if imgui.button("Reset"):
        new = ui.run(new, "reset-paints")
    imgui.end_disabled()
    ui.note("reset paints", "All paints as in the file", greyed=True)
    imgui.pop_style_var()
    return None if new is state else new


def _row(new: ViewState, room: SceneRoom, ui: UiContext, surface: str, colour: Colour) -> ViewState:
    """Draw a surface's colour and paint; a click opens the picker."""
    x, y = imgui.get_cursor_screen_pos()
    width, height = imgui.get_content_region_avail().x, imgui.get_frame_height()
    if imgui.selectable("##row", False, 0, (width, height))[0]:
        imgui.open_popup(_POPUP)
    ui.note(f"paint {surface}", "In the room, to an eye adapted to it; click to paint")
    side, inset, draw_list = ui.px(_SWATCH), ui.px(2), imgui.get_window_draw_list()
    fill_box((x, y + inset, side, height - 2 * inset), colour, ui.px(3))
    border = imgui.get_color_u32(imgui.Col_.text_disabled, 0.7)
    draw_list.add_rect((x, y + inset), (x + side, y + height - inset), border, ui.px(3))
    paint = edits.paint_text(room, surface) or "as in the file"
    top = y + (height - imgui.get_font_size()) / 2
    label = shorten(as_one_line(paint), width / 2)
    text, dim = (imgui.get_color_u32(col) for col in (imgui.Col_.text, imgui.Col_.text_disabled))
    room_left = width - side - text_width(label) - ui.px(24)
    draw_list.add_text((x + side + ui.px(8), top), text, shorten(surface, room_left))
    draw_list.add_text((x + width - text_width(label) - ui.px(2), top), dim, label)
    if imgui.begin_popup(_POPUP):
        new = _picker(new, room, ui, surface)
        imgui.end_popup()
    return new


def _picker(state: ViewState, room: SceneRoom, ui: UiContext, surface: str) -> ViewState:
    """Draw a paint's colour in daylight, and the field with its name."""
    new, codes = state, edits.paint_codes(room, surface)
    imgui.text(f"{as_one_line(surface)}, in daylight")
    imgui.push_item_width(ui.px(_PICKER_WIDTH))
    changed, picked = imgui.color_picker3("##colour", list(codes), _PICKER)
    ui.note("paint picker")
    if changed:
        new = edits.pick(new, surface, (picked[0], picked[1], picked[2]))
    text = edits.paint_text(room, surface) or hexadecimal(codes)
    entered, text = imgui.input_text("##paint", text, _ENTER)
    ui.note("paint name", "grey:0.5, ColorChecker/blue, #f0d9b5, FILE.csv; Enter applies it")
    imgui.pop_item_width()
    return ui.edited(new, partial(edits.paint, surface=surface, text=text)) if entered else new


def _conditions(state: ViewState, room: SceneRoom) -> str:
    """Return what the eye adapts to."""
    viewing, rig = edits.shown_spec(state).viewing, facing_light(state.lights, room)
    lux, surround = (rig.total_lux or 0.0) if rig else 0.0, viewing.surround
    parts = [f"{lux:.3g} lx", f"Y_b {viewing.Y_b:.2g} %"]
    if viewing.adapting == "given":
        parts.append(f"L_A {viewing.lit_by(lux).adapting_luminance:.3g} cd/m²")
    parts.append(f"surround {surround if isinstance(surround, str) else f'{surround:.2g}'}")
    return ", ".join(parts)


# Few, as each keeps a room.
@lru_cache(maxsize=4)
def _colours(room: SceneRoom, rows: Rows, spec: RelightSpec) -> tuple[Colour, ...]:
    """Return the colours of the paints, as the picture shows them on average."""
    XYZ, rig = edits.seen_XYZ(room, rows), facing_light(rows, room)
    if XYZ is None or rig is None:
        return ((0.0, 0.0, 0.0),) * len(edits.paintable(room))
    transform = adapting_transform(rig, spec, white_from_rig(rig))
    adapted = XYZ if transform is None else transform.apply(spec.viewing.exposure * XYZ)
    return tuple(as_colour(codes) for codes in encode_sRGB(linear_sRGB_from_XYZ(adapted)))
