"""Plots of a transfer function: axes, histogram, handles, colours of its parts, swatches."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from imgui_bundle import imgui, implot
from numpy.typing import NDArray

from volspec.appearance.display import encode_sRGB, linear_sRGB_from_XYZ
from volspec.basis import Basis
from volspec.relight import LightRig, RelightSpec
from volspec.spectra import Spectrum, XYZ_from_spectra, white_XYZ
from volspec.transfer import Transfer, presets, weight_matrix
from volspec.viewer.model import fields
from volspec.viewer.model.light_rows import facing_light
from volspec.viewer.model.room import shown_spec
from volspec.viewer.model.state import ViewState
from volspec.viewer.model.transfer_parts import list_parts
from volspec.viewer.ui.context import UiContext, tip
from volspec.viewer.ui.light_look import Colour, adapting_transform, as_colour, fill_box
from volspec.viewer.ui.widgets import ACCENT, pack_colour
from volspec.volume import value_form

Array = NDArray[np.float64]
LIT = "Under the lights that are on, to an eye adapted to them"
FLAGS = implot.Flags_.canvas_only
# Padding left and right of a plot, and above and below it.
_PADDING = 10, 4


def swatch(ui: UiContext, colour: Colour) -> None:
    """Draw a square in a colour, as high as a line."""
    x, y = imgui.get_cursor_screen_pos()
    side = imgui.get_frame_height()
    imgui.dummy((side, side))
    inset = ui.px(3)
    start, end = (x + inset, y + inset), (x + side - inset, y + side - inset)
    fill_box((*start, side - 2 * inset, side - 2 * inset), colour, inset)
    border = imgui.get_color_u32(imgui.Col_.text_disabled, 0.7)
    imgui.get_window_draw_list().add_rect(start, end, border, inset)
    tip(LIT)


def part_colours(state: ViewState) -> tuple[Colour, ...]:
    """Return the colour of every part's mix under the lights."""
    return _colours(state.transfer, _viewing_light(state), shown_spec(state))[0]


def material_colours(state: ViewState) -> dict[str, Colour]:
    """Return the colour of every material under the lights, by name."""
    return _colours(state.transfer, _viewing_light(state), shown_spec(state))[1]


def spectrum_colour(state: ViewState, spectrum: Spectrum) -> Colour:
    """Return the colour of a reflectance that is not a material yet."""
    basis = state.transfer.basis
    return _spectrum_colour(spectrum, basis, _viewing_light(state), shown_spec(state))


def _viewing_light(state: ViewState) -> LightRig | None:
    return facing_light(state.lights, state.room)


@lru_cache(maxsize=512)
def _spectrum_colour(
    spectrum: Spectrum, basis: Basis, rig: LightRig | None, spec: RelightSpec
) -> Colour:
    XYZ_of_all, codes = _colour_functions(rig, spec, basis)
    return as_colour(codes(XYZ_of_all([spectrum]))[0])


@lru_cache(maxsize=64)
def _colours(
    transfer: Transfer, rig: LightRig | None, spec: RelightSpec
) -> tuple[tuple[Colour, ...], dict[str, Colour]]:
    """Return the colours of the parts and of the materials."""
    names = list(transfer.materials)
    XYZ_of_all, codes = _colour_functions(rig, spec, transfer.basis)
    XYZ = XYZ_of_all(list(transfer.materials.values()))
    weights = weight_matrix([part.mix for part in list_parts(transfer)], names)
    parts = tuple(as_colour(code) for code in codes(weights @ XYZ))
    return parts, dict(zip(names, map(as_colour, codes(XYZ)), strict=True))


@lru_cache(maxsize=64)
def _colour_functions(
    rig: LightRig | None, spec: RelightSpec, basis: Basis
) -> tuple[Callable[[list[Spectrum]], Array], Callable[[Array], Array]]:
    """Return functions from reflectances to (P, 3) XYZ under the lights, and on to sRGB codes."""

    def codes(XYZ: Array) -> Array:
        return encode_sRGB(linear_sRGB_from_XYZ(XYZ))

    if rig is None:
        return lambda spectra: np.zeros((len(spectra), 3)), codes
    light, observer_deg = rig.mixed(basis.grid), basis.observer_deg
    transform = adapting_transform(rig, spec, white_XYZ(light, observer_deg))
    return (
        lambda spectra: XYZ_from_spectra(light, spectra, observer_deg),
        codes if transform is None else lambda XYZ: codes(transform.apply(XYZ)),
    )


def bars(counts: Array, logarithmic: bool, quantile: float = 0.98) -> Array:
    """Return the heights of a histogram, 0 to 1.

    Linear heights are clipped at the ``quantile``, as air would dwarf the rest.
    """
    if logarithmic:
        heights = np.log1p(counts)
        return np.asarray(heights / max(float(heights.max()), 1e-12))
    top = float(np.quantile(counts, quantile))
    return np.asarray(np.minimum(counts / max(top, 1.0), 1.0))


