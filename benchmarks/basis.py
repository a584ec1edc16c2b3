"""Colour error of bases, and time of a fit: ``python -m benchmarks.basis``.

CIEDE2000 against 31 bands: trained on the 128 training reflectances, measured on the 84 held-out
ones, with the light as white; then the general bases on reflectances that were not used in their
development. Then median seconds of five fits, with imports and tables warm: for designed spectra
alone, for scenes (their own lights, and the library's at a tenth of the weight), and for the
shipped bases. Takes two minutes.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from statistics import median

import numpy as np

from volspec.basis import SpectralBasis
from volspec.basis.make import NAMES, fit_shipped
from volspec.spectra import SpectralGrid, light_set, reflectance_set

SIZES = (5, 7, 9)
RUNS = 5
FINE = SpectralGrid(360, 830, 1)


def bases() -> Iterator[SpectralBasis]:
    """Yield the papers' methods, trained on the 26 smooth lights, and the shipped bases."""
    lights, reflectances = light_set("smooth"), reflectance_set("training")
    for method in ("pca", "pca-sharpened"):
        for size in SIZES:
            yield SpectralBasis.fit(lights, reflectances, size=size, method=method)
    yield from map(SpectralBasis.load, NAMES)


def print_errors() -> None:
    """Print the table of errors."""
    test = reflectance_set("test")
    sets = {kind: light_set(kind) for kind in ("smooth", "spiky")}
    print(f"{'mean / median / 95 % / max':34s}" + "".join(f"{f'{k} lights':38s}" for k in sets))
    for position, basis in enumerate(bases()):
        reports = [basis.report(lights, test) for lights in sets.values()]
        if position == 0:  # the RGB renderer's colours are the same for every basis
            _print("RGB product", "", [str(r.rgb_product) for r in reports])
        _print(basis.name, "componentwise", [str(r.componentwise) for r in reports])
        _print("", "exact", [str(r.exact) for r in reports])
        _print("", "linear-model", [str(r.linear_model) for r in reports])

    print("\nnot used in development, componentwise")
    for kind in ("natural", "patches"):
        samples = reflectance_set(kind)
        for name in ("general-5", "general-7", "general-9"):
            basis = SpectralBasis.load(name)
            reports = [basis.report(lights, samples) for lights in sets.values()]
            _print(name, kind, [str(r.componentwise) for r in reports])


def _print(name: str, mode: str, cells: list[str]) -> None:
    print(f"{name:20s}{mode:14s}" + "".join(f"{cell:38s}" for cell in cells), flush=True)


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
    fine = light_set("smooth", FINE), reflectance_set("training", FINE)
    yield f"smooth-7 on {FINE}", lambda: SpectralBasis.fit(*fine, grid=FINE)


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


if __name__ == "__main__":
    print_errors()
    print_times()
