"""The line at the bottom: what is shown, and what its stages took."""

from __future__ import annotations

from imgui_bundle import imgui

from volspec.viewer.panels.desk import Desk
from volspec.viewer.state import ViewState

_FLAGS = (
    imgui.WindowFlags_.no_decoration
    | imgui.WindowFlags_.no_docking
    | imgui.WindowFlags_.no_saved_settings
    | imgui.WindowFlags_.no_nav
)
HEIGHT = 26


def draw(state: ViewState, desk: Desk) -> ViewState | None:
    """Draw it along the whole window."""
    viewport = imgui.get_main_viewport()
    imgui.push_style_var(imgui.StyleVar_.window_padding, (desk.px(12), desk.px(4)))
    imgui.internal.begin_viewport_side_bar(
        "##status", viewport, imgui.Dir.down, desk.px(HEIGHT), _FLAGS
    )
    imgui.text(state.document.title)
    imgui.same_line(0, desk.px(16))
    imgui.text_disabled(sizes(state, desk))
    times = timings(desk)
    hint = "H: keys    "
    imgui.same_line(imgui.get_window_width() - imgui.calc_text_size(hint + times).x - desk.px(12))
    imgui.text_disabled(hint + times)
    imgui.end()
    imgui.pop_style_var()
    return None


def sizes(state: ViewState, desk: Desk) -> str:
    """The picture's size, and whether it is still coarse."""
    if desk.image is None:
        return "casting …"
    width, height = state.size
    if desk.whole:
        return f"{width} × {height}"
    shown, _ = desk.image.size
    return f"{width} × {height}, refining (1/{max(1, round(width / shown))})"


def timings(desk: Desk) -> str:
    """What the stages took last."""
    parts = [f"{desk.fps:.0f} fps"] if desk.fps else []
    parts += [f"{stage} {ms:.0f} ms" for stage, ms in desk.ms.items()]
    return "   ".join(parts)
