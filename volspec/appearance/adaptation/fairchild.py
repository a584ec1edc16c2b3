"""Fairchild's model of 1990: von Kries with incomplete adaptation, and cones that mix.

    L_1, M_1, S_1 = M · XYZ in percent of the white
    a_M = p_M / M_n,     p_M = (1 + Y_n^v + m_E) / (1 + Y_n^v + 1/m_E),     v = 1/3
    m_E = 3 (M_n/M_E) / (L_n/L_E + M_n/M_E + S_n/S_E)           L and S alike
    C   = 1 on the diagonal, c = 0.219 − 0.0784 log10(Y_n) beside it
    XYZ_2 = M⁻¹ A_2⁻¹ C_2⁻¹ C_1 A_1 M · XYZ_1

n is the white, E equal energy, and Y_n the white's luminance, L_A Y_w/Y_b, in cd/m². Each side
has its own p and C. ``discount`` is p = 1; D is not the model's.

colour-science 0.4.7 takes one p for both sides, and a C with c on the diagonal and 0 beside it:
both cancel, and plain von Kries is left.

References
----------
[1] Pirsivash, "Viewing Conditions and Chromatic Adaptation", section Fairchild's model.
[2] Fairchild (1991), "Formulation and testing of an incomplete-chromatic-adaptation model",
    Color Research & Application 16(4), 243-250. doi:10.1002/col.5080160406
"""

from __future__ import annotations

import numpy as np

from volspec.appearance.adaptation.base import (
    CONES_FROM_XYZ,
    Adaptation,
    Array,
    cones_of_white,
    inverse,
    scale,
    white_luminance,
)
from volspec.appearance.passages import LinearPassage
from volspec.appearance.spec import ViewingConditions

_EXPONENT = 1.0 / 3.0


def degrees(conditions: ViewingConditions) -> Array:
    """p of the three cones; (3,), 1 where the white is of equal energy."""
    if conditions.discount:
        return np.ones(3)
    share = cones_of_white(conditions) / CONES_FROM_XYZ.sum(axis=1)
    e = 3.0 * share / share.sum()
    base = 1.0 + white_luminance(conditions) ** _EXPONENT
    return np.asarray((base + e) / (base + 1.0 / e))


def mixing(conditions: ViewingConditions) -> Array:
    """C; (3, 3)."""
    c = 0.219 - 0.0784 * np.log10(white_luminance(conditions))
    return c + (1.0 - c) * np.eye(3)


def adapted_from_XYZ(conditions: ViewingConditions) -> Array:
    """(3, 3): C A M, XYZ to adapted cones."""
    a = degrees(conditions) / cones_of_white(conditions)
    return scale(conditions) * mixing(conditions) @ (a[:, None] * CONES_FROM_XYZ)


def passage(source: ViewingConditions, target: ViewingConditions) -> LinearPassage:
    """The passage."""
    return LinearPassage(inverse(adapted_from_XYZ(target)) @ adapted_from_XYZ(source))


PASSAGES: dict[str, Adaptation] = {"Fairchild 1990": passage}
