"""Fit ``virtual-sensors``: m sensors whose channels multiply as spectra do.

    training set -> [sensors] -> A, D

Minimises, over A (rows summing to 1) and D, the mean square colour error

    || G_jk ( D(A E_j * A S_k) / D(A E_j)  -  XYZ_jk / XYZ_white_j ) ||^2

with G_jk the CIE94 metric at the true colour (`volspec.basis.fit.residuals`), so that the
residual is a colour difference, plus small penalties: second differences of the sensors,
errors of predicted whites (the division above, the correction of
`SpectralBasis.display_matrix`, should be small), and large entries of D (which would cancel).
Levenberg-Marquardt with analytic derivatives; the residuals are bilinear.

References
----------
[1] Drew, Finlayson (2003), JOSA A 20(7); Bergner, Drew, Moeller (2009), section 2.3.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from volspec.basis.fit.residuals import FitState, Problem, evaluate, normal_equations, pose_problem
from volspec.basis.fit.training import Training
from volspec.spectra import SpectralGrid

Array = NDArray[np.float64]

_CENTRES_NM = (440.0, 620.0)
_COLOUR_NM = (420.0, 660.0)
_ITERATIONS = 100
_TOLERANCE = 1e-5
# A start that reaches this mean square colour error ends the search.
_GOOD_ENOUGH = 0.02**2
# Lighter than for free sensors: not every space contains every light's white.
_CHANNEL_WHITE_WEIGHT = 8.0
MAX_ALIKE = 30.0
"""Largest condition number of sensors; above it, they are mixtures of each other."""
_KNOT_NM = 10.0
_MAX_FREE_BANDS = 64


def fit_sensors(
    training: Training, size: int, *, positive: bool, smoothness: float, restarts: int
) -> tuple[Array, Array]:
    """Fit A (m, N) and D (3, m).

    D is scaled so that whites are right in the least-squares sense over the training lights,
    with Y = 100 for the flat light of ones. Deterministic: perturbed starts have a fixed seed.
    """
    grid = training.grid
    at_nm, knots = _knots(grid)
    # Curvature of the sensor's density (mean 1) per (10 nm)^2, as a mean square over knots,
    # so that a smoothness has the same effect on every grid.
    second = np.diff(np.eye(at_nm.size), 2, axis=0) * (10.0 / (at_nm[1] - at_nm[0])) ** 2
    roughness = np.sqrt(smoothness / at_nm.size) * grid.size * second
    problem = pose_problem(training, knots, roughness)
    state = _best_descent(problem, _perturb(_gaussians(at_nm, size), restarts), positive)
    return state.heights @ knots, _scaled_display(training, problem, state)


def choose_channels(training: Training, rows: Array) -> tuple[Array, Array]:
    """Return T (m, m) and D for the sensors T @ rows, of a row space (m, N), that multiply best.

    The descent starts at the narrowest sensors of the space: the eigenvectors of diag(lambda) in
    it, with lambda clipped to the wavelengths that affect colour. ``rows`` are orthonormal.
    """
    problem = pose_problem(training, rows, np.zeros((0, len(rows))), _CHANNEL_WHITE_WEIGHT)
    _, narrow = np.linalg.eigh(rows * np.clip(training.grid.wavelengths_nm, *_COLOUR_NM) @ rows.T)
    state = _descend(problem, narrow.T, positive=False)
    return state.heights, _scaled_display(training, problem, state)


def _perturb(heights: Array, count: int) -> Iterator[Array]:
    """Yield the heights, then ``count`` random perturbations of them."""
    rng = np.random.default_rng(20090128)
    yield heights
    for _ in range(count):
        yield heights * np.exp(0.5 * rng.standard_normal(heights.shape))


def _gaussians(at_nm: Array, size: int) -> Array:
    """Return (m, P) values, at P wavelengths, of m Gaussians spread over the visible range."""
    low, high = max(_CENTRES_NM[0], at_nm[0]), min(_CENTRES_NM[1], at_nm[-1])
    centres = np.linspace(low, high, size)
    sigma = (high - low) / (size - 1) / 3
    return np.exp(-0.5 * ((at_nm - centres[:, None]) / sigma) ** 2)


def _best_descent(problem: Problem, starts: Iterable[Array], positive: bool) -> FitState:
    """Return the state of least cost over all starts; sensors that are too alike rank last."""
    candidates: list[tuple[tuple[bool, float], FitState]] = []
    for heights in starts:
        state = _descend(problem, heights, positive)
        value = evaluate(problem, state)
        alike = bool(np.linalg.cond(state.heights) > MAX_ALIKE)
        candidates.append(((alike, value.cost), state))
        if value.colour_error < _GOOD_ENOUGH and not alike:
            break
    return min(candidates, key=lambda pair: pair[0])[1]


def _descend(problem: Problem, heights: Array, positive: bool) -> FitState:
    """Minimise from heights (m, P) and the best D for them (Levenberg-Marquardt)."""
    state = _start(problem, heights, positive)
    value = evaluate(problem, state)
    damping = 1e-3
    for _ in range(_ITERATIONS):
        H, gradient = normal_equations(problem, state, value)
        scale = np.diag(np.diag(H) + 1e-12 * np.trace(H) / len(H))
        for _ in range(12):
            trial = _take_step(problem, state, _step(state, H + damping * scale, gradient))
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


def _scaled_display(training: Training, problem: Problem, state: FitState) -> Array:
    """Return D with whites correct on average, Y = 100 for the flat light of ones."""
    predicted = evaluate(problem, state).e @ state.D.T
    scale = (problem.white * predicted).sum(0) / (predicted**2).sum(0)
    return state.D * scale[:, None] * (100.0 / training.Q[1].sum())


def _knots(grid: SpectralGrid) -> tuple[Array, Array]:
    """Return wavelengths (P,) and knots (P, N), the basis functions of sensors.

    One knot per band; on fine grids, hat functions every 10 nm keep the fit small.
    """
    w = grid.wavelengths_nm
    if grid.size <= _MAX_FREE_BANDS:
        return w, np.eye(grid.size)
    count = max(round((w[-1] - w[0]) / _KNOT_NM) + 1, 3)
    at_nm = np.linspace(w[0], w[-1], count)
    return at_nm, np.array([np.interp(w, at_nm, row) for row in np.eye(count)])


def _start(problem: Problem, heights: Array, positive: bool) -> FitState:
    """Solve for the best D of fixed sensors by linear least squares, before white correction."""
    heights = heights / (heights @ problem.area)[:, None]
    m = len(heights)
    e, s = problem.E @ heights.T, problem.S @ heights.T
    P = (e[:, None] * s)[:, :, None, :] / problem.white[:, None, :, None]
    design = (problem.metric[..., None] * P[:, :, None]).reshape(-1, 3 * m)
    goal = np.einsum("jkrc,jkc->jkr", problem.metric, problem.target).ravel()
    H, gradient = design.T @ design, design.T @ goal
    for c in range(3):  # whites, too: they must not become negative
        block = slice(c * m, (c + 1) * m)
        rows = e / problem.white_scale[:, c, None]
        H[block, block] += rows.T @ rows
        gradient[block] += rows.T @ (problem.white[:, c] / problem.white_scale[:, c])
    H += 1e-10 * np.trace(H) / len(H) * np.eye(len(H))
    return FitState(heights, np.linalg.solve(H, gradient).reshape(3, m), positive)


def _step(state: FitState, H: Array, gradient: Array) -> Array:
    """Minimise the quadratic model; heights of positive sensors stay at or above 0.

    An active set that only grows: heights that would fall below 0 are fixed there, and the rest
    is solved again.
    """
    x = np.concatenate([state.heights.ravel(), state.D.ravel()])
    bounded = np.arange(x.size) < (state.heights.size if state.positive else 0)
    clamped = bounded & (x <= 0) & (gradient > 0)
    while True:
        step = np.where(clamped, -x, 0.0)
        free = np.flatnonzero(~clamped)
        goal = -(gradient + H @ step)[free]
        step[free] = np.linalg.solve(H[np.ix_(free, free)], goal)
        below = bounded & ~clamped & (x + step < 0)
        if not below.any():
            return step
        clamped |= below


def _take_step(problem: Problem, state: FitState, step: Array) -> FitState:
    cut = state.heights.size
    heights = state.heights + step[:cut].reshape(state.heights.shape)
    if state.positive:
        heights = np.maximum(heights, 0.0)  # against rounding
    area = heights @ problem.area
    # A vanishing sensor costs more than any other; just avoid division by zero.
    heights = heights / np.where(np.abs(area) < 1e-9, 1e-9, area)[:, None]
    return replace(state, heights=heights, D=state.D + step[cut:].reshape(state.D.shape))
