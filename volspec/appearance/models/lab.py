"""CIELAB: the simplest appearance model, its derivative and its colour difference.

    relight -> [models] -> reports

References
----------
[1] CIE 15:2018; *Color Appearance Models* (survey 002), eq. 1-7.
[2] Sharma, Wu & Dalal (2005), "The CIEDE2000 Color-Difference Formula: Implementation Notes,
    Supplementary Test Data, and Mathematical Observations", Color Research & Application 30(1).
[3] CIE 116:1995, the CIE94 colour difference: CIELAB, with errors of chroma and hue weighted less
    as chroma grows. The local form of CIEDE2000 except for its corrections of blue and near-grey.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from volspec.appearance.hue import CIELAB_HUES, quadrature
from volspec.appearance.models.base import ROUNDING, Appearance, only_defined, opponents
from volspec.appearance.surround import ViewingConditions
from volspec.appearance.transforms import LinearTransform, triples
from volspec.errors import ViewingError

NAME = "CIELAB"
Array = NDArray[np.float64]

# f of the ratio XYZ / white: its cube root above the knee, linear below.
_KNEE = (6.0 / 29.0) ** 3
_SLOPE = (29.0 / 6.0) ** 2 / 3.0
_OFFSET = 4.0 / 29.0
_LAB_FROM_F = np.array([[0.0, 116.0, 0.0], [500.0, -500.0, 0.0], [0.0, 200.0, -200.0]])
_LAB_AT_0 = np.array([-16.0, 0.0, 0.0])


def _f(ratio: Array) -> Array:
    return np.where(ratio > _KNEE, np.cbrt(ratio), _SLOPE * ratio + _OFFSET)


def _f_slope(ratio: Array) -> Array:
    return np.where(ratio > _KNEE, np.maximum(ratio, _KNEE) ** (-2.0 / 3.0) / 3.0, _SLOPE)


def _white(white_XYZ: ArrayLike) -> Array:
    white = np.array(white_XYZ, dtype=np.float64)
    if white.shape != (3,) or not np.all((white > 0.0) & np.isfinite(white)):
        raise ViewingError.refused(
            "CIELAB.white_XYZ", white_XYZ, "expected three finite numbers above 0", "range"
        )
    return white


def cielab(XYZ: ArrayLike, white_XYZ: ArrayLike) -> Array:
    """Return (..., 3) L*, a*, b* of XYZ; negative XYZ are on the linear toe."""
    ratio = triples("CIELAB.XYZ", XYZ) / _white(white_XYZ)
    return _f(ratio) @ _LAB_FROM_F.T + _LAB_AT_0


def delta_E_2000(Lab_1: ArrayLike, Lab_2: ArrayLike) -> Array:
    """Return (...) CIEDE2000 between (..., 3) CIELAB colours [2]; 1 is just noticeable."""
    (L_1, a_1, b_1), (L_2, a_2, b_2) = (
        np.moveaxis(np.asarray(Lab, dtype=np.float64), -1, 0) for Lab in (Lab_1, Lab_2)
    )
    # Near-greys are spread apart: a is stretched where chroma is low.
    stretch = 1.0 + 0.5 * (1.0 - _weigh_chroma((np.hypot(a_1, b_1) + np.hypot(a_2, b_2)) / 2.0))
    (C_1, h_1), (C_2, h_2) = _polar(stretch * a_1, b_1), _polar(stretch * a_2, b_2)
    dL, dC, dh = L_2 - L_1, C_2 - C_1, h_2 - h_1
    dh = dh - 360.0 * (dh > 180.0) + 360.0 * (dh < -180.0)
    dH = 2.0 * np.sqrt(C_1 * C_2) * np.sin(np.radians(dh / 2.0))
    C, L = (C_1 + C_2) / 2.0, (L_1 + L_2) / 2.0
    h = _mean_hue(h_1, h_2, C_1 * C_2 == 0.0)
    T = 1.0 + sum(k * np.cos(np.radians(n * h + turn)) for k, n, turn in _HUE_TERMS)
    S_L = 1.0 + 0.015 * (L - 50.0) ** 2 / np.sqrt(20.0 + (L - 50.0) ** 2)
    S_C, S_H = 1.0 + 0.045 * C, 1.0 + 0.015 * C * T
    blue = 30.0 * np.exp(-(((h - 275.0) / 25.0) ** 2))
    R_T = -2.0 * _weigh_chroma(C) * np.sin(np.radians(2.0 * blue))
    lightness, chroma, hue = dL / S_L, dC / S_C, dH / S_H
    # Rounding can make the square for equal colours negative.
    square = lightness**2 + chroma**2 + hue**2 + R_T * chroma * hue
    return np.asarray(np.sqrt(np.maximum(square, 0.0)), dtype=np.float64)


# Terms of T: amplitude, multiple of the hue, phase in degrees.
_HUE_TERMS = ((-0.17, 1, -30.0), (0.24, 2, 0.0), (0.32, 3, 6.0), (-0.20, 4, -63.0))


def _weigh_chroma(C: Array) -> Array:
    return np.sqrt(C**7 / (C**7 + 25.0**7))


def _polar(a: Array, b: Array) -> tuple[Array, Array]:
    """Return chroma and hue in degrees."""
    return np.hypot(a, b), np.degrees(np.arctan2(b, a)) % 360.0


def _mean_hue(h_1: Array, h_2: Array, grey: NDArray[np.bool_]) -> Array:
    """Return the middle of the shorter arc; if one colour is grey, the hue of the other."""
    total = h_1 + h_2
    across = np.abs(h_1 - h_2) > 180.0
    mean = np.where(across, total + np.where(total < 360.0, 360.0, -360.0), total) / 2.0
    return np.where(grey, total, mean)


def cielab_derivative(ratio: ArrayLike) -> Array:
    """Return the derivative of CIELAB by XYZ / white, the metric of small colour differences.

    (..., 3) ratios to (..., 3, 3): row L*, a* or b*, column X, Y or Z.
    """
    slope = _f_slope(np.asarray(ratio, dtype=np.float64))
    return _LAB_FROM_F * slope[..., None, :]


_CHROMA_LOSS, _HUE_LOSS = 0.045, 0.015


def CIE94_metric(ratio: ArrayLike) -> Array:
    """Return G (..., 3, 3) with |G d| the CIE94 difference [3] of a small change d of XYZ / white.

    Rows are lightness, chroma and hue; ``ratio`` (..., 3) is XYZ over the white's.

    >>> step = [0.0, 0.001, 0.0]
    >>> grey, green = ([0.2, 0.2, 0.2], [0.1, 0.2, 0.05])
    >>> [round(float(np.linalg.norm(CIE94_metric(c) @ step)), 2) for c in (grey, green)]
    [0.54, 0.17]
    """
    slope = cielab_derivative(ratio)
    _, a, b = np.moveaxis(cielab(ratio, np.ones(3)), -1, 0)
    chroma = np.hypot(a, b)
    # Grey has no hue: any direction will do, as both weights are equal there.
    hue = np.arctan2(b, a)
    toward = np.stack([np.cos(hue), np.sin(hue)], axis=-1)
    across = np.stack([-np.sin(hue), np.cos(hue)], axis=-1)
    ab = slope[..., 1:, :]
    by_chroma = np.einsum("...i,...ij->...j", toward, ab) / (1 + _CHROMA_LOSS * chroma)[..., None]
    by_hue = np.einsum("...i,...ij->...j", across, ab) / (1 + _HUE_LOSS * chroma)[..., None]
    return np.stack([slope[..., 0, :], by_chroma, by_hue], axis=-2)


def cielab_chord(one: ArrayLike, other: ArrayLike) -> Array:
    """Return the slope of the chord of two colours: Lab(one) - Lab(other) = chord · (one - other).

    (..., 3) ratios XYZ / white to (..., 3, 3); the tangent if both colours are equal.

    >>> one, other = np.array([0.3, 0.4, 0.5]), np.array([0.001, 0.2, 0.6])
    >>> difference = cielab(one, [1, 1, 1]) - cielab(other, [1, 1, 1])
    >>> bool(np.allclose(cielab_chord(one, other) @ (one - other), difference))
    True
    """
    a, b = np.broadcast_arrays(np.asarray(one, np.float64), np.asarray(other, np.float64))
    rise, run = _f(a) - _f(b), a - b
    # A chord this short would lose digits.
    short = np.abs(run) < 1e-7
    slope = np.where(short, _f_slope((a + b) / 2.0), rise / np.where(short, 1.0, run))
    return _LAB_FROM_F * slope[..., None, :]


def XYZ_from_cielab(Lab: ArrayLike, white_XYZ: ArrayLike) -> Array:
    """Return (..., 3) XYZ on the white's scale: the inverse of `cielab`."""
    L, a, b = np.moveaxis(triples("CIELAB.Lab", Lab), -1, 0)
    y = (L + 16.0) / 116.0
    f = np.stack([y + a / 500.0, y, y - b / 200.0], axis=-1)
    ratio = np.where(f > 6.0 / 29.0, f**3, (f - _OFFSET) / _SLOPE)
    return ratio * _white(white_XYZ)


