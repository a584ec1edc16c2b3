"""How long does a fit take? ``python -m benchmarks.basis_fit``.

Median seconds of five runs, imports and tables warm: for designed spectra alone, for scenes as
they are trained (their own lights, and those of the library at a tenth of the weight), and for
the bases that ship.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from statistics import median

import numpy as np

from volspec.basis import SpectralBasis
from volspec.basis.make import fit_shipped
from volspec.spectra import SpectralGrid, light_set, reflectance_set

RUNS = 5
FINE = SpectralGrid(360, 830, 1)


def fits() -> Iterator[tuple[str, Callable[[], object]]]:
    """Names, and what is timed."""
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


def main() -> None:
    """Print a line each."""
    for name, fit in fits():
        fit()
        seconds = []
        for _ in range(RUNS):
            started = time.perf_counter()
            fit()
            seconds.append(time.perf_counter() - started)
        print(f"{name:48s}{median(seconds):6.2f} s", flush=True)


if __name__ == "__main__":
    main()
