"""What a basis sees: its sensors, basis vectors or materials over wavelength.

[spectra] -> figure
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from volspec.appearance import constants as k
from volspec.appearance import srgb
from volspec.appearance.models import XYZ_from_cielab, cielab
from volspec.appearance.wavelengths import spectrum_colours
from volspec.basis.figure.style import FAINT, INK, plain, shortened, spread
from volspec.spectra.grid import SpectralGrid
from volspec.spectra.photometry import color_matching_functions

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from volspec.basis.materials import MaterialBasis
    from volspec.basis.model import SpectralBasis

Array = NDArray[np.float64]

_SHOWN_NM = (400.0, 700.0)
_LINE_LIGHTNESS = (30.0, 58.0)
_WIDEST_NAME = 1.1
# How many numbers fit across and along the plot.
_ACROSS, _ALONG = 28.0, 16.0
# Colours nearer than this in CIELAB are told apart by strokes.
_ALIKE = 14.0
_STROKES = ("-", (0, (4.0, 1.2)), (0, (1.2, 1.0)), (0, (6.0, 1.2, 1.2, 1.2)))


def draw_spectra(axes: Axes, basis: SpectralBasis | MaterialBasis) -> None:
    """Sensors, basis vectors or reflectances, each in the colour it stands for."""
    grid = basis.grid
    materials = getattr(basis, "materials", None)
    if materials is not None:
        title, labels = "reflectances of the materials", list(materials)
        curves = np.array([spectrum.on(grid).values for spectrum in materials.values()])
    elif basis.method.startswith("pca"):
        title, curves = "basis vectors (columns of B)", basis.synthesis.T  # type: ignore[union-attr]
        labels = [str(i + 1) for i in range(basis.size)]
    else:
        title, curves = "sensors (rows of A)", basis.analysis  # type: ignore[union-attr]
        labels = [str(i + 1) for i in range(basis.size)]
    w = grid.wavelengths_nm
    shown = (w >= _SHOWN_NM[0]) & (w <= _SHOWN_NM[1])
    low, high = min(float(curves[:, shown].min()), 0.0), float(curves[:, shown].max())
    room = 0.1 * (high - low)
    colours = [line_colour(curve, grid) for curve in curves]
    strokes = _strokes(colours)
    axes.set(xlim=_SHOWN_NM, ylim=(low - (room if low < 0 else 0), high + room))
    plain(axes)
    axes.axhline(0, color=FAINT, linewidth=0.6, zorder=1)
    for curve, colour, stroke in zip(curves, colours, strokes, strict=True):
        axes.plot(w, curve, color=colour, linewidth=1.7, linestyle=stroke, zorder=3)
    if materials is not None:
        axes.set_ylim(0, max(1.0, 1.05 * high))
        _name_ends(axes, curves[:, shown][:, -1], labels, colours)
    else:
        axes.set_yticks([0])
        _number_peaks(axes, w[shown], curves[:, shown], labels, colours)
    axes.text(0, 1.105, title, transform=axes.transAxes, fontsize=9.5, color=INK, va="center")
    axes.tick_params(axis="x", pad=11)
    axes.set_xticks(range(400, 701, 50))
    axes.set_xlabel("wavelength, nm", fontsize=8, color=FAINT, labelpad=3)
    _draw_spectrum(axes)


def names_in(basis: SpectralBasis | MaterialBasis) -> float:
    """Inches that the names of materials take beside their curves."""
    longest = max(map(len, getattr(basis, "materials", None) or [""]))
    return min(0.062 * longest + 0.05, _WIDEST_NAME) if longest else 0.0


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
        text = axes.text(1.028, y, label, transform=frame, fontsize=7, color=colour, va="center")
        shortened(text, _WIDEST_NAME)


def _draw_spectrum(axes: Axes) -> None:
    """The colours of the wavelengths, as a strip under the axis."""
    strip = axes.inset_axes((0.0, -0.048, 1.0, 0.035))
    strip.imshow(spectrum_colours(np.linspace(*_SHOWN_NM, 600))[None], aspect="auto")
    strip.set_axis_off()
