"""A basis in one picture: its sensors, its errors light by light, its worst colours.

basis, error table -> [figure] -> PNG, PDF, SVG

Lines keep to colours that the colour-blind can tell apart, and to shapes besides. matplotlib is
imported late and draws on a canvas of its own: no window, no global state.
"""

from __future__ import annotations

import os
from pathlib import Path
from typing import TYPE_CHECKING, Any

from volspec._files import write_whole
from volspec.basis.figure.errors import NOTHING, draw_errors, matrix_way
from volspec.basis.figure.spectra import draw_spectra, names_in
from volspec.basis.figure.style import FAINT, INK, PAPER, inch_axes, shortened, write
from volspec.basis.figure.swatches import STRIP_IN, draw_swatches
from volspec.basis.materials import MaterialBasis
from volspec.basis.report.errors import WAYS, own_way
from volspec.basis.report.pairs import RGB_PRODUCT
from volspec.basis.report.text import heading_of, number
from volspec.spectra.grid import DEFAULT_GRID

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from volspec.basis.model import SpectralBasis
    from volspec.basis.report.errors import ErrorSummary
    from volspec.basis.report.table import ErrorTable

WIDTH_IN = 10.0
DPI = 160
_MARGIN = 0.42
_CAPTION_LINE = 0.165
_DEFAULT_NM = (DEFAULT_GRID.start_nm, DEFAULT_GRID.stop_nm, DEFAULT_GRID.step_nm)


def basis_figure(basis: SpectralBasis | MaterialBasis, errors: ErrorTable) -> Figure:
    """Draw a basis and its errors; 1600 pixels wide.

    Parameters
    ----------
    basis : SpectralBasis or MaterialBasis
    errors : ErrorTable
        Its own.

    Returns
    -------
    matplotlib.figure.Figure
        On an Agg canvas; ``savefig`` writes it.
    """
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    caption = _CAPTION_LINE * (len(errors.classes) + 1) + 0.2
    strip = caption + 0.13
    plots = strip + (STRIP_IN if _has_colours(errors) else 0.0) + 0.84
    height = plots + 2.5 + 1.06
    figure = Figure(figsize=(WIDTH_IN, height), dpi=DPI, facecolor=PAPER)
    FigureCanvasAgg(figure)
    _draw_title(figure, basis, errors)
    draw_spectra(inch_axes(figure, 0.62, plots, 3.98 - names_in(basis), 2.5), basis)
    draw_errors(inch_axes(figure, 5.32, plots, WIDTH_IN - 5.32 - _MARGIN, 2.5), errors)
    if _has_colours(errors):
        draw_swatches(inch_axes(figure, _MARGIN, strip, WIDTH_IN - 2 * _MARGIN, STRIP_IN), errors)
    _draw_caption(figure, errors, caption)
    return figure


def save_figure(
    basis: SpectralBasis | MaterialBasis, errors: ErrorTable, path: str | os.PathLike[str]
) -> None:
    """Write `basis_figure` as the kind of file that the name says; whole or not at all."""
    kind = Path(path).suffix.lstrip(".").lower()
    with write_whole(path) as temporary:
        basis_figure(basis, errors).savefig(temporary, format=kind, dpi=DPI)


def _has_colours(errors: ErrorTable) -> bool:
    """Whether any colour is off, so that there are worst ones to show."""
    return errors.worst.delta_e > NOTHING


def _draw_title(figure: Figure, basis: SpectralBasis | MaterialBasis, errors: ErrorTable) -> None:
    height = figure.get_figheight()
    left, first, second = _MARGIN / WIDTH_IN, 1 - 0.36 / height, 1 - 0.56 / height
    title = write(figure, left, first, errors.name, fontsize=15, weight="bold", color=INK)
    shortened(title, 4.5)
    edge = title.get_window_extent().x1 / DPI + 0.14
    facts = f"{errors.method}, {errors.size} channels, {errors.observer_deg}° observer"
    if errors.grid_nm != _DEFAULT_NM:
        start, stop, step = errors.grid_nm
        facts += f", {start:g}\N{EN DASH}{stop:g} nm every {step:g} nm"
    write(figure, edge / WIDTH_IN, first, facts, fontsize=9.5, color=FAINT)
    what = (
        "each channel the share of one material: exact by construction"
        if isinstance(basis, MaterialBasis)
        else f"trained on {errors.trained_on}"
    )
    made = f"{what}; measured on {errors.measured_on}"
    line = write(figure, left, second, made, fontsize=7.5, color=FAINT)
    shortened(line, WIDTH_IN - 2 * _MARGIN)


def _draw_caption(figure: Figure, errors: ErrorTable, top: float) -> None:
    """A small table: one line a class, one column a way of making the colour."""
    chained = all(report.products for report in errors.classes.values())
    ways = ("componentwise", matrix_way(errors), RGB_PRODUCT)
    columns = [WAYS[way] for way in ways]
    columns += ["two surfaces", "three surfaces"] if chained else []
    left = _MARGIN + 1.86
    wide = min((WIDTH_IN - _MARGIN - left) / (len(columns) - 0.12), 1.7)
    height = figure.get_figheight()

    def cell(x: float, line: int, text: str, **style: Any) -> None:
        y = (top - 0.1 - _CAPTION_LINE * line) / height
        write(figure, x / WIDTH_IN, y, text, fontsize=7.2, va="center", **style)

    cell(_MARGIN, 0, "ΔE00 mean / median / 95 % / max", color=FAINT)
    for i, column in enumerate(columns):
        cell(left + wide * i, 0, column, color=FAINT)
    for line, (name, report) in enumerate(errors.classes.items(), start=1):
        cell(_MARGIN, line, heading_of(name, len(report.pairs.lights)), color=INK)
        summaries = [report.errors[way] for way in ways]
        summaries += [p.componentwise for p in report.products.values()]
        for i, summary in enumerate(summaries):
            bold = {"weight": "bold"} if columns[i] == WAYS[own_way(errors.method)] else {}
            cell(left + wide * i, line, _four(summary), color=INK, **bold)


def _four(summary: ErrorSummary) -> str:
    values = (summary.mean, summary.median, summary.p95, summary.max)
    shown = (f"{v:.3f}" if v < 0.001 else number(v) for v in values)
    return " / ".join(text.removeprefix("0") for text in shown)
