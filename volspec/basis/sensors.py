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

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from volspec.spectra.grid import SpectralGrid
from volspec.spectra.photometry import color_matching_functions

Array = NDArray[np.float64]

_CENTRES_NM = (425.0, 660.0)
_TOLERANCE = 1e-5
# Penalties in colour differences: a white off by 100 %, and an entry of D of 100 (all of Y).
_WHITE_WEIGHT = 20.0
_DISPLAY_WEIGHT = 0.003
# A start that reaches this mean square colour error needs no rival.
_GOOD_ENOUGH = 0.05**2
_KNOT_NM = 10.0
_MOST_FREE_BANDS = 64
_LAB_FROM_F = np.array([[0.0, 116.0, 0.0], [500.0, -500.0, 0.0], [0.0, 200.0, -200.0]])
_LAB_TOE = (6.0 / 29.0) ** 3
NO_COLOUR = 1e-3
"""A light whose X or Z is below this share of its Y has none to speak of."""


@dataclass(frozen=True, slots=True, eq=False)
class _Problem:
    """What does not change while A and D do; J lights, K reflectances, N bands."""

    E: Array  # (J, N), each with Y = 100 for a perfect diffuser
    S: Array  # (K, N)
    white: Array  # (J, 3)
    white_scale: Array  # (J, 3), what a white's error is measured against
    target: Array  # (J, K, 3), XYZ / white
    metric: Array  # (J, K, 3, 3), G with the light's weight and 1/sqrt(JK) folded in
    roughness: Array  # (N-2, N), the penalty's rows
    knots: Array  # (P, N), what a sensor may be made of


@dataclass(frozen=True, slots=True, eq=False)
class _State:
    heights: Array  # (m, P), at the knots; positive=True keeps them >= 0
    D: Array  # (3, m)
    positive: bool


@dataclass(frozen=True, slots=True, eq=False)
class _Value:
    A: Array
    e: Array
    s: Array
    white: Array
    ratio: Array
    residual: Array
    rough: Array
    white_off: Array
    colour_error: float
    cost: float


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
    problem = _problem(E, S, grid, smoothness, light_weights)
    rng = np.random.default_rng(20090128)
    best: tuple[float, _State] | None = None
    for attempt in range(restarts + 1):
        heights = _gaussians(grid, size, problem.knots)
        if attempt:
            heights = heights * np.exp(0.5 * rng.standard_normal(heights.shape))
        state = _descend(problem, _start(problem, heights, positive), iterations)
        value = _evaluate(problem, state)
        if best is None or value.cost < best[0]:
            best = (value.cost, state)
        if value.colour_error < _GOOD_ENOUGH:
            break
    assert best is not None
    value = _evaluate(problem, best[1])
    predicted = value.e @ best[1].D.T
    scale = (problem.white * predicted).sum(0) / (predicted**2).sum(0)
    luminous = color_matching_functions(grid)[1].sum()
    return value.A, best[1].D * scale[:, None] * (100.0 / luminous)


def _problem(
    E: Array, S: Array, grid: SpectralGrid, smoothness: float, weights: Array | None
) -> _Problem:
    Q = color_matching_functions(grid)
    E = E * (100.0 / (E @ Q[1]))[:, None]
    white = E @ Q.T
    # Where a light has no X or Z to speak of there is no ratio to fit; `display_matrix`
    # shows that row in proportion to Y.
    seen = white > NO_COLOUR * white[:, 1:2]
    white = np.maximum(white, NO_COLOUR * white[:, 1:2])
    target = np.einsum("ck,jk,ik->jic", Q, E, S) / white[:, None]
    slope = np.where(
        target > _LAB_TOE, np.maximum(target, _LAB_TOE) ** (-2 / 3) / 3, _LAB_TOE ** (-2 / 3) / 3
    )
    w = np.ones(len(E)) if weights is None else weights / weights.mean()
    scale = np.sqrt(w / (len(E) * len(S)))
    metric = _LAB_FROM_F * (slope * seen[:, None])[..., None, :] * scale[:, None, None, None]
    # Curvature of the sensor's density (mean 1) per (10 nm)^2, as a mean square over bands,
    # so that one smoothness means the same on every grid.
    N = grid.size
    second = np.diff(np.eye(N), 2, axis=0) * (10.0 / grid.step_nm) ** 2
    roughness = np.sqrt(smoothness / N) * N * second
    white_scale = np.maximum(white, 0.02 * white[:, 1:2])
    return _Problem(E, S, white, white_scale, target, metric, roughness, _knots(grid))


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


def _start(problem: _Problem, heights: Array, positive: bool) -> _State:
    area = (heights @ problem.knots).sum(1, keepdims=True)
    heights = heights / area
    state = _State(heights, np.zeros((3, heights.shape[0])), positive)
    return replace(state, D=_best_display(problem, _sensors(problem, state)))


def _sensors(problem: _Problem, state: _State) -> Array:
    A = state.heights @ problem.knots
    return A / A.sum(1, keepdims=True)


def _best_display(problem: _Problem, A: Array) -> Array:
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


