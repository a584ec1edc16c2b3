"""Time of a palette's redesign, and distance of its colours from their targets.

``python -m tools.palette_figures`` draws figures 3 and 4 of [1], and the tables of
``docs/gallery/palette-evaluation.md`` (minutes).

References
----------
[1] Bergner, Drew & Möller (2009), ACM TOG 28(1) art. 5, section 4.2.
"""

from __future__ import annotations

import math
import os
import platform
from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import lsq_linear

from benchmarks.measure import Figure, compare, report
from volspec.palette import Cell, Criteria, Palette, PaletteSpectrum, design
from volspec.palette.optimisation import Phase
from volspec.palette.quadratic_program import EquationBlock, Term
from volspec.palette.state import DesignState
from volspec.spectra import SpectralGrid, Spectrum

Array = NDArray[np.float64]

SEEDS = 10
ASKED_MS = {"10 x 10": 50.0, "joint": 30.0}
# Weight of exact rows for a solver without equality constraints.
MUST = 1e3


@dataclass(frozen=True, slots=True)
class Model:
    """A model of spectra in [1], figure 3.

    Parameters
    ----------
    name : str
    bands : int
        Between 400 and 700 nm.
    positive : bool
        True if lights and reflectances are at least 0. They have no upper bound.
    asked : float
        Mean ΔE*ab of a 7 × 7 palette.
    """

    name: str
    bands: int
    positive: bool
    asked: float

    @property
    def grid(self) -> SpectralGrid:
        """The model's bands."""
        return SpectralGrid(400.0, 700.0, 300.0 / (self.bands - 1))


MODELS = (
    Model("positive, 31", 31, True, 14.4),
    Model("positive, 100", 100, True, 2.1),
    Model("free, 31", 31, False, 0.01),
)


def drawn(
    model: Model, rows: int, columns: int, seed: int, metric: str = "RGB", draw: str = "linear"
) -> Palette:
    """Return a palette with random targets.

    Parameters
    ----------
    draw : {"linear", "codes"}
        Whether colours are uniform in the display's linear RGB, as [1, eq. 16] has them, or in
        its codes, which are lighter, as sRGB encodes them.

    Notes
    -----
    The seed draws first the lights, one after the other, each band uniform in 0 to 1, then the
    colours, reflectance by reflectance. Lights begin with Y = 100, the display's white, and keep no
    level. Reflectances, then lights, are designed once.
    """
    random = np.random.default_rng(seed)
    low = 0.0 if model.positive else None
    wavelengths = model.grid.wavelengths_nm
    lights = tuple(
        PaletteSpectrum(f"l{j}", Spectrum(wavelengths, random.random(model.bands)), True, low)
        for j in range(columns)
    )
    reflectances = tuple(PaletteSpectrum(f"r{i}", None, True, low) for i in range(rows))
    colours = random.random((rows, columns, 3))
    empty = Palette(
        reflectances,
        lights,
        {("r0", "l0"): Cell("black")},
        grid=model.grid,
        criteria=Criteria(smoothness=1e-3, metric=metric, rounds=1),
        level="absolute",
    )
    if draw == "linear":
        colours = np.clip(empty.viewing.display.colours.encode(colours), 0.0, 1.0)
    return with_colours(empty, colours)


def with_colours(palette: Palette, codes: Array) -> Palette:
    """Return the palette with (R, L, 3) display codes as targets."""
    reflectances, lights = palette.names
    cells = {
        (row, light): Cell(colour=tuple(codes[i, j].tolist()))
        for i, row in enumerate(reflectances)
        for j, light in enumerate(lights)
    }
    return Palette(
        palette.reflectances,
        palette.lights,
        cells,
        palette.viewing,
        palette.grid,
        palette.criteria,
        palette.level,
    )


def colours(palette: Palette) -> tuple[Array, Array]:
    """Return (R, L, 3) CIELAB of the targets and of the design."""
    state = design(palette).state
    model, wanted = state.colour_models()[0], np.empty((*state.XYZ.shape[:2], 3))
    for place, cell in palette.cells.items():
        wanted[palette.index(place)] = cell.colour
    return model.Lab_from_RGB(model.space.decode(wanted)), model.Lab_from_RGB(state.RGB())


