"""Editors of transfer functions: curves and surfaces over values, regions over gradients too."""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import lru_cache

import numpy as np
from imgui_bundle import imgui, implot
from numpy.typing import NDArray

from volspec.transfer import Isosurfaces, Region, TransferFunction, TransferFunction2D, presets
from volspec.viewer.model import fields, transfer_edits
from volspec.viewer.model.document import JointHistogram
from volspec.viewer.model.state import ViewState
from volspec.viewer.model.transfer_parts import TransferPart, gradient_top, list_parts
from volspec.viewer.ui import transfer_detail, transfer_plot
from volspec.viewer.ui.context import UiContext, tip
from volspec.viewer.ui.transfer_plot import HandleEdits, PointHandle, ink, set_axis
from volspec.viewer.ui.widgets import ACCENT, pack_colour
from volspec.volume import value_form

# Margins beyond either end of the axes.
_MARGIN, _ABOVE = 0.02, 0.12
# Opacities of a step are small: the axis has a square-root scale.
_TICKS = (0.0, 0.01, 0.1, 0.3, 0.6, 1.0)
_STRIP_PX = 3.0
# The least height of the opacity plot, alone and above the gradient plot; the latter's height.
_MIN, _MIN_OF_TWO, _GRADIENTS_HEIGHT = 115, 82, 70
_GRADIENTS_TIP = (
    "Multiplies opacity by a factor over gradients, to emphasise boundaries.\n"
    "Drag the points; a double-click adds one, a right click removes it"
)
_FILTERED = "Not available for this curve, as it has material filters"
_EDITS = HandleEdits(
    move=lambda state, i, x, y: transfer_edits.move_point(state, i, x, _opacity_at(y)),
    add=lambda state, x, y: transfer_edits.add_point(state, x, _opacity_at(y)),
    remove=transfer_edits.remove_point,
    choose=transfer_edits.choose_part,
)
_GRADIENT_EDITS = HandleEdits(
    move=transfer_edits.move_gradient_point,
    add=transfer_edits.add_gradient_point,
    remove=transfer_edits.remove_gradient_point,
)


def draw_points(state: ViewState, ui: UiContext) -> ViewState:
    """Draw the plots, and the chosen point or surface below."""
    new, kind = state, "Surface" if isinstance(state.transfer, Isosurfaces) else "Point"
    curve = state.transfer if isinstance(state.transfer, TransferFunction) else None
    below, min_px = 0.0, _MIN
    if curve:
        below = imgui.get_frame_height_with_spacing()
        if curve.gradient_opacity:
            below += ui.px(_GRADIENTS_HEIGHT) + imgui.get_style().item_spacing.y
            min_px = _MIN_OF_TWO
    height = transfer_detail.height_above(2, ui, min_px, below)
    with transfer_plot.low_plot("##transfer", height, ui) as visible:
        if visible:
            new = _opacities(new, curve, ui)
    if curve:
        new = _gradients(new, curve, ui)
    new = transfer_detail.draw_value(new, ui, kind)
    return transfer_detail.draw_material(new, ui, transfer_detail.chosen_part(new))


def _opacities(state: ViewState, curve: TransferFunction | None, ui: UiContext) -> ViewState:
    transfer_plot.set_values_axis(state, _MARGIN)
    set_axis(implot.ImAxis_.y1, -0.04, 1.06, implot.AxisFlags_.no_tick_marks)
    labels = [f"{tick:g}".removeprefix("0") or "0" for tick in _TICKS]
    implot.setup_axis_ticks(implot.ImAxis_.y1, [_height_of(tick) for tick in _TICKS], labels)
    implot.setup_finish()
    transfer_plot.note_area(ui, "transfer")
    span = presets.value_span(fields.data(state).volume)
    logarithmic = state.interface.logarithmic
    transfer_plot.draw_histogram(fields.data(state).histogram, *span, logarithmic)
    implot.push_plot_clip_rect()
    if curve:
        _fill(state, curve, ui)
    else:
        _stems(state, ui)
    implot.pop_plot_clip_rect()
    parts, colours = list_parts(state.transfer), transfer_plot.part_colours(state)
    form = value_form(fields.data(state).volume)
    handles = [
        PointHandle(_place(part), _words(part, form), colour)
        for part, colour in zip(parts, colours, strict=True)
    ]
    index = transfer_detail.chosen_part(state)
    return transfer_plot.draw_handles(state, ui, handles, _EDITS, index)


