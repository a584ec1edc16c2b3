"""The optimum is the one that other solvers find, and refusals name what is to blame."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.optimize import lsq_linear, minimize

from volspec.errors import PaletteError
from volspec.palette import Cell, Criteria, Palette, PaletteSpectrum, design
from volspec.palette.criteria import Phase
from volspec.palette.problem import Block, Term, solve
from volspec.palette.state import State
from volspec.spectra import DEFAULT_GRID, Spectrum, light

NM = DEFAULT_GRID.wavelengths_nm
GREY = (0.5, 0.5, 0.5)


def box(size: int, low: float = 0.0, high: float = 1.0) -> Block:
    return Block(size, np.full(size, low), np.full(size, high))


def stacked(blocks: dict[str, Block], terms: list[Term]) -> tuple[np.ndarray, np.ndarray]:
    """M and y of the soft terms, over all unknowns."""
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


def random_palette(
    rows: int, columns: int, *, free: bool = False, criteria: Criteria | None = None, seed: int = 4
) -> Palette:
    """Open reflectances and lights, colours uniform in display codes."""
    draw = np.random.default_rng(seed)
    surfaces = tuple(PaletteSpectrum(f"s{i}", open=True, upper=1) for i in range(rows))
    lights = tuple(
        PaletteSpectrum(f"l{j}", Spectrum(NM, draw.random(31)), open=True) for j in range(columns)
    )
    cells = {
        (s.name, lamp.name): Cell(colour=tuple(draw.random(3))) for s in surfaces for lamp in lights
    }
    if free:
        cells |= {(s.name, "l0"): Cell("free", group="m", weight=10) for s in surfaces}
    return Palette(surfaces, lights, cells, criteria=criteria or Criteria(rounds=1))


@pytest.mark.parametrize("metric", ["RGB", "Lab"])
@pytest.mark.parametrize("smoothness", [1e-3, 1.0])
def test_separable_phases_match_a_bounded_least_squares_solver(
    metric: str, smoothness: float
) -> None:
    criteria = Criteria(smoothness, metric=metric, rounds=1)
    blocks, terms = Phase(State.start(random_palette(3, 4, criteria=criteria)), False).problem()
    found = solve(blocks, terms)
    M, y = stacked(blocks, terms)
    theirs = lsq_linear(M, y, bounds(blocks), "bvls", tol=1e-14, max_iter=10_000)
    assert found.residual < 1e-6
    # The gap that clarabel may leave is 1e-10 of the problem's numbers.
    assert found.cost == pytest.approx(2.0 * theirs.cost, rel=1e-6)
    ours = np.concatenate(list(found.values.values()))
    assert np.abs(M @ (ours - theirs.x)).max() < 1e-5
    assert np.abs(ours - theirs.x).max() < 1e-3


def test_a_joint_phase_with_a_free_colour_matches_a_bounded_least_squares_solver() -> None:
    criteria = Criteria(0.1, metric="RGB", rounds=1)
    palette = random_palette(4, 3, free=True, criteria=criteria)
    blocks, terms = Phase(State.start(palette), False).problem()
    assert sum(block.size for block in blocks.values()) == 4 * 31 + 3
    found = solve(blocks, terms)
    M, y = stacked(blocks, terms)
    theirs = lsq_linear(M, y, bounds(blocks), "bvls", tol=1e-14, max_iter=10_000)
    assert found.residual < 1e-6
    assert found.cost == pytest.approx(2.0 * theirs.cost, rel=1e-6)
    ours = np.concatenate([found.values[name] for name in blocks])
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
        np.ones(31),
        jac=lambda x: 2.0 * M.T @ (M @ x - y),
        bounds=[(0.0, None)] * 31,
        constraints={"type": "eq", "fun": lambda x: C @ x - hard.target, "jac": lambda x: C},
        method="SLSQP",
        options={"ftol": 1e-15, "maxiter": 2000},
    )
    assert found.residual < 1e-6
    assert C @ found.values["light 'l0'"] == pytest.approx([1.0], abs=1e-9)
    assert found.cost == pytest.approx(theirs.fun, rel=1e-6)


@pytest.mark.parametrize("free", [False, True])
def test_every_solve_of_a_palette_is_optimal_to_a_millionth(free: bool) -> None:
    for seed in range(4):
        made = design(random_palette(5, 5, free=free, seed=seed, criteria=Criteria(rounds=2)))
        assert made.residual < 1e-6


def test_two_starts_give_the_same_reflectances_under_given_lights() -> None:
    draw = np.random.default_rng(0)

    def palette(start: np.ndarray | None) -> Palette:
        begun = None if start is None else Spectrum(NM, start)
        surface = PaletteSpectrum("s", begun, open=True, upper=1)
        lights = tuple(PaletteSpectrum(name, light(name)) for name in ("D65", "A", "FL11"))
        colours = ((0.6, 0.5, 0.4), (0.9, 0.4, 0.1), (0.2, 0.7, 0.5))
        cells = {("s", lamp.name): Cell(colour=c) for lamp, c in zip(lights, colours, strict=True)}
        return Palette((surface,), lights, cells, criteria=Criteria(metric="RGB", rounds=1))

    one, other = (design(palette(start)).state.S for start in (None, draw.random(31)))
    assert np.abs(one - other).max() < 1e-12


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


def test_blocks_that_nothing_ties_together_do_not_move_each_other() -> None:
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


def refused(cells: dict[tuple[str, str], Cell], **surface: float) -> str:
    names = dict.fromkeys(name for name, _ in cells)
    rows = tuple(PaletteSpectrum(n, open=True, **{"upper": 1.0, **surface}) for n in names)
    lights = tuple(PaletteSpectrum(n, light(n)) for n in dict.fromkeys(n for _, n in cells))
    with pytest.raises(PaletteError) as error:
        design(Palette(rows, lights, cells))
    return str(error.value)


def must(*colour: float) -> Cell:
    return Cell(colour=colour, weight=math.inf)


def test_a_colour_too_bright_for_the_upper_bound_names_cell_and_bound() -> None:
    message = refused({("a", "D65"): must(0.9, 0.9, 0.9), ("b", "D65"): must(*GREY)}, upper=0.5)
    assert "cell (a, D65) exactly; widen the upper bound of reflectance 'a'," in message
    assert "b" not in message.split("cell")[1].split("exactly")[0]


def test_a_colour_too_dark_for_the_lower_bound_names_cell_and_bound() -> None:
    message = refused({("a", "D65"): must(0.2, 0.2, 0.2)}, lower=0.5)
    assert "cell (a, D65) exactly; widen the lower bound of reflectance 'a'," in message


def test_cells_at_odds_are_named_and_no_bound_is_blamed() -> None:
    # The same light twice: no spectrum at all has two colours under it.
    rows = (PaletteSpectrum("a", open=True, upper=1.0),)
    lights = (PaletteSpectrum("D65", light("D65")), PaletteSpectrum("noon", light("D65")))
    cells = {("a", "D65"): must(*GREY), ("a", "noon"): must(0.4, 0.5, 0.5)}
    with pytest.raises(PaletteError) as error:
        design(Palette(rows, lights, cells))
    assert "meets cell (a, D65), cell (a, noon) exactly; give finite weights" in str(error.value)


def test_a_light_that_cannot_be_bright_enough_is_named() -> None:
    rows = (PaletteSpectrum("a", open=True, upper=1.0),)
    lights = (PaletteSpectrum("lamp", open=True, upper=0.5),)
    with pytest.raises(PaletteError, match=r"the luminance of light 'lamp' exactly; widen the upp"):
        design(Palette(rows, lights, {("a", "lamp"): Cell(colour=GREY)}))
