"""CIECAM02 and CAM16 in NumPy, float64: forward, inverse, the two in one step as in the shader.

    relight -> [XYZ -> J, C, h -> XYZ] -> display

They differ in the responses that are adapted and compressed, which `Conditions` knows.

Total on finite input: compression carries the sign of its argument, nothing is divided by t
or by the sine or cosine of the hue, a negative achromatic response is black, and responses
stop short of the pole at 400.

References
----------
[1] Neumann, Castro, Neumann & Sbert (2004), "Color Appearance in Multispectral Radiosity",
    appendix, eq. 23-37, with the errata.
[2] Moroney et al. (2002), "The CIECAM02 Color Appearance Model", 10th Color Imaging
    Conference; CIE 159:2004.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from volspec.appearance import constants as k
from volspec.appearance.hue import quadrature
from volspec.appearance.models.base import Appearance, Array, broadcast
from volspec.appearance.models.conditions import Conditions, compress, expand
from volspec.appearance.passages import triples


def _eccentricity(cos_h: Array, sin_h: Array) -> Array:
    """cos(h + 2) + 3.8 without an angle (eq. 33)."""
    cos_2, sin_2 = np.cos(k.ECCENTRICITY_PHASE), np.sin(k.ECCENTRICITY_PHASE)
    return cos_h * cos_2 - sin_h * sin_2 + k.ECCENTRICITY_OFFSET


def forward(XYZ: ArrayLike, conditions: Conditions) -> Appearance:
    """XYZ to what the eye makes of them (eq. 23-37).

    Parameters
    ----------
    XYZ : (..., 3) array_like
        On the scale of the conditions' white.
    conditions : Conditions
        Where the colours are seen.

    Returns
    -------
    Appearance
        Each correlate of shape (...).

    Raises
    ------
    ShapeError
        If the last axis is not 3.

    Examples
    --------
    The pastel of Neumann et al., table 2, under a Planck radiator of 7500 K:

    >>> seen = forward([61.34, 59.94, 50.07],
    ...                Conditions.of([87.12, 90.0, 112.95], L_A=954.93, Y_b=18))
    >>> round(float(seen.J), 2), round(float(seen.C), 2), round(float(seen.h), 2)
    (81.59, 21.56, 59.4)
    """
    responses = compress(triples("CIECAM02: XYZ", XYZ) @ conditions.response_from_XYZ().T)
    achromatic = np.maximum(responses @ k.ACHROMATIC, 0.0)
    a, b = responses @ k.OPPONENT_A, responses @ k.OPPONENT_B
    radius = np.hypot(a, b)
    h = np.degrees(np.arctan2(b, a)) % 360.0
    # A hue of no chroma is anything; taking cos h = 1 there divides by nothing.
    safe = np.where(radius > 0.0, radius, 1.0)
    cos_h, sin_h = np.where(radius > 0.0, a, 1.0) / safe, b / safe
    J = 100.0 * (achromatic / conditions.white_achromatic) ** conditions.lightness_power
    total = responses @ k.CHROMA_SUM + k.RESPONSE_NOISE * k.CHROMA_SUM.sum()
    total = np.maximum(total, k.CHROMA_FLOOR * (achromatic + k.ACHROMATIC_NOISE))
    t = conditions.eccentricity_scale * _eccentricity(cos_h, sin_h) * radius / total
    C = t**k.CHROMA_POWER * np.sqrt(J / 100.0) * conditions.chroma_scale
    brightness_scale = 4.0 / conditions.surround.c * (conditions.A_w + 4.0)
    Q = brightness_scale * np.sqrt(J / 100.0) * conditions.F_L**0.25
    M = C * conditions.F_L**0.25
    s = 100.0 * np.sqrt(np.divide(M, Q, out=np.zeros_like(M), where=Q > 0.0))
    return Appearance(J=J, C=C, h=h, H=quadrature(h), Q=Q, M=M, s=s)


def inverse(J: ArrayLike, C: ArrayLike, h: ArrayLike, conditions: Conditions) -> Array:
    """Lightness, chroma and hue to XYZ; J at or below 0 is black.

    Parameters
    ----------
    J, C, h : (...) array_like
        Lightness, chroma, hue angle in degrees.
    conditions : Conditions
        Where the colours shall be seen.

    Returns
    -------
    (..., 3) float64
        XYZ on the scale of the conditions' white.

    Raises
    ------
    ShapeError
        If the three do not broadcast together.
    """
    J, C, h = broadcast(conditions.model, J, C, h)
    lit = J > 0.0
    level = np.where(lit, J, 1.0) / 100.0
    cos_h, sin_h = np.cos(np.radians(h)), np.sin(np.radians(h))
    t = np.maximum(C, 0.0) / (np.sqrt(level) * conditions.chroma_scale)
    t = t ** (1.0 / k.CHROMA_POWER)
    p1 = conditions.eccentricity_scale * _eccentricity(cos_h, sin_h)
    achromatic = conditions.white_achromatic * level ** (1.0 / conditions.lightness_power)
    p2 = achromatic + k.ACHROMATIC_NOISE
    skew = k.CHROMA_SKEW[0] * cos_h + k.CHROMA_SKEW[1] * sin_h
    chroma = t * p2 / np.maximum(p1 + t * skew, k.CHROMA_FLOOR * p1)
    opponent = np.stack([achromatic, chroma * cos_h, chroma * sin_h], axis=-1)
    responses = expand(opponent @ k.RESPONSE_FROM_OPPONENT.T)
    XYZ_from_response = np.linalg.inv(conditions.response_from_XYZ())
    scale = k.RESPONSE_HALF ** (1.0 / k.RESPONSE_POWER)
    return np.where(lit[..., None], responses @ XYZ_from_response.T * scale, 0.0)
