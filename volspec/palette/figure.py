"""Draw a palette as one picture: lights across, reflectances down, and the colours of both.

design, report -> [figure] -> PNG, PDF, SVG

After figures 1 and 2 of [1]: in each cell the surround is the colour obtained, and the framed
square is the colour wanted; the spectra are in the margins. If reflectances are to be distinguished
with a colour-vision deficiency, a strip in each cell shows its colour as simulated.

References
----------
[1] Bergner, Drew & Möller (2009), ACM TOG 28(1) art. 5.
"""

from __future__ import annotations

import os
from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

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
from volspec._files import require_suffix
from volspec.appearance.comparison import SYMBOLS
from volspec.appearance.display import (
    DEFICIENCIES,
    ColourSpace,
    Simulation,
    simulation,
    spectrum_colours,
)
from volspec.palette.measures import CellReport
from volspec.palette.model import Palette
from volspec.palette.optimisation import Design
from volspec.palette.report import DesignReport
from volspec.spectra import SpectralGrid

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

Array = NDArray[np.float64]

FIGURE_SUFFIXES = (".png", ".svg", ".pdf")
# Inches. Cells shrink from the largest to the smallest as a palette grows.
_CELLS, _MAX_SIDE, _MIN_SIDE = 7.2, 1.25, 0.56
_MARGIN, _GAP, _KEY, _LINE = 0.36, 0.07, 0.5, 0.17
_MIN_WIDTH, _MAX_NAME = 5.6, 1.9
_SLANT_DEG = 36.0
# L* = 50: colours are judged on a neutral grey.
_GREY = "#777777"
# Luma above which black is easier to read than white.
_LIGHT = 0.55
_VISIBLE = 1.0
# Height of the strip of simulated colours, as a fraction of a cell.
_STRIP = 0.18


def palette_figure(design: Design, report: DesignReport | None = None, title: str = "") -> Figure:
    """Draw a designed palette under a title; ``report`` is the design's own by default."""
    report = report or DesignReport.of(design)
    layout = _Layout(*design.palette.names, bool(title))
    figure = new_figure(layout.width, layout.height)
    if title:
        y = 1.0 - 0.3 / layout.height
        text = write(figure, _MARGIN / layout.width, y, title, fontsize=12, weight="bold",
                     color=INK, va="center")  # fmt: skip
        shorten(text, layout.width - 2 * _MARGIN)
    _draw_lights(figure, layout, design)
    _draw_reflectances(figure, layout, design)
    vision = _Vision.of(design.palette)
    _draw_cells(figure, layout, report, vision)
    _draw_key(figure, layout, report, design.palette.grid, vision)
    return figure


def save_palette_figure(
    design: Design,
    path: str | os.PathLike[str],
    report: DesignReport | None = None,
    title: str = "",
) -> None:
    """Write `palette_figure` as .png, .svg or .pdf, atomically; refuse other suffixes."""
    require_suffix(path, "figures", *FIGURE_SUFFIXES)
    write_figure(palette_figure(design, report, title), path)


@dataclass(frozen=True, slots=True, eq=False)
class _Vision:
    """Deficiencies that a palette's reflectances are to be distinguished with."""

    space: ColourSpace
    simulations: Mapping[str, Simulation]

    @classmethod
    def of(cls, palette: Palette) -> _Vision:
        """Return the simulations that a palette asks for, each at its greatest severity."""
        space, severities = (
            palette.viewing.display.colours,
            dict[str, float].fromkeys(DEFICIENCIES, 0.0),
        )
        for row in palette.apart:
            for name in row.deficiencies:
                severities[name] = max(severities[name], row.severity)
        models = {name: simulation(name, severity, space) for name, severity in severities.items()}
        return cls(space, {name: m for name, m in models.items() if m is not None})

    def codes(self, encoded: Array) -> dict[str, Array]:
        """Return a colour's codes as simulated, by deficiency."""
        linear = self.space.decode(encoded)
        return {
            name: self.space.encode(np.clip(model.apply(linear), 0.0, 1.0))
            for name, model in self.simulations.items()
        }


