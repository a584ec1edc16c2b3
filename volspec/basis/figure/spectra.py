"""What a basis sees: its sensors, basis vectors or materials over wavelength.

[spectra] -> figure
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from volspec.appearance import constants as k
from volspec.appearance import srgb
from volspec.appearance.models.cielab import XYZ_from_cielab, cielab
from volspec.appearance.wavelengths import spectrum_colours
from volspec.basis.figure.style import FAINT, INK, plain, shortened, spread, write
from volspec.basis.materials import MaterialBasis
from volspec.spectra.grid import SpectralGrid
from volspec.spectra.observer import color_matching_functions

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from volspec.basis.model import SpectralBasis

Array = NDArray[np.float64]

_LINE_LIGHTNESS = (30.0, 58.0)
_WIDEST_NAME = 1.1
# More curves than this cannot be followed in one plot; each gets its own line, most with names.
_MOST_CURVES = 10
_MOST_NAMED = 30
# How many numbers fit across and along the plot.
_ACROSS, _ALONG = 28.0, 16.0
# Colours nearer than this in CIELAB are told apart by strokes.
_ALIKE = 14.0
_STROKES = ("-", (0, (4.0, 1.2)), (0, (1.2, 1.0)), (0, (6.0, 1.2, 1.2, 1.2)))


def draw_spectra(axes: Axes, basis: SpectralBasis | MaterialBasis) -> None:
    """Sensors, basis vectors or reflectances over the basis' grid, in colours they stand for."""
    from matplotlib.ticker import MultipleLocator

    grid = basis.grid
    plain(axes)
    axes.set_xlim(grid.start_nm, grid.stop_nm)
    if isinstance(basis, MaterialBasis):
        title = "reflectances of the materials"
        curves = np.array([spectrum.values for spectrum in basis.materials.values()])
        draw = _draw_ridges if len(curves) > _MOST_CURVES else _draw_reflectances
        draw(axes, curves, list(basis.materials), grid)
    elif basis.method.startswith("pca"):
        title = "basis vectors (columns of B)"
        _draw_sensors(axes, basis.synthesis.T, grid)
    else:
        title = "sensors (rows of A)"
        _draw_sensors(axes, basis.analysis, grid)
    axes.text(0, 1.105, title, transform=axes.transAxes, fontsize=9.5, color=INK, va="center")
    axes.tick_params(axis="x", pad=11)
    axes.xaxis.set_major_locator(MultipleLocator(50 if grid.stop_nm - grid.start_nm < 400 else 100))
    axes.set_xlabel("wavelength, nm", fontsize=8, color=FAINT, labelpad=3)
    _draw_spectrum(axes, grid)


def names_in(basis: SpectralBasis | MaterialBasis) -> float:
    """Inches that the names of materials take beside their curves."""
    if not isinstance(basis, MaterialBasis):
        return 0.0
    return min(0.062 * max(map(len, basis.materials)) + 0.05, _WIDEST_NAME)


def line_colour(curve: Array, grid: SpectralGrid) -> tuple[float, float, float]:
    """sRGB of what a curve passes of flat light, light or dark enough for a line on white."""
    Q = color_matching_functions(grid)
    XYZ = Q @ np.maximum(curve, 0.0)
    white = Q.sum(1)
    if not XYZ[1] > 0:
        return (0.4, 0.4, 0.4)
    L, a, b = cielab(XYZ * (0.3 * white[1] / XYZ[1]), white)
    strong = min(1.0, 70.0 / max(float(np.hypot(a, b)), 1e-9))
    Lab = np.array([np.clip(L, *_LINE_LIGHTNESS), a * strong, b * strong])
    linear = srgb.linear_from_XYZ(XYZ_from_cielab(Lab, k.DISPLAY_WHITE_XYZ))
    r, g, blue = srgb.encode(linear)
    return float(r), float(g), float(blue)


def _draw_sensors(axes: Axes, curves: Array, grid: SpectralGrid) -> None:
    """Curves from below zero to their peaks, numbered."""
    low, high = min(float(curves.min()), 0.0), float(curves.max())
    room = 0.1 * (high - low)
    axes.set(ylim=(low - (room if low < 0 else 0), high + room), yticks=[0])
    colours = _draw_curves(axes, curves, grid)
    labels = [str(i + 1) for i in range(len(curves))]
    _number_peaks(axes, grid.wavelengths_nm, curves, labels, colours)


def _draw_reflectances(axes: Axes, curves: Array, labels: list[str], grid: SpectralGrid) -> None:
    """Curves from zero to one, named at their ends."""
    axes.set_ylim(0, max(1.0, 1.05 * float(curves.max())))
    _name_ends(axes, curves[:, -1], labels, _draw_curves(axes, curves, grid))


