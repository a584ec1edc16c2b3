"""Channels to XYZ under a light, with every light's white exact.

    analysis, synthesis, light -> [display] -> 3 x m matrix

Neither D nor the light matrix of a basis that does not hold flat white gives a light's white
by itself; `white_exact` mends both in the same way.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from volspec.spectra.grid import SpectralGrid
from volspec.spectra.photometry import color_matching_functions

Array = NDArray[np.float64]

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
    return stretched + rest[:, None] * _luminous_share(stretched[1], channels)


def display_matrix(D: Array, e: Array, E: Array, grid: SpectralGrid) -> Array:
    """K with XYZ = K (e * c), Y = 100 for a perfect diffuser.

    Parameters
    ----------
    D : (3, m) float64
        The basis', scaled for the flat light of ones.
    e : (m,) float64
        The light's channels.
    E : (N,) float64
        The light's power on the grid.
    grid : SpectralGrid

    Returns
    -------
    (3, m) float64
    """
    Q = color_matching_functions(grid)
    kappa = 100.0 / (Q[1] @ E)
    white = kappa * (Q @ E)
    # kappa ratios make D, scaled for the flat light of ones, relative to this one.
    K = white_exact(D * (kappa * Q[1].sum() / 100.0), e, white)
    # A row of which the light has nearly nothing carries no colour: it follows Y.
    trust = np.clip(white / (NO_COLOUR * white[1]), 0.0, 1.0)[:, None]
    return trust * K + (1 - trust) * white[:, None] * _luminous_share(K[1], e)


def light_matrix(B: Array, E: Array, grid: SpectralGrid) -> Array:
    """P_E = kappa Q diag(E) B, (3, m), with its rows stretched where B does not hold white."""
    Q = color_matching_functions(grid)
    kappa = 100.0 / (Q[1] @ E)
    return white_exact(kappa * ((Q * E) @ B), np.ones(B.shape[1]), kappa * (Q @ E))


def _luminous_share(luminous: Array, channels: Array) -> Array:
    """A row u proportional to the channels' luminances, with u @ channels = 1."""
    total = float(luminous @ channels)
    if total > 0:
        return luminous / total
    return channels / float(channels @ channels)
