"""Figure of a light: colour vector graphic, spectrum, chroma by hue, colour rendering indices.

    rendition -> [light_figure] -> PNG, PDF, SVG

The graphic is drawn as ANSI/IES TM-30 asks: the reference is the unit circle, R_f, R_g, the
temperature and Duv are in its corners.
"""

from __future__ import annotations

import os
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from volspec._figures import (
    DPI,
    FAINT,
    HAIR,
    INK,
    inch_axes,
    new_figure,
    shorten,
    style_axes,
    write,
    write_figure,
)
from volspec.appearance.comparison import HUE_BINS, Rendition, hue_colours
from volspec.appearance.display import spectrum_colours
from volspec.spectra import Spectrum

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

Array = NDArray[np.float64]

WIDTH_IN, HEIGHT_IN = 10.0, 5.9
_MARGIN, _GRAPHIC = 0.42, 4.6
_LEFT = _MARGIN + _GRAPHIC + 0.75
_WIDE = WIDTH_IN - _LEFT - _MARGIN
# Radius of the graphic, and of the light disc with the hues.
_EDGE, _DISC = 1.62, 1.42
_RED = "#c1121f"


def light_figure(
    light: Spectrum, reference: Spectrum, rendition: Rendition, facts: str = ""
) -> Figure:
    """Draw a light and its reference on one grid; ``facts`` are written after the light's name."""
    figure = new_figure(WIDTH_IN, HEIGHT_IN)
    top = 1 - 0.36 / HEIGHT_IN
    title = write(
        figure, _MARGIN / WIDTH_IN, top, light.name, fontsize=15, weight="bold", color=INK
    )
    shorten(title, 5.0)
    edge = title.get_window_extent().x1 / DPI + 0.14
    line = write(figure, edge / WIDTH_IN, top, facts, fontsize=9, color=FAINT)
    shorten(line, WIDTH_IN - edge - _MARGIN)
    _draw_vectors(inch_axes(figure, _MARGIN, 0.5, _GRAPHIC, _GRAPHIC), rendition)
    _draw_spectra(inch_axes(figure, _LEFT, 3.86, _WIDE, 1.3), light, reference)
    hues = hue_colours((np.arange(HUE_BINS) + 0.5) * 2 * np.pi / HUE_BINS)
    shifts = inch_axes(figure, _LEFT, 2.2, _WIDE, 0.95)
    _draw_bars(shifts, 100 * rendition.chroma_shift, hues, "chroma shift R_cs by hue bin, %")
    limit = max(25.0, float(np.abs(100 * rendition.chroma_shift).max()) * 1.1)
    shifts.set(ylim=(-limit, limit), yticks=[-20, 0, 20])
    indices = inch_axes(figure, _LEFT, 0.5, _WIDE, 0.95)
    label = f"CIE 13.3: R_a {rendition.R_a:.0f}, and R_1 to R_14"
    _draw_bars(indices, rendition.R, np.full((14, 3), 0.62), label)
    low = min(0.0, float(rendition.R.min()) * 1.25)
    indices.set(ylim=(low, 100), yticks=[0, 50, 100] if low == 0 else [0, 100])
    return figure


def save_light_figure(
    light: Spectrum,
    reference: Spectrum,
    rendition: Rendition,
    path: str | os.PathLike[str],
    facts: str = "",
) -> None:
    """Write `light_figure` in the format of the file's suffix; whole or not at all."""
    write_figure(light_figure(light, reference, rendition, facts), path)


