"""The window's look: neutral greys, so that no colour is next to the picture's."""

from __future__ import annotations

from pathlib import Path
from typing import Any

FONT_SIZE = 15.0
# Greys of the two themes: (window, frame, hovered, active, line, grab, dim text, text); numbers
# stand over a slider's grab.
_DARK = (0.135, 0.205, 0.255, 0.300, 0.260, 0.400, 0.560, 0.880)
_LIGHT = (0.925, 0.850, 0.805, 0.760, 0.770, 0.640, 0.400, 0.110)
# What is switched on or held.
ACCENT = {True: (0.88, 0.64, 0.30, 1.0), False: (0.70, 0.43, 0.08, 1.0)}


def load_font(imgui: Any) -> None:
    """The font that comes with imgui-bundle; imgui's own where that has moved."""
    import imgui_bundle

    file = Path(imgui_bundle.__file__).parent / "assets" / "fonts" / "Roboto" / "Roboto-Regular.ttf"
    if file.exists():
        imgui.get_io().fonts.add_font_from_file_ttf(str(file), FONT_SIZE)


def set_sizes(imgui: Any, implot: Any) -> None:
    """Spacing and type size at 96 dpi."""
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
    style.frame_rounding = style.grab_rounding = style.tab_rounding = 3
    style.popup_rounding = 5
    style.window_menu_button_position = imgui.Dir.none
    style.font_size_base = FONT_SIZE
    plot = implot.get_style()
    plot.plot_border_size = 0
    plot.minor_tick_len = (0, 0)


def set_scale(imgui: Any, implot: Any, scale: float, before: float = 1.0) -> None:
    """All of that for another density of pixels.

    Parameters
    ----------
    imgui, implot : modules
    scale, before : float
        Pixels of the window for each at 96 dpi: now, and what it was set for.
    """
    style, plot = imgui.get_style(), implot.get_style()
    style.font_scale_dpi = scale
    style.scale_all_sizes(scale / before)
    plot.plot_padding = (4 * scale, 4 * scale)
    plot.label_padding = plot.major_tick_len = (3 * scale, 3 * scale)


def set_theme(imgui: Any, implot: Any, dark: bool) -> None:
    """Colours, dark or light."""
    (imgui.style_colors_dark if dark else imgui.style_colors_light)()
    window, frame, hovered, active, line, grab, dim, text = _DARK if dark else _LIGHT
    style, plot = imgui.get_style(), implot.get_style()

    def grey(value: float, alpha: float = 1.0) -> tuple[float, float, float, float]:
        return value, value, value, alpha

    greys = {
        window: "window_bg child_bg title_bg title_bg_active title_bg_collapsed "
        "scrollbar_bg menu_bar_bg tab tab_dimmed",
        frame: "frame_bg button header tab_selected tab_dimmed_selected checkbox_selected_bg",
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
