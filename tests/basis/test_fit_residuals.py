"""Residuals of fits: derivatives by finite differences, the metric by colour-science."""

from __future__ import annotations

import colour
import numpy as np
import pytest

from volspec.appearance.models.cielab import cielab
from volspec.basis.fit import residuals as fitted
from volspec.basis.fit.residuals import (
    CIE94_metric,
    Problem,
    State,
    evaluate,
    normal_equations,
    pose_problem,
)
from volspec.basis.fit.training import Training, training_set
from volspec.spectra import SpectralGrid, light, reflectance

GRID = SpectralGrid(400, 700, 30)
LIGHTS = ("D65", "A", "FL2")
SURFACES = ("red", "blue", "yellow", "cyan")
LIGHT_WEIGHTS, SURFACE_WEIGHTS = (1.0, 3.0, 0.2), (1.0, 0.1, 5.0, 2.0)


@pytest.fixture(scope="module")
def training() -> Training:
    return training_set(
        [light(name, GRID) for name in LIGHTS],
        [reflectance(f"ColorChecker/{name}", GRID) for name in SURFACES],
        GRID,
        observer_deg=2,
        light_weights=LIGHT_WEIGHTS,
        reflectance_weights=SURFACE_WEIGHTS,
    )


def posed(training: Training, kind: str) -> Problem:
    """On the bands themselves, or on six hat functions of them; with roughness to pay."""
    w = GRID.wavelengths_nm
    at = w if kind == "bands" else np.linspace(w[0], w[-1], 6)
    knots = np.array([np.interp(w, at, row) for row in np.eye(at.size)])
    return pose_problem(training, knots, 0.3 * np.diff(np.eye(at.size), 2, axis=0))


def started(problem: Problem, m: int = 3) -> State:
    """Lobes with some noise; D such that whites are about right, far from their floor."""
    P = len(problem.area)
    at, rng = np.linspace(0, 1, P), np.random.default_rng(5)
    heights = np.exp(-(((at - np.linspace(0.2, 0.8, m)[:, None]) / 0.3) ** 2))
    heights += 0.1 * rng.standard_normal(heights.shape)
    heights /= (heights @ problem.area)[:, None]
    D = np.linalg.lstsq(problem.E @ heights.T, problem.white, rcond=None)[0].T
    return State(heights, D + 0.2 * rng.standard_normal(D.shape), positive=False)


def residuals(problem: Problem, x: np.ndarray, like: State) -> np.ndarray:
    """Everything that is squared and summed, of unknowns as a fit steps in them."""
    cut = like.heights.size
    heights = x[:cut].reshape(like.heights.shape)
    heights = heights / (heights @ problem.area)[:, None]
    D = x[cut:].reshape(like.D.shape)
    value = evaluate(problem, State(heights, D, like.positive))
    large = D * (fitted._DISPLAY_WEIGHT / 100)
    parts = (value.residual, value.rough, value.white_off, large)
    return np.concatenate([part.ravel() for part in parts])


@pytest.mark.parametrize("kind", ["bands", "hats"])
def test_normal_equations_are_those_of_a_numerical_jacobian(
    training: Training, kind: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    # Large entries of D cost as much as colours here; in fits too little to show.
    monkeypatch.setattr(fitted, "_DISPLAY_WEIGHT", 20.0)
    problem = posed(training, kind)
    state = started(problem)
    x = np.concatenate([state.heights.ravel(), state.D.ravel()])
    value = evaluate(problem, state)
    r = residuals(problem, x, state)
    assert r @ r == pytest.approx(value.cost)
    # Away from the floor of whites: the fit leaves out its slope.
    assert ((value.e @ state.D.T) / problem.white).min() > 0.5
    columns = []
    for i in range(x.size):
        step = np.zeros_like(x)
        step[i] = 1e-5 * max(abs(x[i]), 0.01)
        more, less = residuals(problem, x + step, state), residuals(problem, x - step, state)
        columns.append((more - less) / (2 * step[i]))
    J = np.array(columns).T
    H, gradient = normal_equations(problem, state, value)
    # Unknowns differ in scale by thousands: each is measured by its own size in J. Central
    # differences of 1e-5 are off by 1e-10 in truncation and 1e-11 / 1e-5 in rounding.
    size = np.sqrt((J**2).sum(0))
    worst = np.abs((H - J.T @ J) / np.outer(size, size)).max()
    off = np.abs((gradient - J.T @ r) / size).max() / np.sqrt(r @ r)
    print(f"{kind}: J^T J off by {worst:.1e}, J^T r by {off:.1e}")
    assert worst < 1e-6 and off < 1e-6


def test_pairs_cost_by_their_weights(training: Training) -> None:
    """The mean over pairs of w_j w_k |G d|^2, weights of mean 1."""
    problem = posed(training, "bands")
    value = evaluate(problem, started(problem))
    d = value.ratio - problem.target
    squares = (np.einsum("jkrc,jkc->jkr", CIE94_metric(problem.target), d) ** 2).sum(-1)
    w, v = (np.array(x) / np.mean(x) for x in (LIGHT_WEIGHTS, SURFACE_WEIGHTS))
    assert value.colour_error == pytest.approx((w[:, None] * v * squares).mean())


def test_the_metric_is_cie94_of_small_steps() -> None:
    rng = np.random.default_rng(7)
    greys = np.array([[0.9, 0.9, 0.9], [0.18, 0.18, 0.18], [0.004, 0.004, 0.004]])
    colours = np.concatenate(
        [greys, rng.uniform(0.02, 0.9, (30, 3)), rng.uniform(0, 0.008, (6, 3))]
    )
    steps = rng.standard_normal((8, 1, 3)) * colours.mean(axis=-1, keepdims=True) * 1e-5
    found = np.linalg.norm(np.einsum("krc,skc->skr", CIE94_metric(colours), steps), axis=-1)
    white = np.ones(3)
    Lab = cielab(colours, white)
    # The textile constants are 2, .048 and .014; the graphic arts' 1, .045 and .015.
    true = colour.delta_E(
        np.broadcast_to(Lab, steps.shape),
        cielab(colours + steps, white),
        method="CIE 1994",
        textiles=False,
    )
    # A step of 1e-5 bends the curves by as much, a few times where X, Y and Z differ widely.
    assert found == pytest.approx(true, rel=1e-3)
    assert found.min() > 0
