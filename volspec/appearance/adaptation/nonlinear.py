"""Nonlinear adaptations: Nayatani's, CIE 109's variant of it, and Guth's.

Nayatani's powers grow with the adapting luminance, and responses have noise:

    L_a = a_L ((L + n) / (Y_o ξ + n))^β_L(L_o)          likewise M and S; n = 1
    ξ, η, ζ = M · XYZ_w / Y_w,      L_o = L_A ξ         (L_A = Y_o E_o / 100π)
    β_L, β_M (x) = (6.469 + 6.362 x^0.4495) / (6.469 + x^0.4495)
    β_S (x) = 0.7844 (8.414 + 8.091 x^0.5128) / (8.414 + x^0.5128)

XYZ are in percent of the white, Y_o is the background's Y. Equal L_a, M_a, S_a on both sides give

    L' = (Y_o' ξ' + n) K^(1/β_L') ((L + n) / (Y_o ξ + n))^(β_L/β_L') − n

``"Nayatani"`` [1, 2] has one a for both sides, K = 1: a colour that equals the background in
luminance factor and hue still does afterwards. ``"CIE 1994"`` [3] sets

    K = k/k',   k = ((Y_o ξ + n) / (20 ξ + n))^(2β_L/3) · ((Y_o η + n) / (20 η + n))^(β_M/3)

which roughly preserves a grey of 20 %, whatever the background; at Y_o = 20 the two are the same.
CIE 109 has one Y_o for both fields; here each side has its own, also in k, so that swapping source
and target is still the exact inverse.

Guth's gains saturate with the adapting light:

    L_r = 0.66 L^0.7 + 0.002,    L_a = L_r (1 − L_r0 / (σ + L_r0))
    M_r = 1.00 M^0.7 + 0.003,    S_r = 0.45 S^0.7 + 0.00135

Equal L_a on both sides, with κ = (σ + L_r0') / (σ + L_r0):

    L' = (κ L^0.7 + (κ − 1) 0.002/0.66)^(1/0.7)

The survey leaves three things open. The choices made here, with their sources:

- σ = 300 [5].
- L, M, S are in trolands, 18 Y_n^0.8 for the white [5], Y_n its luminance in cd/m². The pupil
  follows the white, so one factor applies to the picture; ATD95 applies the power to every colour.
- The adapting light, L_r0, is k_2 = 50 times the white, without the sample: k_1 = 0 and k_2 of 15
  to 50 are the values of [5] for related colours. With the white alone (k_2 = 1) the gains would
  hardly follow it, but the survey finds that the model performs about as well as von Kries.

The cones are the survey's M for all models, not those of ATD95. Equal L_a preserve brightness, not
lightness: from bright to dim, a white comes out brighter than the dim white. Give both sides the
same L_A and Y_b to preserve the picture's tones.

References
----------
[1] Pirsivash, "Viewing Conditions and Chromatic Adaptation", sections Nayatani's and Guth's model.
[2] Nayatani, Takahama & Sobagaki (1981), "Formulation of a nonlinear model of chromatic
    adaptation", Color Research & Application 6(3), 161-171, and Nayatani et al. (1982),
    "Estimation of adaptation effects by use of a theoretical nonlinear model".
[3] CIE 109-1994, "A method of predicting corresponding colours under different chromatic and
    illuminance adaptations".
[4] Guth (1991), "Model for color vision and light adaptation", JOSA A 8(6), 976-993.
[5] Guth (1995), "Further applications of the ATD model for color vision", Proc. SPIE 2414,
    12-26. doi:10.1117/12.206546, via colour-science's ATD95.
"""

from __future__ import annotations

from functools import partial

import numpy as np
from numpy.typing import ArrayLike

from volspec.appearance.adaptation.linear import (
    Adaptation,
    cones_of_white,
    inverse,
    percent_scale,
    white_luminance,
)
from volspec.appearance.display import constants as k
from volspec.appearance.surround import ViewingConditions
from volspec.appearance.transforms import Array, CurveTransform

NAYATANI_NOISE = 1.0

GUTH_GAIN = np.array([0.66, 1.0, 0.45])
GUTH_NOISE = np.array([0.002, 0.003, 0.00135])
GUTH_POWER = 0.7
GUTH_SIGMA = 300.0
GUTH_ADAPTING = 50.0


