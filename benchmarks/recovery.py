"""Accuracy of reflectances made from colours: ``python -m benchmarks.recovery``.

A reflectance is made from the XYZ of a test reflectance under D65, and the two are compared under
A and FL11. Tests are the ColorChecker, which is not among the base spectra; then Vrhel's natural
objects and the Academy's patches, with their own sets removed. Then the valid share of sRGB.
``python -m tools.recovery_figures`` draws the pictures of docs/reflectance.md. Takes five minutes.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from volspec.appearance.models.lab import cielab, delta_E_2000
from volspec.spectra import (
    XYZ_from_spectra,
    light,
    reflectance,
    reflectance_names,
    reflectance_set,
    reflectances_from_colours,
    white_XYZ,
)
from volspec.spectra.construct.base import ROUTES, BaseSpectra, base_spectra
from volspec.spectra.construct.colours import XYZ_from_sRGB
from volspec.spectra.construct.search import Tetrahedra, clip_to_hull, select_distinct
from volspec.spectra.construct.upsampling import METHODS

Array = NDArray[np.float64]

GIVEN, SEEN = "D65", ("A", "FL11")
# RMS difference below which a base spectrum counts as a copy of a test spectrum.
NEAR_COPY = 0.02
NO_COPIES = "no near copies"
SLOW = ("meng-2015",)
CUBE = 33


def colour_checker() -> Array:
    """Return the (24, 31) reflectances of the BabelColor average."""
    names = [name for name in reflectance_names() if name.startswith("ColorChecker/")]
    return np.array([reflectance(name).values for name in names])


def without(base: BaseSpectra, keep: Callable[[str], bool]) -> BaseSpectra:
    """Return a base without some measured spectra and their variants by Bouguer's law."""
    rows = [row for row, name in enumerate(base.names) if keep(name)]
    return BaseSpectra(tuple(base.names[row] for row in rows), base.values[rows], base.grid)


def without_near_copies(base: BaseSpectra, test: Array) -> BaseSpectra:
    """Return a base without near copies of test spectra."""
    apart = np.sqrt(((base.values[:, None] - test[None]) ** 2).mean(-1)).min(1)
    near = {base.names[row].split("^")[0] for row in np.flatnonzero(apart < NEAR_COPY)}
    return without(base, lambda name: name.split("^")[0] not in near)


def errors(made: Array, true: Array, lamp: str) -> Array:
    """Return CIEDE2000 between reflectances under a light, which is the white."""
    E = light(lamp)
    white = white_XYZ(E)
    return delta_E_2000(*(cielab(XYZ_from_spectra(E, S), white) for S in (made, true)))


@dataclass(frozen=True)
class Test:
    """Reflectances to recover, and base spectra to mix them from."""

    name: str
    true: Array
    base: BaseSpectra


def tests() -> list[Test]:
    base, checker = base_spectra(), colour_checker()
    return [
        Test("ColorChecker", checker, base),
        Test(NO_COPIES, checker, without_near_copies(base, checker)),
        Test("natural", reflectance_set("natural"), without(base, lambda n: "Vrhel/" not in n)),
        Test("patches", reflectance_set("patches"), without(base, lambda n: "ACES/" not in n)),
    ]


def print_table() -> None:
    """Print the errors of every method on every test: mean / 95 % / max."""
    head = f"{'test':16s}{'method':14s}{'ms each':>8s}{'within 0-1':>11s}"
    print(head + "".join(f"{f'under {lamp}':>22s}" for lamp in (GIVEN, *SEEN)) + "   routes")
    for test in tests():
        XYZ = XYZ_from_spectra(light(GIVEN), test.true)
        for method in METHODS:
            mixed = method in METHODS[:2]
            # The others have no base to take near copies from, or no end.
            if (test.name == NO_COPIES and not mixed) or (method in SLOW and len(XYZ) > 24):
                continue
            # Warm up: reads the tables and makes the mesh.
            reflectances_from_colours(XYZ[:1], method, GIVEN, base=test.base)
            start = time.perf_counter()
            made = reflectances_from_colours(XYZ, method, GIVEN, base=test.base)
            each = 1e3 * (time.perf_counter() - start) / len(XYZ)
            valid = ((made.values >= 0) & (made.values <= 1)).all(-1).mean()
            cells = [errors(made.values, test.true, lamp) for lamp in (GIVEN, *SEEN)]
            texts = [f"{c.mean():.3f} / {np.percentile(c, 95):.2f} / {c.max():.2f}" for c in cells]
            routes = ", ".join(f"{count} {name}" for name, count in made.counts().items())
            print(
                f"{test.name:16s}{method:14s}{each:8.2f}{valid:11.0%}"
                + "".join(f"{text:>22s}" for text in texts)
                + f"   {routes}",
                flush=True,
            )


def print_sRGB() -> None:
    """Print validity, error and methods for a dense cube of encoded sRGB."""
    levels = np.linspace(0, 1, CUBE)
    cube = np.stack(np.meshgrid(levels, levels, levels), axis=-1)
    E = light(GIVEN)
    XYZ = XYZ_from_sRGB(cube, white_XYZ(E))
    start = time.perf_counter()
    made = reflectances_from_colours(XYZ)
    taken = time.perf_counter() - start
    valid = ((made.values >= 0) & (made.values <= 1)).all(-1).mean()
    off = np.abs(XYZ_from_spectra(E, made.values) - XYZ).max()
    print(
        f"\nsRGB, {CUBE} levels a channel: {valid:.1%} within 0-1, off by {off:.1e} in XYZ at most;"
    )
    print(f"  {made.counts()} in {taken:.1f} s")


def print_speed() -> None:
    """Time a picture of 512 x 512 with all colours inside the hull of the base spectra."""
    grey = 0.5 + 0.1 * np.random.default_rng(4).standard_normal((512, 512, 3)).clip(-2, 2)
    XYZ = XYZ_from_sRGB(grey, white_XYZ(light(GIVEN)))
    start = time.perf_counter()
    made = reflectances_from_colours(XYZ)
    print(f"512 x 512 colours: {time.perf_counter() - start:.2f} s, {made.counts()}")


def print_seam() -> None:
    """Print errors of colours just inside and outside the base's hull, under other lights."""
    E = light(GIVEN)
    white = white_XYZ(E)
    cube = np.random.default_rng(1).uniform(0, 1, (500, 3))
    colours = XYZ_from_sRGB(cube, white)
    beyond = colours[reflectances_from_colours(colours).route == ROUTES.index("extended")]
    points = XYZ_from_spectra(E, base_spectra().values) / white
    mesh = Tetrahedra.of(points[select_distinct(points)])
    on_edge = clip_to_hull(mesh, beyond / white) * white
    just = on_edge + 1e-4 * (beyond - on_edge)
    inner = reflectances_from_colours(on_edge).values
    print("\nacross the edge of the base colours, mean / max:")
    for method in ("delaunay", "smoothest"):
        outer = reflectances_from_colours(just, method).values
        cells = [errors(inner, outer, lamp) for lamp in SEEN]
        print(f"  {method:12s}" + "".join(f"{c.mean():9.3f} / {c.max():.2f}" for c in cells))


def main() -> None:
    """Print the tables."""
    print_table()
    print_sRGB()
    print_speed()
    print_seam()


if __name__ == "__main__":
    main()
