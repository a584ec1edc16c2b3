"""The optimum is the one that other solvers find, and refusals name the contradiction."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.optimize import lsq_linear, minimize

from tests.support.errors import raises
from tests.support.palettes import GREY, NM, free_light, lamp, must, surface
from volspec.errors import PaletteError
from volspec.palette import Cell, Criteria, Palette, PaletteSpectrum, design
from volspec.palette.optimisation import Phase
from volspec.palette.quadratic_program import Block, Term, solve
from volspec.palette.state import State
from volspec.spectra import Spectrum


def box(size: int, low: float = 0.0, high: float = 1.0) -> Block:
    return Block(size, np.full(size, low), np.full(size, high))


def stacked(blocks: dict[str, Block], terms: list[Term]) -> tuple[np.ndarray, np.ndarray]:
    """Return M and y of the soft terms, over all variables."""
    rows = [
        np.hstack([t.parts.get(n, np.zeros((len(t.target), b.size))) for n, b in blocks.items()])
        for t in terms
    ]
    soft = [(t, row) for t, row in zip(terms, rows, strict=True) if math.isfinite(t.weight)]
    return (
        np.vstack([t.weight * row for t, row in soft]),
        np.concatenate([t.weight * t.target for t, _ in soft]),
    )


def bounds(blocks: dict[str, Block]) -> tuple[np.ndarray, np.ndarray]:
    return (
        np.concatenate([b.lower for b in blocks.values()]),
        np.concatenate([b.upper for b in blocks.values()]),
    )


def random_palette(rows: int, columns: int, *, free: bool = False, criteria: Criteria) -> Palette:
    """Return free reflectances and lights, colours uniform in display codes."""
    draw = np.random.default_rng(4)
    surfaces = tuple(surface(f"s{i}") for i in range(rows))
    lights = tuple(
        free_light(f"l{j}", spectrum=Spectrum(NM, draw.random(NM.size))) for j in range(columns)
    )
    places = [(row.name, column.name) for row in surfaces for column in lights]
    cells = {place: Cell(colour=tuple(draw.random(3))) for place in places}
    if free:
        cells |= {(s.name, "l0"): Cell("free", group="m", weight=10) for s in surfaces}
    return Palette(surfaces, lights, cells, criteria=criteria)


@pytest.mark.parametrize(
    ("rows", "columns", "free", "metric", "smoothness"),
    [
        *((3, 4, False, metric, bend) for metric in ("RGB", "Lab") for bend in (1e-3, 1.0)),
        (4, 3, True, "RGB", 0.1),
    ],
)
def test_a_phase_matches_a_bounded_least_squares_solver(
    rows: int, columns: int, free: bool, metric: str, smoothness: float
) -> None:
    criteria = Criteria(smoothness, metric=metric, rounds=1)
    palette = random_palette(rows, columns, free=free, criteria=criteria)
    blocks, terms = Phase(State.start(palette), False).problem()
    assert sum(block.size for block in blocks.values()) == rows * NM.size + 3 * free
    found = solve(blocks, terms)
    M, y = stacked(blocks, terms)
    theirs = lsq_linear(M, y, bounds(blocks), "bvls", tol=1e-14, max_iter=10_000)
    assert found.residual < 1e-6
    # clarabel may leave a gap of 1e-10 of the problem's numbers.
    assert found.cost == pytest.approx(2.0 * theirs.cost, rel=1e-6)
    ours = np.concatenate([found.values[name] for name in blocks])
    assert np.abs(M @ (ours - theirs.x)).max() < 1e-5
    assert np.abs(ours - theirs.x).max() < 1e-3


def test_a_light_of_given_luminance_matches_sequential_quadratic_programming() -> None:
    criteria = Criteria(1.0, metric="RGB", rounds=1)
    palette = random_palette(3, 1, criteria=criteria)
    blocks, terms = Phase(State.start(palette), True).problem()
    found = solve(blocks, terms)
    M, y = stacked(blocks, terms)
    (hard,) = (t for t in terms if math.isinf(t.weight))
    C = hard.parts["light 'l0'"]
    theirs = minimize(
        lambda x: np.sum((M @ x - y) ** 2),
        np.ones(NM.size),
        jac=lambda x: 2.0 * M.T @ (M @ x - y),
        bounds=[(0.0, None)] * NM.size,
        constraints={"type": "eq", "fun": lambda x: C @ x - hard.target, "jac": lambda x: C},
        method="SLSQP",
        options={"ftol": 1e-15, "maxiter": 2000},
    )
    assert found.residual < 1e-6
    assert C @ found.values["light 'l0'"] == pytest.approx([1.0], abs=1e-9)
    assert found.cost == pytest.approx(theirs.fun, rel=1e-6)


def test_two_starts_give_the_same_reflectances_under_given_lights() -> None:
    colours = {"D65": (0.6, 0.5, 0.4), "A": (0.9, 0.4, 0.1), "FL11": (0.2, 0.7, 0.5)}
    cells = {("s", name): Cell(colour=colour) for name, colour in colours.items()}
    start = Spectrum(NM, np.random.default_rng(0).random(NM.size))
    criteria = Criteria(metric="RGB", rounds=1)
    one, other = (
        design(Palette((row,), tuple(map(lamp, colours)), cells, criteria=criteria))
        for row in (surface("s"), surface("s", spectrum=start))
    )
    assert np.abs(one.state.S - other.state.S).max() < 1e-12


def test_an_analytic_optimum_at_a_bound() -> None:
    # (x - 2)² + (x + y - 3/2)² with x <= 1: x = 1, y = 1/2, cost 1.
    term = Term({"b": np.array([[1.0, 0.0], [1.0, 1.0]])}, np.array([2.0, 1.5]), 1.0, "t")
    found = solve({"b": box(2)}, [term])
    assert found.values["b"] == pytest.approx([1.0, 0.5], abs=1e-7)
    assert found.cost == pytest.approx(1.0)


@pytest.mark.parametrize("size", [1e-6, 1.0, 1e6])
def test_the_optimum_does_not_depend_on_the_weights_scale(size: float) -> None:
    M = np.random.default_rng(1).random((5, 4))
    terms = [Term({"b": M}, np.full(5, 0.3), size, "t")]
    found = solve({"b": box(4)}, terms)
    theirs = lsq_linear(M, np.full(5, 0.3), (0.0, 1.0), tol=1e-14)
    assert found.values["b"] == pytest.approx(theirs.x, abs=1e-5)
    assert found.residual < 1e-6


def test_bounds_that_meet_hold_a_number() -> None:
    blocks = {"b": Block(2, np.array([0.25, 0.0]), np.array([0.25, 1.0]))}
    found = solve(blocks, [Term({"b": np.ones((1, 2))}, np.ones(1), math.inf, "sum")])
    assert found.values["b"] == pytest.approx([0.25, 0.75], abs=1e-8)


def test_unconnected_blocks_are_independent() -> None:
    draw = np.random.default_rng(2)
    terms = [Term({n: draw.random((3, 5))}, draw.random(3), 1.0, n) for n in ("a", "b")]
    both = solve({"a": box(5), "b": box(5)}, terms)
    alone = solve({"a": box(5)}, terms[:1])
    assert np.array_equal(both.values["a"], alone.values["a"])


def test_equations_that_repeat_themselves_are_met() -> None:
    rows = np.random.default_rng(3).random((2, 6))
    terms = [Term({"a": rows}, rows @ np.full(6, 0.5), math.inf, label) for label in ("t", "u")]
    found = solve({"a": box(6)}, terms)
    assert rows @ found.values["a"] == pytest.approx(rows @ np.full(6, 0.5), abs=1e-9)
    assert found.residual < 1e-6


def refused(palette: Palette) -> PaletteError:
    with raises(PaletteError, "impossible") as caught:
        design(palette)
    return caught.value


@pytest.mark.parametrize(("side", "bound", "code"), [("upper", 0.5, 0.9), ("lower", 0.05, 0.2)])
def test_a_colour_beyond_a_bound_names_cell_and_bound(side: str, bound: float, code: float) -> None:
    rows = tuple(surface(name, **{side: bound}) for name in "ab")
    cells = {("a", "D65"): must(code, code, code), ("b", "D65"): must(0.3, 0.3, 0.3)}
    error = refused(Palette(rows, (lamp("D65"),), cells))
    assert "(a, D65)" in error.problem and "(b, D65)" not in error.problem
    assert side in error.remedy and "'a'" in error.remedy and "'b'" not in error.remedy


def test_contradictory_cells_are_named_without_blaming_a_bound() -> None:
    # Two names of one light: no spectrum at all has two colours under it.
    lights = (lamp("D65"), PaletteSpectrum("noon", lamp("D65").spectrum))
    cells = {("a", "D65"): must(*GREY), ("a", "noon"): must(0.4, 0.5, 0.5)}
    error = refused(Palette((surface("a"),), lights, cells))
    assert "(a, D65)" in error.problem and "(a, noon)" in error.problem
    assert "bound" not in error.remedy


def test_a_light_that_cannot_be_bright_enough_is_named() -> None:
    cells = {("a", "lamp"): Cell(colour=GREY)}
    error = refused(Palette((surface("a"),), (free_light("lamp", upper=0.5),), cells))
    assert "luminance" in error.problem and "upper" in error.remedy
