"""The menu bar, the status line and the sheet of keys."""

from __future__ import annotations

from collections.abc import Callable, Sequence

from imgui_bundle import imgui

from volspec.viewer.model.choices import TITLES, value_text
from volspec.viewer.model.commands import COMMANDS, MENUS, format_key
from volspec.viewer.model.edit import Command
from volspec.viewer.model.state import ViewState
from volspec.viewer.model.viewing import vision_text
from volspec.viewer.ui.context import UiContext
from volspec.viewer.ui.messages import draw_sign
from volspec.viewer.ui.overlays import BARE_WINDOW
from volspec.viewer.ui.widgets import (
    as_one_line,
    key_text,
    shorten,
    shown_rows,
    text_width,
    whole_label,
)
from volspec.volume import Choice

# Commands with a separator above them.
_PARTS = ("export-scene", "save-session", "screenshot", "quit", "copy-picture", "commands")
# Shown below the recent files, in the Messages panel, and next to a cast's progress.
_ELSEWHERE = ("clear-recent", "clear-messages", "cancel")


def draw_menu(state: ViewState, ui: UiContext) -> ViewState:
    """Draw the menu bar; return the state after the command that was picked."""
    if not imgui.begin_main_menu_bar():
        return state
    open_menu, on_bar = "", False
    for title in MENUS:
        if title == ui.open_menu:
            ui.open_menu = ""
            imgui.open_popup(title)
        opened = imgui.begin_menu(title)
        ui.note(f"menu {title}")
        if title == ui.focus_menu:
            ui.focus_menu, ui.open_menu = "", title
            _focus_title()
        if not opened:
            on_bar |= imgui.is_item_focused()
            continue
        open_menu = title
        for command in COMMANDS:
            if command.menu == title and command.name not in _ELSEWHERE:
                state = _row(command, state, ui)
        imgui.end_menu()
    imgui.end_main_menu_bar()
    _follow_arrows(open_menu, on_bar, ui)
    return state


def _follow_arrows(open_menu: str, on_bar: bool, ui: UiContext) -> None:
    """Open the next menu if an arrow has left the one that was shown.

    imgui closes a menu when an arrow leaves it, and only focuses a title (``on_bar``).
    """
    pressed = imgui.is_key_pressed
    step = pressed(imgui.Key.right_arrow) - pressed(imgui.Key.left_arrow)
    if open_menu:
        # A step that leaves it open was one into a submenu, or back.
        ui.menu, ui.menu_step = open_menu, step
    elif on_bar and ui.menu and ui.menu_step:
        ui.open_menu = MENUS[(MENUS.index(ui.menu) + ui.menu_step) % len(MENUS)]
        ui.menu_step = 0
    elif not ui.open_menu:
        ui.menu = ""


def _focus_title() -> None:
    """Focus the last title of the menu bar, from which arrows lead to the others."""
    window = imgui.internal.get_current_window()
    imgui.internal.focus_window(window)
    (x, y), (right, bottom), (left, top) = (
        imgui.get_item_rect_min(),
        imgui.get_item_rect_max(),
        window.pos,
    )
    rect = imgui.internal.ImRect(x - left, y - top, right - left, bottom - top)
    scope = imgui.internal.get_current_focus_scope()
    imgui.internal.set_nav_id(imgui.get_item_id(), imgui.internal.NavLayer.menu, scope, rect)


def _row(command: Command, state: ViewState, ui: UiContext) -> ViewState:
    if command.name in _PARTS:
        imgui.separator()
    on = command.on is not None and command.on(state)
    picked = imgui.menu_item(command.title, key_text(command), on)[0]
    ui.note(f"action {command.name}")
    if command.name == "open":
        _recent(ui)
    return ui.run(state, command) if picked else state


def _recent(ui: UiContext) -> None:
    if not imgui.begin_menu("Open recent", bool(ui.results.recent)):
        return
    for number, row in enumerate(ui.results.recent):
        if imgui.menu_item(f"{whole_label(row.label)}##{number}", "", False, row.exists)[0]:
            ui.request("open", row.path)
        ui.note(f"recent {number}")
    imgui.separator()
    if imgui.menu_item("Clear the list", "", False)[0]:
        ui.request("clear-recent")
    imgui.end_menu()


_HEIGHT = 26