def draw_histogram(counts: Array, low: float, high: float, logarithmic: bool) -> None:
    """Shade a histogram of equal bins from low to high."""
    edges = np.linspace(low, high, len(counts) + 1)
    dim = imgui.get_style_color_vec4(imgui.Col_.text_disabled)
    shade = implot.Spec(fill_color=dim, fill_alpha=0.5)
    middles = (edges[:-1] + edges[1:]) / 2
    implot.plot_shaded("voxels", middles, bars(counts, logarithmic), spec=shade)


@contextmanager
def low_plot(label: str, height: float, ui: UiContext) -> Iterator[bool]:
    """Begin a plot with little padding; yield False if it is out of view."""
    implot.push_style_var(implot.StyleVar_.plot_padding, (ui.px(_PADDING[0]), ui.px(_PADDING[1])))
    visible = bool(implot.begin_plot(label, (-1, height), FLAGS))
    yield visible
    if visible:
        implot.end_plot()
    implot.pop_style_var()


def set_axis(
    axis: int, low: float, high: float, flags: int, when: int = imgui.Cond_.always
) -> None:
    """Set up an axis without a title."""
    implot.setup_axis(axis, "", flags)
    implot.setup_axis_limits(axis, low, high, when)


def set_values_axis(state: ViewState, margin: float) -> None:
    """Set up the axis of values, wider than the volume's range by a share of it at both ends."""
    low, high = presets.value_span(fields.data(state).volume)
    room = margin * (high - low)
    set_axis(implot.ImAxis_.x1, low - room, high + room, implot.AxisFlags_.no_grid_lines)
    unit = fields.data(state).volume.metadata.unit
    form = f"{value_form(fields.data(state).volume)} {unit.replace('%', '%%')}".rstrip()
    implot.setup_axis_format(implot.ImAxis_.x1, form)


def note_area(ui: UiContext, name: str) -> None:
    """Record the plot's rectangle."""
    (x, y), (width, height) = implot.get_plot_pos(), implot.get_plot_size()
    ui.areas[name] = int(x), int(y), int(width), int(height)


@dataclass(frozen=True, slots=True)
class PointHandle:
    """A point of a plot that can be dragged."""

    place: tuple[float, float]  # in the plot's units
    words: str  # its tooltip
    colour: Colour | None = None  # None draws only a ring


@dataclass(frozen=True, slots=True)
class HandleEdits:
    """Edits by the mouse: a drag, a double-click between handles, a right click, a press.

    Handles are given by their index, and places in the plot's units.
    """

    move: Callable[[ViewState, int, float, float], ViewState]
    add: Callable[[ViewState, float, float], ViewState]
    remove: Callable[[ViewState, int], ViewState]
    choose: Callable[[ViewState, int], ViewState] | None = None


def draw_handles(
    state: ViewState,
    ui: UiContext,
    handles: Sequence[PointHandle],
    edits: HandleEdits,
    active: int = -1,
) -> ViewState:
    """Draw handles in the current plot, the chosen one with a ring; return the edited state."""
    new, on_handle, accent = state, False, pack_colour(ACCENT[state.interface.dark])
    for i, handle in enumerate(handles):
        # Transparent, only for the mouse: `_draw_handle` draws it.
        changed, x, y, clicked, hovered, down = implot.drag_point(
            i, *handle.place, (0, 0, 0, 0), ui.px(5), 0, False, False, False
        )
        on_handle = on_handle or bool(down) or bool(hovered)
        if hovered and imgui.is_mouse_clicked(1):
            new = edits.remove(new, i)
        elif changed:
            new = edits.move(new, i, x, y)
        if edits.choose and (clicked or down):
            new = edits.choose(new, i)
        if hovered or down:
            imgui.set_tooltip(handle.words)
        ring = (accent, 5.5) if i == active else (ink(), 4.5)
        _draw_handle(ui, handle, *ring)
    return add_on_double_click(new, edits.add, on_handle)


def add_on_double_click(
    state: ViewState, add: Callable[[ViewState, float, float], ViewState], on_handle: bool
) -> ViewState:
    """Add a part at a double-click in the plot, unless the mouse is on a handle."""
    if on_handle or not (implot.is_plot_hovered() and imgui.is_mouse_double_clicked(0)):
        return state
    mouse = implot.get_plot_mouse_pos()
    return add(state, mouse.x, mouse.y)


def ink() -> int:
    """Return the text's colour, packed."""
    return int(imgui.get_color_u32(imgui.Col_.text))


def _draw_handle(ui: UiContext, handle: PointHandle, ring: int, radius: float) -> None:
    """Draw a handle in its colour, with a ring that is visible on any background."""
    implot.push_plot_clip_rect(ui.px(6))
    draw_list, place = implot.get_plot_draw_list(), implot.plot_to_pixels(*handle.place)
    draw_list.add_circle_filled(place, ui.px(radius), ring)
    if handle.colour is not None:
        draw_list.add_circle_filled(place, ui.px(3.5), pack_colour(handle.colour))
    implot.pop_plot_clip_rect()