class _Layout:
    """Positions and sizes, in inches from the lower left."""

    def __init__(self, rows: tuple[str, ...], columns: tuple[str, ...], titled: bool) -> None:
        self.rows, self.columns = len(rows), len(columns)
        count = max(self.rows, self.columns)
        self.side = float(np.clip(_CELLS / count, _MIN_SIDE, _MAX_SIDE))
        self.font = 6.5 + 2.5 * (self.side - _MIN_SIDE) / (_MAX_SIDE - _MIN_SIDE)
        self.plot = (max(1.25 * self.side, 0.8), max(0.72 * self.side, 0.5))
        self.names = self._name_width(rows)
        self.left = _MARGIN + self.names + self.plot[0] + 0.22
        self.bottom = _KEY + 0.38
        pitch = self.side + _GAP
        self.width = max(self.left + self.columns * pitch + _GAP + _MARGIN, _MIN_WIDTH)
        # Names of lights are slanted if one is wider than its column.
        widest = self._name_width(columns)
        self.aslant = widest > self.side
        above = 0.62 * widest + 0.1 if self.aslant else 0.18
        if self.aslant:
            self.width += max(0.82 * widest - self.side / 2 - _MARGIN, 0.0)
        top = self.plot[1] + above + 0.32 + (0.42 if titled else 0.0)
        self.height = self.bottom + self.rows * pitch + _GAP + top

    def _name_width(self, names: tuple[str, ...]) -> float:
        """Return the width of the longest name in inches, up to a limit."""
        return min(max(map(len, names)) * 0.6 * self.font / 72.0 + 0.06, _MAX_NAME)

    def cell(self, row: int, column: int) -> tuple[float, float]:
        """Return the lower left corner of a cell."""
        pitch = self.side + _GAP
        return self.left + _GAP + column * pitch, self.bottom + _GAP + (self.rows - 1 - row) * pitch


def _draw_lights(figure: Figure, layout: _Layout, design: Design) -> None:
    for j, name in enumerate(design.palette.names[1]):
        x, y = layout.cell(0, j)
        low = y + layout.side + _GAP + 0.1
        axes = inch_axes(figure, x, low, layout.side, layout.plot[1])
        values = design.state.E[j]
        _draw_spectrum(axes, design.palette.grid, values / values.max(), 1.08)
        middle, above = (x + layout.side / 2) / layout.width, low + layout.plot[1] + 0.11
        text = write(figure, middle, above / layout.height, name, va="center", fontsize=layout.font,
                     color=INK, ha="left" if layout.aslant else "center")  # fmt: skip
        shorten(text, _MAX_NAME)
        if layout.aslant:
            text.set(rotation=_SLANT_DEG, rotation_mode="anchor")


def _draw_reflectances(figure: Figure, layout: _Layout, design: Design) -> None:
    top = max(1.0, float(design.state.S.max()))
    width = layout.plot[0]
    for i, name in enumerate(design.palette.names[0]):
        _, y = layout.cell(i, 0)
        axes = inch_axes(figure, layout.left - 0.12 - width, y, width, layout.side)
        axes.axhline(1.0, color=HAIR, linewidth=0.6, zorder=0)
        _draw_spectrum(axes, design.palette.grid, design.state.S[i], 1.04 * top)
        if i == 0:
            write(axes, -0.02, 1.0, "1", transform=axes.get_yaxis_transform(), ha="right",
                  va="center", fontsize=0.8 * layout.font, color=FAINT)  # fmt: skip
        if i == layout.rows - 1:
            _draw_ticks(axes, design.palette.grid, layout.font)
        x = (layout.left - 0.24 - width) / layout.width
        text = write(figure, x, (y + layout.side / 2) / layout.height, name, ha="right",
                     va="center", fontsize=layout.font, color=INK)  # fmt: skip
        shorten(text, layout.names)


def _draw_spectrum(axes: Axes, grid: SpectralGrid, values: Array, top: float) -> None:
    """Draw a curve, filled with the colours of the wavelengths."""
    from matplotlib.patches import Polygon

    w = grid.wavelengths_nm
    low = min(0.0, 1.05 * float(values.min()))
    axes.set(xlim=(w[0], w[-1]), ylim=(low, top), xticks=[], yticks=[])
    style_axes(axes)
    axes.spines["bottom"].set_position(("data", 0.0))
    axes.patch.set_alpha(0.0)
    nm = np.linspace(w[0], w[-1], 400)
    extent = (float(w[0]), float(w[-1]), low, top)
    # Blended with the paper: these are colours of wavelengths, not of the palette.
    pale = 0.45 + 0.55 * spectrum_colours(nm)
    strip = axes.imshow(pale[None], extent=extent, aspect="auto", zorder=1)
    outline = np.column_stack([[w[0], *w, w[-1]], [0.0, *values, 0.0]])
    strip.set_clip_path(Polygon(outline, closed=True, transform=axes.transData))
    axes.plot(w, values, color=INK, linewidth=0.9, zorder=3, solid_joinstyle="round")


def _draw_ticks(axes: Axes, grid: SpectralGrid, font: float) -> None:
    first, last = grid.start_nm, grid.stop_nm
    labels = {first: f"{first:g}", (first + last) / 2: "nm", last: f"{last:g}"}
    for x, words in labels.items():
        write(axes, x, -0.05, words, transform=axes.get_xaxis_transform(), ha="center", va="top",
              fontsize=0.8 * font, color=FAINT)  # fmt: skip


