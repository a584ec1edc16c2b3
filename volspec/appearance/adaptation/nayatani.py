"""Nayatani's nonlinear model: powers that grow with the adapting luminance, and noise.

    L_a = a_L ((L + n) / (Y_o ξ + n))^β_L(L_o)          M and S alike; n = 1
    ξ, η, ζ = M · XYZ_w / Y_w,      L_o = L_A ξ         (L_A = Y_o E_o / 100π)
    β_L, β_M (x) = (6.469 + 6.362 x^0.4495) / (6.469 + x^0.4495)
    β_S (x) = 0.7844 (8.414 + 8.091 x^0.5128) / (8.414 + x^0.5128)

XYZ are in percent of the white, Y_o is the background's. Equal L_a, M_a, S_a on both sides give

    L' = (Y_o' ξ' + n) K^(1/β_L') ((L + n) / (Y_o ξ + n))^(β_L/β_L') − n

``"Nayatani"`` [1, 2] has one a for both sides, K = 1: what equals the background in luminance
factor and hue does so after. ``"CIE 1994"`` [3] sets

    K = k/k',   k = ((Y_o ξ + n) / (20 ξ + n))^(2β_L/3) · ((Y_o η + n) / (20 η + n))^(β_M/3)

which keeps about the grey of 20 %, whatever the background; at Y_o = 20 the two are one. CIE 109
knows one Y_o for both fields; here each side has its own, k and all, so that swapping source and
target is still the exact inverse.

References
----------
[1] Pirsivash, "Viewing Conditions and Chromatic Adaptation", section Nayatani's model.
[2] Nayatani, Takahama & Sobagaki (1981), "Formulation of a nonlinear model of chromatic
    adaptation", Color Research & Application 6(3), 161-171, and Nayatani et al. (1982),
    "Estimation of adaptation effects by use of a theoretical nonlinear model".
[3] CIE 109-1994, "A method of predicting corresponding colours under different chromatic and
    illuminance adaptations".
"""

from __future__ import annotations

from functools import partial

import numpy as np

from volspec.appearance.adaptation.base import (
    CONES_FROM_XYZ,
    Adaptation,
    Array,
    cones_of_white,
    inverse,
    scale,
)
from volspec.appearance.passages import CurvePassage
from volspec.appearance.spec import ViewingConditions

NOISE = 1.0


def exponents(conditions: ViewingConditions) -> Array:
    """β of the three cones; (3,), 1 to 6.4, and 0.78 to 6.3 for the last."""
    adapting = conditions.L_A * cones_of_white(conditions)
    x = adapting[:2] ** 0.4495
    s = adapting[2] ** 0.5128
    longer = (6.469 + 6.362 * x) / (6.469 + x)
    return np.append(longer, 0.7844 * (8.414 + 8.091 * s) / (8.414 + s))


def background(conditions: ViewingConditions, Y_o: float | None = None) -> Array:
    """Y_o (ξ, η, ζ) + n: the background's responses in percent, with noise; (3,)."""
    if Y_o is None:
        Y_o = scale(conditions) * conditions.Y_b
    return Y_o * cones_of_white(conditions) + NOISE


def level(conditions: ViewingConditions) -> float:
    """K's share of one side."""
    lift = background(conditions) / background(conditions, 20.0)
    return float(np.prod(lift[:2] ** (exponents(conditions)[:2] * (2.0 / 3.0, 1.0 / 3.0))))


def passage(levelled: bool, source: ViewingConditions, target: ViewingConditions) -> CurvePassage:
    """The passage, with K of CIE 109 or without."""
    # The background's responses are divided off first: powers of numbers near 1 suit float32.
    near, beta = background(source), exponents(target)
    K = level(source) / level(target) if levelled else 1.0
    ones = np.ones(3)
    return CurvePassage(
        response_from_XYZ=scale(source) * CONES_FROM_XYZ / near[:, None],
        XYZ_from_response=inverse(scale(target) * CONES_FROM_XYZ),
        gain=background(target) * K ** (1.0 / beta),
        power=exponents(source) / beta,
        shift=NOISE / near,
        offset=-NOISE * ones,
        outer=ones,
    )


PASSAGES: dict[str, Adaptation] = {
    "Nayatani": partial(passage, False),
    "CIE 1994": partial(passage, True),
}
