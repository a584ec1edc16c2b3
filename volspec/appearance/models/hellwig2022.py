"""Hellwig and Fairchild's model of 2022: CAM16 with simpler brightness, colourfulness and chroma.

    XYZ -> CAM16's responses, compressed -> achromatic, a, b -> J, C, h

Lightness and hue are CAM16's; chroma is proportional to the opponent signals and does not depend on
lightness. The transform between two conditions is therefore `CamTransform` with a constant factor
of (a, b). ``J_HK`` is lightness with the Helmholtz-Kohlrausch effect [2].

References
----------
[1] Hellwig & Fairchild (2022), "Brightness, lightness, colorfulness, and chroma in CIECAM02 and
    CAM16", Color Research & Application 47(5), 1083-1095. doi:10.1002/col.22792
[2] Hellwig, Stolitzka & Fairchild (2022), "Extending CIECAM02 and CAM16 for the
    Helmholtz-Kohlrausch effect", Color Research & Application 47(5), 1096-1104.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from volspec.appearance.display import constants as k
from volspec.appearance.hue import quadrature
from volspec.appearance.models.base import ROUNDING, Appearance, Array, broadcast, only_defined
from volspec.appearance.models.cam import (
    HELLWIG_2022,
    MAX_RESPONSE,
    CamConditions,
    CamTransform,
    compress,
    expand,
)
from volspec.appearance.surround import ViewingConditions
from volspec.appearance.transforms import triples

NAME = HELLWIG_2022

# M = 43 N_c e_t √(a² + b²), C = 35 M / A_w.
_COLOURFULNESS, _CHROMA = 43.0, 35.0
# e_t - 1: cosines and sines of h, 2h, 3h, 4h.
COSINES = np.array([-0.0582, -0.0258, -0.1347, 0.0289])
SINES = np.array([-0.1475, -0.0308, 0.0385, 0.0096])


def _harmonics(h: Array, cosines: Array, sines: Array) -> Array:
    """Return the sum of cosines and sines of multiples of h, degrees."""
    angles = np.radians(h)[..., None] * np.arange(1.0, len(cosines) + 1.0)
    return np.asarray(np.cos(angles) @ cosines + np.sin(angles) @ sines)


def _chroma_per_radius(h: Array, eye: CamConditions) -> Array:
    """Return C / √(a² + b²)."""
    e_t = 1.0 + _harmonics(h, COSINES, SINES)
    return _CHROMA * _COLOURFULNESS * eye.surround.N_c * e_t / eye.white_achromatic


def forward(XYZ: ArrayLike, conditions: ViewingConditions) -> Appearance:
    """Return the appearance of XYZ [1].

    Not `defined` if a response is negative, which is no light's, or near its pole.
    """
    eye = CamConditions.of_viewing(conditions, NAME)
    linear = triples(f"{NAME}.XYZ", XYZ) @ eye.response_from_XYZ().T
    responses = compress(linear)
    signal = responses @ k.ACHROMATIC
    a, b = responses @ k.OPPONENT_A, responses @ k.OPPONENT_B
    h = np.degrees(np.arctan2(b, a)) % 360.0
    J = 100.0 * (np.maximum(signal, 0.0) / eye.white_achromatic) ** eye.lightness_power
    C = _chroma_per_radius(h, eye) * np.hypot(a, b)
    Q = 2.0 / eye.surround.c * J / 100.0 * eye.white_achromatic
    M = C * eye.white_achromatic / _CHROMA
    within = (linear >= -ROUNDING) & (responses <= k.RESPONSE_LIMIT)
    f = 0.792 + _harmonics(h, np.array([-0.160, 0.132]), np.array([-0.405, 0.080]))
    return Appearance(
        J=J,
        C=C,
        h=h,
        defined=np.all(within, axis=-1),
        H=quadrature(h),
        Q=Q,
        M=M,
        s=100.0 * np.divide(M, Q, out=np.zeros_like(M), where=Q > 0.0),
        J_HK=J + f * C**0.587,
    )


def inverse(J: ArrayLike, C: ArrayLike, h: ArrayLike, conditions: ViewingConditions) -> Array:
    """Return the XYZ of a lightness, chroma and hue, in closed form; NaN if there is none."""
    XYZ = invert_beyond(J, C, h, conditions)
    return only_defined(XYZ, J, C, h, lambda XYZ: forward(XYZ, conditions))


def invert_beyond(J: ArrayLike, C: ArrayLike, h: ArrayLike, conditions: ViewingConditions) -> Array:
    """Return `inverse`, extended to negative responses; NaN for J below 0 and past the pole."""
    J, C, h = broadcast(NAME, J, C, h)
    eye = CamConditions.of_viewing(conditions, NAME)
    x = eye.white_achromatic * (np.maximum(J, 0.0) / 100.0) ** (1.0 / eye.lightness_power)
    radius = np.maximum(C, 0.0) / _chroma_per_radius(h, eye)
    angle = np.radians(h)
    opponent = np.stack([x, radius * np.cos(angle), radius * np.sin(angle)], axis=-1)
    compressed = opponent @ k.RESPONSE_FROM_OPPONENT.T
    scale = k.RESPONSE_HALF ** (1.0 / k.RESPONSE_POWER)
    XYZ = expand(compressed) @ np.linalg.inv(eye.response_from_XYZ()).T * scale
    valid = (J >= 0.0) & np.all(np.abs(compressed) <= MAX_RESPONSE, axis=-1)
    return np.where(valid[..., None], XYZ, np.nan)


def view_transform(source: ViewingConditions, target: ViewingConditions) -> CamTransform:
    """Make the transform to colours of equal J, C and h, in closed form."""
    return CamTransform.for_viewing(NAME, source, target)
