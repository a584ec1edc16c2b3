"""Fit ``virtual-sensors``: m sensors whose channels multiply like spectra do.

    training lights x reflectances -> [sensors] -> A, D

Minimises, over A (rows summing to 1) and D, the mean square colour error

    || G_jk ( D(A E_j * A S_k) / D(A E_j)  -  XYZ_jk / XYZ_white_j ) ||^2

where G_jk is the derivative of CIELAB at the true colour, so that the residual is a
colour difference, plus small penalties: second differences of the sensors, predicted whites
off their lights' (the per-light correction of `SpectralBasis.display_matrix`, which is the
division above, should have little to do), and large entries of D (which would cancel).
Levenberg-Marquardt with an analytic Jacobian; the residuals are bilinear and few.

References
----------
[1] Drew, Finlayson (2003), JOSA A 20(7); Bergner, Drew, Moeller (2009), section 2.3.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from volspec.basis.residuals import (
    Problem,
    State,
    evaluate,
    normal_equations,
    pose,
    sensors_of,
)
from volspec.spectra.grid import SpectralGrid
from volspec.spectra.photometry import color_matching_functions

Array = NDArray[np.float64]

_CENTRES_NM = (425.0, 660.0)
_TOLERANCE = 1e-5
# A start that reaches this mean square colour error needs no rival.
_GOOD_ENOUGH = 0.05**2
_KNOT_NM = 10.0
_MOST_FREE_BANDS = 64


def fit_sensors(
    E: Array,
    S: Array,
    grid: SpectralGrid,
    size: int,
    *,
    positive: bool,
    smoothness: float,
    restarts: int,
    light_weights: Array | None = None,
    iterations: int = 100,
) -> tuple[Array, Array]:
    """A (m, N) and D (3, m) for lights E (J, N) and reflectances S (K, N).

    D is scaled so that whites are right in the least-squares sense over the training lights,
    with Y = 100 for the flat light of ones. Deterministic: perturbed starts come from a fixed
    seed, the best one is kept.
    """
    problem = pose(E, S, grid, _knots(grid), smoothness, light_weights)
    rng = np.random.default_rng(20090128)
    best: tuple[float, State] | None = None
    for attempt in range(restarts + 1):
        heights = _gaussians(grid, size, problem.knots)
        if attempt:
            heights = heights * np.exp(0.5 * rng.standard_normal(heights.shape))
        state = _descend(problem, _start(problem, heights, positive), iterations)
        value = evaluate(problem, state)
        if best is None or value.cost < best[0]:
            best = (value.cost, state)
        if value.colour_error < _GOOD_ENOUGH:
            break
    assert best is not None
    value = evaluate(problem, best[1])
    predicted = value.e @ best[1].D.T
    scale = (problem.white * predicted).sum(0) / (predicted**2).sum(0)
    luminous = color_matching_functions(grid)[1].sum()
    return value.A, best[1].D * scale[:, None] * (100.0 / luminous)


def _knots(grid: SpectralGrid) -> Array:
    """One free value a band; on fine grids hat functions every 10 nm keep the fit small."""
    if grid.size <= _MOST_FREE_BANDS:
        return np.eye(grid.size)
    w = grid.wavelengths_nm
    count = round((w[-1] - w[0]) / _KNOT_NM) + 1
    at = np.linspace(w[0], w[-1], max(count, 2))
    return np.array([np.interp(w, at, row) for row in np.eye(at.size)])


def _gaussians(grid: SpectralGrid, size: int, knots: Array) -> Array:
    """(m, P) knot heights of m Gaussians spread over the visible."""
    low = max(_CENTRES_NM[0], grid.start_nm)
    high = min(_CENTRES_NM[1], grid.stop_nm)
    centres = np.linspace(low, high, size) if size > 1 else np.array([(low + high) / 2])
    sigma = (high - low) / max(size - 1, 1) / 2
    at = grid.wavelengths_nm[knots.argmax(1)]
    return np.exp(-0.5 * ((at - centres[:, None]) / sigma) ** 2)


def _start(problem: Problem, heights: Array, positive: bool) -> State:
    area = (heights @ problem.knots).sum(1, keepdims=True)
    heights = heights / area
    state = State(heights, np.zeros((3, heights.shape[0])), positive)
    return replace(state, D=_best_display(problem, sensors_of(problem, state)))


def _best_display(problem: Problem, A: Array) -> Array:
    """D by linear least squares for fixed sensors, before the white correction."""
    m = A.shape[0]
    P = (problem.E @ A.T)[:, None] * (problem.S @ A.T)
    P = P[:, :, None, :] / problem.white[:, None, :, None]
    G = problem.metric
    design = np.einsum("jkrc,jkcm->jkrcm", G, P).reshape(-1, 3 * m)
    goal = np.einsum("jkrc,jkc->jkr", G, problem.target).ravel()
    H = design.T @ design
    H += 1e-10 * np.trace(H) / len(H) * np.eye(len(H))
    return np.linalg.solve(H, design.T @ goal).reshape(3, m)


def _descend(problem: Problem, state: State, iterations: int) -> State:
    value = evaluate(problem, state)
    damping = 1e-3
    for _ in range(iterations):
        H, gradient = normal_equations(problem, state, value)
        diagonal = np.diag(H) + 1e-12 * np.trace(H) / len(H)
        free = _free(state, gradient)
        for _ in range(12):
            step = np.zeros_like(gradient)
            damped = H[np.ix_(free, free)] + np.diag(damping * diagonal[free])
            step[free] = np.linalg.solve(damped, -gradient[free])
            trial = _moved(state, step)
            new = evaluate(problem, trial)
            if new.cost < value.cost:
                break
            damping *= 4
        else:
            return state
        gain = 1 - new.cost / value.cost
        state, value = trial, new
        damping = max(damping / 3, 1e-12)
        if gain < _TOLERANCE:
            break
    return state


def _free(state: State, gradient: Array) -> NDArray[np.intp]:
    """The unknowns that may move: not those held at zero by a bound."""
    free = np.ones(gradient.size, dtype=bool)
    if state.positive:
        cut = state.heights.size
        free[:cut] = (state.heights.ravel() > 0) | (gradient[:cut] < 0)
    return np.flatnonzero(free)


def _moved(state: State, step: Array) -> State:
    cut = state.heights.size
    heights = state.heights + step[:cut].reshape(state.heights.shape)
    if state.positive:
        heights = np.maximum(heights, 0.0)
    return replace(state, heights=heights, D=state.D + step[cut:].reshape(state.D.shape))
