"""Plots of a transfer function: axes, handles, colours of its parts, swatches."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from functools import lru_cache
from typing import Literal

import numpy as np
from imgui_bundle import imgui, implot
from numpy.typing import NDArray

from volspec.appearance.srgb import encode, linear_from_XYZ
from volspec.relight import RelightSpec
from volspec.spectra import SpectralGrid, Spectrum, XYZ_of, white_XYZ
from volspec.transfer import Transfer
from volspec.transfer.mixes import share_matrix
from volspec.viewer.model import presets
from volspec.viewer.model.light_rows import Rows, rig_of
from volspec.viewer.model.state import ViewState
from volspec.viewer.model.transfer_parts import parts_of
from volspec.viewer.ui.context import UiContext
from volspec.viewer.ui.light_look import Colour, adapted_to, as_colour
from volspec.viewer.ui.widgets import ACCENT, pack_colour, tip


def swatch(ui: UiContext, colour: Colour) -> None:
    """A colour, as high as a line."""
    x, y = imgui.get_cursor_screen_pos()
    side = imgui.get_frame_height()
    imgui.dummy((side, side))
    inset = ui.px(3)
    draw_list, rounding = imgui.get_window_draw_list(), ui.px(3)
    ends = (x + inset, y + inset), (x + side - inset, y + side - inset)
    draw_list.add_rect_filled(*ends, pack_colour(colour), rounding)
    draw_list.add_rect(*ends, imgui.get_color_u32(imgui.Col_.text_disabled, 0.7), rounding)
    tip("Under the lights that are on, to an eye adapted to them")


Array = NDArray[np.float64]


def part_colours(state: ViewState) -> tuple[Colour, ...]:
    """Of every part's mix; sRGB codes, 0 to 1."""
    return _part_colours(state.transfer, state.lights, state.relight)


def material_colours(state: ViewState) -> dict[str, Colour]:
    """Of every material by name."""
    return _material_colours(state.transfer, state.lights, state.relight)


def spectrum_colour(state: ViewState, spectrum: Spectrum) -> Colour:
    """Of a reflectance that is no material yet."""
    basis = state.transfer.basis
    return _spectrum_colour(spectrum, basis.grid, basis.observer_deg, state.lights, state.relight)


@lru_cache(maxsize=512)
def _spectrum_colour(
    spectrum: Spectrum, grid: SpectralGrid, observer_deg: int, lights: Rows, spec: RelightSpec
) -> Colour:
    light, shown = _adapted(lights, spec, grid, observer_deg)
    XYZ = np.zeros((1, 3)) if light is None else XYZ_of(light, [spectrum], observer_deg)
    return as_colour(shown(XYZ)[0])


@lru_cache(maxsize=64)
def _part_colours(transfer: Transfer, lights: Rows, spec: RelightSpec) -> tuple[Colour, ...]:
    names = list(transfer.materials)
    shares = share_matrix([part.mix for part in parts_of(transfer)], names)
    return _coloured(transfer, lights, spec, shares)


@lru_cache(maxsize=64)
def _material_colours(transfer: Transfer, lights: Rows, spec: RelightSpec) -> dict[str, Colour]:
    names = list(transfer.materials)
    shown = _coloured(transfer, lights, spec, np.eye(len(names)))
    return dict(zip(names, shown, strict=True))


def _coloured(
    transfer: Transfer, lights: Rows, spec: RelightSpec, shares: Array
) -> tuple[Colour, ...]:
    """Of mixes, (P, K) shares; of dark where no light is on."""
    basis = transfer.basis
    light, shown = _adapted(lights, spec, basis.grid, basis.observer_deg)
    XYZ = np.zeros((shares.shape[1], 3))
    if light is not None:
        XYZ = XYZ_of(light, list(transfer.materials.values()), basis.observer_deg)
    codes = shown(shares @ XYZ)
    return tuple(as_colour(each) for each in codes)