def forward(XYZ: ArrayLike, conditions: ViewingConditions) -> Appearance:
    """Return L*, C* and h as J, C and h; only the white of the conditions matters.

    H is based on the unique hues in daylight. XYZ below 0 are on the linear toe, not `defined`.
    """
    XYZ = triples("CIELAB.XYZ", XYZ)
    J, a, b = np.moveaxis(cielab(XYZ, conditions.white_XYZ), -1, 0)
    h = np.degrees(np.arctan2(b, a)) % 360.0
    return Appearance(
        J=J,
        C=np.hypot(a, b),
        h=h,
        H=quadrature(h, CIELAB_HUES),
        defined=np.all(-ROUNDING * _white(conditions.white_XYZ) <= XYZ, axis=-1),
    )


def inverse(J: ArrayLike, C: ArrayLike, h: ArrayLike, conditions: ViewingConditions) -> Array:
    """Return the XYZ of an L*, C* and h, in closed form; NaN if one of them is below 0."""
    XYZ = invert_beyond(J, C, h, conditions)
    return only_defined(XYZ, J, C, h, lambda XYZ: forward(XYZ, conditions))


def invert_beyond(J: ArrayLike, C: ArrayLike, h: ArrayLike, conditions: ViewingConditions) -> Array:
    """Return `inverse`, extended below 0 on the linear toe; never NaN."""
    return XYZ_from_cielab(opponents(NAME, J, C, h), conditions.white_XYZ)


def view_transform(source: ViewingConditions, target: ViewingConditions) -> LinearTransform:
    """Make the transform to colours of equal J, C and h under another condition.

    CIELAB divides by the white; everything else is the same on both sides.
    """
    return LinearTransform(np.diag(np.divide(target.white_XYZ, source.white_XYZ)))
