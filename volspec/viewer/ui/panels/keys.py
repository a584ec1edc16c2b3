"""The cheat sheet: every key, by menu, in as many columns as there is room for."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

from imgui_bundle import imgui

from volspec.viewer.model.actions import ACTIONS, BY_NAME, MENUS, shown
from volspec.viewer.model.state import ViewState
from volspec.viewer.ui.context import UiContext
from volspec.viewer.ui.panels.widgets import text_width

Row = tuple[str, str]
Part = tuple[str, tuple[Row, ...]]

_MOUSE = (
    ("Left drag", "Orbit"),
    ("Middle or Shift + right drag", "Pan"),
    ("Right drag, wheel", "Zoom"),
    ("Shift + left drag or wheel", "Roll"),
    ("Ctrl + wheel", "Field of view"),
    ("Drop a file", "Open it"),
    ("Alt+1 … 9", "Fade to a saved light state"),
    ("Arrows, with Shift", "Orbit, pan"),
    ("+, −", "Zoom"),
    ("Page up and down", "Axial slice"),
    ("with Shift, Ctrl", "Coronal, sagittal slice"),
    ("Ctrl + left drag", "Shift and spread the values"),
    ("Ctrl + right drag", "Opacity"),
)
_PANELS = (
    ("Tab, arrows", "Next item"),
    ("Space, Enter", "Use it"),
    ("Esc", "Back to the picture"),
)


def _rows_of(menu: str) -> tuple[Row, ...]:
    """A menu's actions that have keys."""
    return tuple(
        (", ".join(shown(key) for key in action.keys if key), action.title.removesuffix(" …"))
        for action in ACTIONS
        if action.menu == menu and any(action.keys) and not action.name.startswith("recall-")
    )


SHEET: tuple[Part, ...] = (
    ("Mouse", _MOUSE),
    *((menu, rows) for menu in MENUS if (rows := _rows_of(menu))),
    ("In panels, after F6", _PANELS),
)
_FLAGS = (
    imgui.WindowFlags_.no_title_bar
    | imgui.WindowFlags_.no_resize
    | imgui.WindowFlags_.no_collapse
    | imgui.WindowFlags_.no_docking
    | imgui.WindowFlags_.always_auto_resize
    | imgui.WindowFlags_.horizontal_scrollbar
    | imgui.WindowFlags_.no_saved_settings
)


def columns(parts: Sequence[Part], count: int) -> list[list[Part]]:
    """Parts in their order, in columns of which the tallest is as low as it can be."""
    heights = [len(rows) + 2 for _, rows in parts]
    for most in range(max(heights), sum(heights) + 1):
        filled: list[list[Part]] = [[]]
        room = most
        for part, height in zip(parts, heights, strict=True):
            if height > room:
                filled.append([])
                room = most
            filled[-1].append(part)
            room -= height
        if len(filled) <= count:
            return filled
    return [list(parts)]


def draw(state: ViewState, ui: UiContext) -> ViewState | None:
    """Draw it in the middle of the window; a click, Esc or what opens over it closes it."""
    if not state.interface.keys:
        return None
    if ui.commands is not None or imgui.internal.get_top_most_popup_modal() is not None:
        return ui.done(state, BY_NAME["keys"])
    viewport = imgui.get_main_viewport()
    imgui.set_next_window_pos(viewport.get_work_center(), imgui.Cond_.always, (0.5, 0.5))
    imgui.push_style_var(imgui.StyleVar_.window_padding, (ui.px(22), ui.px(16)))
    imgui.push_style_var(imgui.StyleVar_.window_rounding, ui.px(8))
    imgui.push_style_var(imgui.StyleVar_.item_spacing, (ui.px(8), ui.px(3)))
    imgui.set_next_window_size_constraints((0, 0), viewport.work_size)
    imgui.set_next_window_bg_alpha(0.95)
    imgui.begin("##keys", None, _FLAGS)
    _columns(ui, viewport.work_size.x)
    # Not by its scrollbar.
    free = imgui.is_window_hovered() and not imgui.is_any_item_active()
    closed = free and imgui.is_mouse_clicked(0)
    closed = closed or imgui.is_key_pressed(imgui.Key.escape)
    imgui.end()
    imgui.pop_style_var(3)
    return ui.done(state, BY_NAME["keys"]) if closed else None


def _columns(ui: UiContext, width: float) -> None:
    """Side by side, each as wide as it must be."""
    gap, apart = ui.px(14), ui.px(30)
    count = _fitting(width - ui.px(60), gap, apart)
    left = imgui.get_cursor_pos_x()
    top = imgui.get_cursor_pos_y()
    for column in columns(SHEET, count):
        rows = [row for _, rows in column for row in rows]
        second = _widest(keys for keys, _ in rows) + gap
        imgui.set_cursor_pos((left, top))
        imgui.begin_group()
        for number, (title, part) in enumerate(column):
            if number:
                imgui.dummy((0, ui.px(8)))
            imgui.text_disabled(title)
            for keys, what in part:
                imgui.text(keys)
                imgui.same_line(second)
                imgui.text(what)
        imgui.end_group()
        left += imgui.get_item_rect_size().x + apart


def _fitting(width: float, gap: float, apart: float) -> int:
    """So many columns that they are no wider than this."""
    for count in range(4, 1, -1):
        wide = 0.0
        for column in columns(SHEET, count):
            rows = [row for _, part in column for row in part]
            wide += _widest(keys for keys, _ in rows) + gap + apart
            wide += _widest(what for _, what in rows)
        if wide <= width:
            return count
    return 1


def _widest(texts: Iterable[str]) -> float:
    return max(text_width(text) for text in texts)
