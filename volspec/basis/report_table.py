"""Error table of a basis over several classes of lights: as data, JSON or terminal output.

basis, {class: lights}, reflectances -> [report_table] -> command line, figure
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, astuple, dataclass
from typing import Any

import numpy as np
from rich.table import Table
from rich.text import Text

from volspec.basis.display import DEFAULT_MODE
from volspec.basis.materials import Basis
from volspec.basis.report import (
    ADAPTATION,
    WAYS,
    BasisReport,
    ErrorSummary,
    Reflectances,
    WorstPair,
    basis_report,
    round_delta,
)
from volspec.errors import BasisError
from volspec.spectra import SpectralGrid, Spectrum
from volspec.spectra.library import light_set

CLASSES = ("smooth", "spiky")
"""Classes of the library's lights."""


@dataclass(frozen=True, slots=True)
class ErrorTable:
    """Reports of a basis by class of lights: ``smooth``, ``spiky``, ``scene`` (a scene's own)."""

    basis: Basis
    measured_on: str  # description of the reflectances
    classes: Mapping[str, BasisReport]

    @property
    def worst_class(self) -> str:
        """Class of the overall worst pair."""
        return max(self.classes, key=lambda name: round_delta(self.classes[name].worst.delta_e))

    @property
    def worst(self) -> WorstPair:
        """Worst pair of all classes."""
        return self.classes[self.worst_class].worst

    @property
    def rgb_product(self) -> ErrorSummary:
        """Errors of the RGB renderer over all classes."""
        return ErrorSummary.of(
            np.concatenate([r.pairs.rgb_product.ravel() for r in self.classes.values()])
        )

    def to_dict(self) -> dict[str, Any]:
        """Return JSON types, as ``volspec basis --json`` prints them."""
        return {
            **{name: getattr(self.basis, name) for name in ("name", "method", "size")},
            "trained_on": self.basis.trained_on,
            "measured_on": self.measured_on,
            "fingerprint": self.basis.fingerprint,
            "observer_deg": self.basis.observer_deg,
            "grid_nm": list(astuple(self.basis.grid)),
            "classes": {name: _class_dict(r) for name, r in self.classes.items()},
            "rgb_product": asdict(self.rgb_product)
            | {name: asdict(r.rgb_product) for name, r in self.classes.items()},
            "worst": _worst_dict(self.worst)
            | {"class": self.worst_class, "adaptation": ADAPTATION},
        }


def error_table(
    basis: Basis,
    classes: Mapping[str, Sequence[Spectrum]] | None = None,
    reflectances: Reflectances | None = None,
    names: Sequence[str] | None = None,
    *,
    measured_on: str = "",
    grid: SpectralGrid | None = None,
    progress: Callable[[float], None] = lambda fraction: None,
) -> ErrorTable:
    """Report on a basis class by class, by default for the library's smooth and spiky lights.

    Reflectances, names, grid and errors are as in `basis_report`. ``measured_on`` describes the
    reflectances; ``progress`` is called with the finished fraction, 0…1.
    """
    if classes is None:
        classes = {name: light_set(name, grid or basis.grid) for name in CLASSES}
    if not classes:
        raise BasisError("report: no lights given; nothing to compare", code="missing")
    reports: dict[str, BasisReport] = {}
    total = sum(map(len, classes.values()))
    for name, lights in classes.items():
        reports[name] = basis_report(basis, lights, reflectances, names, grid)
        done = sum(len(r.pairs.lights) for r in reports.values())
        progress(done / total)
    count = len(next(iter(reports.values())).pairs.reflectances)
    return ErrorTable(basis, measured_on or f"{count} reflectances", reports)


def _class_dict(report: BasisReport) -> dict[str, Any]:
    products = {
        str(n): asdict(errors.fitted)
        | {
            "componentwise": asdict(errors.componentwise),
            "rgb_product": asdict(errors.rgb_product),
        }
        for n, errors in report.products.items()
    }
    return asdict(report.fitted) | {
        "lights": len(report.pairs.lights),
        "reflectances": len(report.pairs.reflectances),
        "componentwise": asdict(report.componentwise),
        "exact": asdict(report.exact),
        "linear_model": asdict(report.linear_model),
        "rgb_product": asdict(report.rgb_product),
        "products": products,
        "worst": _worst_dict(report.worst),
    }


