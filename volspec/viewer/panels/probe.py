"""What is under the mouse: value, place, colour, and its spectrum beside the light's."""

from __future__ import annotations

import numpy as np
from imgui_bundle import imgui, implot

from volspec.viewer.panels.desk import Desk
from volspec.viewer.panels.spectrum import band_colours
from volspec.viewer.reading import Reading
from volspec.viewer.state import ViewState

_FLAGS = (
    imgui.WindowFlags_.no_decoration
    | imgui.WindowFlags_.no_inputs
    | imgui.WindowFlags_.no_docking
    | imgui.WindowFlags_.always_auto_resize
    | imgui.WindowFlags_.no_focus_on_appearing
    | imgui.WindowFlags_.no_nav
)
_PLOT = implot.Flags_.canvas_only | implot.Flags_.no_inputs
_SIZE = (196.0, 74.0)
_HEADROOM = 1.06


def draw(state: ViewState, desk: Desk) -> ViewState | None:
    """Draw it over the picture's lower left corner."""
    reading = desk.under_mouse
    if reading is None or not state.interface.probe:
        return None
    x, y, _, height = desk.areas["picture"]
    corner = x + desk.px(12), y + height - desk.px(12)
    imgui.set_next_window_pos(corner, imgui.Cond_.always, (0.0, 1.0))
    imgui.set_next_window_bg_alpha(0.82)
    imgui.push_style_var(imgui.StyleVar_.window_rounding, desk.px(5))
    imgui.push_style_var(imgui.StyleVar_.item_spacing, (desk.px(8), desk.px(3)))
    if imgui.begin("##probe", None, _FLAGS)[0]:
        widest = max(imgui.calc_text_size(name).x for name, _ in reading.rows)
        label = widest + desk.px(14) + imgui.get_style().window_padding.x
        for name, value in reading.rows:
            imgui.text_disabled(name)
            imgui.same_line(label)
            imgui.text(value)
        _spectra(reading, desk)
    imgui.end()
    imgui.pop_style_var(2)
    return None


def _spectra(reading: Reading, desk: Desk) -> None:
    """The light as a line, what comes back filled with its colours."""
    width, height = _SIZE
    if not implot.begin_plot("##reflected", (desk.px(width), desk.px(height)), _PLOT):
        return
    bare = implot.AxisFlags_.no_decorations
    implot.setup_axes("", "", bare, bare)
    at = reading.grid.wavelengths_nm
    half = float(at[1] - at[0]) / 2
    implot.setup_axes_limits(at[0] - half, at[-1] + half, 0.0, _HEADROOM, imgui.Cond_.always)
    implot.setup_finish()
    draw_list = implot.get_plot_draw_list()
    implot.push_plot_clip_rect()
    colours = band_colours(reading.grid)
    for middle, level, colour in zip(at, reading.reflected, colours, strict=True):
        left = implot.plot_to_pixels(float(middle) - half, float(min(level, _HEADROOM)))
        right = implot.plot_to_pixels(float(middle) + half, 0.0)
        ends = (round(left.x), left.y), (round(right.x), right.y)
        draw_list.add_rect_filled(*ends, colour)
    implot.pop_plot_clip_rect()
    text = imgui.get_style_color_vec4(imgui.Col_.text)
    line = implot.Spec(line_color=text, line_weight=desk.px(1.2))
    implot.plot_line("light", np.ascontiguousarray(at), reading.light, spec=line)
    implot.end_plot()
