"""The line at the bottom: what is shown, and what its stages took."""

from __future__ import annotations

from collections.abc import Callable

from imgui_bundle import imgui

from volspec.viewer.model.state import ViewState
from volspec.viewer.ui.context import UiContext
from volspec.viewer.ui.panels.widgets import in_line, shortened, text_width

_FLAGS = (
    imgui.WindowFlags_.no_decoration
    | imgui.WindowFlags_.no_docking
    | imgui.WindowFlags_.no_saved_settings
    | imgui.WindowFlags_.no_nav
)
HEIGHT = 26


def draw(state: ViewState, ui: UiContext) -> ViewState | None:
    """Draw it along the whole window."""
    viewport = imgui.get_main_viewport()
    imgui.push_style_var(imgui.StyleVar_.window_padding, (ui.px(12), ui.px(4)))
    imgui.internal.begin_viewport_side_bar(
        "##status", viewport, imgui.Dir.down, ui.px(HEIGHT), _FLAGS
    )
    texts = (in_line(state.document.title), sizes(state, ui), f"H: keys    {timings(ui)}")
    room = imgui.get_content_region_avail().x
    title, shown, times = fitting_texts(texts, room, ui.px(16), text_width)
    imgui.text(title)
    if shown:
        imgui.same_line(0, ui.px(16))
        imgui.text_disabled(shown)
    if times:
        imgui.same_line(imgui.get_window_width() - text_width(times) - ui.px(12))
        imgui.text_disabled(times)
    imgui.end()
    imgui.pop_style_var()
    return None


def fitting_texts(
    texts: tuple[str, str, str], room: float, apart: float, measure: Callable[[str], float]
) -> tuple[str, str, str]:
    """What there is room for: the last goes first, then the second, then the first is cut.

    >>> fitting_texts(("engine", "9 × 9", "60 fps"), 14, 1, len)
    ('engine', '9 × 9', '')
    >>> fitting_texts(("engine", "9 × 9", "60 fps"), 5, 1, len)
    ('engi…', '', '')
    """
    title, shown, times = texts
    wide = measure(title), measure(shown), measure(times)
    if sum(wide) + 2 * apart <= room:
        return texts
    if wide[0] + wide[1] + apart <= room:
        return title, shown, ""
    return shortened(title, room, measure), "", ""


def sizes(state: ViewState, ui: UiContext) -> str:
    """The picture's size, and whether it is still coarse."""
    if ui.results.image is None:
        return "no picture" if ui.results.fault else "casting …"
    width, height = state.size
    if ui.results.whole:
        return f"{width} × {height}"
    shown, _ = ui.results.image.size
    return f"{width} × {height}, refining (1/{max(1, round(width / shown))})"


def timings(ui: UiContext) -> str:
    """What the stages took last."""
    parts = [f"{ui.results.fps:.0f} fps"] if ui.results.fps else []
    parts += [f"{stage} {ms:.0f} ms" for stage, ms in ui.results.ms.items()]
    return "   ".join(parts)
