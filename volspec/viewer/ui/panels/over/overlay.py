"""Text over the picture, or in place of one."""

from __future__ import annotations

from imgui_bundle import imgui

from volspec.viewer.ui.context import UiContext
from volspec.viewer.ui.panels.widgets import packed

_FLAGS = (
    imgui.WindowFlags_.no_decoration
    | imgui.WindowFlags_.no_docking
    | imgui.WindowFlags_.always_auto_resize
    | imgui.WindowFlags_.no_saved_settings
    | imgui.WindowFlags_.no_focus_on_appearing
)


def message(text: str, ui: UiContext) -> None:
    """A line or two at the picture's top, below what stands there; within the window."""
    x, y, width, _ = ui.areas["picture"]
    viewport = imgui.get_main_viewport()
    left, room = viewport.work_pos.x, viewport.work_size.x
    most = min(max(width - ui.px(48), ui.px(280)), room - ui.px(48), ui.px(560))
    half = most / 2 + ui.px(20)
    middle = min(max(x + width / 2, left + half), left + room - half)
    _, top, _, tall = ui.areas.get("sides", (0, y, 0, 0))
    imgui.set_next_window_pos((middle, top + tall + ui.px(20)), imgui.Cond_.always, (0.5, 0.0))
    imgui.set_next_window_bg_alpha(0.92)
    imgui.push_style_var(imgui.StyleVar_.window_padding, (ui.px(16), ui.px(10)))
    imgui.push_style_var(imgui.StyleVar_.window_rounding, ui.px(6))
    imgui.begin("##message", None, _FLAGS | imgui.WindowFlags_.no_inputs)
    imgui.push_text_wrap_pos(max(most, ui.px(60)))
    imgui.text(text)
    imgui.pop_text_wrap_pos()
    imgui.end()
    imgui.pop_style_var(2)


def in_place(text: str, ui: UiContext) -> None:
    """Write in the middle of where the picture will be, in lines as long as that is wide."""
    x, y, width, height = ui.areas["picture"]
    wrap = 0.9 * width
    size = imgui.calc_text_size(text, wrap_width=wrap)
    place = x + (width - size.x) / 2, y + (height - size.y) / 2
    grey, font, font_size = packed((0.6, 0.6, 0.6)), imgui.get_font(), imgui.get_font_size()
    draw_list = imgui.get_background_draw_list()
    draw_list.add_text(font, font_size, place, grey, text, wrap_width=wrap)
