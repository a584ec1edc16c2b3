"""Colour error of bases, and time of a fit: ``python -m benchmarks.basis [--keep]``.

CIEDE2000 against full spectra, the light as white: trained on the 128 training reflectances,
measured on the 84 held-out ones; then the general bases on reflectances that were not used in their
development. Then median seconds of five fits, with imports and tables warm: for designed spectra
alone, for scenes (their own lights, and the library's at a tenth of the weight), and for the
shipped bases. Takes three minutes. With ``--keep`` the tables are written to ``docs/bases.md``.
"""

from __future__ import annotations

import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from statistics import median

import numpy as np

from benchmarks.measure import replaced
from volspec.basis import SpectralBasis
from volspec.basis.make import fit_shipped
from volspec.basis.report import RGB_PRODUCT, BasisReport, ErrorSummary, basis_report
from volspec.spectra import (
    DEFAULT_GRID,
    PAPERS_GRID,
    SpectralGrid,
    Spectrum,
    light_set,
    reflectance,
    reflectance_set,
)
from volspec.spectra.library.reflectances import reflectance_set_names

PAGE = Path(__file__).resolve().parent.parent / "docs" / "bases.md"
SIZES = (5, 7, 9)
RUNS = 5
FINE, WHOLE = SpectralGrid(380, 780, 1), SpectralGrid(360, 830, 1)
KINDS = ("smooth", "spiky")
Reports = list[BasisReport]
HEAD = "| basis | smooth lights | spiky lights |\n|---|---|---|"


def shipped(name: str) -> SpectralBasis:
    """Return a basis by its name in the tables: one of the papers', bands, or a shipped one."""
    if name.startswith("pca"):
        method, size = name.rsplit("-", 1)
        lights, surfaces = light_set("smooth"), reflectance_set("training")
        return SpectralBasis.fit(lights, surfaces, size=int(size), method=method)
    if name.endswith("bands"):
        return SpectralBasis.bands(PAPERS_GRID if name.startswith("31") else DEFAULT_GRID)
    return SpectralBasis.load(name)


def samples(name: str, grid: SpectralGrid) -> list[Spectrum]:
    """Return the reflectances of a set on a grid."""
    return [reflectance(each, grid) for each in reflectance_set_names(name)]


def reports(name: str, measured_on: str = "test", grid: SpectralGrid | None = None) -> Reports:
    """Return a basis' reports under smooth and spiky lights, on its own bands or a grid's."""
    basis = shipped(name)
    fine = grid or basis.grid
    surfaces = samples(measured_on, fine)
    return [basis_report(basis, light_set(kind, fine), surfaces, grid=fine) for kind in KINDS]


def modes_table() -> Iterator[str]:
    """Yield the rows of the general bases in every mode."""
    names = [f"general-{m}{sign}" for sign in ("", "-positive") for m in SIZES]
    for name in (*names, *(f"general-{m}-10nm" for m in SIZES)):
        found = reports(name)
        if name == names[0]:  # the RGB renderer's colours are the same for every basis
            yield row("RGB light × RGB surface (sharp sensors)", found, RGB_PRODUCT)
        for mode in ("fitted", "componentwise", "exact"):
            yield row(f"`{name}`, {mode}", found, mode)


def methods_table() -> Iterator[str]:
    """Yield the rows of other bases in the mode that they are made for, and fitted."""
    for m in SIZES:
        yield row(f"`smooth-{m}`, fitted", reports(f"smooth-{m}"))
    for m in SIZES:
        found = reports(f"exact-{m}")
        yield row(f"`exact-{m}`, exact", found, "exact")
    for m in SIZES:
        found = reports(f"pca-sharpened-{m}")
        for mode in ("componentwise", "fitted"):
            yield row(f"`pca-sharpened`, {m}, {mode}", found, mode)
    found = reports("pca-7")
    yield row("`pca`, 7, linear-model", found, "linear-model")


def fine_table() -> Iterator[str]:
    """Yield the rows of bases against sums at 1 nm, each with its own white."""
    for name in ("31 bands", "general-7-10nm", "81 bands", *(f"general-{m}" for m in SIZES)):
        yield row(f"`{name}`" if "general" in name else name, reports(name, grid=FINE))


def products_table() -> Iterator[str]:
    """Yield the rows of products of two and of three of the held-out reflectances."""
    found = reports("general-7")
    for n, words in ((2, "two surfaces"), (3, "three surfaces")):
        errors = [each.products[n] for each in found]
        for way in ("fitted", "componentwise", "rgb_product"):
            yield cells(f"{words}, {way.replace('_', ' ')}", [getattr(e, way) for e in errors])


def others_table() -> Iterator[str]:
    """Yield the rows of sets that were not used while the bases were developed."""
    for kind in ("natural", "patches"):
        for m in SIZES:
            yield row(f"`general-{m}`, {kind}", reports(f"general-{m}", kind))


TABLES: dict[str, Callable[[], Iterator[str]]] = {
    "modes": modes_table,
    "methods": methods_table,
    "fine": fine_table,
    "products": products_table,
    "others": others_table,
}


def row(name: str, found: Reports, mode: str = "fitted") -> str:
    """Return a row of a table: the errors of a mode under smooth and spiky lights."""
    return cells(name, [each.errors[mode] for each in found])


def cells(name: str, errors: list[ErrorSummary]) -> str:
    """Return a row of a table: mean / median / 95 % / max of each class of lights."""
    return f"| {name} | {' | '.join(map(_short, errors))} |"


def _short(errors: ErrorSummary) -> str:
    numbers = (errors.mean, errors.median, errors.p95, errors.max)
    return " / ".join(f"{x:.3f}".lstrip("0") if x < 1 else f"{x:.3g}" for x in numbers)


def fits() -> Iterator[tuple[str, Callable[[], object]]]:
    """Yield a name and the fit to time."""
    smooth, spiky = light_set("smooth"), light_set("spiky")
    own = [*smooth[:5], *spiky[::20]]
    materials = reflectance_set("training")[::13]
    yield (
        f"{len(own)} lights x {len(materials)} reflectances",
        lambda: SpectralBasis.fit(own, materials),
    )
    lights = [*own, *smooth, *spiky]
    library = len(lights) - len(own)
    weights = np.repeat([1 / len(own), 0.1 / library], [len(own), library])
    for count in (2, 5, 10):
        yield (
            f"scene: {len(own)} + {library} lights x {count} materials",
            lambda count=count: SpectralBasis.fit(lights, materials[:count], light_weights=weights),
        )
    for name in ("smooth-7", "general-7", "exact-7"):
        yield name, lambda name=name: fit_shipped(name)
    fine = light_set("smooth", WHOLE), reflectance_set("training", WHOLE)
    yield f"smooth-7 on {WHOLE}", lambda: SpectralBasis.fit(*fine, grid=WHOLE)


def print_times() -> None:
    """Print the time of each fit."""
    for name, fit in fits():
        fit()
        seconds = []
        for _ in range(RUNS):
            started = time.perf_counter()
            fit()
            seconds.append(time.perf_counter() - started)
        print(f"{name:48s}{median(seconds):6.2f} s", flush=True)


def main() -> None:
    """Print everything; with ``--keep`` also write the tables to the page."""
    text = PAGE.read_text(encoding="utf-8")
    for name, rows in TABLES.items():
        table = "\n".join((HEAD, *rows()))
        print(f"\n{name}\n{table}", flush=True)
        text = replaced(text, name, f"\n{table}\n")
    if "--keep" in sys.argv[1:]:
        PAGE.write_text(text, encoding="utf-8")
    print_times()


if __name__ == "__main__":
    main()