def _fill(state: ViewState, curve: TransferFunction, ui: UiContext) -> None:
    """Draw a curve, and fill the area below it with the colours of its materials."""
    draw_list = implot.get_plot_draw_list()
    left, width = implot.get_plot_pos().x, implot.get_plot_size().x
    places = np.array([implot.plot_to_pixels(value, 0.0).x for value, _, _ in curve.points])
    # Vertical stripes: the curve between points is straight in opacity, not on this axis.
    strip = ui.px(_STRIP_PX)
    xs = np.concatenate([np.arange(left, left + width + strip, strip), places])
    # At whole pixels, or stripes would blend where they meet.
    xs = np.unique(xs.clip(left, left + width).round())
    opacity = np.interp(xs, places, [opacity for _, opacity, _ in curve.points])
    codes = np.array(transfer_plot.part_colours(state))
    mixed = np.stack([np.interp(xs, places, column) for column in codes.T], axis=1)
    zero, one = (implot.plot_to_pixels(0.0, height).y for height in (0.0, 1.0))
    tops = zero + (one - zero) * np.sqrt(opacity)
    for i in range(len(xs) - 1):
        if max(opacity[i], opacity[i + 1]) <= 0:
            continue
        ends = (xs[i], (tops[i] + tops[i + 1]) / 2), (xs[i + 1], zero)
        draw_list.add_rect_filled(*ends, pack_colour((mixed[i] + mixed[i + 1]) / 2, 0.7))
    line: list[imgui.ImVec2Like] = [(float(x), float(y)) for x, y in zip(xs, tops, strict=True)]
    draw_list.add_polyline(line, ink(), ui.px(1.4), 0)


def _stems(state: ViewState, ui: UiContext) -> None:
    """Draw a vertical line for each surface, as high as its opacity."""
    draw_list = implot.get_plot_draw_list()
    colours = transfer_plot.part_colours(state)
    for part, colour in zip(list_parts(state.transfer), colours, strict=True):
        foot = implot.plot_to_pixels(part.values[0], 0.0)
        head = implot.plot_to_pixels(*_place(part))
        draw_list.add_line(foot, head, ink(), ui.px(5))
        draw_list.add_line(foot, head, pack_colour(colour), ui.px(3))


def _words(part: TransferPart, form: str) -> str:
    value, mix = form % part.values[0], transfer_detail.mix_text(part.mix)
    return f"value {value}\nopacity {part.opacity:.3g}\n{mix}"


def _place(part: TransferPart) -> tuple[float, float]:
    return part.values[0], _height_of(part.opacity)


def _height_of(opacity: float) -> float:
    """Return the place of an opacity on its axis, 0 to 1.

    >>> _height_of(0.25)
    0.5
    """
    return math.sqrt(min(max(opacity, 0.0), 1.0))


def _opacity_at(height: float) -> float:
    return max(height, 0.0) ** 2


def _gradients(state: ViewState, curve: TransferFunction, ui: UiContext) -> ViewState:
    """Draw the checkbox of opacity by gradient, and its plot while it is on."""
    new, on = state, bool(curve.gradient_opacity)
    imgui.begin_disabled(bool(curve.filters))
    pressed, _ = imgui.checkbox("Opacity by gradient", on)
    imgui.end_disabled()
    ui.note("by gradient", _FILTERED if curve.filters else _GRADIENTS_TIP, greyed=True)
    if pressed:
        new = transfer_edits.toggle_gradient_opacity(new)
    if not on:
        return new
    imgui.same_line()
    imgui.text_disabled("factor over value per mm")
    with transfer_plot.low_plot("##gradients", ui.px(_GRADIENTS_HEIGHT), ui) as visible:
        if visible:
            new = _factors(new, curve, ui)
    return new


