"""Colours and curves of lights: white paper and materials under them, spectra as sparklines.

lights, RelightSpec -> [light_look] -> swatches, plots
"""

from __future__ import annotations

from functools import lru_cache
from typing import Any

import numpy as np
from imgui_bundle import imgui
from numpy.typing import NDArray

from volspec.appearance import passage_of
from volspec.appearance.passages import Passage
from volspec.appearance.srgb import encode, linear_from_XYZ
from volspec.errors import VolspecError
from volspec.relight import LightRig, RelightSpec
from volspec.spectra import SpectralGrid, color_matching_functions, white_XYZ
from volspec.viewer.model.viewing import given_viewing
from volspec.viewer.ui.widgets import pack_colour

Colour = tuple[float, float, float]
Array = NDArray[np.float64]
# Of white paper, which reflects less than a perfect diffuser.
_PAPER = 0.96


def white_of(rig: LightRig) -> Array:
    """(3,) XYZ of a perfect diffuser under a light."""
    return white_XYZ(rig.mixed(rig.lights[0].grid))


def as_colour(codes: Array) -> Colour:
    """(3,) codes as plain numbers."""
    r, g, b = codes.tolist()
    return r, g, b


@lru_cache(maxsize=512)
def raw_colour(rig: LightRig) -> Colour:
    """A light on white paper beside the display's white; sRGB codes 0 to 1, the most 1."""
    linear = np.maximum(linear_from_XYZ(white_of(rig)), 0.0)
    return as_colour(encode(linear / max(float(linear.max()), 1e-9)))


# Rows are few; a temperature that is dragged makes many.
@lru_cache(maxsize=256)
def adapted_colour(rig: LightRig, spec: RelightSpec) -> Colour:
    """The same to an eye adapted to the light; as it is where there is nothing to adapt to."""
    white = white_of(rig)
    passage = adapted_to(rig, spec, white)
    if passage is None:
        return raw_colour(rig)
    return as_colour(encode(linear_from_XYZ(passage.apply(_PAPER * white))))


def adapted_to(rig: LightRig, spec: RelightSpec, white: Array) -> Passage | None:
    """What makes of XYZ under a light those that look alike on the display.

    Parameters
    ----------
    rig : LightRig
    spec : RelightSpec
    white : (3,) float64
        XYZ of a perfect diffuser under it.

    Returns
    -------
    Passage or None
        None where the light has no white to adapt to.
    """
    try:
        return passage_of(given_viewing(spec.viewing, rig.total_lux), white)
    except VolspecError:
        return None


Rect = tuple[float, float, float, float]
# Pixels of the window for each column of a spectrum: finer ones look no different.
_COLUMN = 2.0
# Of a small spectrum above its peak.
_HEADROOM = 1.04


@lru_cache(maxsize=512)
def mixed_values(rig: LightRig, grid: SpectralGrid) -> NDArray[np.float64]:
    """(N,) power of a rig's lights together, band by band."""
    return rig.mixed(grid).values


def spark(
    draw_list: Any, rect: Rect, rig: LightRig, grid: SpectralGrid, alpha: float = 1.0
) -> None:
    """The spectrum of a rig in small, to its own peak."""
    values = mixed_values(rig, grid)
    fill(draw_list, rect, values, float(values.max()) * _HEADROOM, grid, alpha)


def fill(
    draw_list: Any,
    rect: Rect,
    values: NDArray[np.float64],
    top: float,
    grid: SpectralGrid,
    alpha: float = 1.0,
) -> None:
    """A spectrum filled with the colours of its wavelengths.

    Parameters
    ----------
    draw_list : imgui's
    rect : (x, y, width, height)
        Each band has the same part of the width.
    values : (N,) float64
    top : float
        Power at the upper edge.
    grid : SpectralGrid
    alpha : float
        Opacity.
    """
    x, y, width, height = rect
    count = max(int(width / _COLUMN), 2)
    colours = column_colours(grid, count, round(alpha, 2))
    heights = column_heights(values, count) * (height / max(top, 1e-12))
    bottom, step = y + height, width / count
    tops = (bottom - np.minimum(heights, height)).tolist()
    edges = [round(x + i * step) for i in range(count + 1)]
    # Upright stripes of whole pixels have no slanted edges to be smoothed into lines.
    for i, level in enumerate(tops):
        draw_list.add_rect_filled((edges[i], level), (edges[i + 1], bottom), colours[i])


def outline(
    draw_list: Any, rect: Rect, values: NDArray[np.float64], top: float, colour: int, weight: float
) -> None:
    """A spectrum as a line, as `fill` lays it out."""
    x, y, width, height = rect
    count = len(values)
    heights = np.minimum(values * (height / max(top, 1e-12)), height)
    middles = x + (np.arange(count) + 0.5) * (width / count)
    ends = [imgui.ImVec2(px, py) for px, py in zip(middles, y + height - heights, strict=True)]
    first, last = imgui.ImVec2(x, ends[0].y), imgui.ImVec2(x + width, ends[-1].y)
    draw_list.add_polyline([first, *ends, last], colour, weight, 0)


def column_heights(values: NDArray[np.float64], count: int) -> NDArray[np.float64]:
    """Values at the middles of equal columns, straight between the bands' middles."""
    places = (np.arange(count) + 0.5) / count * len(values) - 0.5
    return np.interp(places, np.arange(len(values)), values)


@lru_cache(maxsize=32)
def column_colours(grid: SpectralGrid, count: int, alpha: float = 1.0) -> tuple[int, ...]:
    """What wavelengths look like from end to end of a grid, muted, packed for imgui."""
    bands = color_matching_functions(grid).T
    XYZ = np.stack([column_heights(band, count) for band in bands.T], axis=1)
    # Laid on grey until it is a colour of the display, evenly bright but for the ends.
    linear = linear_from_XYZ(XYZ / bands.max() * 100.0)
    linear -= np.minimum(linear.min(axis=1, keepdims=True), 0.0)
    strength = linear.max(axis=1, keepdims=True)
    codes = _smooth(encode(linear / np.maximum(strength, 0.08)), max(count // 24, 1))
    return tuple(pack_colour(colour, alpha) for colour in 0.13 + 0.75 * codes)


def _smooth(codes: NDArray[np.float64], reach: int) -> NDArray[np.float64]:
    """(N, 3) means over neighbours: no edges where primaries set in."""
    padded = np.pad(codes, ((reach, reach), (0, 0)), mode="edge")
    windows = np.lib.stride_tricks.sliding_window_view(padded, 2 * reach + 1, axis=0)
    return np.asarray(windows.mean(axis=-1))
