"""Nayatani's model of 1995: logarithms of cone responses, on a grey background.

    XYZ -> cones -> log over the background's -> Q, t, p -> L*_P, C, theta

``J, C, h, H, Q, M, s, Q_WB, L_N`` are L*_P, C, θ, H, B_r, M, S, Q, L*_N. Chroma is defined from
L*_P, so lightness, too, is L*_P and not L*_N, which hardly differs. The surround, D and
discounting have no influence.

References
----------
[1] Nayatani, Sobagaki & Yano (1995), "Lightness dependency of chroma scales of a nonlinear
    color-appearance model and its latest formulation", Color Research & Application 20(3),
    156-167; *Color Appearance Models* (survey 002), eq. 90-124, with the errata.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from volspec.appearance.adaptation.nonlinear import nayatani_exponent, nayatani_exponents
from volspec.appearance.display import constants as k
from volspec.appearance.hue import NAYATANI_HUES, quadrature
from volspec.appearance.models.base import (
    ROUNDING,
    Appearance,
    Array,
    broadcast,
    only_defined,
    require_real_white,
)
from volspec.appearance.surround import ViewingConditions
from volspec.appearance.transforms import triples
from volspec.errors import ViewingError
from volspec.settings import Positive
from volspec.settings import settings as checked

NAME = "Nayatani95"

_BRIGHT = 1.758
"""e(R), e(G) of colours lighter than a grey of 20 (eq. 104)."""
_ACHROMATIC, _CHROMATIC, _MIDDLE = 41.69, 488.93, 50.0
# E_s(θ), eq. 116-118: the constant, then sines and cosines of θ, 2θ, 3θ, 4θ.
_STRENGTH = 0.9394
_SINES = np.array([-0.2478, -0.0743, 0.0666, -0.0186])
_COSINES = np.array([-0.0055, -0.0521, -0.0573, -0.0061])
# The logarithm's argument is clamped to at least this fraction of the noise.
_MIN = 1e-3


@checked(ViewingError)
@dataclass(frozen=True, slots=True)
class NayataniSettings:
    """Inputs of Nayatani's model beyond the viewing conditions."""

    E_or: Positive = 1000.0
    """Normalising illuminance, lux; usually 1000 to 3000."""
    n: Positive = 1.0
    """Noise, in the units of Y; usually 1."""


NORMAL = NayataniSettings()


def _weight(x: Array) -> Array:
    """Return e(R) x; the sign of x = β_1 log (R + n) / (20 ξ + n) selects e(R)."""
    return np.where(x >= 0.0, _BRIGHT, 1.0) * x


def _strength(h: Array) -> Array:
    """Return E_s(θ) (eq. 116-118), θ in degrees."""
    angles = np.radians(h)[..., None] * np.arange(1.0, 5.0)
    return np.asarray(_STRENGTH + np.sin(angles) @ _SINES + np.cos(angles) @ _COSINES)


class _Scalars:
    """Numbers of one viewing condition (eq. 90-98, 102, 109-111)."""

    def __init__(self, conditions: ViewingConditions, settings: NayataniSettings) -> None:
        white = np.asarray(conditions.white_XYZ)
        cones = k.D65_CONES_FROM_XYZ @ (white / white[1])
        grey = require_real_white(NAME, conditions, cones)
        self.n = settings.n
        # Y_o E_o / (100 π) is just the adapting luminance L_A (eq. 90).
        adapting = conditions.L_A * grey
        self.beta = nayatani_exponents(adapting)
        L_or = conditions.Y_b * settings.E_or / (100.0 * np.pi)
        self.beta_or = float(nayatani_exponent(L_or, 6.469, 6.362, 0.4495))
        self.background = 20.0 * grey + self.n
        ratios = self.beta * np.log10((100.0 * grey + self.n) / self.background)
        self.raised = _MIDDLE / self.beta_or * (2.0 * self.beta[0] + self.beta[1]) / 3.0
        self.B_rw = float(self.achromatic(ratios[0], ratios[1])) + self.raised

    def achromatic(self, x_R: Array, x_G: Array) -> Array:
        """Return Q (eq. 104)."""
        both = (2.0 * _weight(x_R) + _weight(x_G)) / 3.0
        return np.asarray(_ACHROMATIC / self.beta_or * both)