def _factors(state: ViewState, curve: TransferFunction, ui: UiContext) -> ViewState:
    joint, factors = fields.data(state).joint, curve.gradient_opacity or ()
    end = gradient_top(curve, joint.top)
    # While the mouse is down, an axis that follows the last point would run away from it.
    when = imgui.Cond_.once if imgui.is_mouse_down(0) else imgui.Cond_.always
    ends = -_MARGIN * end, (1 + _MARGIN) * end
    set_axis(implot.ImAxis_.x1, *ends, implot.AxisFlags_.no_grid_lines, when)
    set_axis(implot.ImAxis_.y1, -_ABOVE, 1 + _ABOVE, implot.AxisFlags_.no_tick_marks)
    implot.setup_axis_ticks(implot.ImAxis_.y1, [0.0, 1.0], ["0", "1"])
    implot.setup_finish()
    transfer_plot.note_area(ui, "gradients")
    counts, logarithmic = joint.counts.sum(axis=1), state.interface.logarithmic
    transfer_plot.draw_histogram(counts, 0.0, joint.top, logarithmic)
    _draw_line(factors, end, ui)
    handles = []
    for i, (gradient, factor) in enumerate(factors):
        x, y = implot.plot_to_pixels(gradient, factor)
        ui.areas[f"gradient {i}"] = int(x), int(y), 0, 0
        words = f"gradient {gradient:.4g} per mm\nopacity × {factor:.3g}"
        handles.append(PointHandle((gradient, factor), words))
    return transfer_plot.draw_handles(state, ui, handles, _GRADIENT_EDITS)


def _draw_line(factors: Sequence[tuple[float, float]], end: float, ui: UiContext) -> None:
    """Draw the factors, which are constant before the first and beyond the last."""
    first, last = factors[0], factors[-1]
    points = [(0.0, first[1]), *factors, (max(end, last[0]), last[1])]
    line: list[imgui.ImVec2Like] = [implot.plot_to_pixels(x, y) for x, y in points]
    implot.push_plot_clip_rect(ui.px(1))
    implot.get_plot_draw_list().add_polyline(line, ink(), ui.px(1.4), 0)
    implot.pop_plot_clip_rect()


Span = tuple[float, float]
# Edges and corners can be gripped this far to either side; pixels at 96 dpi.
_GRIP = 6
# Regions may extend beyond the volume's values, so that soft sides do not fade the outer ones.
_REGION_MARGIN, _REGION_ABOVE = 0.14, 1.14


def draw_regions(state: ViewState, ui: UiContext) -> ViewState:
    """Draw the plot, and the chosen region below."""
    # Above the plot: inside, the text would hide parts of the plot.
    imgui.text_disabled("gradient per mm, over value")
    new, height = state, transfer_detail.height_above(3, ui)
    if implot.begin_plot("##regions", (-1, height), transfer_plot.FLAGS):
        _heatmap(state, ui)
        new = _rectangles(state, ui)
        implot.end_plot()
    return _numbers(new, ui)


def _heatmap(state: ViewState, ui: UiContext) -> None:
    """Set up the plot's axes, and draw the joint histogram."""
    joint = fields.data(state).joint
    implot.push_colormap(_greys(state.interface.dark))
    transfer_plot.set_values_axis(state, _REGION_MARGIN)
    ends = -0.02 * joint.top, _REGION_ABOVE * joint.top
    transfer_plot.set_axis(implot.ImAxis_.y1, *ends, implot.AxisFlags_.no_grid_lines)
    implot.setup_finish()
    transfer_plot.note_area(ui, "transfer")
    low, high = presets.value_span(fields.data(state).volume)
    corners = implot.Point(low, 0.0), implot.Point(high, joint.top)
    cells = shades(joint, state.interface.logarithmic)
    implot.plot_heatmap("voxels", cells, 0.0, 1.0, "", *corners)
    implot.pop_colormap()


def _rectangles(state: ViewState, ui: UiContext) -> ViewState:
    transfer, top = state.transfer, fields.data(state).joint.top
    assert isinstance(transfer, TransferFunction2D)
    new, on_handle, index = state, False, transfer_detail.chosen_part(state)
    colours = transfer_plot.part_colours(state)
    draw_list = implot.get_plot_draw_list()
    implot.push_plot_clip_rect()
    for i, region in enumerate(transfer.regions):
        (x1, x2), (y1, y2) = region.values, _shown_gradients(region, top)
        box = implot.plot_to_pixels(x1, y2), implot.plot_to_pixels(x2, y1)
        (left, above), (right, below) = box
        ui.areas[f"region {i}"] = int(left), int(above), int(right - left), int(below - above)
        draw_list.add_rect_filled(*box, pack_colour(colours[i], 0.3))
        if i == index:
            ring = pack_colour(ACCENT[state.interface.dark])
            draw_list.add_rect(*box, ring, 0.0, ui.px(3), 0)
        changed, a, b, c, d, clicked, hovered, down = implot.drag_rect(
            i, x1, y1, x2, y2, (*colours[i], 1.0), implot.DragToolFlags_.no_fit, False, False, False
        )
        on_handle = on_handle or bool(hovered) or bool(down)
        if hovered and imgui.is_mouse_clicked(1):
            new = transfer_edits.remove_point(new, i)
        elif changed:
            new = _place_region(new, i, region, (a, c), (b, d))
        elif down and _is_inside(box, ui):
            # implot moves a whole rectangle only by its middle.
            across, up = _mouse_step()
            new = _place_region(new, i, region, (x1 + across, x2 + across), (y1 + up, y2 + up))
        if clicked or down:
            new = transfer_edits.choose_part(new, i)
    implot.pop_plot_clip_rect()
    return transfer_plot.add_on_double_click(new, transfer_edits.add_point, on_handle)


