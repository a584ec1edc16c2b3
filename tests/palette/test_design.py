"""Palettes come out as asked: colours, metamers, blacks, and honest refusals."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from volspec.appearance import Viewing
from volspec.errors import PaletteError
from volspec.palette import Cell, Criteria, Design, Palette, PaletteSpectrum, design
from volspec.palette.merit import merit
from volspec.spectra import light

GREY = (0.5, 0.5, 0.5)


def surface(name: str, **more: object) -> PaletteSpectrum:
    return PaletteSpectrum(name, open=True, upper=1.0, **more)


def lamp(name: str) -> PaletteSpectrum:
    return PaletteSpectrum(name, light(name))


def colours(made: Design) -> np.ndarray:
    """(R, L, 3) display codes."""
    eyes = made.state.eyes()
    return np.asarray(eyes[0].space.encode(made.state.linear(eyes)))


@pytest.mark.parametrize("model", ["none", "CAT02", "CIECAM02"])
def test_a_colour_under_each_of_two_lights_is_met(model: str) -> None:
    cells = {("s", "D65"): Cell(colour=(0.6, 0.5, 0.4)), ("s", "A"): Cell(colour=(0.62, 0.5, 0.38))}
    viewing = Viewing(model=model)
    if model == "none":  # tungsten as it is: orange
        cells["s", "A"] = Cell(colour=(0.8, 0.47, 0.2))
    made = design(Palette((surface("s"),), (lamp("D65"), lamp("A")), cells, viewing))
    wanted = [cells["s", name].colour for name in ("D65", "A")]
    assert np.abs(colours(made)[0] - wanted).max() < 2 / 255
    assert made.state.S.min() >= 0.0 and made.state.S.max() <= 1.0
    assert made.residual < 1e-6


def test_free_metamers_are_alike_and_apart() -> None:
    free = Cell("free", group="m", weight=10, low=(0.1, 0.1, 0.3))
    cells = {
        ("a", "D65"): free,
        ("b", "D65"): free,
        ("a", "HP1"): Cell(colour=(0.55, 0.25, 0.15)),
        ("b", "HP1"): Cell(colour=GREY),
    }
    viewing = Viewing("CAT02", exposure=2)
    lights = (lamp("D65"), lamp("HP1"))
    seen = colours(design(Palette((surface("a"), surface("b")), lights, cells, viewing)))
    assert np.abs(seen[0, 0] - seen[1, 0]).max() < 1 / 255
    assert seen[0, 0, 2] > 0.29  # within its bounds
    assert np.abs(seen[0, 1] - (0.55, 0.25, 0.15)).max() < 0.05
    assert np.abs(seen[1, 1] - GREY).max() < 0.02


def test_distinct_cells_part_as_far_as_the_display_shows_and_must_is_exact() -> None:
    cells = {
        ("a", "D65"): Cell(colour=GREY, weight=math.inf),
        ("b", "D65"): Cell("same", other=("a", "D65"), weight=math.inf),
        ("a", "L"): Cell("distinct", other=("b", "L"), distance=60),
    }
    bulbs = tuple(light(name) for name in ("LED-B1", "LED-RGB1", "FL11", "HP1"))
    mixed = PaletteSpectrum("L", open=True, mixture=bulbs)
    made = design(
        Palette((surface("a"), surface("b")), (lamp("D65"), mixed), cells, Viewing("CAT02"))
    )
    seen = colours(made)
    assert np.abs(seen[:, 0] - GREY).max() < 1e-6
    eye = made.state.eyes()[1]
    Lab = eye.Lab(eye.space.decode(seen[:, 1]))
    assert np.linalg.norm(Lab[0] - Lab[1]) == pytest.approx(60, abs=2)
    shares = np.linalg.lstsq(mixed.synthesis(made.palette.grid), made.state.E[1], rcond=None)
    assert shares[0].min() > -1e-9 and np.all(shares[1] < 1e-12)


def test_a_constant_row_keeps_its_colour_under_every_light() -> None:
    rows = (surface("a", constant=True), surface("b"))
    lights = (lamp("D65"), lamp("A"), lamp("FL2"))
    cells = {
        ("a", "D65"): Cell(colour=(0.6, 0.5, 0.4)),
        ("b", "A"): Cell("black"),
    }
    seen = colours(design(Palette(rows, lights, cells, Viewing("CAT02"))))
    assert np.abs(seen[0] - (0.6, 0.5, 0.4)).max() < 2 / 255
    assert seen[1, 1].max() < 0.02


def test_cells_that_contradict_each_other_are_named() -> None:
    cells = {
        ("a", "D65"): Cell(colour=GREY, weight=math.inf),
        ("a", "A"): Cell(colour=(0.0, 1.0, 0.0), weight=math.inf),
        ("b", "D65"): Cell(colour=(0.2, 0.2, 0.2)),
    }
    palette = Palette((surface("a"), surface("b")), (lamp("D65"), lamp("A")), cells)
    with pytest.raises(PaletteError, match=r"cell \(a, D65\), cell \(a, A\) exactly"):
        design(palette)


def test_rounds_never_leave_the_bounds_and_a_relative_light_keeps_its_luminance() -> None:
    cells = {("a", "L"): Cell(colour=(0.9, 0.2, 0.2)), ("b", "L"): Cell(colour=(0.2, 0.2, 0.9))}
    palette = Palette(
        (surface("a"), surface("b")),
        (PaletteSpectrum("L", open=True, band_nm=(450, 650)),),
        cells,
        criteria=Criteria(smoothness=0.1, rounds=3),
    )
    state = design(palette).state
    assert state.E.min() >= 0.0
    assert state.E[0, [0, -1]].tolist() == [0.0, 0.0]
    assert (state.Q @ state.E[0])[1] == pytest.approx(100)


def between_two_lights(weight: float, rounds: int = 8) -> Palette:
    """Alike by day, and under a light that is open as well as red and blue as can be."""
    rust = Cell(colour=(0.5, 0.25, 0.25))
    cells = {
        ("a", "D65"): rust,
        ("b", "D65"): rust,
        ("a", "L"): Cell(colour=(0.75, 0.125, 0.125)),
        ("b", "L"): Cell(colour=(0.125, 0.125, 0.75), weight=weight),
    }
    lights = (lamp("D65"), PaletteSpectrum("L", open=True))
    return Palette((surface("a"), surface("b")), lights, cells, criteria=Criteria(rounds=rounds))


@pytest.mark.parametrize("weight", [1.0, 10.0, math.inf])
def test_a_cell_that_counts_more_does_not_tie_its_light_to_where_it_began(weight: float) -> None:
    made = design(between_two_lights(weight))
    wanted = [[made.palette.cells[r, c].colour for c in ("D65", "L")] for r in "ab"]
    assert np.abs(colours(made) - wanted).max() < 4 / 255


def test_what_lies_on_a_bound_can_be_asked_for_exactly() -> None:
    white = {("a", "L"): Cell(colour=(1.0, 1.0, 1.0), weight=math.inf)}
    made = design(Palette((surface("a"),), (PaletteSpectrum("L", open=True),), white))
    assert colours(made).min() > 0.999


def test_more_rounds_are_never_worse() -> None:
    viewing = Viewing()
    reached = []
    for rounds in (1, 2, 3, 4, 6, 8):
        palette = replace(between_two_lights(1.0, rounds), viewing=viewing)
        reached.append(merit(design(palette).state))
    assert reached == sorted(reached, reverse=True)