def forward(
    XYZ: ArrayLike, conditions: ViewingConditions, settings: NayataniSettings = NORMAL
) -> Appearance:
    """Return the appearance of XYZ (eq. 90-124); Y = 100 for a perfect diffuser.

    The illuminance follows from the background's Y_b and luminance L_A. Not `defined` where a
    cone's response falls to -n, or lightness below 0, as near black; there C scales with |J|^0.7.
    Raises ViewingError if a cone's response to the white is not above 0.
    """
    eye = _Scalars(conditions, settings)
    noisy = triples("Nayatani95.XYZ", XYZ) @ k.D65_CONES_FROM_XYZ.T + eye.n
    floor = _MIN * eye.n
    x = eye.beta * np.log10(np.maximum(noisy, floor) / eye.background)
    x_R, x_G, x_B = np.moveaxis(x, -1, 0)
    achromatic = eye.achromatic(x_R, x_G)
    t = x_R - 12.0 / 11.0 * x_G + x_B / 11.0
    p = (x_R + x_G - 2.0 * x_B) / 9.0
    h = np.degrees(np.arctan2(p, t)) % 360.0
    J, brightness = achromatic + _MIDDLE, achromatic + eye.raised
    s = _CHROMATIC / eye.beta_or * _strength(h) * np.hypot(t, p)
    C = np.abs(J / _MIDDLE) ** 0.7 * s
    M, angle = C * eye.B_rw / 100.0, np.radians(h)
    return Appearance(
        J=J,
        C=C,
        h=h,
        H=quadrature(h, NAYATANI_HUES),
        Q=brightness,
        M=M,
        M_RG=M * np.cos(angle),
        M_YB=M * np.sin(angle),
        s=s,
        Q_WB=achromatic,
        L_N=100.0 * brightness / eye.B_rw,
        defined=np.all(noisy > floor, axis=-1) & (J >= -100.0 * ROUNDING),
    )


def inverse(
    J: ArrayLike,
    C: ArrayLike,
    h: ArrayLike,
    conditions: ViewingConditions,
    settings: NayataniSettings = NORMAL,
) -> Array:
    """Return the XYZ of a lightness, chroma and hue, in closed form; NaN if there is none.

    t and p determine x_R - x_G, where x are the logarithms times their exponents; Q then increases
    with x_G piecewise linearly, in three pieces that meet where x_R or x_G is 0.
    """
    XYZ = invert_beyond(J, C, h, conditions, settings)
    return only_defined(XYZ, J, C, h, lambda XYZ: forward(XYZ, conditions, settings))


def invert_beyond(
    J: ArrayLike,
    C: ArrayLike,
    h: ArrayLike,
    conditions: ViewingConditions,
    settings: NayataniSettings = NORMAL,
) -> Array:
    """Return `inverse`, extended to lightness below 0 and cone responses near -n.

    NaN for chroma at lightness 0, and beyond float64's range.
    """
    J, C, h = broadcast(NAME, J, C, h)
    eye = _Scalars(conditions, settings)
    C = np.maximum(C, 0.0)
    with np.errstate(all="ignore"):
        s = np.where(C > 0.0, C / np.abs(J / _MIDDLE) ** 0.7, 0.0)
        radius = s * eye.beta_or / (_CHROMATIC * _strength(h))
        angle = np.radians(h)
        t, p = radius * np.cos(angle), radius * np.sin(angle)
        difference = (22.0 * t + 9.0 * p) / 23.0
        level = 3.0 * (J - _MIDDLE) * eye.beta_or / _ACHROMATIC
        e_G = np.where(level >= 2.0 * _weight(difference), _BRIGHT, 1.0)
        e_R = np.where(level >= _weight(-difference), _BRIGHT, 1.0)
        x_G = (level - 2.0 * e_R * difference) / (2.0 * e_R + e_G)
        x_R = x_G + difference
        x_B = (x_R + x_G - 9.0 * p) / 2.0
        x = np.stack([x_R, x_G, x_B], axis=-1)
        cones = 10.0 ** (x / eye.beta) * eye.background - eye.n
        XYZ: Array = cones @ np.linalg.inv(k.D65_CONES_FROM_XYZ).T
        finite = np.isfinite(XYZ).all(axis=-1, keepdims=True)
        return np.where(finite, XYZ, np.nan)
