"""How luminance and background enter CIECAM02 and CAM16: of one condition, or of many at once.

    L_A, Y_b -> [level] -> Conditions, PassageField

References
----------
[1] Neumann, Castro, Neumann & Sbert (2004), eq. 18-24, 33 and 37.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from volspec.appearance import constants as k

Array = NDArray[np.float64]

# Below these the limits are reached to float32's digits; above is brighter than the sun's disc.
_LEAST_L_A, _LEAST_N = 1e-6, 1e-4
_MOST_L_A = 1e9


def level_factor(L_A: ArrayLike) -> Array:
    """(...) F_L of an adapting luminance, cd/m² (eq. 18-19)."""
    five_L_A = 5.0 * np.clip(L_A, _LEAST_L_A, _MOST_L_A)
    k4 = (five_L_A + 1.0) ** -4
    return np.asarray(0.1 * (2.0 * k4 * five_L_A + (1.0 - k4) ** 2 * np.cbrt(five_L_A)))


def degree_of_adaptation(F: float, L_A: ArrayLike) -> Array:
    """(...) D of a surround's F and an adapting luminance (eq. 24)."""
    return F * (1.0 - np.exp(-(np.asarray(L_A) + 42.0) / 92.0) / 3.6)


def background_ratio(Y_b: ArrayLike, Y_w: float) -> Array:
    """(...) n = Y_b / Y_w (eq. 20)."""
    return np.maximum(np.asarray(Y_b) / Y_w, _LEAST_N)


def background_induction(n: ArrayLike) -> Array:
    """(...) N_bb = N_cb (eq. 21)."""
    return np.asarray(0.725 * np.asarray(n) ** -0.2)


def lightness_exponent(n: ArrayLike) -> Array:
    """(...) z (eq. 22)."""
    return np.asarray(1.48 + np.sqrt(n))


def chroma_scale(n: ArrayLike) -> Array:
    """(...) (1.64 - 0.29^n)^0.73 of eq. 37."""
    return np.asarray((1.64 - 0.29 ** np.asarray(n)) ** 0.73)


def eccentricity_scale(N_c: float, n: ArrayLike) -> Array:
    """(...) 50000/13 N_c N_cb / 4, what stands before cos(h + 2) + 3.8 in t (eq. 33-34)."""
    return np.asarray(k.ECCENTRICITY_SCALE * N_c * background_induction(n) / 4.0)
