"""Designed palettes meet their colours, metamers and blacks, and refuse what is impossible."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from tests.support.errors import raises
from tests.support.palettes import GREY, free_light, lamp, must, shown_codes, surface
from volspec.appearance import Viewing
from volspec.errors import PaletteError
from volspec.palette import Cell, Criteria, Design, Palette, PaletteSpectrum, design
from volspec.palette.optimisation import true_cost
from volspec.spectra import PAPERS_GRID, light


def test_distinct_cells_part_as_far_as_the_display_shows_and_must_is_exact() -> None:
    cells = {
        ("a", "D65"): must(*GREY),
        ("b", "D65"): Cell("same", other=("a", "D65"), weight=math.inf),
        ("a", "L"): Cell("distinct", other=("b", "L"), distance=60),
    }
    bulbs = tuple(light(name) for name in ("LED-B1", "LED-RGB1", "FL11", "HP1"))
    mixed = free_light(mixture=bulbs)
    made = design(
        Palette((surface("a"), surface("b")), (lamp("D65"), mixed), cells, Viewing("CAT02"))
    )
    seen = shown_codes(made)
    assert np.abs(seen[:, 0] - GREY).max() < 1e-6
    model = made.state.colour_models()[1]
    Lab = model.Lab_from_RGB(model.space.decode(seen[:, 1]))
    assert np.linalg.norm(Lab[0] - Lab[1]) == pytest.approx(60, abs=2)
    weights, rest, *_ = np.linalg.lstsq(mixed.synthesis(made.palette.grid), made.state.E[1])
    assert weights.min() > -1e-9 and np.all(rest < 1e-12)


def test_bounds_hold_and_a_relative_light_has_its_luminance() -> None:
    cells = {("a", "L"): Cell(colour=(0.9, 0.2, 0.2)), ("b", "L"): Cell(colour=(0.2, 0.2, 0.9))}
    palette = Palette(
        (surface("a"), surface("b")),
        (free_light(band_nm=(450, 650)),),
        cells,
        criteria=Criteria(smoothness=0.1, rounds=3),
    )
    state = design(palette).state
    assert state.E.min() >= 0.0
    assert state.E[0, [0, -1]].tolist() == [0.0, 0.0]
    assert (state.Q @ state.E[0])[1] == pytest.approx(100)


def between_two_lights(weight: float) -> Palette:
    """Return two surfaces alike by day, and red and blue under a free light."""
    rust = Cell(colour=(0.5, 0.25, 0.25))
    cells = {
        ("a", "D65"): rust,
        ("b", "D65"): rust,
        ("a", "L"): Cell(colour=(0.75, 0.125, 0.125)),
        ("b", "L"): Cell(colour=(0.125, 0.125, 0.75), weight=weight),
    }
    return Palette((surface("a"), surface("b")), (lamp("D65"), free_light()), cells)


@pytest.mark.parametrize("weight", [1.0, 10.0, math.inf])
def test_a_cell_of_more_weight_does_not_fix_its_light_at_the_start(weight: float) -> None:
    made = design(replace(between_two_lights(weight), grid=PAPERS_GRID))
    assert colour_error(made) < 4 / 255


def test_on_a_wider_range_of_wavelengths_a_light_and_its_surfaces_take_more_rounds() -> None:
    """Measured after 8 rounds: 2.6 codes from 400 to 700 nm, 6.4 from 380 to 780; after 20 .4."""
    palette = between_two_lights(1.0)
    made = design(replace(palette, criteria=replace(palette.criteria, rounds=20)))
    assert colour_error(made) < 1 / 255


def colour_error(made: Design) -> float:
    """Return the largest difference of a colour code from the wanted one."""
    wanted = [[made.palette.cells[r, c].colour for c in ("D65", "L")] for r in "ab"]
    return float(np.abs(shown_codes(made) - wanted).max())


def test_a_colour_on_a_bound_can_be_exact() -> None:
    white = {("a", "L"): must(1.0, 1.0, 1.0)}
    made = design(Palette((surface("a"),), (free_light(),), white))
    assert shown_codes(made).min() > 0.999


def unlike_metamers() -> Palette:
    """Return three surfaces that should be alike by day, and cannot."""
    wanted = {"a": (0.9, 0.1, 0.1), "b": (0.1, 0.1, 0.9), "c": (0.1, 0.9, 0.1)}
    cells = {(name, "D65"): Cell("free", group="m", weight=2.0) for name in wanted}
    cells |= {(name, "A"): Cell(colour=colour) for name, colour in wanted.items()}
    return Palette(tuple(map(surface, wanted)), (lamp("D65"), lamp("A")), cells, Viewing("CAT02"))


@pytest.mark.parametrize(
    "palette", [replace(between_two_lights(1.0), viewing=Viewing()), unlike_metamers()]
)
def test_more_iterations_are_never_worse(palette: Palette) -> None:
    designs = (design(replace(palette, criteria=Criteria(rounds=n))) for n in (1, 2, 4, 8))
    costs = [true_cost(made.state) for made in designs]
    assert costs == sorted(costs, reverse=True)


def test_a_model_without_an_inverse_is_refused() -> None:
    palette = replace(between_two_lights(1.0), viewing=Viewing("Hunt"))
    with raises(PaletteError, "unsupported", "viewing.model"):
        design(palette)


def test_open_is_a_deprecated_name_of_free() -> None:
    with pytest.warns(DeprecationWarning):
        old = PaletteSpectrum("s", open=True)  # type: ignore[call-arg]  # no field
    with pytest.warns(DeprecationWarning):
        assert old.free and old.open
