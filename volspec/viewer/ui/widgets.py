"""The window's look in neutral greys, and widgets that several panels use."""

from __future__ import annotations

import math
import re
import textwrap
import unicodedata
import warnings
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager
from functools import lru_cache
from pathlib import Path
from typing import Any

import imgui_bundle
from imgui_bundle import imgui

from volspec._text import printable, text_runs
from volspec.errors import VolspecWarning, quote
from volspec.settings import descriptions
from volspec.viewer.model.commands import format_key
from volspec.viewer.model.edit import Command
from volspec.viewer.ui.context import LibraryState, UiContext

FONT_SIZE = 15.0
# Greys of the two themes, so that no colour is next to the picture's: (window, frame, hovered,
# active, line, grab, dim text, text); numbers are drawn over a slider's grab.
_DARK = (0.135, 0.205, 0.255, 0.300, 0.260, 0.400, 0.560, 0.880)
_LIGHT = (0.925, 0.850, 0.805, 0.760, 0.770, 0.640, 0.400, 0.110)
# Colour of active items, by the theme: True if it is dark.
ACCENT = {True: (0.88, 0.64, 0.30, 1.0), False: (0.70, 0.43, 0.08, 1.0)}
# Text on the accent.
_INK = (0.05, 0.05, 0.05, 1.0)
WHITE, BLACK = (1.0, 1.0, 1.0), (0.0, 0.0, 0.0)
# The most letters of a name or title; no panel has room for more.
_MAX_LETTERS = 240


def load_font(imgui: Any) -> None:
    """Load the font that comes with imgui-bundle; imgui's own is used if there is no such file."""
    file = Path(imgui_bundle.__file__).parent / "assets" / "fonts" / "Roboto" / "Roboto-Regular.ttf"
    if file.exists():
        imgui.get_io().fonts.add_font_from_file_ttf(str(file), FONT_SIZE)


@lru_cache(maxsize=512)
def load_letters(text: str) -> None:
    """Add the installed fonts that have letters of a text which the window's font lacks."""
    if text.isascii() or imgui.get_current_context() is None:
        return
    fonts = imgui.get_io().fonts
    lacking = "".join(c for c in text if not fonts.fonts[0].is_glyph_in_font(ord(c)))
    more = imgui.ImFontConfig()
    more.merge_mode = True
    for font in {font for _, font in text_runs(lacking)}:
        fonts.add_font_from_file_ttf(str(font), FONT_SIZE, more)
    if any(unicodedata.bidirectional(c) in ("R", "AL") for c in lacking):
        warnings.warn(
            f"the window shows {quote(text)} from left to right; saved pictures show it right",
            VolspecWarning,
            stacklevel=2,
        )


def set_sizes(imgui: Any, implot: Any) -> None:
    """Set spacing and type size at 96 dpi."""
    style = imgui.get_style()
    style.window_padding = (12, 10)
    style.frame_padding = (7, 3)
    style.item_spacing = (8, 6)
    style.item_inner_spacing = (6, 4)
    style.cell_padding = (3, 2)
    style.scrollbar_size = 10
    style.grab_min_size = 9
    style.window_border_size = style.child_border_size = style.frame_border_size = 0
    style.tab_bar_border_size = style.tab_bar_overline_size = 0
    style.popup_border_size = 1
    style.docking_separator_size = 1
    # Five tabs fit next to each other; their close buttons are shown under the mouse.
    style.tab_min_width_shrink, style.tab_close_button_min_width_selected = 60, 0
    style.frame_rounding = style.grab_rounding = style.tab_rounding = 3
    style.popup_rounding = 5
    style.window_menu_button_position = imgui.Dir.none
    style.font_size_base = FONT_SIZE
    plot = implot.get_style()
    plot.plot_border_size = 0
    plot.minor_tick_len = (0, 0)


def set_scale(imgui: Any, implot: Any, scale: float, before: float = 1.0) -> None:
    """Set spacing and type size; both scales are window pixels per pixel at 96 dpi."""
    style, plot = imgui.get_style(), implot.get_style()
    style.font_scale_dpi = scale
    style.scale_all_sizes(scale / before)
    plot.plot_padding = (4 * scale, 4 * scale)
    plot.label_padding = plot.major_tick_len = (3 * scale, 3 * scale)


