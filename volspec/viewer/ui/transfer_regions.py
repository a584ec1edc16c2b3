"""Regions of value and gradient: rectangles over the volume's histogram of both."""

from __future__ import annotations

import math
from functools import lru_cache

import numpy as np
from imgui_bundle import imgui, implot
from numpy.typing import NDArray

from volspec.transfer import Region, TransferFunction2D
from volspec.viewer.model import presets, transfer_edits
from volspec.viewer.model.document import JointHistogram
from volspec.viewer.model.state import ViewState
from volspec.viewer.ui import transfer_detail, transfer_plot
from volspec.viewer.ui.context import UiContext
from volspec.viewer.ui.widgets import ACCENT, pack_colour, tip

Span = tuple[float, float]
# The width of edges and corners to either side, pixels at 96 dpi.
_GRIP = 6
# Regions reach beyond the volume's values, so that their soft sides do not cut them.
_MARGIN, _ABOVE = 0.14, 1.14


def draw(state: ViewState, ui: UiContext) -> ViewState:
    """Draw the plot, and the chosen region below."""
    # Above the plot: inside it would hide parts of it.
    imgui.text_disabled("gradient per mm, over value")
    new, height = state, transfer_detail.height_above(3, ui)
    if implot.begin_plot("##regions", (-1, height), transfer_plot.FLAGS):
        _heatmap(state, ui)
        new = _rectangles(state, ui)
        implot.end_plot()
    return _numbers(new, ui)


def _heatmap(state: ViewState, ui: UiContext) -> None:
    """Set up the plot's axes, and draw the joint histogram."""
    joint = state.document.joint
    implot.push_colormap(_greys(state.interface.dark))
    transfer_plot.set_values_axis(state, _MARGIN)
    ends = -0.02 * joint.top, _ABOVE * joint.top
    transfer_plot.set_axis(implot.ImAxis_.y1, *ends, implot.AxisFlags_.no_grid_lines)
    implot.setup_finish()
    transfer_plot.note_area(ui, "transfer")
    low, high = presets.value_span(state.document.volume)
    corners = implot.Point(low, 0.0), implot.Point(high, joint.top)
    cells = shades(joint, state.interface.logarithmic)
    implot.plot_heatmap("voxels", cells, 0.0, 1.0, "", *corners)
    implot.pop_colormap()


def _rectangles(state: ViewState, ui: UiContext) -> ViewState:
    transfer, top = state.transfer, state.document.joint.top
    assert isinstance(transfer, TransferFunction2D)
    new, held, chosen = state, False, transfer_detail.chosen_part(state)
    colours = transfer_plot.part_colours(state)
    draw_list = implot.get_plot_draw_list()
    implot.push_plot_clip_rect()
    for i, region in enumerate(transfer.regions):
        (x1, x2), (y1, y2) = region.values, _shown_gradients(region, top)
        box = implot.plot_to_pixels(x1, y2), implot.plot_to_pixels(x2, y1)
        (left, above), (right, below) = box
        ui.areas[f"region {i}"] = int(left), int(above), int(right - left), int(below - above)
        draw_list.add_rect_filled(*box, pack_colour(colours[i], 0.3))
        if i == chosen:
            ring = pack_colour(ACCENT[state.interface.dark])
            draw_list.add_rect(*box, ring, 0.0, ui.px(3), 0)
        moved, a, b, c, d, clicked, hovered, down = implot.drag_rect(
            i, x1, y1, x2, y2, (*colours[i], 1.0), implot.DragToolFlags_.no_fit, False, False, False
        )
        held = held or bool(hovered) or bool(down)
        if hovered and imgui.is_mouse_clicked(1):
            new = transfer_edits.remove_point(new, i)
        elif moved:
            new = _place_region(new, i, region, (a, c), (b, d))
        elif down and _is_inside(box, ui):
            # implot moves a whole rectangle only by its middle.
            across, up = _mouse_step()
            new = _place_region(new, i, region, (x1 + across, x2 + across), (y1 + up, y2 + up))
        if clicked or down:
            new = transfer_edits.choose_part(new, i)
    implot.pop_plot_clip_rect()
    return transfer_plot.add_on_double_click(new, transfer_edits.add_point, held)