def nayatani_exponent(responses: ArrayLike, knee: float, top: float, power: float) -> Array:
    """Return β, which rises from 1 in the dark towards ``top``."""
    x = np.asarray(responses, dtype=np.float64) ** power
    return np.asarray((knee + top * x) / (knee + x))


def nayatani_exponents(adapting: Array) -> Array:
    """Return (3,) β of adapting cone responses: 1 to 6.4, and 0.78 to 6.3 for the last."""
    longer = nayatani_exponent(adapting[:2], 6.469, 6.362, 0.4495)
    return np.append(longer, 0.7844 * nayatani_exponent(adapting[2], 8.414, 8.091, 0.5128))


def own_exponents(conditions: ViewingConditions) -> Array:
    """Return (3,) β of the cones under viewing conditions."""
    return nayatani_exponents(conditions.L_A * cones_of_white(conditions))


def background_responses(conditions: ViewingConditions, Y_o: float | None = None) -> Array:
    """Return (3,) Y_o (ξ, η, ζ) + n: the background's responses in percent, with noise."""
    if Y_o is None:
        Y_o = percent_scale(conditions) * conditions.Y_b
    return Y_o * cones_of_white(conditions) + NAYATANI_NOISE


def level_factor(conditions: ViewingConditions) -> float:
    """Return k of the source or the target."""
    lift = background_responses(conditions) / background_responses(conditions, 20.0)
    exponents = own_exponents(conditions)[:2] * (2.0 / 3.0, 1.0 / 3.0)
    return float(np.prod(lift[:2] ** exponents))


def nayatani_transform(
    use_level: bool, source: ViewingConditions, target: ViewingConditions
) -> CurveTransform:
    """Make Nayatani's transform, with or without CIE 109's K."""
    # Dividing by the background's responses first leaves powers of numbers near 1, for float32.
    near, beta = background_responses(source), own_exponents(target)
    K = level_factor(source) / level_factor(target) if use_level else 1.0
    ones = np.ones(3)
    return CurveTransform(
        response_from_XYZ=percent_scale(source) * k.D65_CONES_FROM_XYZ / near[:, None],
        XYZ_from_response=inverse(percent_scale(target) * k.D65_CONES_FROM_XYZ),
        gain=background_responses(target) * K ** (1.0 / beta),
        power=own_exponents(source) / beta,
        shift=NAYATANI_NOISE / near,
        offset=-NAYATANI_NOISE * ones,
        outer=ones,
    )


def white_trolands(conditions: ViewingConditions) -> float:
    """Return 18 Y_n^0.8."""
    return float(18.0 * white_luminance(conditions) ** 0.8)


def saturation(conditions: ViewingConditions) -> Array:
    """Return (3,) σ + L_r0."""
    adapting = GUTH_ADAPTING * white_trolands(conditions) * cones_of_white(conditions)
    return np.asarray(GUTH_SIGMA + GUTH_GAIN * adapting**GUTH_POWER + GUTH_NOISE)


def trolands_from_XYZ(conditions: ViewingConditions) -> Array:
    """Return (3, 3): XYZ to cone responses in trolands."""
    return white_trolands(conditions) / conditions.white_XYZ[1] * k.D65_CONES_FROM_XYZ


def guth_transform(source: ViewingConditions, target: ViewingConditions) -> CurveTransform:
    """Make Guth's transform; the model has no D and no ``discount``."""
    kappa = saturation(target) / saturation(source)
    ones = np.ones(3)
    return CurveTransform(
        response_from_XYZ=trolands_from_XYZ(source),
        XYZ_from_response=inverse(trolands_from_XYZ(target)),
        gain=kappa,
        power=GUTH_POWER * ones,
        shift=0.0 * ones,
        offset=(kappa - 1.0) * GUTH_NOISE / GUTH_GAIN,
        outer=ones / GUTH_POWER,
    )


TRANSFORMS: dict[str, Adaptation] = {
    "Nayatani": partial(nayatani_transform, False),
    "CIE 1994": partial(nayatani_transform, True),
    "Guth": guth_transform,
}