def _draw_vectors(axes: Axes, rendition: Rendition) -> None:
    """Draw the colour vector graphic."""
    axes.set(xlim=(-_EDGE, _EDGE), ylim=(-_EDGE, _EDGE), aspect="equal")
    axes.set_axis_off()
    axes.imshow(_hue_disc(500), extent=(-_DISC, _DISC, -_DISC, _DISC), interpolation="bilinear")
    around = np.linspace(0, 2 * np.pi, 241)
    for radius, style in ((0.8, ":"), (1.2, ":"), (1.0, "-")):
        colour, width = (INK, 1.6) if radius == 1 else ("white", 0.9)
        x, y = radius * np.cos(around), radius * np.sin(around)
        axes.plot(x, y, style, color=colour, linewidth=width)
    for number in range(HUE_BINS):
        angle = number * 2 * np.pi / HUE_BINS
        x, y = np.cos(angle), np.sin(angle)
        axes.plot([0, _DISC * x], [0, _DISC * y], "--", color="white", linewidth=0.6)
        middle = angle + np.pi / HUE_BINS
        x, y = 1.51 * np.cos(middle), 1.51 * np.sin(middle)
        write(axes, x, y, str(number + 1), ha="center", va="center", fontsize=8, color=FAINT)
    write(axes, 0.81 * np.cos(1.77), 0.81 * np.sin(1.77), "-20 %", fontsize=6.5, color="white")
    write(axes, 1.21 * np.cos(1.72), 1.21 * np.sin(1.72), "+20 %", fontsize=6.5, color="white")
    starts, ends = rendition.vectors()
    closed = np.vstack([ends, ends[:1]])
    axes.plot(*closed.T, color=_RED, linewidth=1.8)
    colours = hue_colours(np.arctan2(starts[:, 1], starts[:, 0]), chroma=48.0, lightness=38.0)
    for start, end, colour in zip(starts, ends, colours, strict=True):
        arrow = {"arrowstyle": "-|>", "color": tuple(colour), "linewidth": 1.6, "shrinkA": 0}
        axes.annotate("", end, start, arrowprops=arrow | {"shrinkB": 0, "mutation_scale": 9})
    near = rendition.temperature
    for across, up, value, label in (
        (-1, 1, f"{rendition.R_f:.0f}", "R_f"),
        (1, 1, f"{rendition.R_g:.0f}", "R_g"),
        (-1, -1, f"{near.kelvin:.0f} K", "CCT"),
        (1, -1, f"{round(near.Duv, 4) + 0.0:+.4f}", "Duv"),
    ):
        place = {"ha": ("left", "right")[across > 0], "va": ("bottom", "top")[up > 0]}
        large, step = (17, 0.22) if up > 0 else (11, 0.15)
        write(
            axes,
            across * _EDGE,
            up * _EDGE,
            value,
            fontsize=large,
            weight="bold",
            color=INK,
            **place,
        )
        write(axes, across * _EDGE, up * (_EDGE - step), label, fontsize=8, color=FAINT, **place)


def _hue_disc(size: int) -> Array:
    """Return (size, size, 4) codes: a disc of even lightness whose chroma grows outwards."""
    y, x = np.mgrid[1 : -1 : size * 1j, -1 : 1 : size * 1j]
    radius = np.hypot(x, y)
    rgb = hue_colours(np.arctan2(y, x), chroma=36.0 * np.minimum(radius, 1.0), lightness=68.0)
    return np.dstack([rgb, np.clip((1.0 - radius) * size / 2.0, 0.0, 1.0)])


def _draw_spectra(axes: Axes, light: Spectrum, reference: Spectrum) -> None:
    """Draw a light, filled with the colours of its wavelengths, and its reference as a line."""
    style_axes(axes)
    nm, power = light.wavelengths_nm, light.values
    largest = float(max(power.max(), reference.values.max()))
    fine = np.arange(nm[0], nm[-1], 0.5)
    axes.bar(fine, np.interp(fine, nm, power / largest), 0.7, color=spectrum_colours(fine))
    axes.plot(nm, power / largest, color=INK, linewidth=1.0)
    axes.plot(nm, reference.values / largest, color=_RED, linewidth=1.2, linestyle=(0, (4, 2)))
    axes.set(xlim=(nm[0], nm[-1]), ylim=(0, 1.05), yticks=[])
    write(axes, 0, 1.08, f"spectrum, nm; dashed: {reference.name}",
          fontsize=7.5, color=FAINT, transform=axes.transAxes)  # fmt: skip


def _draw_bars(axes: Axes, values: Array, colours: Array, label: str) -> None:
    style_axes(axes)
    axes.spines["bottom"].set_visible(False)
    numbers = np.arange(1, len(values) + 1)
    axes.bar(numbers, values, 0.8, color=colours)
    axes.axhline(0, color=FAINT, linewidth=0.6)
    axes.grid(axis="y", color=HAIR, linewidth=0.5)
    axes.set(xlim=(0.4, len(values) + 0.6), xticks=numbers)
    write(axes, 0, 1.1, label, fontsize=7.5, color=FAINT, transform=axes.transAxes)
