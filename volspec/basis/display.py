"""Matrices from channels to XYZ under a light, with every light's white exact.

    analysis, synthesis, samples, light -> [display] -> 3 x m matrix

D, D R(e) and the light matrix of a basis that does not contain flat white all miss a light's
white a little; `white_exact` corrects each in the same way. Q are the observer's colour-matching
functions.
"""

from __future__ import annotations

from typing import Literal, get_args

import numpy as np
from numpy.typing import NDArray

from volspec.appearance.models import CIE94_metric
from volspec.errors import BasisError, nearest

Array = NDArray[np.float64]

Mode = Literal["fitted", "componentwise", "exact", "linear-model"]
MODES: tuple[Mode, ...] = get_args(Mode)
"""Matrices from channels to XYZ: `fitted_matrix`, D diag(e), kappa Q diag(E) B, or D R(e)."""
DEFAULT_MODE: Mode = "fitted"

NO_COLOUR = 1e-3
"""X or Z below this fraction of Y is negligible."""
# Limits of a row's stretch towards a light's white; the rest is added along Y.
_STRETCH = (0.5, 2.0)
# Weight of a fitted matrix' distance from its prior: 1 costs as much as a difference of 0.01.
_PRIOR = 1e-5


def white_exact(matrix: Array, channels: Array, white: Array) -> Array:
    """Stretch the rows of a (3, m) display matrix so that ``result @ channels == white``.

    ``channels`` (m,) and ``white`` (3,), with Y above 0, are those of the perfect diffuser.
    The stretch is limited to a factor of two, and the rest is distributed like luminance.
    Continuous in all arguments.
    """
    low, high = _STRETCH
    predicted = matrix @ channels
    # Bounded on both sides, and continuous where a prediction crosses zero.
    ratio = white / np.maximum(predicted, np.maximum(white / high, 1e-12))
    stretched = matrix * np.maximum(ratio, low)[:, None]
    residual = white - stretched @ channels
    return stretched + residual[:, None] * _luminous_share(stretched[1], channels, white[1])


def display_matrix(D: Array, e: Array, E: Array, Q: Array) -> Array:
    """Return K (3, m) with XYZ = K (e * c), Y = 100 for a perfect diffuser.

    D is scaled for the flat light of ones, e (m,) are the diffuser's channels under the light, and
    E (N,) is the light's power on the grid.
    """
    kappa = 100.0 / (Q[1] @ E)
    white = kappa * (Q @ E)
    # The ratio of the kappas rescales D from the flat light of ones to this light.
    K = white_exact(D * (kappa * Q[1].sum() / 100.0), e, white)
    # A row with almost no response to the light carries no colour: it follows Y.
    trust = np.clip(white / (NO_COLOUR * white[1]), 0.0, 1.0)[:, None]
    return trust * K + (1 - trust) * white[:, None] * _luminous_share(K[1], e, white[1])


def fitted_matrix(channels: Array, XYZ: Array, weights: Array, white: Array, prior: Array) -> Array:
    """Return the (3, m) matrix M that gives the colours of K surfaces best, and white exactly.

    Least squares of |G_k (M c_k - XYZ_k) / white|, G_k the CIE94 metric at the true colour, with
    M 1 = white. ``channels`` are (K, m), ``XYZ`` (K, 3) and ``white`` (3,) on one scale,
    ``weights`` (K,) those of the squares, and ``prior`` (3, m) decides what they leave open.
    """
    m = channels.shape[1]
    scale = visible_white(white)
    target = XYZ / scale
    # A row with almost no response to the light carries no colour.
    metric = CIE94_metric(target) * (white > NO_COLOUR * white[1])
    metric *= np.sqrt(weights)[:, None, None]
    design = (metric[..., None] * channels[:, None, None]).reshape(-1, 3 * m)
    goal = np.einsum("kij,kj->ki", metric, target).ravel()
    H = design.T @ design + _PRIOR * np.eye(3 * m)
    gradient = design.T @ goal + _PRIOR * (prior / scale[:, None]).ravel()
    at_white = np.kron(np.eye(3), np.ones(m))
    system = np.block([[H, at_white.T], [at_white, np.zeros((3, 3))]])
    solution = np.linalg.solve(system, np.concatenate([gradient, white / scale]))
    return np.asarray(solution[: 3 * m].reshape(3, m) * scale[:, None])


def require_mode(mode: str) -> None:
    """Raise BasisError unless ``mode`` is one of `MODES`."""
    if mode not in MODES:
        raise BasisError(
            f"mode {mode!r} is unknown; {nearest(str(mode), MODES)}choose {', '.join(MODES)}",
            code="unknown",
        )


def _luminous_share(luminous: Array, channels: Array, Y: float) -> Array:
    """Return u proportional to the channels' luminances, with u @ channels = 1.

    If these fall short of the white's Y, the channels themselves add the rest.
    """
    total = float(luminous @ channels)
    scale = max(total, Y)
    # Squares of channels near the smallest float would vanish.
    unit = channels / float(np.abs(channels).max())
    missing = (1 - total / scale) / float(unit @ channels)
    return luminous / scale + unit * missing


def visible_white(white: Array) -> Array:
    """Return a light's white XYZ (..., 3) with X and Z of at least a thousandth of Y.

    Smaller values are invisible, and ratios to them are noise.
    """
    return np.maximum(white, NO_COLOUR * white[..., 1:2])