def error(
    model: Model,
    rows: int,
    columns: int,
    metric: str = "RGB",
    draw: str = "linear",
    seeds: int = SEEDS,
) -> Array:
    """Return (seeds,) mean ΔE*ab over a palette's cells."""
    palettes = [drawn(model, rows, columns, seed, metric, draw) for seed in range(seeds)]
    pairs = [colours(palette) for palette in palettes]
    return np.array([np.linalg.norm(got - wanted, axis=-1).mean() for wanted, got in pairs])


def live() -> Palette:
    """Return a palette as in the designer, on the papers' 31 bands: 10 × 10, all open, CIELAB."""
    wishes = drawn(MODELS[0], 10, 10, 0, "Lab", "codes")
    surfaces = tuple(PaletteSpectrum(r.name, None, True, 0.0, 1.0) for r in wishes.reflectances)
    criteria = Criteria(rounds=1)
    return Palette(surfaces, wishes.lights, wishes.cells, grid=wishes.grid, criteria=criteria)


def joint() -> Palette:
    """Return ten reflectances that share one free colour: 313 unknowns, solved together."""
    wishes = live()
    lights = tuple(PaletteSpectrum(lamp.name, lamp.spectrum) for lamp in wishes.lights[:3])
    cells = {place: cell for place, cell in wishes.cells.items() if place[1] in ("l1", "l2")}
    cells |= {(row.name, "l0"): Cell("free", group="m", weight=10.0) for row in wishes.reflectances}
    criteria = Criteria(rounds=1)
    return Palette(wishes.reflectances, lights, cells, grid=wishes.grid, criteria=criteria)


def by_scipy(palette: Palette) -> Callable[[], object]:
    """Return `lsq_linear` on the same rows, stacked beforehand, so that only solving is timed."""
    state = DesignState.start(palette)
    phases = [Phase(state, lights) for lights in (False, True)]
    problems = [dense(*phase.problem()) for phase in phases if phase.free]
    tied = [matrix for problem in problems for matrix in problem]
    return lambda: [lsq_linear(M, y, limits) for M, y, limits in tied]


def dense(
    blocks: dict[str, EquationBlock], terms: list[Term]
) -> Iterator[tuple[Array, Array, tuple[Array, Array]]]:
    """Return M, y and bounds of each block, or of all if a colour couples them."""
    groups = [list(blocks)] if any(len(t.parts) > 1 for t in terms) else [[n] for n in blocks]
    for names in groups:
        own = [term for term in terms if not term.parts.keys().isdisjoint(names)]
        weights = [MUST if math.isinf(term.weight) else term.weight for term in own]
        M = np.vstack(
            [
                np.hstack(
                    [
                        weight * t.parts.get(n, np.zeros((len(t.target), blocks[n].size)))
                        for n in names
                    ]
                )
                for weight, t in zip(weights, own, strict=True)
            ]
        )
        y = np.concatenate([w * term.target for w, term in zip(weights, own, strict=True)])
        lower = np.concatenate([blocks[n].lower for n in names])
        upper = np.concatenate([blocks[n].upper for n in names])
        yield M, y, (lower, upper)


def figures() -> Iterator[Figure]:
    """Yield the time of a redesign, and the errors of 7 × 7 palettes in both metrics."""
    device = f"{os.cpu_count()} cores, {platform.machine()}"
    for name, palette in (("10 x 10", live()), ("joint", joint())):
        peer, runs = by_scipy(palette), 15 if name == "10 x 10" else 7
        row = compare(
            f"palette/{name}", "lsq_linear", device, lambda p=palette: design(p), peer, runs=runs
        )
        yield Figure(row.name, row.ours_ms, ASKED_MS[name], at_most=True, unit="ms", row=row)
    for model in MODELS:
        for metric in ("RGB", "Lab"):
            reached = float(error(model, 7, 7, metric).mean())
            name = f"palette/{model.name}: {metric}"
            yield Figure(name, reached, model.asked, at_most=True, unit="dE")
    for metric in ("RGB", "Lab"):
        reached = float(error(MODELS[0], 7, 7, metric, "codes").mean())
        name = f"palette/{MODELS[0].name}, codes: {metric}"
        yield Figure(name, reached, MODELS[0].asked, at_most=True, unit="dE")


if __name__ == "__main__":
    print(report(figures()))
