"""Channels to XYZ under a light, with every light's white exact.

    analysis, synthesis, light -> [display] -> 3 x m matrix

Neither D, nor D R(e), nor the light matrix of a basis that does not hold flat white gives a
light's white by itself; `white_exact` mends all in the same way. Q stands for the observer's
colour-matching functions.
"""

from __future__ import annotations

from typing import Literal, get_args

import numpy as np
from numpy.typing import NDArray

from volspec.errors import BasisError, nearest

Array = NDArray[np.float64]

Mode = Literal["componentwise", "exact", "linear-model"]
MODES: tuple[Mode, ...] = get_args(Mode)
"""How channels become XYZ: D diag(e), kappa Q diag(E) B, or D R(e)."""

NO_COLOUR = 1e-3
"""A light whose X or Z is below this share of its Y has none to speak of."""
# How far a row may be stretched to meet a light's white; the rest is added along Y.
_STRETCH = (0.5, 2.0)


def white_exact(matrix: Array, channels: Array, white: Array) -> Array:
    """A display matrix with its rows stretched so that it gives a white exactly.

    Parameters
    ----------
    matrix : (3, m) float64
        Channels to XYZ.
    channels : (m,) float64
        The perfect diffuser's.
    white : (3,) float64
        The diffuser's XYZ; Y above 0.

    Returns
    -------
    (3, m) float64
        ``result @ channels == white``. A row that would be stretched beyond a factor of two
        stops there, and the rest is shared out like luminance. Continuous in all arguments.
    """
    low, high = _STRETCH
    predicted = matrix @ channels
    # Bounded from both sides, and continuous where a prediction crosses zero.
    ratio = white / np.maximum(predicted, np.maximum(white / high, 1e-12))
    stretched = matrix * np.maximum(ratio, low)[:, None]
    rest = white - stretched @ channels
    return stretched + rest[:, None] * _luminous_share(stretched[1], channels, white[1])


def display_matrix(D: Array, e: Array, E: Array, Q: Array) -> Array:
    """K with XYZ = K (e * c), Y = 100 for a perfect diffuser.

    Parameters
    ----------
    D : (3, m) float64
        Scaled for the flat light of ones.
    e : (m,) float64
        The perfect diffuser's channels under the light.
    E : (N,) float64
        The light's power on the grid.
    Q : (3, N) float64

    Returns
    -------
    (3, m) float64
    """
    kappa = 100.0 / (Q[1] @ E)
    white = kappa * (Q @ E)
    # kappa ratios make D, scaled for the flat light of ones, relative to this one.
    K = white_exact(D * (kappa * Q[1].sum() / 100.0), e, white)
    # A row of which the light has nearly nothing carries no colour: it follows Y.
    trust = np.clip(white / (NO_COLOUR * white[1]), 0.0, 1.0)[:, None]
    return trust * K + (1 - trust) * white[:, None] * _luminous_share(K[1], e, white[1])


def light_matrix(B: Array, E: Array, Q: Array) -> Array:
    """P_E = kappa Q diag(E) B, (3, m), with its rows stretched where B does not hold white."""
    kappa = 100.0 / (Q[1] @ E)
    return white_exact(kappa * ((Q * E) @ B), np.ones(B.shape[1]), kappa * (Q @ E))


def illumination_matrix(A: Array, B: Array, e: Array) -> Array:
    """R(e), (m, m): the channels of (B e) * (B s) are R(e) s."""
    return A @ (B * (B @ e)[:, None])


def require_mode(mode: str) -> None:
    """Refuse what is not one of `MODES`.

    Raises
    ------
    BasisError
    """
    if mode not in MODES:
        raise BasisError(
            f"mode {mode!r} is unknown; {nearest(str(mode), MODES)}choose {', '.join(MODES)}",
            code="unknown",
        )


def _luminous_share(luminous: Array, channels: Array, Y: float) -> Array:
    """A row u proportional to the channels' luminances, with u @ channels = 1.

    Where they fall short of the white's Y, the channels themselves make up for the rest.
    """
    total = float(luminous @ channels)
    scale = max(total, Y)
    # Of channels near the least float the squares would vanish.
    unit = channels / float(np.abs(channels).max())
    missing = (1 - total / scale) / float(unit @ channels)
    return luminous / scale + unit * missing


def visible_white(white: Array) -> Array:
    """A light's white XYZ (..., 3) with X and Z of at least a thousandth of Y.

    What lies below no eye sees; ratios to it would be noise.
    """
    return np.maximum(white, NO_COLOUR * white[..., 1:2])