def _draw_cells(figure: Figure, layout: _Layout, report: DesignReport, vision: _Vision) -> None:
    pitch = layout.side + _GAP
    width, height = layout.columns * pitch + _GAP, layout.rows * pitch + _GAP
    axes = inch_axes(figure, layout.left, layout.bottom, width, height)
    axes.set(xlim=(0, width), ylim=(0, height))
    axes.set_axis_off()
    _square(axes, 0, 0, width, height, facecolor=_GREY)
    for number, cell in enumerate(report.cells):
        x, y = layout.cell(*divmod(number, layout.columns))
        x, y = x - layout.left, y - layout.bottom
        _draw_cell(axes, x, y, layout, cell, bool(vision.simulations))
        simulated = vision.codes(np.clip(cell.obtained, 0.0, 1.0))
        for place, (name, codes) in enumerate(simulated.items()):
            width, left = layout.side / len(simulated), x + place * layout.side / len(simulated)
            _square(axes, left, y, width, _STRIP * layout.side, facecolor=codes)
            write(axes, left + 0.04, y + _STRIP * layout.side / 2, name, va="center",
                  fontsize=0.7 * layout.font, color=_legible(codes))  # fmt: skip


def _draw_cell(
    axes: Axes, x: float, y: float, layout: _Layout, cell: CellReport, striped: bool
) -> None:
    low = y + (_STRIP * layout.side if striped else 0.0)
    side, codes = layout.side, np.clip(cell.obtained, 0.0, 1.0)
    _square(axes, x, y, side, side, facecolor=codes)
    on = _legible(codes)
    size = 0.44 * side
    xy = x + (side - size) / 2, y + (side - size) / 2
    middle = x + side / 2, y + side / 2
    mark = {"same": "=", "distinct": "≠"}.get(cell.kind)
    if cell.kind == "distinct":
        _square(axes, *xy, size, size, facecolor="none", edgecolor=on, alpha=0.35, linewidth=0.6)
    elif cell.wanted is not None:
        inner = np.clip(cell.wanted, 0.0, 1.0)
        dashes: Any = (0, (2.2, 1.8)) if cell.kind in ("free", "same") else "solid"
        _square(axes, *xy, size, size, facecolor=inner)
        _square(axes, *xy, size, size, facecolor="none", edgecolor=on, alpha=0.6,
                linewidth=0.7, linestyle=dashes)  # fmt: skip
    if mark:
        write(axes, *middle, mark, ha="center", va="center", fontsize=1.1 * layout.font,
              color=on, alpha=0.7)  # fmt: skip
    if cell.error is not None and cell.error > _VISIBLE:
        write(axes, x + side - 0.05, low + 0.05, f"{cell.error:.{1 if cell.error < 9.95 else 0}f}",
              ha="right", va="bottom", fontsize=0.85 * layout.font, color=on)  # fmt: skip
    if not cell.in_gamut:
        write(axes, x + side - 0.06, y + side - 0.05, "!", ha="right", va="top",
              fontsize=0.85 * layout.font, weight="bold", color=on)  # fmt: skip


def _legible(codes: Array) -> str:
    """Return the colour of writing on a colour."""
    return "black" if float(codes @ (0.299, 0.587, 0.114)) > _LIGHT else "white"


def _square(axes: Axes, x: float, y: float, width: float, height: float, **style: Any) -> None:
    from matplotlib.patches import Rectangle

    axes.add_patch(Rectangle((x, y), width, height, **{"linewidth": 0.0, **style}))


def _draw_key(
    figure: Figure, layout: _Layout, report: DesignReport, grid: SpectralGrid, vision: _Vision
) -> None:
    kinds, symbol = {cell.kind for cell in report.cells}, SYMBOLS[report.difference]
    words = ["surround: obtained", "square: wanted"]
    words += ["dashed: left free"] * ("free" in kinds)
    words += ["=: the same as another"] * ("same" in kinds)
    words += ["≠: apart from another"] * ("distinct" in kinds)
    words += ["strip: as simulated"] * bool(vision.simulations)
    words += [f"number: {symbol} above 1"] * (report.max > _VISIBLE)
    words += ["!: outside the display"] * any(not cell.in_gamut for cell in report.cells)
    totals = (
        f"{symbol} mean {report.mean:.2f}, largest {report.max:.2f} on {grid.size} bands; "
        f"exposure {report.exposure:.3g}"
    )
    if report.metamers:
        largest = max(pair.delta_E for pair in report.metamers)
        fine = max(pair.delta_E_1nm for pair in report.metamers)
        totals += f"; metamers apart {largest:.2f}, at 1 nm {fine:.2f}"
    axes = inch_axes(figure, _MARGIN, 0.1, layout.width - 2 * _MARGIN, _KEY)
    axes.set(xlim=(0, layout.width - 2 * _MARGIN), ylim=(0, _KEY))
    axes.set_axis_off()
    axes.axhline(_KEY - 0.02, color=HAIR, linewidth=0.6)
    for line, caption in enumerate(("  ·  ".join(words), totals)):
        text = write(axes, 0, _KEY - 0.16 - _LINE * line, caption, fontsize=7.2, color=FAINT,
                     va="center")  # fmt: skip
        fit = (layout.width - 2 * _MARGIN) * DPI / max(text.get_window_extent().width, 1.0)
        text.set_fontsize(7.2 * min(1.0, 0.96 * fit))  # small type is a little wider
