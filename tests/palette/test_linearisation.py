"""The equations of a design are those of Bergner, Drew & Möller (2009), eq. 16-24."""

import math
from dataclasses import replace
from itertools import pairwise
from typing import Any

import numpy as np
import pytest
from scipy.optimize import lsq_linear

from tests.support.palettes import (
    NM,
    Q,
    free_light,
    given,
    lamp,
    linear,
    must,
    palette_of,
    power,
    surface,
)
from volspec.appearance import Viewing
from volspec.basis import SpectralBasis
from volspec.palette import Cell, Criteria, Palette, design
from volspec.palette.optimisation import Phase
from volspec.palette.quadratic_program import Term
from volspec.palette.state import ColourModel, DesignState
from volspec.spectra import SpectralGrid, Spectrum, light

RGB_FROM_XYZ = Viewing("none").display.colours.RGB_from_XYZ
RGB = Criteria(metric="RGB", rounds=1)
COLOUR = (0.6, 0.5, 0.4)
MODELS = ("none", "CAT02", "CIECAM02", "CAM16", "RLAB", "CIELAB")


def phase_terms(palette: Palette, lights: bool = False) -> list[Term]:
    return Phase(DesignState.start(palette), lights).problem()[1]


def only_term(terms: list[Term], label: str) -> Term:
    (found,) = (term for term in terms if term.label.startswith(label))
    return found


def one_cell(**more: Any) -> Palette:
    """Return the palette of a surface under tungsten."""
    return palette_of({("s", "A"): Cell(colour=COLOUR)}, **more)


def test_a_colour_is_eq_16_over_root_three():
    term = only_term(phase_terms(one_cell(criteria=RGB)), "cell")
    expected = RGB_FROM_XYZ @ (Q * power("A")) / math.sqrt(3.0)
    assert np.abs(term.parts["reflectance 's'"] - expected).max() < 1e-12
    assert term.target == pytest.approx(linear(COLOUR) / math.sqrt(3.0))


def test_light_and_reflectance_are_interchangeable():
    S = np.linspace(0.2, 0.8, NM.size)
    cells = {("s", "l"): Cell(colour=COLOUR)}
    palette = palette_of(cells, given("s", S), free_light("l"), criteria=RGB)
    terms = phase_terms(palette, lights=True)
    # A variable of 1 is the even light's value.
    even = 100.0 / Q[1].sum()
    expected = RGB_FROM_XYZ @ (Q * S) * even / math.sqrt(3.0)
    assert np.abs(only_term(terms, "cell").parts["light 'l'"] - expected).max() < 1e-12
    luminance = only_term(terms, "the luminance").parts["light 'l'"]
    assert (luminance @ np.ones(NM.size)).item() == pytest.approx(1.0)