def draw_status(state: ViewState, ui: UiContext) -> ViewState:
    """Draw the status line along the whole window; a click on its count of errors lists them."""
    viewport = imgui.get_main_viewport()
    imgui.push_style_var(imgui.StyleVar_.window_padding, (ui.px(12), ui.px(4)))
    flags = BARE_WINDOW | imgui.WindowFlags_.no_nav
    imgui.internal.begin_viewport_side_bar(
        "##status", viewport, imgui.Dir.down, ui.px(_HEIGHT), flags
    )
    details = (sizes(state, ui), vision_text(state.relight.viewing))
    title, times = as_one_line(state.document.title), f"H: keys    {timings(ui)}"
    texts = (title, "    ".join(filter(None, details)), times)
    errors = sum(message.kind == "error" for message in ui.results.messages)
    counted = f"{errors} error{'s' * (errors > 1)}" if errors else ""
    taken = text_width(counted) + ui.px(40) if errors else 0.0
    choices = [choice for choice in state.document.choices if choice.chosen is not None]
    labels = [_choice_label(choice) for choice in choices]
    taken += sum(text_width(label) + ui.px(52) for label in labels)
    room = imgui.get_content_region_avail().x - taken
    title, notes, times = fitting_texts(texts, room, ui.px(16), text_width)
    imgui.text(title)
    for choice, label in zip(choices, labels, strict=True):
        _draw_choice(choice, label, ui)
    if notes:
        imgui.same_line(0, ui.px(16))
        imgui.text_disabled(notes)
    if errors:
        imgui.same_line(0, ui.px(16))
        imgui.begin_group()
        draw_sign("error", ui)
        imgui.same_line(0, ui.px(4))
        imgui.text(counted)
        imgui.end_group()
        ui.note("errors", "Show the messages")
        if imgui.is_item_clicked() and "Messages" not in state.interface.panels:
            state = ui.run(state, "panel-messages")
            ui.front = "Messages"
    if times:
        imgui.same_line(imgui.get_window_width() - text_width(times) - ui.px(12))
        imgui.text_disabled(times)
    imgui.end()
    imgui.pop_style_var()
    return state


def _choice_label(choice: Choice) -> str:
    assert choice.chosen is not None
    value = value_text(choice, choice.values.index(choice.chosen))
    return as_one_line(f"{TITLES.get(choice.key, choice.key)}: {value}")


def _draw_choice(choice: Choice, label: str, ui: UiContext) -> None:
    """Draw the open volume's channel, time step, …, from which another can be chosen."""
    imgui.same_line(0, ui.px(16))
    imgui.push_style_var(imgui.StyleVar_.frame_padding, (ui.px(6), 0))
    flags = imgui.ComboFlags_.width_fit_preview | imgui.ComboFlags_.height_large
    if imgui.begin_combo(f"##{choice.key}", label, flags):
        current = choice.values.index(choice.chosen or choice.values[0])
        for number in shown_rows(len(choice.values), always=current):
            name = f"{as_one_line(value_text(choice, number))}##{number}"
            if imgui.selectable(name, number == current)[0]:
                ui.request("choose", f"{choice.key}={choice.values[number]}")
            ui.note(f"choose {choice.key} {choice.values[number]}")
        imgui.end_combo()
    ui.note(f"status {choice.key}")
    imgui.pop_style_var()


def fitting_texts(
    texts: tuple[str, str, str], room: float, gap: float, measure: Callable[[str], float]
) -> tuple[str, str, str]:
    """Return the texts that fit: the last is dropped first; the first is never dropped but cut.

    >>> fitting_texts(("engine", "9 × 9", "60 fps"), 14, 1, len)
    ('engine', '9 × 9', '')
    >>> fitting_texts(("engine", "9 × 9", "60 fps"), 5, 1, len)
    ('engi…', '', '')
    """
    title, details, times = texts
    widths = measure(title), measure(details), measure(times)
    if sum(widths) + 2 * gap <= room:
        return texts
    if widths[0] + widths[1] + gap <= room:
        return title, details, ""
    return shorten(title, room, measure), "", ""


def sizes(state: ViewState, ui: UiContext) -> str:
    """Return the picture's size, and how coarse it still is."""
    if ui.results.image is None:
        return "no picture" if ui.results.fault else "casting …"
    width, height = state.size if state.document.image is None else state.document.image.size
    pyramid = state.document.volume.pyramid
    if pyramid is not None and pyramid.counts.progress:
        return f"{width} × {height}, reading {pyramid.counts.progress}"
    if ui.results.sharp:
        return f"{width} × {height}"
    image_width, _ = ui.results.image.size
    return f"{width} × {height}, refining (1/{max(1, round(width / image_width))})"


