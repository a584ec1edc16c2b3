"""The start screen: demonstrations with a thumbnail each, and the user's own files."""

from __future__ import annotations

from imgui_bundle import imgui

from volspec.viewer.model.state import ViewState
from volspec.viewer.ui.context import UiContext
from volspec.viewer.ui.widgets import shorten, text_width, whole_label
from volspec.viewer.work.demonstrations import DEMONSTRATIONS, Demonstration

# Width and height of a thumbnail, the space between two, and of the window's edge.
_WIDE, _TALL, _GAP, _PAD = 240.0, 180.0, 14.0, 22.0
_MIN = 110.0
_MAX_RECENT = 5
_AREAS = ("open your own", *(f"demonstration {demo.name}" for demo in DEMONSTRATIONS))
_W = imgui.WindowFlags_
_FLAGS = (
    _W.no_docking
    | _W.no_saved_settings
    | _W.no_collapse
    | _W.no_resize
    | _W.no_move
    | _W.always_auto_resize
)


def draw(_: ViewState | None, ui: UiContext) -> ViewState | None:
    """Draw the screen in the middle of the window while it is open; Esc closes it.

    It needs no state: it is there before the first file is read.
    """
    if not ui.start:
        for name in _AREAS:
            ui.areas.pop(name, None)
        return None
    viewport = imgui.get_main_viewport()
    room = viewport.work_size.x - 2 * ui.px(_PAD + _GAP)
    card_width = max(min(ui.px(_WIDE), room / len(DEMONSTRATIONS) - ui.px(_GAP)), ui.px(_MIN))
    imgui.set_next_window_pos(viewport.get_work_center(), imgui.Cond_.always, (0.5, 0.5))
    imgui.push_style_var(imgui.StyleVar_.window_padding, (ui.px(_PAD), ui.px(_PAD * 0.8)))
    imgui.push_style_var(imgui.StyleVar_.window_rounding, ui.px(8))
    imgui.push_style_var(imgui.StyleVar_.window_border_size, 1)
    stays = imgui.begin("Welcome to volspec###start", True, _FLAGS)[1]
    ui.start = bool(stays) and not imgui.is_key_pressed(imgui.Key.escape)
    imgui.text("Render once, then change the light. Move the mouse across a picture to try.")
    imgui.dummy((0, ui.px(4)))
    for number, demonstration in enumerate(DEMONSTRATIONS):
        if number:
            imgui.same_line(0, ui.px(_GAP))
        imgui.begin_group()
        if _card(demonstration, card_width, ui):
            ui.start = False
            ui.request("open", str(demonstration.path))
        imgui.end_group()
    imgui.dummy((0, ui.px(6)))
    _own_files(ui)
    imgui.end()
    imgui.pop_style_var(3)
    return None


def _card(demonstration: Demonstration, width: float, ui: UiContext) -> bool:
    """Draw a thumbnail under the light that the mouse is at; return True if it was clicked."""
    x, y = imgui.get_cursor_screen_pos()
    height = width * _TALL / _WIDE
    clicked = bool(imgui.invisible_button(demonstration.name, (width, height)))
    ui.note(f"demonstration {demonstration.name}")
    hovered, count = imgui.is_item_hovered(), len(demonstration.lights)
    frame = 0
    if hovered:
        frame = min(max(int((imgui.get_mouse_pos().x - x) / width * count), 0), count - 1)
        imgui.set_mouse_cursor(imgui.MouseCursor_.hand)
    draw_list, end = imgui.get_window_draw_list(), (x + width, y + height)
    thumbnails = ui.results.thumbnails
    if thumbnails is not None:
        texture = imgui.ImTextureRef(thumbnails.texture(demonstration))
        left, right = (frame / count, 0.0), ((frame + 1) / count, 1.0)
        draw_list.add_image_rounded(texture, (x, y), end, left, right, 0xFFFFFFFF, ui.px(5))
    caption = list(demonstration.lights.values())[frame]
    line = imgui.get_text_line_height()
    place = x + ui.px(8), y + height - line - ui.px(6)
    under = place[0] + text_width(caption) + ui.px(5), end[1] - ui.px(4)
    back, ink = imgui.get_color_u32((0, 0, 0, 0.6)), imgui.get_color_u32((1, 1, 1, 0.95))
    draw_list.add_rect_filled((place[0] - ui.px(5), place[1] - ui.px(2)), under, back, ui.px(3))
    draw_list.add_text(place, ink, caption)
    # One mark per light: the mouse's is bright.
    for i in range(count):
        dot_centre = end[0] - ui.px(10) * (count - i), end[1] - ui.px(11)
        bright = imgui.get_color_u32((1, 1, 1, 0.95 if i == frame else 0.4))
        draw_list.add_circle_filled(dot_centre, ui.px(2.6), bright)
    border = imgui.Col_.check_mark if hovered or imgui.is_item_focused() else imgui.Col_.border
    draw_list.add_rect((x, y), end, imgui.get_color_u32(border), ui.px(5), ui.px(1.5))
    imgui.text(shorten(demonstration.title, width))
    return clicked


def _own_files(ui: UiContext) -> None:
    """Draw the ways to the user's own files."""
    if imgui.button("Open your own …"):
        ui.start = False
        ui.request("open")
    ui.note("open your own")
    imgui.same_line(0, ui.px(12))
    imgui.align_text_to_frame_padding()
    imgui.text_disabled("or drop a file: NRRD, NIfTI, DICOM, TIFF, VTK, OME-Zarr, a scene")
    for number, row in enumerate(ui.results.recent[:_MAX_RECENT]):
        if row.exists and imgui.selectable(f"{whole_label(row.label)}##{number}", False)[0]:
            ui.start = False
            ui.request("open", row.path)
