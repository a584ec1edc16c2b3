"""The error table for a terminal of 80 columns.

ErrorTable -> [text] -> rich
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from rich.table import Table
from rich.text import Text

from volspec.basis.report.errors import WAYS, BasisReport, ErrorSummary, own_way

if TYPE_CHECKING:
    from volspec.basis.report.table import ErrorTable

_SURFACES = {2: "two surfaces", 3: "three surfaces"}


def number(delta_e: float) -> str:
    """A CIEDE2000 to three figures, never in powers of ten."""
    if delta_e < 0.001:
        return "< .001" if delta_e > 1e-9 else "0"
    decimals = 3 if delta_e < 1 else 2 if delta_e < 10 else 1 if delta_e < 100 else 0
    return f"{delta_e:.{decimals}f}"


def terminal_table(errors: ErrorTable) -> Table:
    """Classes of lights below each other, the RGB renderer beside the basis."""
    table = Table(box=None, pad_edge=False, header_style="", show_edge=False)
    table.add_column("ΔE00, the light as white", style="dim", header_style="dim", min_width=24)
    for heading in ("mean", "median", "95 %", "max"):
        table.add_column(heading, justify="right", min_width=6, header_style="dim")
    table.add_column("  RGB mean", justify="right", min_width=10, style="dim", header_style="dim")
    table.add_column("max", justify="right", min_width=6, style="dim", header_style="dim")
    for position, (name, report) in enumerate(errors.classes.items()):
        if position:
            table.add_row()
        table.add_row(Text(heading_of(name, len(report.pairs.lights)), style="bold not dim"))
        for label, summary, rgb in _rows(report):
            cells = [number(v) for v in (summary.mean, summary.median, summary.p95, summary.max)]
            if rgb:
                cells += [number(rgb.mean), number(rgb.max)]
            style = "bold" if label == WAYS[own_way(errors.method)] else ""
            table.add_row(f"  {label}", *(Text(cell, style=style) for cell in cells))
    return table


def heading_of(name: str, count: int) -> str:
    """A class of lights in words."""
    owner = "the scene's lights" if name == "scene" else f"{name} lights"
    return f"{owner} ({count})"


def worst_line(errors: ErrorTable, colours: bool) -> Text:
    """The worst pair, its colours beside each other where the terminal has some."""
    worst = errors.worst
    text = Text("worst: ")
    text.append(worst.reflectance, style="bold")
    text.append(" under ")
    text.append(worst.light, style="bold")
    text.append(f", ΔE00 {number(worst.delta_e)} ({WAYS[worst.way]})\n  full spectra ")
    _swatch(text, worst.sRGB, colours)
    text.append(f"   {errors.size} channels ")
    _swatch(text, worst.sRGB_shown, colours)
    return text


def verdict(errors: ErrorTable) -> str:
    """How the RGB renderer stands against the basis, in one sentence."""
    parts = []
    for name, report in errors.classes.items():
        ours = report.errors[own_way(errors.method)].mean
        theirs = report.rgb_product.mean
        if ours > 1e-6:
            times = float(f"{theirs / ours:.2g}")
            heading = heading_of(name, 0).partition(" (")[0]
            parts.append(f"{times:,.{0 if times >= 10 else 1}f} times as far under {heading}")
    return f"RGB light times RGB surface is off {', '.join(parts)}." if parts else ""


def _rows(report: BasisReport) -> list[tuple[str, ErrorSummary, ErrorSummary | None]]:
    rows: list[tuple[str, ErrorSummary, ErrorSummary | None]] = [
        (WAYS["componentwise"], report.componentwise, report.rgb_product)
    ]
    for n, errors in report.products.items():
        rows.append((_SURFACES[n], errors.componentwise, errors.rgb_product))
    rows += [(WAYS[way], report.errors[way], None) for way in ("linear-model", "exact")]
    return rows


def _swatch(text: Text, code: str, colours: bool) -> None:
    if colours:
        text.append("      ", style=f"on {code}")
        text.append(" ")
    text.append(code)