@pytest.mark.parametrize("bands", [31, 100])
def test_smoothness_is_the_normed_second_difference_of_eq_21(bands):
    palette = one_cell(grid=SpectralGrid(400, 700, 300 / (bands - 1)), criteria=RGB)
    term = only_term(phase_terms(palette), "reflectance")
    assert term.weight == RGB.smoothness
    rows = term.parts["reflectance 's'"]
    assert np.abs(rows @ np.linspace(0.1, 0.9, bands)).max() < 1e-12
    # A bump of one band: 1, -2, 1 in three rows, over √N |(-1, 2, -1)|.
    bump = rows @ np.eye(bands)[bands // 2]
    assert np.linalg.norm(bump) == pytest.approx(1.0 / math.sqrt(bands))


def test_without_bounds_the_optimum_is_the_pseudo_inverse_of_eq_17():
    draw = np.random.default_rng(1)
    names = ("D65", "A", "FL11", "HP1")
    colours = {name: tuple(draw.random(3)) for name in names}
    free = surface("s", lower=None, upper=None)
    criteria = Criteria(smoothness=1.0, metric="RGB", rounds=1)
    cells = {("s", name): Cell(colour=c) for name, c in colours.items()}
    made = design(palette_of(cells, free, criteria=criteria))
    rows = [RGB_FROM_XYZ @ (Q * power(name)) / math.sqrt(3.0) for name in names]
    bend = np.diff(np.eye(NM.size), 2, axis=0) / math.sqrt(6.0 * NM.size)
    M = np.vstack([*rows, bend])
    y = np.concatenate(
        [*(linear(c) / math.sqrt(3.0) for c in colours.values()), np.zeros(NM.size - 2)]
    )
    expected = np.linalg.lstsq(M, y)[0]
    # Measured 1.1e-5 at 780 nm, where only smoothness decides; less than 1e-5 up to 770 nm.
    assert np.abs(made.state.S[0] - expected).max() < 2e-5
    assert made.cost == pytest.approx(np.sum((M @ expected - y) ** 2))


def test_free_metamers_solve_eq_24():
    wa, wb = 10.0, 1.0
    low, high = (0.1, 0.1, 0.3), (0.9, 0.4, 1.0)
    free = Cell("free", group="m", weight=wa, low=low, high=high)
    colours = {"i": (0.55, 0.25, 0.15), "j": (0.5, 0.5, 0.5)}
    cells = {(name, "D65"): free for name in colours}
    cells |= {(name, "HP1"): Cell(colour=c, weight=wb) for name, c in colours.items()}
    made = design(palette_of(cells, criteria=Criteria(smoothness=0.1, metric="RGB", rounds=1)))
    # The paper's matrix: the colour first, then both reflectances.
    a, b = (RGB_FROM_XYZ @ (Q * power(name)) / math.sqrt(3.0) for name in ("D65", "HP1"))
    bend = 0.1 * np.diff(np.eye(NM.size), 2, axis=0) / math.sqrt(6.0 * NM.size)
    one, none, flat = np.eye(3) / math.sqrt(3.0), np.zeros((3, NM.size)), np.zeros(bend.shape)
    zero, edge = np.zeros((3, 3)), np.zeros((NM.size - 2, 3))
    same = [-wa * one, wa * a, none], [-wa * one, none, wa * a]
    own = [zero, wb * b, none], [zero, none, wb * b]
    M = np.block([*same, *own, [edge, bend, flat], [edge, flat, bend]])
    wanted = [wb * linear(c) / math.sqrt(3.0) for c in colours.values()]
    y = np.concatenate([np.zeros(6), *wanted, np.zeros(2 * len(bend))])
    lower = np.concatenate([linear(low), np.zeros(2 * NM.size)])
    upper = np.concatenate([linear(high), np.ones(2 * NM.size)])
    theirs = lsq_linear(M, y, (lower, upper), "bvls", tol=1e-14)
    assert made.cost == pytest.approx(2.0 * theirs.cost, rel=1e-6)
    assert np.abs(made.state.S.ravel() - theirs.x[3:]).max() < 1e-3


def below(*high: float) -> Palette:
    """Return two surfaces of one free colour: above a grey, and below another colour."""
    above = Cell("free", group="m", low=(0.5, 0.5, 0.5))
    return palette_of({("a", "D65"): above, ("b", "D65"): Cell("free", group="m", high=high)})


def test_cells_of_one_free_colour_share_their_bounds():
    codes = Viewing("none").display.colours.encode(design(below(0.6, 0.6, 0.6)).state.RGB())
    assert codes.min() > 0.499 and codes.max() < 0.601


def subspace_palette(level: str) -> Palette:
    return Palette(
        (given("s", 0.5 + 0.4 * np.sin(NM / 25.0)),),
        (free_light("l", spectrum=light("FL11")),),
        {("s", "l"): Cell(colour=COLOUR, weight=2.0)},
        criteria=Criteria(subspace=3.0, metric="RGB", rounds=1),
        basis=SpectralBasis.load("smooth-7"),
        level=level,
    )


def basis_XYZ(palette: Palette, E: np.ndarray, S: np.ndarray) -> np.ndarray:
    """Return the XYZ of a picture in the palette's basis, at the light's own level."""
    basis = palette.basis
    assert basis is not None
    lit = Spectrum(NM, E)
    channels = basis.analyse(lit) * (basis.analysis @ S)
    return np.asarray(basis.display_matrix(lit) @ channels * (Q[1] @ E) / 100.0)


@pytest.mark.parametrize("scale", [1.0, 0.3])
def test_the_subspace_error_of_a_reflectance_is_eq_20(scale):
    palette = subspace_palette("absolute")
    cells = {("s", "FL11"): Cell(colour=COLOUR, weight=2.0)}
    opened = replace(palette, reflectances=(surface("s"),), lights=(lamp("FL11"),), cells=cells)
    # A designed light may have another level than 100: the error has it, too.
    state = DesignState.start(opened).with_spectra(True, {0: scale * power("FL11")})
    term = only_term(Phase(state, False).problem()[1], "the subspace error")
    assert term.weight == 6.0
    S = np.random.default_rng(0).random(NM.size)
    full = Q @ (state.E[0] * S)
    expected = RGB_FROM_XYZ @ (full - basis_XYZ(opened, state.E[0], S)) / math.sqrt(3.0)
    assert np.abs(term.parts["reflectance 's'"] @ S - expected).max() < 1e-12


@pytest.mark.parametrize("scale", [1.0, 0.3])
def test_the_subspace_error_of_a_light_is_eq_20_and_its_tangent(scale):
    palette = subspace_palette("absolute")
    state = DesignState.start(palette).with_spectra(True, {0: scale * power("FL11")})
    phase = Phase(state, True)
    part = only_term(phase.problem()[1], "the subspace error").parts["light 'l'"] / phase.unit
    S, E = state.S[0], state.E[0]

    def error(E: np.ndarray) -> np.ndarray:
        return RGB_FROM_XYZ @ (Q @ (E * S) - basis_XYZ(palette, E, S)) / math.sqrt(3.0)

    assert np.abs(part @ E - error(E)).max() < 1e-7
    toward = power("D65") * scale
    step = 1e-3
    moved = (error(E + step * toward) - error(E - step * toward)) / (2.0 * step)
    assert np.abs(part @ toward - moved).max() < 1e-5 * scale


def test_flat_white_has_no_subspace_error_under_any_light():
    state = DesignState.start(subspace_palette("absolute")).with_spectra(
        False, {0: np.ones(NM.size)}
    )
    part = only_term(Phase(state, True).problem()[1], "the subspace error").parts["light 'l'"]
    assert np.abs(part @ np.random.default_rng(3).random(NM.size)).max() < 1e-6


def test_the_cost_of_a_colour_in_Lab_is_its_delta_E_squared_and_falls():
    # Two colours that one reflectance cannot both have: what remains, after many iterations.
    cells = {
        ("s", "D65"): Cell(colour=(0.9, 0.2, 0.2)),
        ("s", "A"): Cell(colour=(0.2, 0.4, 0.9), weight=2.0),
    }
    costs = []
    for iterations in (1, 2, 4, 8, 12):
        made = design(palette_of(cells, criteria=Criteria(smoothness=0.0, rounds=iterations)))
        models = made.state.colour_models()
        wanted = [models[0].space.decode(cell.colour) for cell in cells.values() if cell.colour]
        got = made.state.RGB(models)[0]
        dE = np.linalg.norm(models[0].Lab_from_RGB(got) - models[0].Lab_from_RGB(wanted), axis=-1)
        costs.append(np.sum((np.array([1.0, 2.0]) * dE / 100.0) ** 2) / 3.0)
    assert made.cost == pytest.approx(costs[-1], rel=1e-3)
    # No iteration is worse than the one before.
    assert all(later < before * 1.0001 for before, later in pairwise(costs))


@pytest.mark.parametrize("metric", ["RGB", "Lab"])
def test_an_exact_cell_is_met_in_both_metrics(metric):
    criteria = Criteria(metric=metric, rounds=1)
    made = design(replace(one_cell(criteria=criteria), cells={("s", "A"): must(*COLOUR)}))
    assert np.abs(made.state.RGB()[0, 0] - linear(COLOUR)).max() < 1e-8


def test_a_distinct_cell_asks_for_its_distance_where_the_colours_are():
    S = np.linspace(0.1, 0.9, NM.size)
    cells = {("a", "D65"): Cell("distinct", other=("b", "D65"), distance=40.0)}
    palette = Palette((surface("a"), given("b", S)), (lamp("D65"),), cells)
    state = DesignState.start(palette)
    (model,) = state.colour_models()
    a, b = state.RGB([model])[:, 0]
    term = phase_terms(palette)[-1]
    one, other = term.parts.values()
    # At the current colours the residual is their difference minus the distance.
    off = (one @ a + other @ b - term.target).item()
    there = np.linalg.norm(model.Lab_from_RGB(a) - model.Lab_from_RGB(b))
    assert off == pytest.approx((there - 40.0) / 100.0)


@pytest.mark.parametrize("name", MODELS)
def test_a_colour_model_is_invertible_and_its_jacobian_is_a_tangent(name):
    model = ColourModel.of(Viewing(name, exposure=1.7), Q @ power("A"))
    XYZ = np.array([[20.0, 30.0, 7.0], [60.0, 50.0, 20.0], [0.0, 0.0, 0.0]])
    assert np.abs(model.XYZ_from_RGB(model.RGB_from_XYZ(XYZ)) - XYZ).max() < 1e-9
    step = np.array([0.3, -0.2, 0.1])
    change = (model.RGB_from_XYZ(XYZ + 0.05 * step) - model.RGB_from_XYZ(XYZ - 0.05 * step)) / 0.1
    slopes = (model.RGB_jacobian(XYZ) @ step)[:2]
    assert np.abs(slopes - change[:2]).max() < 1e-5
    assert np.isfinite(model.RGB_jacobian(XYZ)).all()


@pytest.mark.parametrize("model", MODELS)
def test_black_and_equal_cells_are_met_under_every_model(model):
    # Without adaptation tungsten is orange.
    colour = COLOUR if model != "none" else (0.7, 0.47, 0.25)
    cells = {
        ("a", "A"): Cell("black", weight=math.inf),
        ("b", "A"): must(*colour),
        ("c", "A"): Cell("same", other=("b", "D65"), weight=math.inf),
    }
    rows, lights = tuple(map(surface, "abc")), (lamp("A"), lamp("D65"))
    made = design(Palette(rows, lights, cells, Viewing(model)))
    seen = made.state.RGB()
    assert np.abs(seen[0, 0]).max() < 1e-6
    assert np.abs(seen[1, 0] - linear(colour)).max() < 1e-8
    # Solved again in every iteration: the last step was small.
    assert np.abs(seen[2, 0] - seen[1, 1]).max() < 1e-4
    assert made.residual < 1e-6


def test_a_constant_row_has_its_colour_in_every_place_without_a_cell():
    lights = tuple(map(lamp, ("D65", "A", "FL2")))
    cells = {("s", "A"): Cell(colour=COLOUR, weight=3.0), ("s", "FL2"): Cell("black")}
    palette = Palette((surface("s", constant=True),), lights, cells, Viewing("CAT02"), criteria=RGB)
    terms = {term.label: term for term in phase_terms(palette) if term.label.startswith("cell")}
    assert set(terms) == {"cell (s, D65)", "cell (s, A)", "cell (s, FL2)"}
    assert terms["cell (s, D65)"].weight == 3.0
    assert np.abs(terms["cell (s, FL2)"].target).max() < 1e-15


def test_a_light_that_should_show_nothing_goes_out():
    cells = {("s", "l"): Cell("black")}
    spectra = given("s", 0.5), free_light("l")
    made = design(palette_of(cells, *spectra, viewing=Viewing("CAT02"), level="absolute"))
    assert np.abs(made.state.E).max() < 0.01
    assert np.isfinite(made.state.RGB()).all()
