"""What stands over the picture for a while: messages."""

from __future__ import annotations

from imgui_bundle import imgui

from volspec.viewer.ui.desk import Desk

_FLAGS = (
    imgui.WindowFlags_.no_decoration
    | imgui.WindowFlags_.no_docking
    | imgui.WindowFlags_.always_auto_resize
    | imgui.WindowFlags_.no_saved_settings
    | imgui.WindowFlags_.no_focus_on_appearing
)


def message(text: str, desk: Desk) -> None:
    """A line or two at the picture's top, below what stands there; within the window."""
    x, y, width, _ = desk.areas["picture"]
    viewport = imgui.get_main_viewport()
    left, room = viewport.work_pos.x, viewport.work_size.x
    most = min(max(width - desk.px(48), desk.px(280)), room - desk.px(48), desk.px(560))
    half = most / 2 + desk.px(20)
    middle = min(max(x + width / 2, left + half), left + room - half)
    _, top, _, tall = desk.areas.get("sides", (0, y, 0, 0))
    imgui.set_next_window_pos((middle, top + tall + desk.px(20)), imgui.Cond_.always, (0.5, 0.0))
    imgui.set_next_window_bg_alpha(0.92)
    imgui.push_style_var(imgui.StyleVar_.window_padding, (desk.px(16), desk.px(10)))
    imgui.push_style_var(imgui.StyleVar_.window_rounding, desk.px(6))
    imgui.begin("##message", None, _FLAGS | imgui.WindowFlags_.no_inputs)
    imgui.push_text_wrap_pos(max(most, desk.px(60)))
    imgui.text(text)
    imgui.pop_text_wrap_pos()
    imgui.end()
    imgui.pop_style_var(2)
