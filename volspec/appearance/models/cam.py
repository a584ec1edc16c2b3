"""CIECAM02 and CAM16 in NumPy, float64: forward, inverse, the two in one step as in the shader.

    relight -> [XYZ -> J, C, h -> XYZ] -> display

They differ in the responses that are adapted and compressed, which `Conditions` knows.

Forward gives numbers for all finite input: compression carries the sign of its argument, nothing
is divided by t or by the sine or cosine of the hue, and a negative achromatic response is black.
``defined`` tells where these are the published model's, and there the inverse comes back.

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
from volspec.appearance.models.base import Appearance, Array, broadcast, only_defined
from volspec.appearance.models.conditions import Conditions, compress, expand
from volspec.appearance.passages import triples

# Where `forward` is just defined its inverse is, too: a little is left for rounding.
_LEAST_UNDER = k.CHROMA_FLOOR * (1.0 - 1e-9)
_MOST = k.RESPONSE_LIMIT * (1.0 + 1e-12)


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
        Each correlate of shape (...). Not `defined` where the published formulas take a power of
        a negative number, which is NaN: the achromatic response A (eq. 35-36) or the sum under t
        (eq. 34); where either has fallen to a hundredth of the other, and floors hold; and
        where a response nears its pole. Black is defined. A negative R', G' or B' by itself is
        not outside: eq. 29 takes its sign along.

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
    responses = compress(
        triples(f"{conditions.model}: XYZ", XYZ) @ conditions.response_from_XYZ().T
    )
    signal = responses @ k.ACHROMATIC
    achromatic = np.maximum(signal, 0.0)
    a, b = responses @ k.OPPONENT_A, responses @ k.OPPONENT_B
    radius = np.hypot(a, b)
    h = np.degrees(np.arctan2(b, a)) % 360.0
    # A hue of no chroma is anything; taking cos h = 1 there divides by nothing.
    safe = np.where(radius > 0.0, radius, 1.0)
    cos_h, sin_h = np.where(radius > 0.0, a, 1.0) / safe, b / safe
    J = 100.0 * (achromatic / conditions.white_achromatic) ** conditions.lightness_power
    p2 = achromatic + k.ACHROMATIC_NOISE
    total = responses @ k.CHROMA_SUM + k.RESPONSE_NOISE * k.CHROMA_SUM.sum()
    sound = (total >= k.CHROMA_FLOOR * p2) & (p2 >= k.CHROMA_FLOOR * total) & (signal > 0.0)
    black = np.all(responses == 0.0, axis=-1)
    total = np.maximum(total, k.CHROMA_FLOOR * p2)
    t = conditions.eccentricity_scale * _eccentricity(cos_h, sin_h) * radius / total
    C = t**k.CHROMA_POWER * np.sqrt(J / 100.0) * conditions.chroma_scale
    brightness_scale = 4.0 / conditions.surround.c * (conditions.A_w + 4.0)
    Q = brightness_scale * np.sqrt(J / 100.0) * conditions.F_L**0.25
    M = C * conditions.F_L**0.25
    s = 100.0 * np.sqrt(np.divide(M, Q, out=np.zeros_like(M), where=Q > 0.0))
    defined = (sound | black) & np.all(np.abs(responses) <= k.RESPONSE_LIMIT, axis=-1)
    return Appearance(J=J, C=C, h=h, defined=defined, H=quadrature(h), Q=Q, M=M, s=s)


def inverse(J: ArrayLike, C: ArrayLike, h: ArrayLike, conditions: Conditions) -> Array:
    """Lightness, chroma and hue to XYZ: `forward` undone where it is defined.

    Parameters
    ----------
    J, C, h : (...) array_like
        Lightness, chroma, hue angle in degrees. Chroma below 0 counts as 0.
    conditions : Conditions
        Where the colours shall be seen.

    Returns
    -------
    (..., 3) float64
        XYZ on the scale of the conditions' white; NaN where none that is `defined` looks so: J
        below 0, chroma at J = 0, and what is brighter or more chromatic than the responses reach.

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
    # p1 p2 over the sum under t: at or below 0 nothing has that chroma at that hue.
    under = p1 + t * skew
    chroma = t * p2 / np.maximum(under, k.CHROMA_FLOOR * p1)
    opponent = np.stack([achromatic, chroma * cos_h, chroma * sin_h], axis=-1)
    compressed = opponent @ k.RESPONSE_FROM_OPPONENT.T
    known = (under > _LEAST_UNDER * p1) & np.all(np.abs(compressed) <= _MOST, axis=-1)
    XYZ_from_response = np.linalg.inv(conditions.response_from_XYZ())
    scale = k.RESPONSE_HALF ** (1.0 / k.RESPONSE_POWER)
    XYZ = np.where(known[..., None], expand(compressed) @ XYZ_from_response.T * scale, np.nan)
    unlit = np.where((J == 0.0) & (C <= 0.0), 0.0, np.nan)
    XYZ = np.where(lit[..., None], XYZ, unlit[..., None])
    return only_defined(XYZ, J, C, h, lambda each: forward(each, conditions))
