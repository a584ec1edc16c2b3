"""Messages to the user: the newest over the picture, all of them in a panel.

    Notice -> [messages] -> toast, panel, text on an empty picture

Kinds differ by their sign as well as by their colour.
"""

from __future__ import annotations

from imgui_bundle import imgui

from volspec.viewer.model.state import ViewState
from volspec.viewer.ui.context import UiContext, tip
from volspec.viewer.ui.overlays import BARE_WINDOW
from volspec.viewer.ui.widgets import pack_colour, text_width, whole_label
from volspec.viewer.work.notify import Kind, Message

_W = imgui.WindowFlags_
_TOAST = BARE_WINDOW | _W.always_auto_resize | _W.no_focus_on_appearing | _W.no_nav
# Colours by the theme, True if it is dark; informative messages have none.
_COLOURS = {
    "error": {True: (1.0, 0.47, 0.42), False: (0.74, 0.09, 0.06)},
    "warning": {True: (0.95, 0.76, 0.25), False: (0.56, 0.38, 0.0)},
}
# Widths in pixels at 96 dpi.
_MAX, _MIN, _SIGN = 560, 280, 17


def colour_of(kind: Kind, dark: bool) -> tuple[float, float, float, float]:
    """Return the colour of a message's text."""
    if kind == "info":
        text = imgui.get_style_color_vec4(imgui.Col_.text)
        return text.x, text.y, text.z, text.w
    return (*_COLOURS[kind][dark], 1.0)


def is_dark() -> bool:
    """Return True if the theme in use is dark."""
    return bool(imgui.get_style_color_vec4(imgui.Col_.text).x > 0.5)


def draw_sign(kind: Kind, ui: UiContext) -> None:
    """Draw a kind's sign in the line: a disc for errors, a triangle for warnings, or nothing."""
    x, y = imgui.get_cursor_screen_pos()
    side, line = ui.px(_SIGN), imgui.get_text_line_height()
    imgui.dummy((side, line))
    if kind == "info":
        return
    draw_list, dark = imgui.get_window_draw_list(), is_dark()
    fill = pack_colour(colour_of(kind, dark))
    mark = pack_colour((0.08, 0.08, 0.08) if dark else (1.0, 1.0, 1.0))
    middle, half = (x + side / 2, y + line / 2), side / 2 - ui.px(1)
    if kind == "error":
        draw_list.add_circle_filled(middle, half, fill, 24)
    else:
        top = middle[0], middle[1] - half
        low = middle[1] + half * 0.8
        draw_list.add_triangle_filled(top, (middle[0] - half, low), (middle[0] + half, low), fill)
    drop = 0.0 if kind == "error" else ui.px(1.5)
    stroke = ui.px(1.8)
    upper, lower = middle[1] - half * 0.55 + drop, middle[1] + half * 0.12 + drop
    draw_list.add_line((middle[0], upper), (middle[0], lower), mark, stroke)
    draw_list.add_circle_filled((middle[0], middle[1] + half * 0.5 + drop / 2), stroke * 0.6, mark)


def draw_toast(message: Message, ui: UiContext) -> bool:
    """Show a message at the picture's top, below its titles; return True if it is dismissed.

    Only errors, which stay, have a cross and take the mouse.
    """
    x, y, width, _ = ui.areas["picture"]
    viewport = imgui.get_main_viewport()
    left, room = viewport.work_pos.x, viewport.work_size.x
    max_width = min(max(width - ui.px(48), ui.px(_MIN)), room - ui.px(48), ui.px(_MAX))
    half = max_width / 2 + ui.px(20)
    middle = min(max(x + width / 2, left + half), left + room - half)
    _, top, _, sides_h = ui.areas.get("sides", (0, y, 0, 0))
    imgui.set_next_window_pos((middle, top + sides_h + ui.px(20)), imgui.Cond_.always, (0.5, 0.0))
    stays = message.kind == "error"
    _begin("##message", ui, 0 if stays else _W.no_inputs)
    closed = False
    if message.kind != "info":
        draw_sign(message.kind, ui)
        imgui.same_line()
    cross = ui.px(26) if stays else 0.0
    _write(message.text, message.kind, max(max_width - cross, ui.px(60)))
    if stays:
        imgui.same_line(0, ui.px(10))
        closed = _cross(ui)
    imgui.end()
    imgui.pop_style_var(2)
    return closed