def set_theme(imgui: Any, implot: Any, dark: bool) -> None:
    """Set the colours of the dark or the light theme."""
    (imgui.style_colors_dark if dark else imgui.style_colors_light)()
    window, frame, hovered, active, line, grab, dim, text = _DARK if dark else _LIGHT
    style, plot = imgui.get_style(), implot.get_style()

    def grey(value: float, alpha: float = 1.0) -> tuple[float, float, float, float]:
        return value, value, value, alpha

    greys = {
        window: "window_bg child_bg title_bg title_bg_active title_bg_collapsed "
        "scrollbar_bg menu_bar_bg tab tab_dimmed",
        frame: "frame_bg button header table_header_bg tab_selected tab_dimmed_selected "
        "checkbox_selected_bg",
        hovered: "frame_bg_hovered button_hovered header_hovered tab_hovered",
        active: "frame_bg_active button_active header_active",
        line: "separator border table_border_light table_border_strong separator_hovered "
        "separator_active resize_grip",
        grab: "slider_grab scrollbar_grab",
        dim: "text_disabled scrollbar_grab_hovered scrollbar_grab_active",
        text: "text",
    }
    for value, names in greys.items():
        for name in names.split():
            style.set_color_(getattr(imgui.Col_, name), grey(value))
    style.set_color_(imgui.Col_.popup_bg, grey(window + 0.03))
    for name in ("slider_grab_active", "check_mark", "nav_cursor"):
        style.set_color_(getattr(imgui.Col_, name), ACCENT[dark])
    style.set_color_(imgui.Col_.text_selected_bg, (*ACCENT[dark][:3], 0.35))
    plot.set_color_(implot.Col_.frame_bg, grey(window, 0.0))
    plot.set_color_(implot.Col_.plot_bg, grey(window - (0.035 if dark else 0.03)))
    plot.set_color_(implot.Col_.axis_text, grey(dim))
    plot.set_color_(implot.Col_.axis_grid, grey(dim, 0.15))


def pack_colour(colour: Sequence[float], alpha: float = 1.0) -> int:
    """Pack sRGB codes 0 to 1 for draw lists; a fourth number multiplies the opacity."""
    r, g, b, opacity = (*colour, 1.0)[:4]
    return int(imgui.color_convert_float4_to_u32((r, g, b, opacity * alpha)))


@contextmanager
def over_picture(ui: UiContext) -> Iterator[imgui.ImDrawList]:
    """Yield the draw list behind the panels, clipped to the picture."""
    x, y, width, height = ui.areas["picture"]
    draw_list = imgui.get_background_draw_list()
    draw_list.push_clip_rect((x, y), (x + width, y + height))
    yield draw_list
    draw_list.pop_clip_rect()


def text_width(text: str) -> float:
    """Return the width of a text in imgui's current font, in pixels."""
    return float(imgui.calc_text_size(text).x)


@lru_cache(maxsize=512)
def as_one_line(text: str) -> str:
    """Return a user's name for something as one printable line.

    >>> as_one_line("north\\nwindow\\t\\x07"), as_one_line("a##b")
    ('north window', 'a# #b')
    """
    line = whole_label(printable(text, _MAX_LETTERS).strip())
    load_letters(line)
    return line


def whole_label(text: str) -> str:
    """Escape ``##``, at which imgui ends a label and begins its identity.

    >>> whole_label("a###b")
    'a# # #b'
    """
    return re.sub("#(?=#)", "# ", text)


def shorten(text: str, width: float, measure: Callable[[str], float] = text_width) -> str:
    """Return a text in one line, cut with an ellipsis if it would be wider.

    >>> shorten("tungsten", 5, len), shorten("D\\n65", 5, len)
    ('tung…', 'D 65')
    """
    text = as_one_line(text)
    if measure(text) <= width:
        return text
    end = len(text)
    while end > 1 and measure(text[:end].rstrip() + "…") > width:
        end -= 1
    return text[:end].rstrip() + "…"


def shorten_middle(text: str, width: float, measure: Callable[[str], float] = text_width) -> str:
    """Return a text in one line, with an ellipsis in its middle if it would be wider.

    >>> shorten_middle("led:455*0.3+led:600", 11, len), shorten_middle("D65", 5, len)
    ('led:4…d:600', 'D65')
    """
    text = as_one_line(text)
    if measure(text) <= width:
        return text
    count = len(text) // 2
    while count > 1 and measure(f"{text[:count]}…{text[-count:]}") > width:
        count -= 1
    return f"{text[:count]}…{text[-count:]}"


