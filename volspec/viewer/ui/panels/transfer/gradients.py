"""What gradients do to a curve's opacity: points of (gradient, factor) under the curve's plot."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from imgui_bundle import imgui, implot

from volspec.transfer import TransferFunction
from volspec.viewer.model.events import Event, reduced
from volspec.viewer.model.state import ViewState
from volspec.viewer.model.transfer.placing import factors_top
from volspec.viewer.ui.context import UiContext
from volspec.viewer.ui.panels.transfer.axes import bars, low_plot, note_area
from volspec.viewer.ui.panels.transfer.handles import Handle, ink, touched
from volspec.viewer.ui.panels.widgets import WAITING_GREYED, tip

_HEIGHT = 70
# Beyond either end of the axes.
_MARGIN, _ABOVE = 0.02, 0.12
_TIP = (
    "Multiplies opacity by how steeply values change, so that boundaries stand out.\n"
    "Drag the points; a double-click adds one, a right click removes it"
)
_FILTERED = "Not together with filters of materials, which this curve has"
_EVENTS = {
    "move": "gradient-point",
    "remove": "remove-gradient-point",
    "add": "add-gradient-point",
}


def height(curve: TransferFunction, ui: UiContext) -> float:
    """Of all that is drawn here, with the gap below it."""
    gap = imgui.get_style().item_spacing.y
    plot = ui.px(_HEIGHT) + gap if curve.gradient_opacity else 0.0
    return plot + imgui.get_frame_height_with_spacing()


def draw(state: ViewState, curve: TransferFunction, ui: UiContext) -> ViewState:
    """Draw what turns it on and off, and the plot while it is on."""
    new, on = state, bool(curve.gradient_opacity)
    imgui.begin_disabled(bool(curve.filters))
    pressed, _ = imgui.checkbox("Opacity by gradient", on)
    imgui.end_disabled()
    ui.note("by gradient")
    tip(_FILTERED if curve.filters else _TIP, WAITING_GREYED)
    if pressed:
        new = reduced(new, Event("by-gradient"))
    if not on:
        return new
    imgui.same_line()
    imgui.text_disabled("factor over value per mm")
    with low_plot("##gradients", ui.px(_HEIGHT), ui) as shown:
        if shown:
            new = _plot(new, curve, ui)
    return new


def _plot(state: ViewState, curve: TransferFunction, ui: UiContext) -> ViewState:
    joint, new = state.document.joint, state
    end = factors_top(curve, joint.top)
    implot.setup_axis(implot.ImAxis_.x1, "", implot.AxisFlags_.no_grid_lines)
    # While the mouse is down an axis that follows the last point would run away from it.
    when = imgui.Cond_.once if imgui.is_mouse_down(0) else imgui.Cond_.always
    implot.setup_axis_limits(implot.ImAxis_.x1, -_MARGIN * end, (1 + _MARGIN) * end, when)
    implot.setup_axis(implot.ImAxis_.y1, "", implot.AxisFlags_.no_tick_marks)
    implot.setup_axis_limits(implot.ImAxis_.y1, -_ABOVE, 1 + _ABOVE, imgui.Cond_.always)
    implot.setup_axis_ticks(implot.ImAxis_.y1, [0.0, 1.0], ["0", "1"])
    implot.setup_finish()
    note_area(ui, "gradients")
    _histogram(state)
    factors = curve.gradient_opacity or ()
    _line(factors, end, ui)
    handles = [
        Handle(place, f"gradient {place[0]:.4g} per mm\nopacity × {place[1]:.3g}")
        for place in factors
    ]
    for i, handle in enumerate(handles):
        x, y = implot.plot_to_pixels(*handle.place)
        ui.areas[f"gradient {i}"] = int(x), int(y), 0, 0
    for touch in touched(handles, -1, ui, state.interface.dark):
        if touch.what in _EVENTS:
            new = reduced(new, Event(_EVENTS[touch.what], touch.x, touch.y, touch.index))
    return new


def _histogram(state: ViewState) -> None:
    """Voxels by gradient, of whatever value."""
    joint = state.document.joint
    counts = joint.counts.sum(axis=1)
    edges = np.linspace(0.0, joint.top, len(counts) + 1)
    dim = imgui.get_style_color_vec4(imgui.Col_.text_disabled)
    shade = implot.Spec(fill_color=dim, fill_alpha=0.5)
    heights = bars(counts, state.interface.logarithmic)
    implot.plot_shaded("voxels", (edges[:-1] + edges[1:]) / 2, heights, spec=shade)


def _line(factors: Sequence[tuple[float, float]], end: float, ui: UiContext) -> None:
    """The factors; before the first and beyond the last they stay."""
    at, heights = np.array(factors).T
    places = [0.0, *at.tolist(), max(end, float(at[-1]))]
    levels = [float(heights[0]), *heights.tolist(), float(heights[-1])]
    line: list[imgui.ImVec2Like] = [
        implot.plot_to_pixels(x, y) for x, y in zip(places, levels, strict=True)
    ]
    implot.push_plot_clip_rect(ui.px(1))
    implot.get_plot_draw_list().add_polyline(line, ink(), ui.px(1.4), 0)
    implot.pop_plot_clip_rect()
