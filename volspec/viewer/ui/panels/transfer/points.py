"""Opacity over value: points of a curve, or surfaces, dragged over the histogram."""

from __future__ import annotations

import numpy as np
from imgui_bundle import imgui, implot

from volspec.transfer import Isosurfaces, TransferFunction
from volspec.viewer.model.events import Event, reduced
from volspec.viewer.model.state import ViewState
from volspec.viewer.model.transfer.parts import Part, parts_of
from volspec.viewer.ui.context import UiContext
from volspec.viewer.ui.panels.transfer import detail, gradients
from volspec.viewer.ui.panels.transfer.axes import height_of, opacity_at, opacity_plot
from volspec.viewer.ui.panels.transfer.colours import part_colours
from volspec.viewer.ui.panels.transfer.handles import Handle, ink, touched
from volspec.viewer.ui.panels.widgets import packed

_STRIP_PX = 3.0
# The plot's height, alone and with another one below.
_LEAST, _LEAST_OF_TWO = 115, 82
_EVENTS = {
    "move": "point",
    "remove": "remove-point",
    "choose": "choose-point",
    "add": "add-point",
}


def draw(state: ViewState, ui: UiContext) -> ViewState:
    """Draw the plot, and the chosen point or surface below."""
    new, what = state, "Surface" if isinstance(state.transfer, Isosurfaces) else "Point"
    curve = state.transfer if isinstance(state.transfer, TransferFunction) else None
    below = gradients.height(curve, ui) if curve else 0.0
    least = _LEAST_OF_TWO if curve and curve.gradient_opacity else _LEAST
    with opacity_plot(state, ui, detail.height_above(2, ui, least, below)) as shown:
        if shown:
            implot.push_plot_clip_rect()
            if curve:
                _fill(state, curve, ui)
            else:
                _stems(state, ui)
            implot.pop_plot_clip_rect()
            new = _handles(state, ui)
    if curve:
        new = gradients.draw(new, curve, ui)
    new = detail.value_and_opacity(new, ui, what)
    return detail.material(new, ui, detail.chosen(new))


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
        draw_list.add_rect_filled(*ends, packed((mixed[i] + mixed[i + 1]) / 2, 0.7))
    line: list[imgui.ImVec2Like] = [(float(x), float(y)) for x, y in zip(at, tops, strict=True)]
    draw_list.add_polyline(line, ink(), ui.px(1.4), 0)


def _stems(state: ViewState, ui: UiContext) -> None:
    """An upright line for each surface, as high as it is opaque."""
    draw_list = implot.get_plot_draw_list()
    for part, colour in zip(parts_of(state.transfer), part_colours(state), strict=True):
        foot = implot.plot_to_pixels(part.values[0], 0.0)
        head = implot.plot_to_pixels(*_place(part))
        draw_list.add_line(foot, head, ink(), ui.px(5))
        draw_list.add_line(foot, head, packed(colour), ui.px(3))


def _handles(state: ViewState, ui: UiContext) -> ViewState:
    """What is dragged, clicked away, or added where there is none."""
    new, parts = state, parts_of(state.transfer)
    handles = [
        Handle(_place(part), _words(part), colour)
        for part, colour in zip(parts, part_colours(state), strict=True)
    ]
    for touch in touched(handles, detail.chosen(state), ui, state.interface.dark):
        event = Event(_EVENTS[touch.what], touch.x, opacity_at(touch.y), touch.index)
        new = reduced(new, event)
    return new


def _words(part: Part) -> str:
    value, mix = part.values[0], detail.in_words(part.mix)
    return f"value {value:.5g}\nopacity {part.opacity:.3g}\n{mix}"


def _place(part: Part) -> tuple[float, float]:
    return part.values[0], height_of(part.opacity)
