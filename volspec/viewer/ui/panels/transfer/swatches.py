"""A colour as a small square, beside a name."""

from __future__ import annotations

from imgui_bundle import imgui

from volspec.viewer.ui.context import UiContext
from volspec.viewer.ui.panels.lights.colours import Colour
from volspec.viewer.ui.panels.widgets import packed, tip


def swatch(ui: UiContext, colour: Colour) -> None:
    """A colour, as high as a line."""
    x, y = imgui.get_cursor_screen_pos()
    side = imgui.get_frame_height()
    imgui.dummy((side, side))
    inset = ui.px(3)
    draw_list, rounding = imgui.get_window_draw_list(), ui.px(3)
    ends = (x + inset, y + inset), (x + side - inset, y + side - inset)
    draw_list.add_rect_filled(*ends, packed(colour), rounding)
    draw_list.add_rect(*ends, imgui.get_color_u32(imgui.Col_.text_disabled, 0.7), rounding)
    tip("Under the lights that are on, to an eye adapted to them")
