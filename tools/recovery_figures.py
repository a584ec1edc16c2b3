"""Draw the base spectra, as in figure 1 of Wang, Xu & Sun (2004), and a mixture, as in figure 3.

``python -m tools.recovery_figures`` draws them for docs/reflectance.md, and prints the base's span.
"""

from __future__ import annotations

from collections.abc import Mapping
from itertools import combinations
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import ConvexHull

from volspec._figures import FAINT, HAIR, INK, PAPER, inch_axes, style_axes, write
from volspec._files import write_whole
from volspec.appearance.display.spaces import encode_sRGB
from volspec.basis.figure import line_colour
from volspec.basis.reflectance_figure import save_reflectance_figure
from volspec.spectra import (
    SpectralGrid,
    Spectrum,
    XYZ_from_spectra,
    colour_matching_functions,
    light,
    reflectance_from_colour,
    white_XYZ,
)
from volspec.spectra.construct.base import BaseSpectra, base_spectra
from volspec.spectra.construct.colours import XYZ_from_linear_sRGB

Array = NDArray[np.float64]

IMAGES = Path(__file__).resolve().parent.parent / "docs" / "images"
EXAMPLE = "#c08040"
_LOCUS = SpectralGrid(380, 700, 2)
_WIDTH, _HEIGHT, _DPI = 10.0, 3.75, 120
_TALL = 4.4
_MARK_NM = (480, 500, 520, 540, 560, 580, 600, 620)


def STAGES() -> list[tuple[str, BaseSpectra]]:
    """Return the base before and after Bouguer's law, and also with eq. 6 as printed."""
    return [
        ("measured", base_spectra(powers=())),
        ("with Bouguer's law", base_spectra()),
        ("with the complementary ones besides", base_spectra(complementary=(1, 2, 4))),
    ]


def xy(XYZ: Array) -> Array:
    """Return (n, 2) chromaticities, without black, which has none."""
    total = XYZ.sum(-1)
    return XYZ[total > 1e-6, :2] / total[total > 1e-6, None]


def locus() -> Array:
    """Return (n, 2) chromaticities of monochromatic light."""
    return xy(colour_matching_functions(_LOCUS).T)


def xy_share(base: BaseSpectra) -> float:
    """Return the fraction of the area within the spectral locus that mixtures cover."""
    return float(ConvexHull(_chromaticities(base)).volume / ConvexHull(locus()).volume)


def solid_share(base: BaseSpectra) -> float:
    """Return the fraction of the colour solid of reflectances in 0 to 1 that mixtures cover."""
    E, N = light("D65"), base.grid.size
    # The solid's extreme points reflect all or nothing, with at most two transitions.
    starts, stops = np.triu_indices(N + 1, 1)
    bands = np.arange(N)
    blocks = (bands >= starts[:, None]) & (bands < stops[:, None])
    extreme = XYZ_from_spectra(E, np.vstack([blocks, ~blocks]).astype(float))
    return float(ConvexHull(XYZ_from_spectra(E, base.values)).volume / ConvexHull(extreme).volume)


def _chromaticities(base: BaseSpectra) -> Array:
    return xy(XYZ_from_spectra(light("D65"), base.values))


def draw() -> None:
    """Write base-spectra.png, tetrahedron.png and reflectance.png into docs/images."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=(_WIDTH, _HEIGHT), dpi=_DPI, facecolor=PAPER)
    FigureCanvasAgg(figure)
    (_, measured), (_, enlarged), _ = STAGES()
    _draw_curves(figure, measured)
    _draw_chromaticities(figure, 3.75, "their colours under D65", measured)
    _draw_chromaticities(figure, 6.95, "and what Bouguer's law adds", enlarged)
    with write_whole(IMAGES / "base-spectra.png") as temporary:
        figure.savefig(temporary, format="png", dpi=_DPI)
    made = reflectance_from_colour(EXAMPLE)
    base = base_spectra()
    values = dict(zip(base.names, base.values, strict=True))
    mix = (part.partition(" ") for part in made.notes["mixed from"].split(", "))
    parts = {name: (float(share), values[name]) for share, _, name in mix}
    _save_tetrahedron(base, made, parts)
    lamps = [light("D65"), light("A")]
    save_reflectance_figure(made, parts, lamps, IMAGES / "reflectance.png")


def _save_tetrahedron(
    base: BaseSpectra, made: Spectrum, parts: Mapping[str, tuple[float, Array]]
) -> None:
    """Write the tetrahedron around a colour among the base spectra's, in XYZ under D65."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    E = light("D65")
    to_linear = np.linalg.inv(XYZ_from_linear_sRGB(white_XYZ(E)))

    def shown(XYZ: Array) -> Array:
        return np.asarray(encode_sRGB(np.clip(XYZ @ to_linear.T, 0.0, 1.0)))

    XYZ, wanted = XYZ_from_spectra(E, base.values), XYZ_from_spectra(E, made)
    corners = np.array([XYZ_from_spectra(E, values) for _, values in parts.values()])
    middle, reach = corners.mean(0), 0.62 * np.ptp(corners, axis=0).max()
    near = (np.abs(XYZ - middle) < reach).all(1)
    near &= np.abs(XYZ[:, None] - corners).max(-1).min(1) > 1e-6  # drawn larger
    figure = Figure(figsize=(_TALL, _TALL), dpi=_DPI, facecolor=PAPER)
    FigureCanvasAgg(figure)
    axes: Any = figure.add_axes((0.02, 0.04, 0.93, 0.9), projection="3d", computed_zorder=False)
    axes.view_init(elev=24, azim=-118)
    axes.set_box_aspect((1, 1, 1), zoom=1.0)
    axes.scatter(*XYZ[near].T, s=9, c=shown(XYZ[near]), linewidths=0, alpha=0.7, zorder=1)
    for one, other in combinations(corners, 2):
        axes.plot(*np.stack([one, other]).T, color=INK, linewidth=0.9, zorder=2)
    axes.scatter(*corners.T, s=80, c=shown(corners), edgecolors=INK, linewidths=0.8, zorder=3,
                 depthshade=False)  # fmt: skip
    axes.scatter(*wanted, s=60, c="white", edgecolors=INK, linewidths=1.2, zorder=4)
    for (name, (share, _)), at in zip(parts.items(), corners, strict=True):
        axes.text(
            *(at + 0.3 * (at - middle)), f"{share:.0%}\n{name}", fontsize=7, color=INK, ha="center",
            va="center", zorder=5,
        )  # fmt: skip
    for name, centre in zip("xyz", middle, strict=True):
        axes.set(**{f"{name}lim": (centre - reach, centre + reach)})
        getattr(axes, f"set_{name}label")(name.upper(), fontsize=8, color=FAINT, labelpad=-6)
        axis = getattr(axes, f"{name}axis")
        axis.set_pane_color((1, 1, 1, 0))
        axis.line.set_color(HAIR)
        axis._axinfo["grid"].update(color=HAIR, linewidth=0.5)
    axes.tick_params(labelsize=6.5, labelcolor=FAINT, pad=-2)
    write(figure, 0.05, 0.95, f"{made.name} among the base spectra", fontsize=9.5, color=INK)
    with write_whole(IMAGES / "tetrahedron.png") as temporary:
        figure.savefig(temporary, format="png", dpi=_DPI)


