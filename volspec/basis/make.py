"""Fit the shipped bases again: ``python -m volspec.basis.make [NAME ...]``.

Writes ``data/bases/NAME.json`` for all bases, or the named ones, and prints their error tables.
Reproducible: the same versions of NumPy and colour-science give the same numbers to rounding.
"""

from __future__ import annotations

import sys
from dataclasses import replace
from typing import Any, Literal

import numpy as np

from volspec._gpu import asset
from volspec.basis.model import SpectralBasis
from volspec.basis.storage import GRID_ENDINGS
from volspec.errors import BasisError, nearest
from volspec.spectra import DEFAULT_GRID, PAPERS_GRID, Observer, SpectralGrid
from volspec.spectra.library import light_set, reflectance_set

SIZES = (5, 7, 9)
# Total weight of the spiky lights relative to the smooth ones: enough to quarter their error, small
# enough to keep the errors of smooth lights invisible.
SPIKY_SHARE = 0.03
# Fits of positive sensors have several minima.
_POSITIVE_RESTARTS = 8
# By size: beyond 400 to 700 nm little is seen, and smoother sensors have smaller errors.
_SMOOTHNESS = {5: 1e-4, 7: 1e-4}
_SIGNS = ("", "-positive")
_REFLECTANCES = "99 CES of CIE 224:2017 and 29 CIE colour rendering samples"

_KINDS = tuple(
    [f"{lights}-{m}{sign}" for lights in ("general", "smooth") for m in SIZES for sign in _SIGNS]
    + [f"exact-{m}" for m in SIZES]
)
NAMES = tuple(f"{kind}{ending}" for ending in GRID_ENDINGS.values() for kind in _KINDS)
"""``general`` and ``exact`` are trained on all lights, ``smooth`` on the smooth ones; ``-10nm`` are
the 31 bands of the papers and of scenes of the first version."""


def fit_library(
    size: int,
    method: str = "virtual-sensors",
    positive: bool = False,
    lights: Literal["smooth", "all"] | None = None,
    observer_deg: Observer = 2,
    grid: SpectralGrid = DEFAULT_GRID,
) -> SpectralBasis:
    """Fit a basis on the library's lights and its 128 training reflectances.

    ``lights`` are the smooth ones, or all, with a small weight of the spiky ones for
    ``virtual-sensors``; by default smooth for the principal-component methods, else all. Other
    arguments: see `SpectralBasis.fit`.
    """
    if lights not in (None, "smooth", "all"):
        raise BasisError(f"lights {lights!r:.40} are unknown; choose smooth or all", code="unknown")
    sensors = method == "virtual-sensors"
    smooth, spiky = light_set("smooth", grid), light_set("spiky", grid)
    options: dict[str, Any] = {}
    if sensors:
        options["restarts"] = _POSITIVE_RESTARTS if positive else 0
        if grid != PAPERS_GRID and not positive:
            options["smoothness"] = _SMOOTHNESS.get(size)
    trained_on_lights = f"{len(smooth)} smooth"
    if lights == "smooth" or (lights is None and method in ("pca", "pca-sharpened")):
        spiky = []
        trained_on_lights += " lights"
    elif sensors:
        weights = [1.0 / len(smooth), SPIKY_SHARE / len(spiky)]
        options["light_weights"] = np.repeat(weights, [len(smooth), len(spiky)])
        trained_on_lights += f" lights and, weighted {SPIKY_SHARE:g}, {len(spiky)} spiky lights"
    else:
        trained_on_lights += f" and {len(spiky)} spiky lights"
    basis = SpectralBasis.fit(
        smooth + spiky,
        reflectance_set("training", grid),
        grid=grid,
        size=size,
        method=method,
        positive=positive,
        observer_deg=observer_deg,
        trained_on=f"{trained_on_lights}; {_REFLECTANCES}",
        **options,
    )
    # The library's training set is a sample of every basis.
    return replace(basis, samples=np.zeros((0, grid.size)))


def fit_shipped(name: str) -> SpectralBasis:
    """Fit a shipped basis, one of `NAMES`, on the 128 training reflectances."""
    if name not in NAMES:
        raise BasisError(
            f"basis {name!r} does not ship; {nearest(name, NAMES)}shipped: {', '.join(NAMES)}",
            code="unknown",
        )
    grid = PAPERS_GRID if name.endswith(GRID_ENDINGS[PAPERS_GRID]) else DEFAULT_GRID
    kind = name.removesuffix(GRID_ENDINGS[grid])
    lights, size = kind.removesuffix("-positive").split("-")
    basis = fit_library(
        int(size),
        "reduced-rank" if lights == "exact" else "virtual-sensors",
        positive=kind.endswith("-positive"),
        lights="smooth" if lights == "smooth" else "all",
        grid=grid,
    )
    return replace(basis, name=name)


def main(names: list[str]) -> int:
    """Fit, save, and print the tables."""
    for name in names or NAMES:
        basis = fit_shipped(name)
        path = asset("data/bases") / f"{name}.json"
        basis.save(path)
        print(f"{path} (fingerprint {basis.fingerprint})")
        for kind in ("smooth", "spiky"):
            print(f"\n{kind} lights, held-out reflectances\n{basis.report(light_set(kind))}\n")
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
