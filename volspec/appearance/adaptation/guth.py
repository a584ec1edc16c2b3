"""Guth's model: powers of the cones, and gains that saturate with the adapting light.

    L_r = 0.66 L^0.7 + 0.002,    L_a = L_r (1 − L_r0 / (σ + L_r0))
    M_r = 1.00 M^0.7 + 0.003,    S_r = 0.45 S^0.7 + 0.00135

Equal L_a on both sides, with κ = (σ + L_r0') / (σ + L_r0):

    L' = (κ L^0.7 + (κ − 1) 0.002/0.66)^(1/0.7)

The survey leaves three things open. Taken here, and from where:

- σ = 300 [2].
- L, M, S are in trolands, 18 Y_n^0.8 for the white [2], Y_n its luminance in cd/m². The pupil
  follows the white, one factor for the picture; ATD95 puts the power on every colour.
- The adapting light, L_r0, is k_2 = 50 times the white, and nothing of the sample: k_1 = 0 and
  k_2 of 15 to 50 is what [2] gives for related colours. With the white alone (k_2 = 1) the gains
  would hardly follow it, against the survey's finding that the model does about as von Kries.

Cones are the survey's, M before all models, not those of ATD95.

Equal L_a carry brightness, not lightness: from bright to dim a white comes out above the dim
white's. Feed both sides one L_A and Y_b where the picture's tones are to stay.

References
----------
[1] Pirsivash, "Viewing Conditions and Chromatic Adaptation", section Guth's model; from Guth
    (1991), "Model for color vision and light adaptation", JOSA A 8(6), 976-993.
[2] Guth (1995), "Further applications of the ATD model for color vision", Proc. SPIE 2414,
    12-26. doi:10.1117/12.206546, by way of colour-science's ATD95.
"""

from __future__ import annotations

import numpy as np

from volspec.appearance.adaptation.base import (
    CONES_FROM_XYZ,
    Adaptation,
    Array,
    cones_of_white,
    inverse,
    white_luminance,
)
from volspec.appearance.passages import CurvePassage
from volspec.appearance.spec import ViewingConditions

GAIN = np.array([0.66, 1.0, 0.45])
NOISE = np.array([0.002, 0.003, 0.00135])
POWER = 0.7
SIGMA = 300.0
ADAPTING = 50.0


def white_trolands(conditions: ViewingConditions) -> float:
    """18 Y_n^0.8."""
    return float(18.0 * white_luminance(conditions) ** 0.8)


def saturation(conditions: ViewingConditions) -> Array:
    """σ + L_r0; (3,)."""
    adapting = ADAPTING * white_trolands(conditions) * cones_of_white(conditions)
    return np.asarray(SIGMA + GAIN * adapting**POWER + NOISE)


def trolands_from_XYZ(conditions: ViewingConditions) -> Array:
    """(3, 3): XYZ to cone responses in trolands."""
    return white_trolands(conditions) / conditions.white_XYZ[1] * CONES_FROM_XYZ


def passage(source: ViewingConditions, target: ViewingConditions) -> CurvePassage:
    """The passage; D and ``discount`` are not Guth's."""
    kappa = saturation(target) / saturation(source)
    ones = np.ones(3)
    return CurvePassage(
        response_from_XYZ=trolands_from_XYZ(source),
        XYZ_from_response=inverse(trolands_from_XYZ(target)),
        gain=kappa,
        power=POWER * ones,
        shift=0.0 * ones,
        offset=(kappa - 1.0) * NOISE / GAIN,
        outer=ones / POWER,
    )


PASSAGES: dict[str, Adaptation] = {"Guth": passage}