def _worst_dict(worst: WorstPair) -> dict[str, Any]:
    return {name: list(v) if isinstance(v, tuple) else v for name, v in asdict(worst).items()}


_SURFACES = {2: "two surfaces", 3: "three surfaces"}


def format_delta_e(delta_e: float) -> str:
    """Format a CIEDE2000 difference to three figures, never in scientific notation."""
    if delta_e < 0.001:
        return "< .001" if delta_e > 1e-9 else "0"
    decimals = 3 if delta_e < 1 else 2 if delta_e < 10 else 1 if delta_e < 100 else 0
    return f"{delta_e:.{decimals}f}"


def terminal_table(errors: ErrorTable) -> Table:
    """Return a table with a block per class of lights, and columns for the RGB renderer."""
    table = Table(box=None, pad_edge=False, header_style="", show_edge=False)
    table.add_column("ΔE00, the light as white", style="dim", header_style="dim", min_width=24)
    for heading in ("mean", "median", "95 %", "max"):
        table.add_column(heading, justify="right", min_width=6, header_style="dim")
    table.add_column("  RGB mean", justify="right", min_width=10, style="dim", header_style="dim")
    table.add_column("max", justify="right", min_width=6, style="dim", header_style="dim")
    for position, (name, report) in enumerate(errors.classes.items()):
        if position:
            table.add_row()
        table.add_row(Text(class_heading(name, len(report.pairs.lights)), style="bold not dim"))
        for label, summary, rgb in _rows(report):
            cells = [
                format_delta_e(v) for v in (summary.mean, summary.median, summary.p95, summary.max)
            ]
            if rgb:
                cells += [format_delta_e(rgb.mean), format_delta_e(rgb.max)]
            style = "bold" if label == WAYS[DEFAULT_MODE] else ""
            table.add_row(f"  {label}", *(Text(cell, style=style) for cell in cells))
    return table


def class_heading(name: str, count: int) -> str:
    """Return the heading of a class of lights."""
    owner = "the scene's lights" if name == "scene" else f"{name} lights"
    return f"{owner} ({count})"


def worst_line(errors: ErrorTable, colours: bool) -> Text:
    """Return the worst pair, with colour swatches if the terminal has colours."""
    worst = errors.worst
    text = Text("worst: ")
    text.append(worst.reflectance, style="bold")
    text.append(" under ")
    text.append(worst.light, style="bold")
    text.append(f", ΔE00 {format_delta_e(worst.delta_e)} ({WAYS[worst.way]})\n  full spectra ")
    _swatch(text, worst.sRGB, colours)
    text.append(f"   {errors.basis.size} channels ")
    _swatch(text, worst.sRGB_shown, colours)
    return text


def verdict(errors: ErrorTable) -> str:
    """Return a sentence that compares the RGB renderer with the basis."""
    parts = []
    for name, report in errors.classes.items():
        ours = report.fitted.mean
        theirs = report.rgb_product.mean
        if ours > 1e-6:
            times = float(f"{theirs / ours:.2g}")
            heading = class_heading(name, 0).partition(" (")[0]
            parts.append(f"{times:,.{0 if times >= 10 else 1}f} times the error under {heading}")
    return f"RGB light times RGB surface has {', '.join(parts)}." if parts else ""


def _rows(report: BasisReport) -> list[tuple[str, ErrorSummary, ErrorSummary | None]]:
    rows: list[tuple[str, ErrorSummary, ErrorSummary | None]] = [
        (WAYS["fitted"], report.fitted, report.rgb_product)
    ]
    for n, errors in report.products.items():
        rows.append((_SURFACES[n], errors.fitted, errors.rgb_product))
    modes = ("exact", "componentwise", "linear-model")
    return rows + [(WAYS[mode], report.errors[mode], None) for mode in modes]


def _swatch(text: Text, code: str, colours: bool) -> None:
    if colours:
        text.append("      ", style=f"on {code}")
        text.append(" ")
    text.append(code)
