"""Figures of palettes: draws repeat, and errors behave as in the paper."""

import numpy as np
import pytest

from benchmarks.palette import ASKED_MS, MODELS, by_scipy, colours, dense, drawn, joint, live
from tools.palette_figures import REFERENCE, SIZES, SQUARES, distances, tenths
from volspec.palette.optimisation import Phase
from volspec.palette.quadratic_program import solve
from volspec.palette.state import DesignState

POSITIVE, FINE, FREE = MODELS


def mean_distance(model: object, size: int, metric: str = "RGB") -> float:
    wanted, got = colours(drawn(model, size, size, 0, metric))
    return float(np.linalg.norm(got - wanted, axis=-1).mean())


def test_a_seed_draws_the_same_palette_and_another_seed_another():
    one, again, other = (drawn(POSITIVE, 2, 3, seed) for seed in (0, 0, 1))
    assert dict(one.cells) == dict(again.cells) != dict(other.cells)
    assert np.array_equal(DesignState.start(one).E, DesignState.start(again).E)


def test_wanted_colours_are_uniform_in_linear_RGB_or_in_codes():
    for draw, middle in (("linear", 0.69), ("codes", 0.5)):
        palette = drawn(POSITIVE, 12, 12, 3, draw=draw)
        codes = np.array([cell.colour for cell in palette.cells.values()])
        # 432 uniform numbers: their mean is within 0.05 of its own, three deviations.
        assert codes.mean() == pytest.approx(middle, abs=0.05)


def test_models_have_the_bands_and_bounds_of_the_paper():
    assert [model.grid.size for model in MODELS] == [31, 100, 31]
    for model, lower in zip(MODELS, (0.0, 0.0, None), strict=True):
        palette = drawn(model, 1, 1, 0)
        members = (*palette.reflectances, *palette.lights)
        assert {(m.free, m.lower, m.upper) for m in members} == {(True, lower, None)}
        assert palette.criteria.smoothness == 1e-3 and palette.criteria.rounds == 1


def test_without_bounds_ten_colours_are_met_and_twelve_are_not():
    # 30 equations for 31 bands, and 36: the paper's figure 3c.
    assert mean_distance(FREE, 10) < 0.01
    assert mean_distance(FREE, 12) > 1.0


def test_bounds_cost_most_and_more_bands_buy_it_back():
    positive = mean_distance(POSITIVE, 7)
    assert 1.0 < positive < 14.4
    assert mean_distance(FINE, 7) < 0.1 * positive


def test_distances_are_of_all_pairs_and_kept_without_bounds():
    wanted, got = distances(FREE, 4)
    assert wanted.shape == (16 * 15 // 2,) and got == pytest.approx(wanted, abs=0.01)


def test_the_live_palette_and_the_joint_problem_are_what_they_are_called():
    assert len(live().reflectances) == len(live().lights) == 10
    blocks, terms = Phase(DesignState.start(joint()), False).problem()
    assert sum(block.size for block in blocks.values()) == 313
    assert len(list(dense(blocks, terms))) == 1
    blocks, terms = Phase(DesignState.start(live()), False).problem()
    assert [M.shape[1] for M, _, _ in dense(blocks, terms)] == [31] * 10
    assert set(ASKED_MS) == {"10 x 10", "joint"}


def test_both_sides_of_the_timing_solve_the_same():
    palette = drawn(POSITIVE, 3, 3, 0)
    theirs = by_scipy(palette)()
    assert isinstance(theirs, list) and len(theirs) == 6
    ours = solve(*Phase(DesignState.start(palette), False).problem()).cost
    assert ours == pytest.approx(2.0 * sum(each.cost for each in theirs[:3]), rel=1e-4, abs=1e-9)


def test_tables_have_the_reference_sizes_and_say_little_as_nothing():
    assert {n for known in REFERENCE.values() for n in known} <= set(SQUARES)
    assert set(SQUARES) <= set(SIZES)
    assert tenths(0.003) == "<0.1" and tenths(7.39) == "7.4"
