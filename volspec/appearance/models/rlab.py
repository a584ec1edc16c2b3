"""RLAB: CIELAB with a better adaptation and a contrast that follows the surround.

    XYZ -> cones, partly adapted -> XYZ under D65 -> power sigma -> L, a, b -> J, C, h

``J, C, h, H, s`` are L^R, C^R, h^R, H^R, s^R. The conditions' D is the fraction of the light's
colour that is discounted: 1 for prints in a lit room, 0 for self-luminous pictures (and None).

References
----------
[1] Fairchild (1996), "Refinement of the RLAB color space", Color Research & Application 21(5),
    338-346; *Color Appearance Models* (survey 002), eq. 70-89 with the errata.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from volspec.appearance.display import constants as k
from volspec.appearance.hue import CIELAB_HUES, quadrature
from volspec.appearance.models.base import (
    ROUNDING,
    Appearance,
    Array,
    cone_adaptation,
    cones_of_white,
    degree_of_discounting,
    interpolate_surround,
    only_defined,
    opponents,
)
from volspec.appearance.surround import ViewingConditions
from volspec.appearance.transforms import CurveTransform, signed_power, triples

NAME = "RLAB"

# Eq. 83: (A M)⁻¹ under D65 at D = 1, rows divided by the white.
REFERENCE_FROM_ADAPTED = np.array(
    [[1.9569, -1.1882, 0.2313], [0.3612, 0.6388, 0.0], [0.0, 0.0, 1.0]]
)
# L, a, b from X_ref^σ, Y_ref^σ, Z_ref^σ (eq. 84-86).
LAB_FROM_POWERS = np.array([[0.0, 100.0, 0.0], [430.0, -430.0, 0.0], [0.0, 170.0, -170.0]])


def exponent(surround: str | float) -> float:
    """Return σ: dark 1/3.5, dim 1/2.9, average 1/2.3, linear between the surrounds' ratios."""
    return interpolate_surround(surround, dark=1.0 / 3.5, dim=1.0 / 2.9, average=1.0 / 2.3)


def reference_from_XYZ(conditions: ViewingConditions) -> Array:
    """Return (3, 3) R A M: XYZ to the XYZ of equal appearance under D65 (eq. 70-83)."""
    white = cones_of_white(NAME, conditions)
    gains = cone_adaptation(white, conditions.L_A, degree_of_discounting(conditions)) / white
    return np.asarray(REFERENCE_FROM_ADAPTED @ (gains[:, None] * k.HPE_FROM_XYZ))


def forward(XYZ: ArrayLike, conditions: ViewingConditions) -> Appearance:
    """Return L^R, C^R, h^R, H^R and s^R; the model has no brightness and no colourfulness.

    Y_b has no influence. A value that is negative under D65 keeps its sign and is not `defined`.
    """
    reference = triples("RLAB.XYZ", XYZ) @ reference_from_XYZ(conditions).T
    Lab = signed_power(reference, exponent(conditions.surround)) @ LAB_FROM_POWERS.T
    J, a, b = np.moveaxis(Lab, -1, 0)
    C, h = np.hypot(a, b), np.degrees(np.arctan2(b, a)) % 360.0
    return Appearance(
        J=J,
        C=C,
        h=h,
        H=quadrature(h, CIELAB_HUES),
        s=np.divide(C, J, out=np.zeros_like(C), where=J > 0.0),
        defined=np.all(reference >= -ROUNDING, axis=-1),
    )


def inverse(J: ArrayLike, C: ArrayLike, h: ArrayLike, conditions: ViewingConditions) -> Array:
    """Return the XYZ of a lightness, chroma and hue; NaN if a channel is below 0 under D65."""
    XYZ = invert_beyond(J, C, h, conditions)
    return only_defined(XYZ, J, C, h, lambda XYZ: forward(XYZ, conditions))


def invert_beyond(J: ArrayLike, C: ArrayLike, h: ArrayLike, conditions: ViewingConditions) -> Array:
    """Return `inverse`, extended below 0 by sign-preserving powers; never NaN."""
    powers = opponents(NAME, J, C, h) @ np.linalg.inv(LAB_FROM_POWERS).T
    reference = signed_power(powers, 1.0 / exponent(conditions.surround))
    return np.asarray(reference @ np.linalg.inv(reference_from_XYZ(conditions)).T)


def view_transform(source: ViewingConditions, target: ViewingConditions) -> CurveTransform:
    """Make inverse after forward in one step: a power per response between two matrices.

    Equal J, C and h mean equal X_ref^σ, Y_ref^σ, Z_ref^σ, so X_ref' = X_ref^(σ/σ').
    """
    ones = np.ones(3)
    return CurveTransform(
        response_from_XYZ=reference_from_XYZ(source),
        XYZ_from_response=np.asarray(np.linalg.inv(reference_from_XYZ(target)), np.float64),
        gain=ones,
        power=ones * exponent(source.surround) / exponent(target.surround),
        shift=0.0 * ones,
        offset=0.0 * ones,
        outer=ones,
    )
