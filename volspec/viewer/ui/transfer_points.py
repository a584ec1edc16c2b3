"""Curves and surfaces: their plot, and the factors of a curve over gradients."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from imgui_bundle import imgui, implot

from volspec.transfer import Isosurfaces, TransferFunction
from volspec.viewer.model import transfer_edits
from volspec.viewer.model.state import ViewState
from volspec.viewer.model.transfer_parts import Part, parts_of
from volspec.viewer.model.transfer_placing import gradient_top
from volspec.viewer.ui import transfer_detail
from volspec.viewer.ui.context import UiContext
from volspec.viewer.ui.transfer_plot import (
    Handle,
    bars,
    draw_handles,
    height_of,
    ink,
    low_plot,
    note_area,
    opacity_at,
    opacity_plot,
    part_colours,
)
from volspec.viewer.ui.widgets import WAITING_GREYED, pack_colour, tip

_HEIGHT = 70
# Beyond either end of the axes.
_MARGIN, _ABOVE = 0.02, 0.12
_TIP = (
    "Multiplies opacity by how steeply values change, so that boundaries stand out.\n"
    "Drag the points; a double-click adds one, a right click removes it"
)
_FILTERED = "Not together with filters of materials, which this curve has"


def gradients_height(curve: TransferFunction, ui: UiContext) -> float:
    """Of all that is drawn here, with the gap below it."""
    gap = imgui.get_style().item_spacing.y
    plot = ui.px(_HEIGHT) + gap if curve.gradient_opacity else 0.0
    return plot + imgui.get_frame_height_with_spacing()


def draw_gradients(state: ViewState, curve: TransferFunction, ui: UiContext) -> ViewState:
    """Draw what turns it on and off, and the plot while it is on."""
    new, on = state, bool(curve.gradient_opacity)
    imgui.begin_disabled(bool(curve.filters))
    pressed, _ = imgui.checkbox("Opacity by gradient", on)
    imgui.end_disabled()
    ui.note("by gradient")
    tip(_FILTERED if curve.filters else _TIP, WAITING_GREYED)
    if pressed:
        new = transfer_edits.toggle_gradient_opacity(new)
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
    end = gradient_top(curve, joint.top)
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
    for touch in draw_handles(handles, -1, ui, state.interface.dark):
        match touch.what:
            case "move":
                new = transfer_edits.move_gradient_point(new, touch.index, touch.x, touch.y)
            case "add":
                new = transfer_edits.add_gradient_point(new, touch.x, touch.y)
            case "remove":
                new = transfer_edits.remove_gradient_point(new, touch.index)
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


_STRIP_PX = 3.0
# The plot's height, alone and with another one below.
_LEAST, _LEAST_OF_TWO = 115, 82


def draw(state: ViewState, ui: UiContext) -> ViewState:
    """Draw the plot, and the chosen point or surface below."""
    new, what = state, "Surface" if isinstance(state.transfer, Isosurfaces) else "Point"
    curve = state.transfer if isinstance(state.transfer, TransferFunction) else None
    below = gradients_height(curve, ui) if curve else 0.0
    least = _LEAST_OF_TWO if curve and curve.gradient_opacity else _LEAST
    with opacity_plot(state, ui, transfer_detail.height_above(2, ui, least, below)) as shown:
        if shown:
            implot.push_plot_clip_rect()
            if curve:
                _fill(state, curve, ui)
            else:
                _stems(state, ui)
            implot.pop_plot_clip_rect()
            new = _handles(state, ui)
    if curve:
        new = draw_gradients(new, curve, ui)
    new = transfer_detail.value_and_opacity(new, ui, what)
    return transfer_detail.material(new, ui, transfer_detail.chosen(new))


def _fill(state: ViewState, curve: TransferFunction, ui: UiContext) -> None:
    """What is below the curve, in the colours of what is seen there; the curve itself."""
    draw_list = implot.get_plot_draw_list()
    left, width = implot.get_plot_pos().x, implot.get_plot_size().x
    places = np.array([implot.plot_to_pixels(value, 0.0).x for value, _, _ in curve.points])
    # Upright stripes: the curve between points is straight in opacity, not on this axis.
    strip = ui.px(_STRIP_PX)
    at = np.concatenate([np.arange(left, left + width + strip, strip), places])
    # At whole pixels, or stripes would blend where they meet.
    at = np.unique(at.clip(left, left + width).round())
    opacity = np.interp(at, places, [opacity for _, opacity, _ in curve.points])
    codes = np.array(part_colours(state))
    mixed = np.stack([np.interp(at, places, column) for column in codes.T], axis=1)
    zero, one = (implot.plot_to_pixels(0.0, height).y for height in (0.0, 1.0))
    tops = zero + (one - zero) * np.sqrt(opacity)
    for i in range(len(at) - 1):
        if max(opacity[i], opacity[i + 1]) <= 0:
            continue
        ends = (at[i], (tops[i] + tops[i + 1]) / 2), (at[i + 1], zero)
        draw_list.add_rect_filled(*ends, pack_colour((mixed[i] + mixed[i + 1]) / 2, 0.7))
    line: list[imgui.ImVec2Like] = [(float(x), float(y)) for x, y in zip(at, tops, strict=True)]
    draw_list.add_polyline(line, ink(), ui.px(1.4), 0)


def _stems(state: ViewState, ui: UiContext) -> None:
    """An upright line for each surface, as high as it is opaque."""
    draw_list = implot.get_plot_draw_list()
    for part, colour in zip(parts_of(state.transfer), part_colours(state), strict=True):
        foot = implot.plot_to_pixels(part.values[0], 0.0)
        head = implot.plot_to_pixels(*_place(part))
        draw_list.add_line(foot, head, ink(), ui.px(5))
        draw_list.add_line(foot, head, pack_colour(colour), ui.px(3))


def _handles(state: ViewState, ui: UiContext) -> ViewState:
    """What is dragged, clicked away, or added where there is none."""
    new, parts = state, parts_of(state.transfer)
    handles = [
        Handle(_place(part), _words(part), colour)
        for part, colour in zip(parts, part_colours(state), strict=True)
    ]
    for touch in draw_handles(handles, transfer_detail.chosen(state), ui, state.interface.dark):
        match touch.what:
            case "move":
                place = touch.x, opacity_at(touch.y)
                new = transfer_edits.move_point(new, touch.index, *place)
            case "add":
                new = transfer_edits.add_point(new, touch.x, opacity_at(touch.y))
            case "remove":
                new = transfer_edits.remove_point(new, touch.index)
            case _:
                new = transfer_edits.choose_part(new, touch.index)
    return new


def _words(part: Part) -> str:
    value, mix = part.values[0], transfer_detail.in_words(part.mix)
    return f"value {value:.5g}\nopacity {part.opacity:.3g}\n{mix}"


def _place(part: Part) -> tuple[float, float]:
    return part.values[0], height_of(part.opacity)
