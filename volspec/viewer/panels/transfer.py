"""The transfer function: the curve of opacity over the histogram, its points dragged."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from imgui_bundle import imgui, implot
from numpy.typing import NDArray

from volspec.transfer import TransferFunction
from volspec.viewer.events import Event, reduced
from volspec.viewer.panels.desk import Desk
from volspec.viewer.state import ViewState
from volspec.viewer.style import ACCENT

_FLAGS = implot.Flags_.canvas_only
_LEGEND = "Drag points. Double-click adds one, right-click removes it."


def draw(state: ViewState, desk: Desk) -> ViewState | None:
    """Draw the panel."""
    curve = state.transfer
    if not isinstance(curve, TransferFunction):
        kind = type(curve).__name__
        imgui.text_wrapped(f"This scene has a {kind}; the scene file holds its settings.")
        return None
    new = state
    low, high = state.document.volume.range
    imgui.set_next_item_width(-desk.px(92))
    span = (high - low) / 2
    moved, shift = imgui.slider_float("Shift", state.shift, -span, span, "%.3g")
    desk.note("shift")
    if moved:
        new = reduced(new, Event("shift", shift))
    pressed, logarithmic = imgui.checkbox("Log histogram", state.interface.logarithmic)
    if pressed:
        new = replace(new, interface=replace(new.interface, logarithmic=logarithmic))
    height = max(imgui.get_content_region_avail().y - desk.px(26), desk.px(120))
    new = _plot(new, desk, height)
    imgui.text_disabled(_LEGEND)
    return None if new is state else new


def bars(counts: NDArray[np.float64], logarithmic: bool) -> NDArray[np.float64]:
    """Heights 0 to 1 of a histogram.

    Linear ones are cut where a tenth of the highest but few stand, as air would dwarf the rest.
    """
    if logarithmic:
        heights = np.log1p(counts)
        return np.asarray(heights / max(float(heights.max()), 1e-12))
    top = float(np.quantile(counts, 0.98))
    return np.asarray(np.minimum(counts / max(top, 1.0), 1.0))


def _plot(state: ViewState, desk: Desk, height: float) -> ViewState:
    curve = state.transfer
    assert isinstance(curve, TransferFunction)
    low, high = state.document.volume.range
    if not implot.begin_plot("##transfer", (-1, height), _FLAGS):
        return state
    implot.setup_axes("", "", implot.AxisFlags_.no_grid_lines, implot.AxisFlags_.no_decorations)
    margin = 0.02 * (high - low)
    implot.setup_axes_limits(low - margin, high + margin, -0.04, 1.06, imgui.Cond_.always)
    implot.setup_finish()
    desk.areas["transfer"] = _area()
    counts = state.document.histogram
    edges = np.linspace(low, high, len(counts) + 1)
    middles = (edges[:-1] + edges[1:]) / 2
    dim = imgui.get_style_color_vec4(imgui.Col_.text_disabled)
    shade = implot.Spec(fill_color=dim, fill_alpha=0.35)
    implot.plot_shaded("voxels", middles, bars(counts, state.interface.logarithmic), spec=shade)
    accent = ACCENT[state.interface.dark]
    # Opacities per step are small: their root shows them apart.
    at = np.array([low, *(point[0] for point in curve.points), high], dtype=np.float64)
    opacity = np.array([point[1] for point in curve.points], dtype=np.float64)
    heights = np.sqrt(np.array([opacity[0], *opacity, opacity[-1]]))
    line = implot.Spec(line_color=imgui.ImVec4(*accent), line_weight=desk.px(1.8))
    implot.plot_line("opacity", at, heights, spec=line)
    new, held = state, False
    for i, (value, own, _) in enumerate(curve.points):
        place = value, float(np.sqrt(own))
        # The last three ask for what it tells of the mouse.
        moved, x, y, _, hovered, down = implot.drag_point(
            i, *place, imgui.ImVec4(*accent), desk.px(4.5), 0, False, False, False
        )
        held = held or bool(down) or bool(hovered)
        if hovered and imgui.is_mouse_clicked(1):
            new = reduced(new, Event("remove-point", index=i))
        elif moved:
            new = reduced(new, Event("point", x, max(y, 0.0) ** 2, index=i))
        if hovered or down:
            imgui.set_tooltip(f"value {value:.4g}\nopacity {own:.3g}")
    if implot.is_plot_hovered() and not held and imgui.is_mouse_double_clicked(0):
        mouse = implot.get_plot_mouse_pos()
        new = reduced(new, Event("add-point", mouse.x, max(mouse.y, 0.0) ** 2))
    implot.end_plot()
    return new


def _area() -> tuple[int, int, int, int]:
    (x, y), (width, height) = implot.get_plot_pos(), implot.get_plot_size()
    return int(x), int(y), int(width), int(height)
