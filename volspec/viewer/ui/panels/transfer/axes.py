"""What the plots of all kinds share: axes with their ticks, the histogram behind."""

from __future__ import annotations

import math
from collections.abc import Iterator
from contextlib import contextmanager

import numpy as np
from imgui_bundle import imgui, implot
from numpy.typing import NDArray

from volspec.viewer.model.state import ViewState
from volspec.viewer.model.transfer import presets
from volspec.viewer.ui.context import UiContext

# Opacities of a step are small: their root shows them apart, and its axis says so.
_TICKS = (0.0, 0.01, 0.1, 0.3, 0.6, 1.0)
FLAGS = implot.Flags_.canvas_only
_MARGIN = 0.02
# Left and right of a plot, above and below it.
_PADDING = 10, 4


def height_of(opacity: float) -> float:
    """Where an opacity stands on its axis, 0 to 1.

    >>> height_of(0.25)
    0.5
    """
    return math.sqrt(min(max(opacity, 0.0), 1.0))


def opacity_at(height: float) -> float:
    """`height_of` undone."""
    return max(height, 0.0) ** 2


def bars(
    counts: NDArray[np.float64], logarithmic: bool, share: float = 0.98
) -> NDArray[np.float64]:
    """Heights 0 to 1 of a histogram.

    Linear ones are cut above what this share of them reaches, as air would dwarf the rest.
    """
    if logarithmic:
        heights = np.log1p(counts)
        return np.asarray(heights / max(float(heights.max()), 1e-12))
    top = float(np.quantile(counts, share))
    return np.asarray(np.minimum(counts / max(top, 1.0), 1.0))


@contextmanager
def opacity_plot(state: ViewState, ui: UiContext, height: float) -> Iterator[bool]:
    """A plot of opacity over value, with the histogram; whether anything is to be drawn."""
    with low_plot("##transfer", height, ui) as shown:
        if shown:
            _set_axes(state)
            note_area(ui, "transfer")
            _histogram(state)
        yield shown


@contextmanager
def low_plot(label: str, height: float, ui: UiContext) -> Iterator[bool]:
    """A plot with less around it, as its panel has little room; whether it is to be drawn."""
    implot.push_style_var(implot.StyleVar_.plot_padding, (ui.px(_PADDING[0]), ui.px(_PADDING[1])))
    shown = bool(implot.begin_plot(label, (-1, height), FLAGS))
    yield shown
    if shown:
        implot.end_plot()
    implot.pop_style_var()


def _set_axes(state: ViewState) -> None:
    set_values_axis(state, _MARGIN)
    implot.setup_axis(implot.ImAxis_.y1, "", implot.AxisFlags_.no_tick_marks)
    implot.setup_axis_limits(implot.ImAxis_.y1, -0.04, 1.06, imgui.Cond_.always)
    labels = [f"{tick:g}".removeprefix("0") or "0" for tick in _TICKS]
    implot.setup_axis_ticks(implot.ImAxis_.y1, [height_of(tick) for tick in _TICKS], labels)
    implot.setup_finish()


def set_values_axis(state: ViewState, margin: float) -> None:
    """The axis of values, a little wider than the volume's."""
    low, high = presets.span(state.document.volume)
    room = margin * (high - low)
    flags = implot.AxisFlags_.no_grid_lines
    implot.setup_axis(implot.ImAxis_.x1, "", flags)
    implot.setup_axis_limits(implot.ImAxis_.x1, low - room, high + room, imgui.Cond_.always)
    unit = " HU" if presets.in_hounsfield(state.document.volume) else ""
    implot.setup_axis_format(implot.ImAxis_.x1, f"%g{unit}")


def note_area(ui: UiContext, name: str) -> None:
    """Note down where the plot is."""
    (x, y), (width, height) = implot.get_plot_pos(), implot.get_plot_size()
    ui.areas[name] = int(x), int(y), int(width), int(height)


def _histogram(state: ViewState) -> None:
    low, high = presets.span(state.document.volume)
    counts = state.document.histogram
    edges = np.linspace(low, high, len(counts) + 1)
    middles = (edges[:-1] + edges[1:]) / 2
    dim = imgui.get_style_color_vec4(imgui.Col_.text_disabled)
    shade = implot.Spec(fill_color=dim, fill_alpha=0.5)
    implot.plot_shaded("voxels", middles, bars(counts, state.interface.logarithmic), spec=shade)