@lru_cache(maxsize=64)
def _adapted(
    lights: Rows, spec: RelightSpec, grid: SpectralGrid, observer_deg: int
) -> tuple[Spectrum | None, Callable[[Array], Array]]:
    """The light, and what makes of (P, 3) XYZ under it the (P, 3) codes that look alike."""

    def codes(XYZ: Array) -> Array:
        return encode(linear_from_XYZ(XYZ))

    rig = rig_of(lights)
    if rig is None:
        return None, codes
    light = rig.mixed(grid)
    passage = adapted_to(rig, spec, white_XYZ(light, observer_deg))
    return light, codes if passage is None else lambda XYZ: codes(passage.apply(XYZ))


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
    low, high = presets.value_span(state.document.volume)
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
    low, high = presets.value_span(state.document.volume)
    counts = state.document.histogram
    edges = np.linspace(low, high, len(counts) + 1)
    middles = (edges[:-1] + edges[1:]) / 2
    dim = imgui.get_style_color_vec4(imgui.Col_.text_disabled)
    shade = implot.Spec(fill_color=dim, fill_alpha=0.5)
    implot.plot_shaded("voxels", middles, bars(counts, state.interface.logarithmic), spec=shade)


@dataclass(frozen=True, slots=True)
class Handle:
    """One of them.

    Parameters
    ----------
    place : (x, y)
        In the plot's units.
    words : str
        Shown at the mouse.
    colour : (3,) float, optional
        sRGB codes, 0 to 1; the ink's where left out.
    """

    place: tuple[float, float]
    words: str
    colour: Colour | None = None


@dataclass(frozen=True, slots=True)
class Touch:
    """What the mouse does to one.

    Parameters
    ----------
    what : {"move", "remove", "choose", "add"}
    x, y : float
        Where it is moved or added, in the plot's units.
    index : int
        Of the handle; of none that is added.
    """

    what: Literal["move", "remove", "choose", "add"]
    x: float = 0.0
    y: float = 0.0
    index: int = 0


def draw_handles(
    handles: Sequence[Handle], chosen: int, ui: UiContext, dark: bool
) -> Iterator[Touch]:
    """Draw them in the plot that was begun, the chosen one ringed; what the mouse does."""
    held = False
    for i, handle in enumerate(handles):
        # The last three ask for what it tells of the mouse; `_mark` is what is seen.
        moved, x, y, clicked, hovered, down = implot.drag_point(
            i, *handle.place, (0, 0, 0, 0), ui.px(5), 0, False, False, False
        )
        held = held or bool(down) or bool(hovered)
        if hovered and imgui.is_mouse_clicked(1):
            yield Touch("remove", index=i)
        elif moved:
            yield Touch("move", x, y, i)
        if clicked or down:
            yield Touch("choose", index=i)
        if hovered or down:
            imgui.set_tooltip(handle.words)
        _mark(ui, handle, pack_colour(ACCENT[dark]) if i == chosen else ink(), i == chosen)
    if implot.is_plot_hovered() and not held and imgui.is_mouse_double_clicked(0):
        mouse = implot.get_plot_mouse_pos()
        yield Touch("add", mouse.x, mouse.y)


def ink() -> int:
    """The text's colour, packed."""
    return int(imgui.get_color_u32(imgui.Col_.text))


def _mark(ui: UiContext, handle: Handle, ring: int, chosen: bool) -> None:
    """A handle in its colour, ringed so that it is seen on any ground."""
    implot.push_plot_clip_rect(ui.px(6))
    draw_list, place = implot.get_plot_draw_list(), implot.plot_to_pixels(*handle.place)
    draw_list.add_circle_filled(place, ui.px(5.5 if chosen else 4.5), ring)
    if handle.colour is not None:
        draw_list.add_circle_filled(place, ui.px(3.5), pack_colour(handle.colour))
    implot.pop_plot_clip_rect()
