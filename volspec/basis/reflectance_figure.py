"""Figure of a constructed reflectance: its curve, the mixed base spectra, its colours.

    spectrum, base spectra -> [reflectance_figure] -> PNG, PDF, SVG

After figure 3b of Wang, Xu & Sun (2004).
"""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from volspec._figures import (
    DPI,
    FAINT,
    INK,
    inch_axes,
    new_figure,
    shorten,
    style_axes,
    write,
    write_figure,
)
from volspec.appearance.display import encode_sRGB
from volspec.basis.figure import line_colour
from volspec.spectra import Observer, Spectrum, XYZ_from_spectra, white_XYZ
from volspec.spectra.construct import XYZ_from_linear_sRGB

if TYPE_CHECKING:
    from matplotlib.figure import Figure

Array = NDArray[np.float64]

WIDTH_IN, HEIGHT_IN = 6.4, 3.4
_LEFT, _BOTTOM, _PLOT_WIDE, _PLOT_TALL = 0.42, 0.5, 4.1, 2.4
_SWATCH = 0.62


def reflectance_figure(
    paint: Spectrum,
    parts: Mapping[str, tuple[float, Array]],
    lights: Sequence[Spectrum],
    observer_deg: Observer = 2,
) -> Figure:
    """Draw a reflectance, its base spectra, and its colour under lights of its grid.

    Its name is the title. ``parts`` are base spectra by name with their weights, empty if it was
    not mixed. A swatch for each light is adapted to the light's white (Bradford).
    """
    figure = new_figure(WIDTH_IN, HEIGHT_IN)
    how = paint.notes.get("constructed", "")
    title = write(figure, _LEFT / WIDTH_IN, 1 - 0.3 / HEIGHT_IN, paint.name, fontsize=12,
                  weight="bold", color=INK)  # fmt: skip
    edge = title.get_window_extent().x1 / DPI + 0.12
    write(figure, edge / WIDTH_IN, 1 - 0.3 / HEIGHT_IN, how, fontsize=8.5, color=FAINT)
    axes = inch_axes(figure, _LEFT, _BOTTOM, _PLOT_WIDE, _PLOT_TALL)
    w = paint.wavelengths_nm
    style_axes(axes)
    axes.set(xlim=(w[0], w[-1]), ylim=(0, 1), yticks=[0, 0.5, 1])
    axes.set_xlabel("wavelength, nm", fontsize=8, color=FAINT, labelpad=3)
    right = _LEFT + _PLOT_WIDE + 0.28
    line = HEIGHT_IN - 0.62
    if parts:
        write(figure, right / WIDTH_IN, line / HEIGHT_IN, "mixed from", fontsize=7.5, color=FAINT)
    for name, (fraction, values) in parts.items():
        colour = line_colour(values, paint.grid)
        axes.plot(w, values, color=colour, linewidth=1.0, linestyle=(0, (1.2, 1.4)))
        line -= 0.19
        text = write(figure, right / WIDTH_IN, line / HEIGHT_IN, f"{100 * fraction:.0f} %  {name}",
                     fontsize=7.5, color=colour)  # fmt: skip
        shorten(text, WIDTH_IN - right - 0.1)
    axes.plot(w, paint.values, color=line_colour(paint.values, paint.grid), linewidth=2.4)
    for i, lamp in enumerate(lights):
        x = right + i * (_SWATCH + 0.1)
        if x + _SWATCH > WIDTH_IN:
            break
        swatch = inch_axes(figure, x, _BOTTOM + 0.18, _SWATCH, _SWATCH)
        swatch.set_facecolor(_sRGB(paint, lamp, observer_deg))
        swatch.set(xticks=[], yticks=[])
        for side in swatch.spines.values():
            side.set_visible(False)
        label = write(figure, x / WIDTH_IN, (_BOTTOM + 0.02) / HEIGHT_IN, lamp.name, fontsize=7.5,
                      color=FAINT)  # fmt: skip
        shorten(label, _SWATCH)
    return figure


def save_reflectance_figure(
    paint: Spectrum,
    parts: Mapping[str, tuple[float, Array]],
    lights: Sequence[Spectrum],
    path: str | os.PathLike[str],
    observer_deg: Observer = 2,
) -> None:
    """Write `reflectance_figure` in the format of the file's suffix; whole or not at all."""
    write_figure(reflectance_figure(paint, parts, lights, observer_deg), path)


def _sRGB(paint: Spectrum, lamp: Spectrum, observer_deg: Observer) -> tuple[float, float, float]:
    """Return encoded sRGB of a surface under a light, adapted to its white."""
    to_linear = np.linalg.inv(XYZ_from_linear_sRGB(white_XYZ(lamp, observer_deg)))
    red, green, blue = encode_sRGB(to_linear @ XYZ_from_spectra(lamp, paint, observer_deg)).tolist()
    return red, green, blue
