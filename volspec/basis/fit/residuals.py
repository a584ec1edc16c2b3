"""Residuals of fits: colour errors weighted by CIE94, and their normal equations.

    training set -> [residuals] -> sensors, linear

J lights, K reflectances, m channels, P knots; the equations are in `volspec.basis.fit.sensors`.
A residual depends on the sensors only through its light's channels e_j and its reflectance's s_k,
so J^T J is a sum of small blocks by light and by reflectance; the Jacobian itself, (3 J K) x (m P),
is never formed.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from volspec.appearance.models import CIE94_metric
from volspec.basis.display import NO_COLOUR, visible_white
from volspec.basis.fit.training import Training

Array = NDArray[np.float64]

# Penalties in colour differences: of a white off by 100 %, and of a D entry of 100 (all of Y).
_WHITE_WEIGHT = 20.0
_DISPLAY_WEIGHT = 0.0012
_MIN_WHITE = 0.1


@dataclass(frozen=True, slots=True, eq=False)
class Problem:
    """Constants of a fit."""

    E: Array  # (J, P), each light on the knots
    S: Array  # (K, P)
    area: Array  # (P,), sums of the knots over bands
    white: Array  # (J, 3)
    white_scale: Array  # (J, 3), cost of a white off by 100 %
    target: Array  # (J, K, 3), XYZ / white
    metric: Array  # (J, K, 3, 3), G with the weights and 1/sqrt(JK) folded in
    roughness: Array  # (R, P), the penalty's rows


@dataclass(frozen=True, slots=True, eq=False)
class FitState:
    """Unknowns: sensors A = heights @ knots, each with sum 1 over bands, and D."""

    heights: Array  # (m, P), heights @ area = 1; positive=True keeps them >= 0
    D: Array  # (3, m)
    positive: bool


@dataclass(frozen=True, slots=True, eq=False)
class Value:
    e: Array  # (J, m)
    s: Array  # (K, m)
    white: Array  # (J, 3), as predicted
    ratio: Array  # (J, K, 3), XYZ / white as predicted
    residual: Array  # (J, K, 3)
    rough: Array  # (m, R)
    white_off: Array  # (J, 3)
    colour_error: float
    cost: float


def pose_problem(
    training: Training, knots: Array, roughness: Array, white_weight: float = _WHITE_WEIGHT
) -> Problem:
    """Return the problem of a training set for sensors made of knots (P, N)."""
    white, target, metric = relative_colours(training)
    white_scale = np.maximum(white, 0.02 * white[:, 1:2])
    return Problem(
        E=training.E @ knots.T,
        S=training.S @ knots.T,
        area=knots.sum(1),
        white=white,
        white_scale=white_scale * (np.sqrt(len(white)) / white_weight),
        target=target,
        metric=metric,
        roughness=roughness,
    )


def evaluate(problem: Problem, state: FitState) -> Value:
    """Return the residuals and their sum of squares."""
    e, s = problem.E @ state.heights.T, problem.S @ state.heights.T
    predicted = e @ state.D.T
    # A light's predicted white may be far too small, or negative; a floor bounds the errors
    # while the penalty on whites corrects it.
    white = np.maximum(predicted, _MIN_WHITE * problem.white)
    display = state.D * e[:, None] / white[..., None]  # (J, 3, m)
    ratio = np.matmul(s, display.swapaxes(1, 2))
    residual = _apply(problem.metric, ratio - problem.target)
    rough = state.heights @ problem.roughness.T
    white_off = (predicted - problem.white) / problem.white_scale
    large = state.D * (_DISPLAY_WEIGHT / 100)
    colour_error = float((residual**2).sum())
    cost = colour_error + float((rough**2).sum() + (white_off**2).sum() + (large**2).sum())
    return Value(e, s, white, ratio, residual, rough, white_off, colour_error, cost)


def normal_equations(problem: Problem, state: FitState, value: Value) -> tuple[Array, Array]:
    """Return J^T J, (n, n), and J^T r, (n,), for the n = m P + 3 m unknowns (heights, D)."""
    by_e, by_s, by_D = _derivatives(problem, state, value)
    m, P = state.heights.shape
    J, K = len(value.e), len(value.s)
    r = value.residual[..., None]
    by_light = np.concatenate([by_e, by_D, r], axis=3).reshape(J, 3 * K, 4 * m + 1)
    by_light = np.concatenate([by_light, _white_rows(problem, state, value)], axis=1)
    by_reflectance = np.concatenate([by_s, by_D, r], axis=3)
    by_reflectance = by_reflectance.swapaxes(0, 1).reshape(K, 3 * J, 4 * m + 1)
    light = np.matmul(by_light.swapaxes(1, 2), by_light)  # (J, 4m + 1, 4m + 1)
    reflectance = np.matmul(by_reflectance[..., :m].swapaxes(1, 2), by_reflectance)
    cross = np.matmul(by_e.swapaxes(2, 3), by_s)  # (J, K, m, m)
    # By the heights, before they are constrained to sum 1: axes (m, P, m, P).
    both = np.einsum("jp,jkx->pkx", problem.E, cross.reshape(J, K, -1), optimize=True)
    both = np.einsum("pkx,kq->pxq", both, problem.S, optimize=True).reshape(P, m, m, P)
    both = both.swapaxes(0, 1)
    H = both + both.transpose(2, 3, 0, 1)
    H += _outer_sum(light[:, :m, :m], problem.E) + _outer_sum(reflectance[..., :m], problem.S)
    bend = problem.roughness.T @ problem.roughness
    H[np.arange(m), :, np.arange(m)] += bend
    # By the heights against D and the residual: axes (m, P, 3m + 1).
    border = np.einsum("jmx,jp->mpx", light[:, :m, m:], problem.E, optimize=True)
    border += np.einsum("kmx,kp->mpx", reflectance[..., m:], problem.S, optimize=True)
    border[..., -1] += value.rough @ problem.roughness
    H = _fix_sums(_fix_sums(H, state, problem).transpose(2, 3, 0, 1), state, problem)
    border = _fix_sums(border, state, problem).reshape(m * P, -1)
    last = light[:, m:, m:].sum(0)
    ridge = (_DISPLAY_WEIGHT / 100) ** 2
    last[:-1, :-1] += ridge * np.eye(3 * m)
    last[:-1, -1] += ridge * state.D.ravel()
    full = np.block([[H.reshape(m * P, m * P), border], [border.T, last]])
    return full[:-1, :-1], full[:-1, -1]


def _derivatives(problem: Problem, state: FitState, value: Value) -> tuple[Array, Array, Array]:
    """Differentiate the residual by e and s, (J, K, 3, m), and by D, (J, K, 3, 3m).

    ratio_c = D_c (e * s) / (D_c e): the quotient rule.
    """
    weighed = problem.metric / value.white[:, None, None, :]
    projected = np.matmul(weighed, state.D)
    pulled = np.matmul(weighed * value.ratio[:, :, None, :], state.D)
    by_e = projected * value.s[None, :, None, :] - pulled
    by_s = projected * value.e[:, None, None, :]
    relative = (value.s[None, :, None, :] - value.ratio[..., None]) * value.e[:, None, None, :]
    by_D = (weighed[..., None] * relative[:, :, None]).reshape(*by_e.shape[:3], -1)
    return by_e, by_s, by_D


def _white_rows(problem: Problem, state: FitState, value: Value) -> Array:
    """Return (J, 3, 4m + 1): derivatives of whites' errors by e and by D, and the errors."""
    J, m = value.e.shape
    scale = 1.0 / problem.white_scale
    by_D = np.zeros((J, 3, 3, m))
    for c in range(3):
        by_D[:, c, c] = scale[:, c, None] * value.e
    by_e = scale[..., None] * state.D
    return np.concatenate([by_e, by_D.reshape(J, 3, -1), value.white_off[..., None]], axis=2)


