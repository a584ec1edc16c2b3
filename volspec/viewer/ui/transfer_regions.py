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
from volspec.viewer.ui import transfer_detail
from volspec.viewer.ui.context import UiContext
from volspec.viewer.ui.transfer_plot import FLAGS, bars, note_area, part_colours, set_values_axis
from volspec.viewer.ui.widgets import ACCENT, pack_colour, tip

# Of edges and corners, to either side.
_GRIP = 6
# Regions reach beyond the volume's values, so that their soft sides do not cut them.
_MARGIN, _ABOVE = 0.14, 1.14


def draw(state: ViewState, ui: UiContext) -> ViewState:
    """Draw the plot, and the chosen region below."""
    # Above the plot: inside it would lie across what is drawn there.
    imgui.text_disabled("gradient per mm, over value")
    new = _plot(state, ui, transfer_detail.height_above(3, ui))
    return _numbers(new, ui)


def _plot(state: ViewState, ui: UiContext, height: float) -> ViewState:
    if not implot.begin_plot("##regions", (-1, height), FLAGS):
        return state
    joint = state.document.joint
    implot.push_colormap(_greys(state.interface.dark))
    set_values_axis(state, _MARGIN)
    implot.setup_axis(implot.ImAxis_.y1, "", implot.AxisFlags_.no_grid_lines)
    implot.setup_axis_limits(
        implot.ImAxis_.y1, -0.02 * joint.top, _ABOVE * joint.top, imgui.Cond_.always
    )
    implot.setup_finish()
    note_area(ui, "transfer")
    low, high = presets.value_span(state.document.volume)
    implot.plot_heatmap(
        *("voxels", shades(joint, state.interface.logarithmic), 0.0, 1.0, ""),
        implot.Point(low, 0.0),
        implot.Point(high, joint.top),
    )
    implot.pop_colormap()
    new = _rectangles(state, ui)
    implot.end_plot()
    return new


def _rectangles(state: ViewState, ui: UiContext) -> ViewState:
    transfer, top = state.transfer, state.document.joint.top
    assert isinstance(transfer, TransferFunction2D)
    new, held, chosen = state, False, transfer_detail.chosen(state)
    colours = part_colours(state)
    draw_list = implot.get_plot_draw_list()
    implot.push_plot_clip_rect()
    for i, region in enumerate(transfer.regions):
        (x1, x2), (y1, y2) = region.values, shown_gradients(region, top)
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
            new = _placed(new, i, region, (a, c), (b, d))
        elif down and _well_inside(box, ui):
            # implot takes hold of the whole rectangle, and moves it by its middle only.
            across, up = _step()
            new = _placed(new, i, region, (x1 + across, x2 + across), (y1 + up, y2 + up))
        if clicked or down:
            new = transfer_edits.choose_part(new, i)
    implot.pop_plot_clip_rect()
    if implot.is_plot_hovered() and not held and imgui.is_mouse_double_clicked(0):
        mouse = implot.get_plot_mouse_pos()
        new = transfer_edits.add_point(new, mouse.x, mouse.y)
    return new


def _well_inside(box: tuple[imgui.ImVec2, imgui.ImVec2], ui: UiContext) -> bool:
    """Whether the mouse is further in than edges and corners reach."""
    (left, above), (right, below) = box
    (x, y), grip = imgui.get_mouse_pos(), ui.px(_GRIP)
    return left + grip < x < right - grip and above + grip < y < below - grip


def _step() -> tuple[float, float]:
    """By how much the mouse has moved since the last frame, in the plot's units."""
    (x, y), (across, down) = imgui.get_mouse_pos(), imgui.get_io().mouse_delta
    before, now = implot.pixels_to_plot(x - across, y - down), implot.pixels_to_plot(x, y)
    return now.x - before.x, now.y - before.y


def _placed(
    state: ViewState,
    index: int,
    region: Region,
    values: tuple[float, float],
    gradients: tuple[float, float],
) -> ViewState:
    """A region with its sides elsewhere; one without end that is moved as a whole has none."""
    top = state.document.joint.top
    (bottom, end), shown = gradients, shown_gradients(region, top)
    if values != tuple(region.values):
        state = transfer_edits.set_region_values(state, index, *values)
    if bottom != shown[0] and end != shown[1] and not math.isfinite(region.gradients[1]):
        end = top
    if (bottom, end) != shown:
        state = transfer_edits.set_region_gradients(state, index, bottom, end)
    return state


def shown_gradients(region: Region, top: float) -> tuple[float, float]:
    """Where a region's lower and upper side are drawn."""
    bottom, end = region.gradients
    return bottom, end if math.isfinite(end) else max(top, bottom)


def _numbers(state: ViewState, ui: UiContext) -> ViewState:
    """The chosen region: values and gradients, opacity and softness, material."""
    transfer, top = state.transfer, state.document.joint.top
    assert isinstance(transfer, TransferFunction2D)
    index = transfer_detail.chosen(state)
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
    bottom, end = shown_gradients(region, top)
    most = "≤ %.4g" if math.isfinite(region.gradients[1]) else "any"
    moved, *gradients = imgui.drag_float_range2(
        "##gradients", bottom, end, top / 500, 0.0, top, "≥ %.4g", most
    )
    ui.note("region gradients")
    tip("From gradient to gradient, value per mm; at the axis' end and above: any")
    if moved:
        new = transfer_edits.set_region_gradients(new, index, gradients[0], gradients[1])
    wide = (imgui.get_content_region_avail().x - ui.px(36)) / 2
    new = transfer_detail.opacity(new, ui, index, wide)
    imgui.same_line()
    imgui.set_next_item_width(wide)
    moved, softness = imgui.slider_float("##softness", region.softness, 0.0, 1.0, "softness %.2f")
    ui.note("softness")
    if moved:
        new = transfer_edits.set_softness(new, index, softness)
    imgui.same_line()
    new = transfer_detail.remove(new, ui, index, "Remove the region")
    return transfer_detail.material(new, ui, transfer_detail.chosen(new))


# By the histogram, as a cache of documents would keep volumes that were closed.
@lru_cache(maxsize=2)
def shades(joint: JointHistogram, logarithmic: bool) -> NDArray[np.float32]:
    """(64, 128) 0 to 1, steepest first: how many voxels."""
    shown = bars(joint.counts[::-1], logarithmic, 0.99)
    return np.ascontiguousarray(shown, dtype=np.float32)


@lru_cache(maxsize=2)
def _greys(dark: bool) -> int:
    """A colour map from the plot's ground to a grey that stands out from it."""
    first, last = (0.10, 0.75) if dark else (0.895, 0.25)
    colours = [pack_colour((v, v, v)) for v in np.linspace(first, last, 16).tolist()]
    return int(implot.add_colormap(f"voxels {dark}", np.array(colours, np.uint32), False))
