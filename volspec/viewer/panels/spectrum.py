"""The spectrum of what shines, filled with its own colours; the chosen light as a line."""

from __future__ import annotations

from functools import lru_cache

import numpy as np
from imgui_bundle import imgui, implot
from numpy.typing import NDArray

from volspec.appearance.srgb import encode, linear_from_XYZ
from volspec.spectra import SpectralGrid, Spectrum, color_matching_functions
from volspec.viewer.lighting import rig_of
from volspec.viewer.panels.desk import Desk
from volspec.viewer.state import ViewState

_NO_MOUSE = implot.Flags_.canvas_only | implot.Flags_.no_inputs
_HEADROOM = 1.08
_MARGIN = 0.07
_STRIPS = 93


def draw(state: ViewState, desk: Desk, height: float) -> None:
    """Draw it into what is left of the line."""
    grid = state.document.grid
    width = imgui.get_content_region_avail().x
    if not implot.begin_plot("##spectrum", (width, height), _NO_MOUSE):
        return
    implot.setup_axes("", "", implot.AxisFlags_.no_grid_lines, implot.AxisFlags_.no_decorations)
    first, last = float(grid.wavelengths_nm[0]), float(grid.wavelengths_nm[-1])
    margin = _MARGIN * (last - first)  # half a label
    implot.setup_axes_limits(first - margin, last + margin, 0.0, 1.0, imgui.Cond_.always)
    implot.setup_axis_ticks(implot.ImAxis_.x1, [400.0, 500.0, 600.0, 700.0])
    implot.setup_finish()
    rig = rig_of(state.lights)
    if rig is not None:
        _fill(rig.mixed(grid), grid)
    if state.interface.light < len(state.lights):
        row = state.lights[state.interface.light]
        spectrum = row.rig.mixed(grid)
        text = imgui.get_style_color_vec4(imgui.Col_.text)
        spec = implot.Spec(line_color=text, line_weight=desk.px(1.5))
        implot.plot_line(row.name, grid.wavelengths_nm, _heights(spectrum), spec=spec)
    implot.end_plot()


def _heights(spectrum: Spectrum) -> NDArray[np.float64]:
    values = spectrum.values
    return np.asarray(values / (max(float(values.max()), 1e-12) * _HEADROOM))


def _fill(spectrum: Spectrum, grid: SpectralGrid) -> None:
    heights, colours = _heights(spectrum), band_colours(grid)
    draw_list = implot.get_plot_draw_list()
    implot.push_plot_clip_rect()
    at = grid.wavelengths_nm
    edges = np.linspace(at[0], at[-1], 2 * _STRIPS + 1)
    levels = np.interp(edges, at, heights)
    nearest = np.abs(edges[1::2, None] - at).argmin(axis=1)
    # Upright stripes a pixel or two wide have no slanted edges to be smoothed into lines.
    for i in range(_STRIPS):
        left = implot.plot_to_pixels(float(edges[2 * i]), float(levels[2 * i + 1]))
        right = implot.plot_to_pixels(float(edges[2 * i + 2]), 0.0)
        ends = (round(left.x), left.y), (round(right.x), right.y)
        draw_list.add_rect_filled(*ends, colours[nearest[i]])
    implot.pop_plot_clip_rect()


@lru_cache(maxsize=4)
def band_colours(grid: SpectralGrid) -> tuple[int, ...]:
    """What each band looks like, muted, packed for imgui."""
    XYZ = color_matching_functions(grid).T
    # Laid on grey until it is a colour of the display, evenly bright but for the ends.
    linear = linear_from_XYZ(XYZ / XYZ.max() * 100.0)
    linear -= np.minimum(linear.min(axis=1, keepdims=True), 0.0)
    strength = linear.max(axis=1, keepdims=True)
    codes = encode(linear / np.maximum(strength, 0.08))
    return tuple(
        int(imgui.color_convert_float4_to_u32((float(r), float(g), float(b), 0.85)))
        for r, g, b in 0.15 + 0.75 * codes
    )