def _outer_sum(weights: Array, spectra: Array) -> Array:
    """Return sum_i weights_imn spectra_ip spectra_iq, axes (m, p, n, q)."""
    count, m, _ = weights.shape
    P = spectra.shape[1]
    outer = (spectra[:, :, None] * spectra[:, None]).reshape(count, -1)
    return (weights.reshape(count, -1).T @ outer).reshape(m, m, P, P).swapaxes(1, 2)


def _fix_sums(by_heights: Array, state: FitState, problem: Problem) -> Array:
    """Convert derivatives (m, P, ...) to those for sensors divided by their sum, now 1."""
    radial = np.einsum("mp,mp...->m...", state.heights, by_heights)
    tail = (1,) * (by_heights.ndim - 2)
    return by_heights - problem.area.reshape(1, -1, *tail) * radial[:, None]


def _apply(matrices: Array, vectors: Array) -> Array:
    """Multiply (..., 3, 3) matrices by (..., 3) vectors."""
    return np.matmul(matrices, vectors[..., None])[..., 0]


def relative_colours(training: Training) -> tuple[Array, Array, Array]:
    """Return whites (J, 3), XYZ / white (J, K, 3), and G (J, K, 3, 3) of every pair.

    G includes the pair's weight and the number of pairs, so that the sum of squares of errors
    weighted by G is their mean square.
    """
    E, S, Q = training.E, training.S, training.Q
    white = E @ Q.T
    # Without noticeable X or Z there is no ratio to fit; `display_matrix` uses Y instead.
    visible = white > NO_COLOUR * white[:, 1:2]
    white = visible_white(white)
    ratio = np.matmul(S, (Q * E[:, None]).swapaxes(1, 2)) / white[:, None]
    weights = np.outer(training.light_weights, training.reflectance_weights) / training.pairs
    metric = CIE94_metric(ratio) * visible[:, None, None, :]
    return white, ratio, metric * np.sqrt(weights)[..., None, None]