def _is_inside(box: tuple[imgui.ImVec2, imgui.ImVec2], ui: UiContext) -> bool:
    """Return True if the mouse is inside a rectangle, but not on its edges or corners."""
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
    """Move a region's sides; one without an upper end stays open if it is moved as a whole."""
    top = fields.data(state).joint.top
    (bottom, end), before = gradients, _shown_gradients(region, top)
    if values != tuple(region.values):
        state = transfer_edits.set_region_values(state, index, *values)
    if bottom != before[0] and end != before[1] and not math.isfinite(region.gradients[1]):
        end = top
    if (bottom, end) != before:
        state = transfer_edits.set_region_gradients(state, index, bottom, end)
    return state


def _shown_gradients(region: Region, top: float) -> Span:
    """Return the gradients at which a region's lower and upper side are drawn."""
    bottom, end = region.gradients
    return bottom, end if math.isfinite(end) else max(top, bottom)


def _numbers(state: ViewState, ui: UiContext) -> ViewState:
    """Draw the chosen region's values and gradients, opacity and softness, and material."""
    transfer, top = state.transfer, fields.data(state).joint.top
    assert isinstance(transfer, TransferFunction2D)
    index = transfer_detail.chosen_part(state)
    region = transfer.regions[index]
    low, high = presets.value_span(fields.data(state).volume)
    new, form = state, value_form(fields.data(state).volume)
    width = imgui.get_content_region_avail().x / 2 - ui.px(5)
    imgui.set_next_item_width(width)
    changed, *values = imgui.drag_float_range2(
        "##values", *region.values, (high - low) / 500, 0.0, 0.0, f"≥ {form}", f"≤ {form}"
    )
    ui.note("region values", "Range of values")
    if changed:
        new = transfer_edits.set_region_values(new, index, values[0], values[1])
    imgui.same_line()
    imgui.set_next_item_width(width)
    bottom, end = _shown_gradients(region, top)
    high_form = "≤ %.4g" if math.isfinite(region.gradients[1]) else "any"
    changed, *gradients = imgui.drag_float_range2(
        "##gradients", bottom, end, top / 500, 0.0, top, "≥ %.4g", high_form
    )
    ui.note("region gradients")
    tip("Range of gradients, value per mm; an upper end at the end of the axis means any")
    if changed:
        new = transfer_edits.set_region_gradients(new, index, gradients[0], gradients[1])
    width = (imgui.get_content_region_avail().x - ui.px(36)) / 2
    new = transfer_detail.draw_opacity(new, ui, index, width)
    imgui.same_line()
    imgui.set_next_item_width(width)
    changed, softness = imgui.slider_float("##softness", region.softness, 0.0, 1.0, "softness %.2f")
    ui.note("softness")
    if changed:
        new = transfer_edits.set_softness(new, index, softness)
    imgui.same_line()
    new = transfer_detail.draw_remove(new, ui, index, "Remove the region")
    return transfer_detail.draw_material(new, ui, transfer_detail.chosen_part(new))


# Keyed by the histogram, as a cache of documents would keep closed volumes alive.
@lru_cache(maxsize=2)
def shades(joint: JointHistogram, logarithmic: bool) -> NDArray[np.float32]:
    """Return (64, 128) shades of the joint histogram, 0 to 1, steepest first."""
    heights = transfer_plot.bars(joint.counts[::-1], logarithmic, 0.99)
    return np.ascontiguousarray(heights, dtype=np.float32)


@lru_cache(maxsize=2)
def _greys(dark: bool) -> int:
    """Return a colour map from the plot's background to a grey of high contrast with it."""
    first, last = (0.10, 0.75) if dark else (0.895, 0.25)
    colours = [pack_colour((v, v, v)) for v in np.linspace(first, last, 16).tolist()]
    return int(implot.add_colormap(f"voxels {dark}", np.array(colours, np.uint32), False))