def _is_inside(box: tuple[imgui.ImVec2, imgui.ImVec2], ui: UiContext) -> bool:
    """Return True if the mouse is in a rectangle, and on none of its edges and corners."""
    (left, above), (right, below) = box
    (x, y), grip = imgui.get_mouse_pos(), ui.px(_GRIP)
    return left + grip < x < right - grip and above + grip < y < below - grip


def _mouse_step() -> Span:
    """Return the mouse's movement since the last frame, in the plot's units."""
    (x, y), (across, down) = imgui.get_mouse_pos(), imgui.get_io().mouse_delta
    before, now = implot.pixels_to_plot(x - across, y - down), implot.pixels_to_plot(x, y)
    return now.x - before.x, now.y - before.y


def _place_region(
    state: ViewState, index: int, region: Region, values: Span, gradients: Span
) -> ViewState:
    """Move a region's sides; one without an upper end gets none if it is moved as a whole."""
    top = state.document.joint.top
    (bottom, end), shown = gradients, _shown_gradients(region, top)
    if values != tuple(region.values):
        state = transfer_edits.set_region_values(state, index, *values)
    if bottom != shown[0] and end != shown[1] and not math.isfinite(region.gradients[1]):
        end = top
    if (bottom, end) != shown:
        state = transfer_edits.set_region_gradients(state, index, bottom, end)
    return state


def _shown_gradients(region: Region, top: float) -> Span:
    """Return the gradients at which a region's lower and upper side are drawn."""
    bottom, end = region.gradients
    return bottom, end if math.isfinite(end) else max(top, bottom)


def _numbers(state: ViewState, ui: UiContext) -> ViewState:
    """Draw the chosen region's values and gradients, opacity and softness, and material."""
    transfer, top = state.transfer, state.document.joint.top
    assert isinstance(transfer, TransferFunction2D)
    index = transfer_detail.chosen_part(state)
    region = transfer.regions[index]
    low, high = presets.value_span(state.document.volume)
    new = state
    wide = imgui.get_content_region_avail().x / 2 - ui.px(5)
    imgui.set_next_item_width(wide)
    moved, *values = imgui.drag_float_range2(
        "##values", *region.values, (high - low) / 500, 0.0, 0.0, "≥ %.4g", "≤ %.4g"
    )
    ui.note("region values")
    tip("From value to value")
    if moved:
        new = transfer_edits.set_region_values(new, index, values[0], values[1])
    imgui.same_line()
    imgui.set_next_item_width(wide)
    bottom, end = _shown_gradients(region, top)
    most = "≤ %.4g" if math.isfinite(region.gradients[1]) else "any"
    moved, *gradients = imgui.drag_float_range2(
        "##gradients", bottom, end, top / 500, 0.0, top, "≥ %.4g", most
    )
    ui.note("region gradients")
    tip("From gradient to gradient, value per mm; at the axis' end and above: any")
    if moved:
        new = transfer_edits.set_region_gradients(new, index, gradients[0], gradients[1])
    wide = (imgui.get_content_region_avail().x - ui.px(36)) / 2
    new = transfer_detail.draw_opacity(new, ui, index, wide)
    imgui.same_line()
    imgui.set_next_item_width(wide)
    moved, softness = imgui.slider_float("##softness", region.softness, 0.0, 1.0, "softness %.2f")
    ui.note("softness")
    if moved:
        new = transfer_edits.set_softness(new, index, softness)
    imgui.same_line()
    new = transfer_detail.draw_remove(new, ui, index, "Remove the region")
    return transfer_detail.draw_material(new, ui, transfer_detail.chosen_part(new))


# By the histogram, as a cache of documents would keep volumes that were closed.
@lru_cache(maxsize=2)
def shades(joint: JointHistogram, logarithmic: bool) -> NDArray[np.float32]:
    """Return (64, 128) shades of the joint histogram, 0 to 1, steepest first."""
    shown = transfer_plot.bars(joint.counts[::-1], logarithmic, 0.99)
    return np.ascontiguousarray(shown, dtype=np.float32)


@lru_cache(maxsize=2)
def _greys(dark: bool) -> int:
    """Return a colour map from the plot's background to a grey of high contrast with it."""
    first, last = (0.10, 0.75) if dark else (0.895, 0.25)
    colours = [pack_colour((v, v, v)) for v in np.linspace(first, last, 16).tolist()]
    return int(implot.add_colormap(f"voxels {dark}", np.array(colours, np.uint32), False))