def _draw_ridges(axes: Axes, curves: Array, labels: list[str], grid: SpectralGrid) -> None:
    """Each curve on a line of its own, filled, and named at the line."""
    K = len(curves)
    axes.set(ylim=(K + 0.15, 0), yticks=[])
    every = -(-K // _MOST_NAMED)
    size = float(np.clip(150.0 / K, 5.0, 7.0))
    for i, (curve, label) in enumerate(zip(curves, labels, strict=True)):
        base, colour = i + 1.0, line_colour(curve, grid)
        w, top = grid.wavelengths_nm, base - 0.95 * np.minimum(curve, 1.0)
        axes.fill_between(w, base, top, color=colour, linewidth=0.4)
        if i % every == 0:
            text = write(axes, 1.012, base - 0.4, label, transform=axes.get_yaxis_transform(),
                         fontsize=size, color=colour, va="center")  # fmt: skip
            shortened(text, _WIDEST_NAME)


def _draw_curves(axes: Axes, curves: Array, grid: SpectralGrid) -> list[Any]:
    """Curves in their colours, which are given back."""
    colours = [line_colour(curve, grid) for curve in curves]
    axes.axhline(0, color=FAINT, linewidth=0.6, zorder=1)
    for curve, colour, stroke in zip(curves, colours, _strokes(colours), strict=True):
        axes.plot(grid.wavelengths_nm, curve, color=colour, linewidth=1.7, linestyle=stroke,
                  zorder=3)  # fmt: skip
    return colours


def _strokes(colours: list[tuple[float, float, float]]) -> list[Any]:
    """Solid, or another stroke for a colour much like one before."""
    linear = srgb.decode(np.array(colours))
    Lab = cielab(linear @ k.XYZ_FROM_sRGB.T, k.DISPLAY_WHITE_XYZ)
    kinds: list[int] = []
    for i in range(len(Lab)):
        taken = [kinds[j] for j in range(i) if np.linalg.norm(Lab[i] - Lab[j]) < _ALIKE]
        free = [kind for kind in range(len(_STROKES)) if kind not in taken]
        kinds.append(free[0] if free else i % len(_STROKES))
    return [_STROKES[kind] for kind in kinds]


def _number_peaks(
    axes: Axes, w: Array, curves: Array, labels: list[str], colours: list[Any]
) -> None:
    """Each curve's number near its peak, where no other curve or number is in the way."""
    bottom, top = axes.get_ylim()
    scale = np.array([(w[-1] - w[0]) / _ACROSS, (top - bottom) / _ALONG])
    placed: list[Array] = []
    for curve, label, colour in zip(curves, labels, colours, strict=True):
        at = int(np.abs(curve).argmax())
        up = 1 if curve[at] > 0 else -1
        places = []
        for i in np.flatnonzero(up * curve > 0.75 * abs(curve[at])):
            spot = np.array([w[i], curve[i] + up * 0.8 * scale[1]])
            lines = np.abs(curves[:, i] - spot[1]) / scale[1]
            others = [np.abs((spot - p) / scale).max() for p in placed]
            clear = min(1.0, *(lines / 0.6), *others)
            places.append((clear - 0.8 * (1 - abs(curve[i] / curve[at])), int(i), spot))
        _, best, spot = max(places, key=lambda place: place[:2])
        placed.append(spot)
        x = float(np.clip(w[best], w[0] + 4, w[-1] - 4))
        axes.text(x, spot[1], label, ha="center", va="center", fontsize=7.5, color=colour,
                  weight="bold", zorder=6)  # fmt: skip


def _name_ends(axes: Axes, ends: Array, labels: list[str], colours: list[Any]) -> None:
    """Names beside the curves' right ends, pushed apart, hairs where they had to move."""
    bottom, top = axes.get_ylim()
    share = (ends - bottom) / (top - bottom)
    frame = axes.transAxes
    for at, y, label, colour in zip(share, spread(share, 0.056, 0.02, 0.98), labels, colours,
                                    strict=True):  # fmt: skip
        axes.plot([1.0, 1.02], [at, y], transform=frame, color=colour, linewidth=0.6,
                  clip_on=False)  # fmt: skip
        text = write(axes, 1.028, y, label, transform=frame, fontsize=7, color=colour, va="center")
        shortened(text, _WIDEST_NAME)


def _draw_spectrum(axes: Axes, grid: SpectralGrid) -> None:
    """The colours of the wavelengths, as a strip under the axis."""
    strip = axes.inset_axes((0.0, -0.048, 1.0, 0.035))
    nm = np.linspace(grid.start_nm, grid.stop_nm, 600)
    strip.imshow(spectrum_colours(nm)[None], aspect="auto")
    strip.set_axis_off()
