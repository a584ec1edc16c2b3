"""What stands over the picture for a while: messages, and the field to open a file by its path."""

from __future__ import annotations

from imgui_bundle import imgui

from volspec.viewer.panels.desk import Desk

_FLAGS = (
    imgui.WindowFlags_.no_decoration
    | imgui.WindowFlags_.no_docking
    | imgui.WindowFlags_.always_auto_resize
    | imgui.WindowFlags_.no_saved_settings
    | imgui.WindowFlags_.no_focus_on_appearing
)
_OPEN = "Open a scene or a volume"
_HINT = "scene.toml, volume.nrrd, …"


def message(text: str, desk: Desk) -> None:
    """A line or two at the picture's top."""
    x, y, width, _ = desk.areas["picture"]
    most = min(width - desk.px(48), desk.px(560))
    imgui.set_next_window_pos((x + width / 2, y + desk.px(20)), imgui.Cond_.always, (0.5, 0.0))
    imgui.set_next_window_bg_alpha(0.92)
    imgui.push_style_var(imgui.StyleVar_.window_padding, (desk.px(16), desk.px(10)))
    imgui.push_style_var(imgui.StyleVar_.window_rounding, desk.px(6))
    imgui.begin("##message", None, _FLAGS | imgui.WindowFlags_.no_inputs)
    imgui.push_text_wrap_pos(max(most, desk.px(120)))
    imgui.text(text)
    imgui.pop_text_wrap_pos()
    imgui.end()
    imgui.pop_style_var(2)


def ask_path(
    desk: Desk, begin: bool, title: str = _OPEN, hint: str = _HINT, verb: str = "Open"
) -> str:
    """The field; what was entered, or nothing.

    Parameters
    ----------
    desk : Desk
    begin : bool
        Whether it shall open now.
    title, hint, verb : str
        What is asked for, an example, and what the button says.
    """
    if begin:
        desk.path = ""
        imgui.open_popup(title)
    x, y, width, height = desk.areas["picture"]
    imgui.set_next_window_pos((x + width / 2, y + height / 3), imgui.Cond_.always, (0.5, 0.5))
    imgui.set_next_window_size((min(desk.px(560), width * 0.9), 0))
    entered = ""
    if imgui.begin_popup(title):
        imgui.text_disabled(title)
        if imgui.is_window_appearing():
            imgui.set_keyboard_focus_here()
        imgui.set_next_item_width(-desk.px(70))
        done, desk.path = imgui.input_text_with_hint("##path", hint, desk.path, _ENTER)
        imgui.same_line()
        if imgui.button(verb, (-1, 0)) or done:
            entered = desk.path.strip()
            imgui.close_current_popup()
        imgui.end_popup()
    return entered


_ENTER = imgui.InputTextFlags_.enter_returns_true