def draw_centred(text: str, fault: bool, opens: bool, ui: UiContext) -> None:
    """Write in the middle of the picture's area; a ``fault`` as an error.

    If it ``opens`` files, there are a button for that, and the recent files.
    """
    x, y, width, height = ui.areas["picture"]
    place = x + width / 2, y + height / 2
    imgui.set_next_window_pos(place, imgui.Cond_.always, (0.5, 0.5))
    _begin("##centred", ui, 0 if opens else _W.no_inputs)
    if fault:
        draw_sign("error", ui)
        imgui.same_line()
    _write(text, "error" if fault else "info", min(0.8 * width, ui.px(_MAX)))
    if opens:
        imgui.spacing()
        if imgui.button("Open …"):
            ui.request("open")
        ui.note("open another")
        for number, row in enumerate(row for row in ui.results.recent if row.exists):
            if imgui.selectable(f"{whole_label(row.label)}##{number}", False)[0]:
                ui.request("open", row.path)
    imgui.end()
    imgui.pop_style_var(2)


def _begin(name: str, ui: UiContext, flags: int) -> None:
    imgui.set_next_window_bg_alpha(0.92)
    imgui.push_style_var(imgui.StyleVar_.window_padding, (ui.px(16), ui.px(10)))
    imgui.push_style_var(imgui.StyleVar_.window_rounding, ui.px(6))
    imgui.begin(name, None, _TOAST | flags)


def _write(text: str, kind: Kind, wrap_width: float) -> None:
    imgui.push_style_color(imgui.Col_.text, colour_of(kind, is_dark()))
    imgui.push_text_wrap_pos(imgui.get_cursor_pos_x() + wrap_width)
    imgui.text(text)
    imgui.pop_text_wrap_pos()
    imgui.pop_style_color()


def _cross(ui: UiContext) -> bool:
    """Draw a button that closes a message."""
    side = imgui.get_text_line_height()
    x, y = imgui.get_cursor_screen_pos()
    pressed = bool(imgui.invisible_button("close", (side, side)))
    ui.note("close message", "Dismiss; Window › Messages has it still")
    colour = imgui.get_color_u32(
        imgui.Col_.text if imgui.is_item_hovered() else imgui.Col_.text_disabled
    )
    draw_list, gap = imgui.get_window_draw_list(), side * 0.25
    for ends in (
        ((x + gap, y + gap), (x + side - gap, y + side - gap)),
        ((x + gap, y + side - gap), (x + side - gap, y + gap)),
    ):
        draw_list.add_line(*ends, colour, ui.px(1.6))
    return pressed


def draw(state: ViewState, ui: UiContext) -> ViewState | None:
    """Draw the panel: all messages, the newest first; a click copies one."""
    messages = ui.results.messages
    imgui.begin_disabled(not messages)
    if imgui.button("Copy all"):
        imgui.set_clipboard_text("\n".join(map(str, messages)))
    ui.note("copy messages")
    imgui.same_line()
    if imgui.button("Clear"):
        ui.request("clear-messages")
    ui.note("clear messages")
    imgui.end_disabled()
    imgui.separator()
    if not messages:
        imgui.text_disabled("No messages yet")
    for number in range(len(messages) - 1, -1, -1):
        _row(number, messages[number], ui)
    return None


def _row(number: int, message: Message, ui: UiContext) -> None:
    imgui.push_id(number)
    time = message.time
    indent = text_width(time) + ui.px(_SIGN) + 2 * imgui.get_style().item_spacing.x
    room = max(imgui.get_content_region_avail().x - indent, ui.px(60))
    text = message.text + (f"  ({message.count} times)" if message.count > 1 else "")
    height = imgui.calc_text_size(text, wrap_width=room).y
    left, top = imgui.get_cursor_pos()
    if imgui.selectable("##copy", False, 0, (0, height))[0]:
        imgui.set_clipboard_text(str(message))
    ui.note(f"message {number}")
    tip("Click to copy")
    imgui.set_cursor_pos((left, top))
    imgui.text_disabled(time)
    imgui.same_line()
    draw_sign(message.kind, ui)
    imgui.same_line()
    _write(text, message.kind, room)
    imgui.pop_id()
