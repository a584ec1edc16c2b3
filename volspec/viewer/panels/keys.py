"""The cheat sheet."""

from __future__ import annotations

from dataclasses import replace

from imgui_bundle import imgui

from volspec.viewer.actions import ACTIONS, shown
from volspec.viewer.panels.desk import Desk
from volspec.viewer.state import ViewState

_MOUSE = (
    ("Left drag", "Orbit"),
    ("Middle or Shift + right drag", "Pan"),
    ("Right drag, wheel", "Zoom"),
    ("Shift + left drag or wheel", "Roll"),
    ("Ctrl + wheel", "Field of view"),
    ("Drop a file", "Open it"),
    ("Arrows, with Shift", "Orbit, pan"),
    ("+, −", "Zoom"),
    ("Page up and down", "Axial slice"),
    ("with Shift, Ctrl", "Coronal, sagittal slice"),
)
SHEET = (
    *_MOUSE,
    *(
        (", ".join(shown(key) for key in action.keys), action.title)
        for action in ACTIONS
        if action.keys and action.menu and not action.name.startswith("recall-")
    ),
    ("Alt+1 … 9", "Fade to a saved light state"),
)
_FLAGS = (
    imgui.WindowFlags_.no_decoration
    | imgui.WindowFlags_.no_docking
    | imgui.WindowFlags_.always_auto_resize
    | imgui.WindowFlags_.no_saved_settings
)


def draw(state: ViewState, desk: Desk) -> ViewState | None:
    """Draw it in the middle of the picture; a click or Esc closes it."""
    if not state.interface.keys:
        return None
    x, y, width, height = desk.areas["picture"]
    imgui.set_next_window_pos((x + width / 2, y + height / 2), imgui.Cond_.always, (0.5, 0.5))
    imgui.push_style_var(imgui.StyleVar_.window_padding, (desk.px(22), desk.px(18)))
    imgui.push_style_var(imgui.StyleVar_.window_rounding, desk.px(8))
    imgui.set_next_window_bg_alpha(0.94)
    imgui.begin("##keys", None, _FLAGS)
    half = -(-len(SHEET) // 2)
    keys_wide, what_wide = (max(imgui.calc_text_size(row[k]).x for row in SHEET) for k in (0, 1))
    column, second = keys_wide + desk.px(40), keys_wide + what_wide + desk.px(90)
    for i, (keys, what) in enumerate(SHEET[:half]):
        imgui.text(keys)
        imgui.same_line(column)
        imgui.text_disabled(what)
        for keys, what in SHEET[half + i : half + i + 1]:
            imgui.same_line(second)
            imgui.text(keys)
            imgui.same_line(second + column - desk.px(22))
            imgui.text_disabled(what)
    closed = imgui.is_window_hovered() and imgui.is_mouse_clicked(0)
    closed = closed or imgui.is_key_pressed(imgui.Key.escape)
    imgui.end()
    imgui.pop_style_var(2)
    return replace(state, interface=replace(state.interface, keys=False)) if closed else None
