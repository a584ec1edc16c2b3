"""Linear adaptations: none, von Kries in five spaces, and Fairchild's model of 1990.

Von Kries divides each response by the white's:

    R   = M · XYZ · 100/Y_w
    R_c = (D · 100/R_w + 1 − D) · R         R_w: the white's response in percent; D: the side's
    XYZ' : the inverse under the target, with the target's white and the target's D

The two sides meet in R_c, each with its own D, as in CIECAM02 (and in Zhai and Luo's two steps via
equal energy). At D = 1 on both sides this is M⁻¹ · diag(R_w'/R_w) · M, and swapping source and
target is the exact inverse at any D.

====================  ====================================================  ================
name                  M                                                     D = None means
====================  ====================================================  ================
``"von Kries"``       Hunt-Pointer-Estévez cones, normalised to D65         1
``"Bradford"``        Lam's sharpened cones [3]                             1
``"Sharp"``           Finlayson and Süsstrunk's [4]                         1
``"CAT02"``           CIECAM02's [1, 2]                                     eq. 24 of [2]
``"CAT16"``           CAM16's [5]                                           the same
====================  ====================================================  ================

``discount`` means D = 1 in all of them.

Fairchild's adaptation is incomplete and mixes the cone responses:

    a_M = p_M / M_n,     p_M = (1 + Y_n^v + m_E) / (1 + Y_n^v + 1/m_E),     v = 1/3
    m_E = 3 (M_n/M_E) / (L_n/L_E + M_n/M_E + S_n/S_E)           L and S alike
    C   = 1 on the diagonal, c = 0.219 − 0.0784 log10(Y_n) off it
    XYZ_2 = M⁻¹ A_2⁻¹ C_2⁻¹ C_1 A_1 M · XYZ_1

with n for the white, E for equal energy, and Y_n the white's luminance, L_A Y_w/Y_b, in cd/m². Each
side has its own p and C. ``discount`` means p = 1; the model has no D. colour-science 0.4.7 uses
one p for both sides, and a C with c on the diagonal and 0 off it: both cancel, which leaves plain
von Kries.

References
----------
[1] Pirsivash, "Viewing Conditions and Chromatic Adaptation" (after Fairchild, Color Appearance
    Models), sections von Kries, CAT02 and Fairchild's model. M precedes X₁ there too (erratum).
[2] Neumann, Castro, Neumann & Sbert (2004), eq. 22-24.
[3] Lam (1985), "Metamerism and colour constancy", PhD thesis, University of Bradford.
[4] Finlayson & Süsstrunk (2000), "Performance of a chromatic adaptation transform based on
    spectral sharpening", Color Imaging Conference 8, 49-55.
[5] Li et al. (2017), "Comprehensive color solutions: CAM16, CAT16, and CAM16-UCS", Color
    Research & Application 42(6), 703-718. doi:10.1002/col.22131
[6] Fairchild (1991), "Formulation and testing of an incomplete-chromatic-adaptation model",
    Color Research & Application 16(4), 243-250. doi:10.1002/col.5080160406
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

import numpy as np

from volspec.appearance.display import constants as k
from volspec.appearance.surround import ViewingConditions
from volspec.appearance.transforms import Array, LinearTransform, ViewTransform

Adaptation = Callable[[ViewingConditions, ViewingConditions], ViewTransform]

SHARP_FROM_XYZ = np.array(
    [[1.2694, -0.0988, -0.1706], [-0.8364, 1.8006, 0.0357], [0.0297, -0.0315, 1.0018]]
)
# Bounds on responses to a white over its luminance. Real lights reach 164 (violet of 380 nm).
_MIN, _MAX = 1e-6, 1e6
# cd/m²: bounds on the models' input. Fairchild's C is singular outside of 1e-10 to 1e9;
# starlight on paper is 1e-4, and the sun's disc 1e9.
LUMINANCES = (1e-4, 1e6)
_MIN_N = 1e-4
_FAIRCHILD_EXPONENT = 1.0 / 3.0


def percent_scale(conditions: ViewingConditions) -> float:
    """Return 100 / Y_w: XYZ to percent of the white."""
    return 100.0 / conditions.white_XYZ[1]


def inverse(matrix: Array) -> Array:
    """Return the (3, 3) float64 inverse."""
    return np.asarray(np.linalg.inv(matrix), dtype=np.float64)


def clamp_magnitude(values: Array) -> Array:
    """Clamp magnitudes to 1e-6…1e6; signs stay."""
    return np.asarray(np.copysign(np.clip(np.abs(values), _MIN, _MAX), values))


def relative_white(matrix: Array, conditions: ViewingConditions) -> Array:
    """Return (3,) responses to the white over its Y. Saturated lights can have negative ones."""
    return clamp_magnitude(matrix @ np.divide(conditions.white_XYZ, conditions.white_XYZ[1]))


def cones_of_white(conditions: ViewingConditions) -> Array:
    """Return (3,) cone responses to the white over its Y, clamped above 0; all 1 for D65."""
    return np.maximum(relative_white(k.D65_CONES_FROM_XYZ, conditions), _MIN)


def white_luminance(conditions: ViewingConditions) -> float:
    """Return Y_n = L_A Y_w / Y_b in cd/m², within `LUMINANCES`.

    A background darker than 1e-4 of the white counts as 1e-4, as in CIECAM02.
    """
    Y_n = conditions.L_A / max(conditions.Y_b / conditions.white_XYZ[1], _MIN_N)
    return float(np.clip(Y_n, *LUMINANCES))


def complete(conditions: ViewingConditions) -> float:
    """Return D of von Kries, Bradford and Sharp: 1 unless given."""
    return 1.0 if conditions.D is None or conditions.discount else conditions.D


def partial_by_luminance(conditions: ViewingConditions) -> float:
    """Return D of CIECAM02: F (1 − exp(−(L_A + 42)/92) / 3.6) unless given."""
    if conditions.D is not None or conditions.discount:
        return complete(conditions)
    return float(conditions.factors.F * (1.0 - np.exp(-(conditions.L_A + 42.0) / 92.0) / 3.6))


VON_KRIES = {
    "von Kries": (k.D65_CONES_FROM_XYZ, complete),
    "Bradford": (k.BRADFORD_FROM_XYZ, complete),
    "Sharp": (SHARP_FROM_XYZ, complete),
    "CAT02": (k.CAT02_FROM_XYZ, partial_by_luminance),
    "CAT16": (k.CAT16_FROM_XYZ, partial_by_luminance),
}


def adapted_from_XYZ(name: str, conditions: ViewingConditions) -> Array:
    """Return (3, 3): XYZ to R_c, in the space of that name."""
    matrix, degree = VON_KRIES[name]
    D = degree(conditions)
    # A light with a negative response has one D at which a gain vanishes; clamped off 0, too.
    gains = clamp_magnitude(D / relative_white(matrix, conditions) + 1.0 - D)
    return percent_scale(conditions) * gains[:, None] * matrix


def fairchild_degrees(conditions: ViewingConditions) -> Array:
    """Return (3,) p of the three cones; 1 if the white is of equal energy."""
    if conditions.discount:
        return np.ones(3)
    relative = cones_of_white(conditions) / k.D65_CONES_FROM_XYZ.sum(axis=1)
    e = 3.0 * relative / relative.sum()
    base = 1.0 + white_luminance(conditions) ** _FAIRCHILD_EXPONENT
    return np.asarray((base + e) / (base + 1.0 / e))


def fairchild_mixing(conditions: ViewingConditions) -> Array:
    """Return (3, 3) C."""
    c = 0.219 - 0.0784 * np.log10(white_luminance(conditions))
    return c + (1.0 - c) * np.eye(3)


def fairchild_from_XYZ(conditions: ViewingConditions) -> Array:
    """Return (3, 3) C A M: XYZ to adapted cones."""
    a = fairchild_degrees(conditions) / cones_of_white(conditions)
    cones = a[:, None] * k.D65_CONES_FROM_XYZ
    return percent_scale(conditions) * fairchild_mixing(conditions) @ cones


def identity(source: ViewingConditions, target: ViewingConditions) -> LinearTransform:
    """Make the identity, XYZ' = XYZ: no adaptation, so tungsten light looks orange."""
    return LinearTransform(np.eye(3))


def linear_transform(
    adapted: Callable[[ViewingConditions], Array],
    source: ViewingConditions,
    target: ViewingConditions,
) -> LinearTransform:
    """Make the transform via adapted responses; ``adapted`` returns their matrix."""
    return LinearTransform(inverse(adapted(target)) @ adapted(source))


TRANSFORMS: dict[str, Adaptation] = {
    "none": identity,
    **{name: partial(linear_transform, partial(adapted_from_XYZ, name)) for name in VON_KRIES},
}
fairchild_transform: Adaptation = partial(linear_transform, fairchild_from_XYZ)
