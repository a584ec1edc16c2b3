"""What a fit of ``virtual-sensors`` minimises: residuals and their derivatives.

    lights, reflectances -> [residuals] -> sensors

J lights, K reflectances, m channels, N bands, P knots. The equations stand in
`volspec.basis.sensors`.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from volspec.appearance.models import cielab_derivative
from volspec.basis.display import NO_COLOUR
from volspec.spectra.grid import SpectralGrid
from volspec.spectra.photometry import color_matching_functions

Array = NDArray[np.float64]

# Penalties in colour differences: a white off by 100 %, and an entry of D of 100 (all of Y).
_WHITE_WEIGHT = 20.0
_DISPLAY_WEIGHT = 0.003


@dataclass(frozen=True, slots=True, eq=False)
class Problem:
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
class State:
    heights: Array  # (m, P), at the knots; positive=True keeps them >= 0
    D: Array  # (3, m)
    positive: bool


@dataclass(frozen=True, slots=True, eq=False)
class Value:
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


def pose(
    E: Array,
    S: Array,
    grid: SpectralGrid,
    knots: Array,
    smoothness: float,
    weights: Array | None,
) -> Problem:
    """The problem of lights E (J, N), reflectances S (K, N) and knots (P, N)."""
    Q = color_matching_functions(grid)
    E = E * (100.0 / (E @ Q[1]))[:, None]
    white = E @ Q.T
    # Where a light has no X or Z to speak of there is no ratio to fit; `display_matrix`
    # shows that row in proportion to Y.
    seen = white > NO_COLOUR * white[:, 1:2]
    white = np.maximum(white, NO_COLOUR * white[:, 1:2])
    target = np.einsum("ck,jk,ik->jic", Q, E, S) / white[:, None]
    w = np.ones(len(E)) if weights is None else weights / weights.mean()
    scale = np.sqrt(w / (len(E) * len(S)))
    metric = cielab_derivative(target) * seen[:, None, None, :] * scale[:, None, None, None]
    # Curvature of the sensor's density (mean 1) per (10 nm)^2, as a mean square over bands,
    # so that one smoothness means the same on every grid.
    N = grid.size
    second = np.diff(np.eye(N), 2, axis=0) * (10.0 / grid.step_nm) ** 2
    roughness = np.sqrt(smoothness / N) * N * second
    white_scale = np.maximum(white, 0.02 * white[:, 1:2])
    return Problem(E, S, white, white_scale, target, metric, roughness, knots)


def sensors_of(problem: Problem, state: State) -> Array:
    A = state.heights @ problem.knots
    return A / A.sum(1, keepdims=True)


def evaluate(problem: Problem, state: State) -> Value:
    A = sensors_of(problem, state)
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
    return Value(A, e, s, white, ratio, residual, rough, white_off, colour_error, cost)


def normal_equations(problem: Problem, state: State, value: Value) -> tuple[Array, Array]:
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
    H: Array, gradient: Array, problem: Problem, state: State, value: Value, dE: Array
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


def _sensor_derivative(problem: Problem, state: State, A: Array) -> Array:
    """(m, P, N): how a sensor, kept at sum 1, follows each knot."""
    area = (state.heights @ problem.knots).sum(1)[:, None, None]
    sums = problem.knots.sum(1)
    return (problem.knots[None] - A[:, None, :] * sums[None, :, None]) / area