def _evaluate(problem: _Problem, state: _State) -> _Value:
    A = _sensors(problem, state)
    e, s = problem.E @ A.T, problem.S @ A.T
    predicted = e @ state.D.T
    # A trial step may cross zero; a floor keeps it finite and the cost turns it down.
    white = np.maximum(predicted, 1e-6)
    ratio = np.einsum("cm,jm,km->jkc", state.D, e, s, optimize=True) / white[:, None]
    residual = np.einsum("jkrc,jkc->jkr", problem.metric, ratio - problem.target)
    rough = A @ problem.roughness.T
    off = (predicted - problem.white) / problem.white_scale
    white_off = off * (_WHITE_WEIGHT / np.sqrt(len(e)))
    large = state.D * (_DISPLAY_WEIGHT / 100)
    colour_error = float((residual**2).sum())
    cost = colour_error + float((rough**2).sum() + (white_off**2).sum() + (large**2).sum())
    return _Value(A, e, s, white, ratio, residual, rough, white_off, colour_error, cost)


def _descend(problem: _Problem, state: _State, iterations: int) -> _State:
    value = _evaluate(problem, state)
    damping = 1e-3
    for _ in range(iterations):
        H, gradient = _normal_equations(problem, state, value)
        diagonal = np.diag(H) + 1e-12 * np.trace(H) / len(H)
        free = _free(state, gradient)
        for _ in range(12):
            step = np.zeros_like(gradient)
            damped = H[np.ix_(free, free)] + np.diag(damping * diagonal[free])
            step[free] = np.linalg.solve(damped, -gradient[free])
            trial = _moved(state, step)
            new = _evaluate(problem, trial)
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


def _free(state: _State, gradient: Array) -> NDArray[np.intp]:
    """The unknowns that may move: not those held at zero by a bound."""
    free = np.ones(gradient.size, dtype=bool)
    if state.positive:
        cut = state.heights.size
        free[:cut] = (state.heights.ravel() > 0) | (gradient[:cut] < 0)
    return np.flatnonzero(free)


def _moved(state: _State, step: Array) -> _State:
    cut = state.heights.size
    heights = state.heights + step[:cut].reshape(state.heights.shape)
    if state.positive:
        heights = np.maximum(heights, 0.0)
    return replace(state, heights=heights, D=state.D + step[cut:].reshape(state.D.shape))


def _normal_equations(problem: _Problem, state: _State, value: _Value) -> tuple[Array, Array]:
    """J^T J and J^T r for the unknowns (heights, D)."""
    D, e, s = state.D, value.e, value.s
    m = D.shape[1]
    A_of = _sensor_derivative(problem, state, value.A)  # (m, P, N)
    dE = np.einsum("jn,mpn->jmp", problem.E, A_of, optimize=True)
    dS = np.einsum("kn,mpn->kmp", problem.S, A_of, optimize=True)
    # ratio_c = D_c (e * s) / (D_c e): quotient rule, first by e and s, then by D.
    inverse = 1.0 / value.white  # (J, 3)
    relative = s[None, :, None, :] - value.ratio[..., None]  # (J, K, 3, m)
    G = problem.metric * inverse[:, None, None, :]
    by_e = np.einsum("jkrc,cm,jkcm->jkrm", G, D, relative, optimize=True)
    by_s = np.einsum("jkrc,cm,jm->jkrm", G, D, e, optimize=True)
    by_heights = by_e[..., None] * dE[:, None, None] + by_s[..., None] * dS[None, :, None]
    by_D = G[..., None] * (relative * e[:, None, None])[:, :, None]
    count = value.residual.size
    jacobian = np.concatenate([by_heights.reshape(count, -1), by_D.reshape(count, -1)], axis=1)
    H = jacobian.T @ jacobian
    gradient = jacobian.T @ value.residual.ravel()
    _add_display_penalties(H, gradient, problem, state, value, dE)
    bend = A_of @ problem.roughness.T  # (m, P, N-2)
    P = bend.shape[1]
    for i in range(m):
        block = slice(i * P, (i + 1) * P)
        H[block, block] += bend[i] @ bend[i].T
        gradient[block] += bend[i] @ value.rough[i]
    return H, gradient


def _add_display_penalties(
    H: Array, gradient: Array, problem: _Problem, state: _State, value: _Value, dE: Array
) -> None:
    m = state.D.shape[1]
    scale = _WHITE_WEIGHT / np.sqrt(len(value.e)) / problem.white_scale  # (J, 3)
    by_heights = np.einsum("jc,cm,jmp->jcmp", scale, state.D, dE)
    by_D = np.zeros((len(value.e), 3, 3, m))
    for c in range(3):
        by_D[:, c, c] = scale[:, c, None] * value.e
    count = value.white_off.size
    jacobian = np.concatenate([by_heights.reshape(count, -1), by_D.reshape(count, -1)], axis=1)
    H += jacobian.T @ jacobian
    gradient += jacobian.T @ value.white_off.ravel()
    cut = state.heights.size
    ridge = (_DISPLAY_WEIGHT / 100) ** 2
    H[np.arange(cut, len(H)), np.arange(cut, len(H))] += ridge
    gradient[cut:] += ridge * state.D.ravel()


def _sensor_derivative(problem: _Problem, state: _State, A: Array) -> Array:
    """(m, P, N): how a sensor, kept at sum 1, follows each knot."""
    area = (state.heights @ problem.knots).sum(1)[:, None, None]
    sums = problem.knots.sum(1)
    return (problem.knots[None] - A[:, None, :] * sums[None, :, None]) / area