def _draw_curves(figure: Any, measured: BaseSpectra) -> None:
    axes = inch_axes(figure, 0.45, 0.5, 2.75, 2.7)
    style_axes(axes)
    w = measured.grid.wavelengths_nm
    axes.set(xlim=(w[0], w[-1]), ylim=(0, 1), yticks=[0, 0.5, 1])
    axes.set_xlabel("wavelength, nm", fontsize=8, color=FAINT, labelpad=3)
    # Flat ones are not measured.
    curves = [values for values in measured.values if np.ptp(values) > 0.0]
    for values in curves:
        axes.plot(w, values, color=line_colour(values, measured.grid), linewidth=0.45, alpha=0.55)
    title = f"{len(curves)} measured reflectances"
    write(figure, 0.45 / _WIDTH, 1 - 0.3 / _HEIGHT, title, fontsize=9.5, color=INK)


def _draw_chromaticities(figure: Any, left: float, title: str, base: BaseSpectra) -> None:
    axes = inch_axes(figure, left, 0.5, 2.8, 2.7)
    style_axes(axes)
    # One unit is as long in y as in x.
    axes.set(xlim=(0, 0.8 * 2.8 / 2.7 + 0.03), ylim=(0, 0.86), xticks=[0, 0.2, 0.4, 0.6],
             yticks=[0.2, 0.4, 0.6, 0.8])  # fmt: skip
    axes.set_aspect("equal", adjustable="box", anchor="SW")
    axes.spines["bottom"].set_color(HAIR)
    around = locus()
    axes.fill(*around.T, facecolor="#f6f6f7", edgecolor=FAINT, linewidth=0.9)
    for nm in _MARK_NM:
        x, y = around[int((nm - _LOCUS.start_nm) / _LOCUS.step_nm)]
        axes.plot(x, y, ".", color=FAINT, markersize=2.5)
        # Away from the locus, whose left side rises to 520 nm.
        side = {"ha": "right"} if nm < 520 else {"ha": "left", "va": "bottom"}
        write(
            axes, x + (0.012 if nm >= 520 else -0.015), y, str(nm), fontsize=6, color=FAINT, **side
        )
    E = light("D65")
    white = white_XYZ(E)
    XYZ = XYZ_from_spectra(E, base.values)
    seen = XYZ.sum(1) > 1e-6
    # As bright as the screen shows the chromaticity: dark base spectra are points too.
    linear = XYZ[seen] @ np.linalg.inv(XYZ_from_linear_sRGB(white)).T
    linear = np.maximum(linear, 0) / np.maximum(linear.max(1, keepdims=True), 1e-12)
    points = xy(XYZ)
    axes.scatter(*points.T, s=4.5, c=encode_sRGB(0.8 * linear), linewidths=0, zorder=3)
    hull = points[ConvexHull(points).vertices]
    axes.plot(*np.vstack([hull, hull[:1]]).T, color=INK, linewidth=0.8, zorder=4)
    screen = xy(XYZ_from_linear_sRGB(white).T)
    axes.plot(*np.vstack([screen, screen[:1]]).T, color=FAINT, linewidth=0.7,
              linestyle=(0, (3, 2)), zorder=2)  # fmt: skip
    write(axes, 0.55, 0.06, "dashed: sRGB", fontsize=6.5, color=FAINT)
    write(figure, left / _WIDTH, 1 - 0.3 / _HEIGHT, title, fontsize=9.5, color=INK)
    share, solid = xy_share(base), solid_share(base)
    facts = f"{share:.0%} of the locus, {solid:.0%} of the colour solid"
    write(figure, left / _WIDTH, 1 - 0.47 / _HEIGHT, facts, fontsize=7.5, color=FAINT)


def print_coverage() -> None:
    """Print the colours that the base spectra span."""
    print("\nspan of the base spectra under D65: of the area within the spectral locus in xy,")
    print("of the volume of the object-colour solid in XYZ")
    for title, base in STAGES():
        print(f"  {title:38s}{len(base):6d} spectra{xy_share(base):8.1%}{solid_share(base):8.1%}")


if __name__ == "__main__":
    draw()
    print_coverage()