def timings(ui: UiContext) -> str:
    """Return the frame rate and the last duration of each stage."""
    parts = [f"{ui.results.fps:.0f} fps"] if ui.results.fps else []
    parts += [f"{stage} {ms:.0f} ms" for stage, ms in ui.results.ms.items()]
    return "   ".join(parts)


# A title, and rows of keys with their actions.
Part = tuple[str, tuple[tuple[str, str], ...]]

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
_PANELS = (("Tab, arrows", "Next item"), ("Space, Enter", "Use it"), ("Esc", "Back to the picture"))


def _menu_part(menu: str) -> Part:
    """Return a menu's commands that have keys."""
    rows = [
        (", ".join(format_key(key) for key in command.keys if key), command.title)
        for command in COMMANDS
        if command.menu == menu and any(command.keys) and not command.name.startswith("recall-")
    ]
    return menu, tuple((keys, title.removesuffix(" …")) for keys, title in rows)


SHEET: tuple[Part, ...] = (
    ("Mouse", _MOUSE),
    *(part for menu in MENUS if (part := _menu_part(menu))[1]),
    ("In panels, after F6", _PANELS),
)
_SHEET_FLAGS = (
    imgui.WindowFlags_.no_title_bar
    | imgui.WindowFlags_.no_resize
    | imgui.WindowFlags_.no_collapse
    | imgui.WindowFlags_.no_docking
    | imgui.WindowFlags_.always_auto_resize
    | imgui.WindowFlags_.horizontal_scrollbar
    | imgui.WindowFlags_.no_saved_settings
)


def columns(parts: Sequence[Part], count: int) -> list[list[Part]]:
    """Distribute parts, in order, over columns so that the tallest is as short as possible."""
    heights = [len(rows) + 2 for _, rows in parts]
    for max_height in range(max(heights), sum(heights) + 1):
        filled: list[list[Part]] = [[]]
        room = max_height
        for part, height in zip(parts, heights, strict=True):
            if height > room:
                filled.append([])
                room = max_height
            filled[-1].append(part)
            room -= height
        if len(filled) <= count:
            return filled
    return [list(parts)]


def draw_keys(state: ViewState, ui: UiContext) -> ViewState | None:
    """Draw the sheet of keys; a click, Esc or a window over it closes it."""
    if not state.interface.keys:
        return None
    if ui.commands is not None or imgui.internal.get_top_most_popup_modal() is not None:
        return ui.run(state, "keys")
    viewport = imgui.get_main_viewport()
    imgui.set_next_window_pos(viewport.get_work_center(), imgui.Cond_.always, (0.5, 0.5))
    imgui.push_style_var(imgui.StyleVar_.window_padding, (ui.px(22), ui.px(16)))
    imgui.push_style_var(imgui.StyleVar_.window_rounding, ui.px(8))
    imgui.push_style_var(imgui.StyleVar_.item_spacing, (ui.px(8), ui.px(3)))
    imgui.set_next_window_size_constraints((0, 0), viewport.work_size)
    imgui.set_next_window_bg_alpha(0.95)
    imgui.begin("##keys", None, _SHEET_FLAGS)
    _columns(ui, viewport.work_size.x)
    # A click on the sheet's scrollbar does not close it.
    free = imgui.is_window_hovered() and not imgui.is_any_item_active()
    closed = (free and imgui.is_mouse_clicked(0)) or imgui.is_key_pressed(imgui.Key.escape)
    imgui.end()
    imgui.pop_style_var(3)
    return ui.run(state, "keys") if closed else None


def _columns(ui: UiContext, width: float) -> None:
    """Draw the columns next to each other, each as wide as necessary."""
    gap, spacing = ui.px(14), ui.px(30)
    for count in range(4, 0, -1):
        fitting = columns(SHEET, count)
        keys_wide = [_widest(column, 0) + gap for column in fitting]
        texts_wide = [_widest(column, 1) + spacing for column in fitting]
        if sum(keys_wide) + sum(texts_wide) <= width - ui.px(60):
            break
    left, top = imgui.get_cursor_pos()
    for column, second in zip(fitting, keys_wide, strict=True):
        imgui.set_cursor_pos((left, top))
        imgui.begin_group()
        for number, (title, part) in enumerate(column):
            if number:
                imgui.dummy((0, ui.px(8)))
            imgui.text_disabled(title)
            for keys, text in part:
                imgui.text(keys)
                imgui.same_line(second)
                imgui.text(text)
        imgui.end_group()
        left += imgui.get_item_rect_size().x + spacing


def _widest(column: Sequence[Part], place: int) -> float:
    """Return the width of the keys, or of their actions, in a column."""
    return max(text_width(row[place]) for _, rows in column for row in rows)
