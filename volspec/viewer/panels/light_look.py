"""How lights are drawn wherever they stand in a panel: as swatches, and as spectra in colour."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import lru_cache
from typing import Any

import numpy as np
from imgui_bundle import imgui
from numpy.typing import NDArray

from volspec.appearance.srgb import encode, linear_from_XYZ
from volspec.relight import LightRig
from volspec.spectra import SpectralGrid, color_matching_functions, white_XYZ

Rect = tuple[float, float, float, float]
# Pixels of the window for each column of a spectrum: finer ones look no different.
COLUMN = 2.0


@lru_cache(maxsize=512)
def raw_colour(rig: LightRig) -> tuple[float, float, float]:
    """A light on white paper beside the display's white; sRGB codes 0 to 1, the most 1."""
    white = white_XYZ(rig.mixed(rig.lights[0].grid))
    linear = np.maximum(linear_from_XYZ(white), 0.0)
    r, g, b = (float(v) for v in encode(linear / max(float(linear.max()), 1e-9)))
    return r, g, b


def packed(colour: Sequence[float], alpha: float = 1.0) -> int:
    """A colour as draw lists take it."""
    r, g, b = colour[:3]
    return int(imgui.color_convert_float4_to_u32((r, g, b, alpha)))


@lru_cache(maxsize=512)
def mixed_values(rig: LightRig, grid: SpectralGrid) -> NDArray[np.float64]:
    """(N,) power of a rig's lights together, band by band."""
    return rig.mixed(grid).values


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
    count = max(int(width / COLUMN), 2)
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
    return tuple(packed(colour, alpha) for colour in 0.13 + 0.75 * codes)


def _smooth(codes: NDArray[np.float64], reach: int) -> NDArray[np.float64]:
    """(N, 3) means over neighbours: no edges where primaries set in."""
    padded = np.pad(codes, ((reach, reach), (0, 0)), mode="edge")
    windows = np.lib.stride_tricks.sliding_window_view(padded, 2 * reach + 1, axis=0)
    return np.asarray(windows.mean(axis=-1))


def shortened(text: str, width: float, measure: Callable[[str], float]) -> str:
    """A text, cut with an ellipsis where it would be wider.

    >>> shortened("tungsten", 5, len), shortened("D65", 5, len)
    ('tung…', 'D65')
    """
    if measure(text) <= width:
        return text
    end = len(text)
    while end > 1 and measure(text[:end].rstrip() + "…") > width:
        end -= 1
    return text[:end].rstrip() + "…"


def fitting(text: str, width: float) -> str:
    """As `shortened`, in imgui's present font."""
    return shortened(text, width, lambda part: float(imgui.calc_text_size(part).x))


def tip(text: str) -> None:
    """A tooltip of the last item."""
    if imgui.is_item_hovered(imgui.HoveredFlags_.delay_normal):
        imgui.set_tooltip(text)