def wrap_text(text: str, colour: int) -> None:
    """Draw a text in as many lines as it needs, in one of the theme's colours."""
    imgui.push_style_color(imgui.Col_.text, imgui.get_style_color_vec4(colour))
    imgui.text_wrapped(text)
    imgui.pop_style_color()


def pick(
    label: str, now: str, names: Iterable[str], after_row: Callable[[str], None] | None = None
) -> str | None:
    """Draw a list to pick from; return the name that was clicked, possibly ``now``, or None.

    While the list is open, ``after_row`` is called with every name after its row is drawn.
    """
    clicked = None
    if imgui.begin_combo(label, as_one_line(now), imgui.ComboFlags_.height_large):
        for number, name in enumerate(names):
            if imgui.selectable(f"{as_one_line(name)}###{number}", name == now)[0]:
                clicked = name
            if after_row is not None:
                after_row(name)
        imgui.end_combo()
    return clicked


def describe_field(cls: Any, field: str) -> str:
    """Return the description of a setting, for a tooltip."""
    return _wrap_description(descriptions(cls)[field])


@lru_cache(maxsize=128)
def _wrap_description(text: str) -> str:
    return textwrap.fill(text.replace("``", ""), 64)


def focus_if_wanted(name: str, ui: UiContext) -> None:
    """Focus the next item, and scroll to it, if that was requested."""
    if ui.item == name:
        ui.item = ""
        imgui.set_keyboard_focus_here()


def lit_button(label: str, on: bool, dark: bool, size: tuple[float, float] = (0, 0)) -> bool:
    """Draw a button, in the accent colour if ``on``; return True if pressed."""
    if on:
        imgui.push_style_color(imgui.Col_.button, ACCENT[dark])
        imgui.push_style_color(imgui.Col_.text, _INK)
    pressed = bool(imgui.button(label, size))
    if on:
        imgui.pop_style_color(2)
    return pressed


def draw_eye(ui: UiContext, is_open: bool, name: str) -> bool:
    """Draw a button with an eye, which is crossed out unless open; return True if pressed."""
    side = imgui.get_frame_height()
    x, y = imgui.get_cursor_screen_pos()
    pressed = bool(imgui.invisible_button(f"##{name}", (side, side)))
    colour = imgui.Col_.text if is_open or imgui.is_item_hovered() else imgui.Col_.text_disabled
    ink, line = imgui.get_color_u32(colour), max(ui.px(1.3), 1.0)
    draw_list = imgui.get_window_draw_list()
    middle, half, height = (x + side / 2, y + side / 2), side * 0.36, side * 0.24
    angles = [math.pi * step / 12 for step in range(13)]
    for up in (-1, 1):
        arc: list[imgui.ImVec2Like] = [
            (middle[0] - half * math.cos(angle), middle[1] + up * height * math.sin(angle))
            for angle in angles
        ]
        draw_list.add_polyline(arc, ink, line, 0)
    draw_list.add_circle_filled(middle, side * 0.12, ink)
    if not is_open:
        slope = 0.8 * half
        start, end = (middle[0] - half, middle[1] + slope), (middle[0] + half, middle[1] - slope)
        draw_list.add_line(start, end, ink, line)
    return pressed


def search_field(label: str, hint: str, panel: LibraryState) -> bool:
    """Draw a library's search field, which is empty at first; return True on Enter."""
    if imgui.is_window_appearing():
        panel.search, panel.complaint = "", ""
        imgui.set_keyboard_focus_here()
    # Otherwise the field would consume the first Esc.
    if imgui.is_key_pressed(imgui.Key.escape):
        imgui.close_current_popup()
    imgui.set_next_item_width(-1)
    enter = imgui.InputTextFlags_.enter_returns_true
    entered, text = imgui.input_text_with_hint(label, hint, panel.search, enter)
    if text != panel.search:
        panel.search, panel.complaint = text, ""
    return entered


def shown_rows(count: int, height: float = -1.0, always: int | None = None) -> Iterator[int]:
    """Yield the indices of a list's visible rows, and ``always`` if the list has that row.

    A negative row height is measured.
    """
    clipper = imgui.ListClipper()
    clipper.begin(count, height)
    if always is not None and always < count:
        clipper.include_item_by_index(always)
    while clipper.step():
        yield from range(clipper.display_start, clipper.display_end)
    clipper.end()


def key_text(command: Command) -> str:
    """Return the first key of a command as text; empty if it has none."""
    return format_key(command.keys[0]) if command.keys and command.keys[0] else ""
