"""Colours of white paper under lights, and plots of spectra.

lights, RelightSpec -> [light_look] -> swatches, plots
"""

from __future__ import annotations

from functools import lru_cache
from typing import Any

import numpy as np
from imgui_bundle import imgui
from numpy.typing import NDArray

from volspec.appearance import ViewTransform, view_transform
from volspec.appearance.display import encode_sRGB, linear_sRGB_from_XYZ
from volspec.errors import VolspecError
from volspec.relight import LightRig, RelightSpec
from volspec.spectra import SpectralGrid, colour_matching_functions, white_XYZ
from volspec.viewer.model.light_rows import KELVIN
from volspec.viewer.model.viewing import given_viewing
from volspec.viewer.ui.widgets import pack_colour

Colour = tuple[float, float, float]
Array = NDArray[np.float64]
# Reflectance of white paper.
_PAPER = 0.96


def white_from_rig(rig: LightRig) -> Array:
    """Return the XYZ of a perfect diffuser under a light."""
    return white_XYZ(rig.mixed(rig.lights[0].grid))


def as_colour(codes: Array) -> Colour:
    """Return (3,) codes as plain numbers."""
    r, g, b = codes.tolist()
    return r, g, b


@lru_cache(maxsize=512)
def raw_colour(rig: LightRig) -> Colour:
    """Return white paper's colour without adaptation; sRGB codes 0 to 1, the largest 1."""
    linear = np.maximum(linear_sRGB_from_XYZ(white_from_rig(rig)), 0.0)
    return as_colour(encode_sRGB(linear / max(float(linear.max()), 1e-9)))


# Rows are few, but dragging a temperature makes many rigs.
@lru_cache(maxsize=256)
def adapted_colour(rig: LightRig, spec: RelightSpec) -> Colour:
    """Return white paper's colour to an eye adapted to the light, if it can adapt."""
    white = white_from_rig(rig)
    transform = adapting_transform(rig, spec, white)
    if transform is None:
        return raw_colour(rig)
    return as_colour(encode_sRGB(linear_sRGB_from_XYZ(transform.apply(_PAPER * white))))


def adapting_transform(rig: LightRig, spec: RelightSpec, white: Array) -> ViewTransform | None:
    """Return the view transform from XYZ under a light to XYZ of the display.

    ``white`` is the XYZ of a perfect diffuser under the light. None if the light has no white
    to adapt to.
    """
    try:
        return view_transform(given_viewing(spec.viewing, rig.total_lux), white)
    except VolspecError:
        return None


# x, y, width, height.
Rect = tuple[float, float, float, float]
# Window pixels per column of a spectrum: finer columns look no different.
_COLUMN = 2.0


def fill_box(rect: Rect, colour: Colour, rounding: float, corners: int = 0) -> None:
    """Fill a rectangle of the window with a colour; ``corners`` 0 rounds all of them."""
    x, y, width, height = rect
    end, packed = (x + width, y + height), pack_colour(colour)
    imgui.get_window_draw_list().add_rect_filled((x, y), end, packed, rounding, corners)


def kelvin_slider(label: str, kelvin: float) -> tuple[bool, float]:
    """Draw a logarithmic slider for a temperature."""
    return imgui.slider_float(label, kelvin, *KELVIN, "%.0f K", imgui.SliderFlags_.logarithmic)


@lru_cache(maxsize=512)
def mixed_values(rig: LightRig, grid: SpectralGrid) -> Array:
    """Return the summed power of a rig's lights, band by band."""
    return rig.mixed(grid).values


def spark(
    rect: Rect, rig: LightRig, grid: SpectralGrid, alpha: float = 1.0, headroom: float = 1.04
) -> None:
    """Fill the spectrum of a rig; ``headroom`` is the upper edge's power relative to the peak."""
    values, draw_list = mixed_values(rig, grid), imgui.get_window_draw_list()
    fill(draw_list, rect, values, float(values.max()) * headroom, grid, alpha)


def fill(
    draw_list: Any, rect: Rect, values: Array, top: float, grid: SpectralGrid, alpha: float = 1.0
) -> None:
    """Fill a spectrum with the colours of its wavelengths.

    Bands share the width equally; ``top`` is the power at the upper edge.
    """
    x, y, width, height = rect
    count = max(int(width / _COLUMN), 2)
    colours = column_colours(grid, count, round(alpha, 2))
    heights = column_heights(values, count) * (height / max(top, 1e-12))
    bottom, step = y + height, width / count
    tops = (bottom - np.minimum(heights, height)).tolist()
    edges = [round(x + i * step) for i in range(count + 1)]
    # Vertical stripes of whole pixels: antialiasing would show slanted edges as lines.
    for i, level in enumerate(tops):
        draw_list.add_rect_filled((edges[i], level), (edges[i + 1], bottom), colours[i])


def outline(
    draw_list: Any, rect: Rect, values: Array, top: float, colour: int, weight: float
) -> None:
    """Draw a spectrum as a line, in the layout of `fill`."""
    x, y, width, height = rect
    count = len(values)
    heights = np.minimum(values * (height / max(top, 1e-12)), height)
    middles = x + (np.arange(count) + 0.5) * (width / count)
    ends = [imgui.ImVec2(px, py) for px, py in zip(middles, y + height - heights, strict=True)]
    first, last = imgui.ImVec2(x, ends[0].y), imgui.ImVec2(x + width, ends[-1].y)
    draw_list.add_polyline([first, *ends, last], colour, weight, 0)


def column_heights(values: Array, count: int) -> Array:
    """Interpolate the bands' values at the middles of equal columns."""
    places = (np.arange(count) + 0.5) / count * len(values) - 0.5
    return np.interp(places, np.arange(len(values)), values)


@lru_cache(maxsize=32)
def column_colours(grid: SpectralGrid, count: int, alpha: float = 1.0) -> tuple[int, ...]:
    """Return the muted colours of a grid's wavelengths, packed for imgui."""
    bands = colour_matching_functions(grid)
    XYZ = np.stack([column_heights(band, count) for band in bands], axis=1)
    # Add grey until the colour is in the display's gamut; equalise brightness, except at the ends.
    linear = linear_sRGB_from_XYZ(XYZ / bands.max() * 100.0)
    linear -= np.minimum(linear.min(axis=1, keepdims=True), 0.0)
    strength = linear.max(axis=1, keepdims=True)
    codes, reach = encode_sRGB(linear / np.maximum(strength, 0.08)), max(count // 24, 1)
    # A moving average hides the edges where a primary begins.
    padded = np.pad(codes, ((reach, reach), (0, 0)), mode="edge")
    windows = np.lib.stride_tricks.sliding_window_view(padded, 2 * reach + 1, axis=0)
    return tuple(pack_colour(colour, alpha) for colour in 0.13 + 0.75 * windows.mean(axis=-1))
