"""ZCAM: lightness and brightness from absolute luminances, for high dynamic range.

    XYZ, cd/m² -> CAT02 to D65 -> cones -> PQ -> I, a, b -> J, C, h

``J, C, h, H, Q, M, s`` are J_z, C_z, h_z, H_z, Q_z, M_z, S_z. The model needs the white's
luminance, `ViewingConditions.white_luminance`. J and C are relative to the white as it is, before
its adaptation to D65, as in the paper's example: under A white has J = 101.3.

References
----------
[1] Safdar, Hardeberg & Luo (2021), "ZCAM, a colour appearance model based on a high dynamic range
    uniform colour space", Optics Express 29(4), 6036-6052. doi:10.1364/OE.413659
[2] Zhai & Luo (2018), "Study of chromatic adaptation via neutral white matches on different viewing
    media", Optics Express 26(6), 7724-7739: the two steps of the adaptation, through equal energy.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from volspec.appearance.display import constants as k
from volspec.appearance.display.hdr import PQ_PEAK, pq_decode, pq_encode
from volspec.appearance.display.spaces import SPACES
from volspec.appearance.hue import UniqueHues, quadrature
from volspec.appearance.models.base import (
    ROUNDING,
    Appearance,
    Array,
    broadcast,
    only_defined,
    opponents,
)
from volspec.appearance.models.cam import degree_of_adaptation
from volspec.appearance.surround import Surround, ViewingConditions
from volspec.appearance.transforms import signed_power, triples
from volspec.errors import ViewingError

NAME = "ZCAM"

ZCAM_HUES = UniqueHues((33.44, 89.29, 146.30, 238.36), (0.68, 0.64, 1.52, 0.77))

_PQ_POWER = 1.7 * 2523.0 / 32.0
# X' = b X − (b − 1) Z, Y' = g Y − (g − 1) X with b = 1.15, g = 0.66; then cones.
_CONES_FROM_XYZ = k.frozen(
    np.array(
        [
            [0.41478972, 0.579999, 0.0146480],
            [-0.2015100, 1.120649, 0.0531008],
            [-0.0166008, 0.264800, 0.6684799],
        ]
    )
    @ [[1.15, 0.0, -0.15], [0.34, 0.66, 0.0], [0.0, 0.0, 1.0]]
)
_IAB_FROM_CONES = k.frozen(
    [[0.0, 1.0, 0.0], [3.524, -4.066708, 0.542708], [0.199076, 1.096799, -1.295875]]
)
_CHROMA_POWER = 0.37
# Least L_A, cd/m², and background over white: below these, numbers are their limits.
_MIN_L_A, _MIN_N = 1e-6, 1e-4


@dataclass(frozen=True, slots=True, eq=False)
class ZcamConditions:
    """Scalars of ZCAM (steps 0 to 2), for XYZ in cd/m²."""

    adapted_from_XYZ: Array  # (3, 3): to D65, of the same luminance
    F_s: float  # impact of the surround, CIECAM02's c
    F_b: float  # background factor
    F_L: float  # luminance level factor
    Y_w: float  # the white's luminance, cd/m²
    I_w: float  # the white's I_z

    @classmethod
    def of(
        cls,
        white_XYZ: ArrayLike,
        L_A: float,
        Y_b: float,
        surround: Surround,
        D: float | None = None,
    ) -> ZcamConditions:
        """Compute the scalars; white (3,), L_A and the background's Y_b are luminances, cd/m²."""
        white = np.asarray(white_XYZ, dtype=np.float64)
        L_A = max(float(L_A), _MIN_L_A)
        if D is None:
            D = float(degree_of_adaptation(surround.F, L_A))
        to_D65 = _gains(white, D) / _gains(SPACES["sRGB"].white_XYZ, D)
        adapted = np.linalg.solve(k.CAT02_FROM_XYZ, to_D65[:, None] * k.CAT02_FROM_XYZ)
        I_w = float(_IAB(_CONES_FROM_XYZ @ white)[0])
        if not I_w > 0.0:
            raise ViewingError(
                f"the white XYZ = {white.round(4).tolist()} has no lightness in ZCAM",
                "expected the white of a real light",
                code="range",
                field=f"{NAME}.white_XYZ",
                given=white_XYZ,
            )
        return cls(
            adapted_from_XYZ=np.asarray(adapted),
            F_s=surround.c,
            F_b=float(np.sqrt(max(Y_b / white[1], _MIN_N))),
            F_L=float(0.171 * np.cbrt(L_A) * (1.0 - np.exp(-48.0 / 9.0 * L_A))),
            Y_w=float(white[1]),
            I_w=I_w,
        )

    @classmethod
    def of_viewing(cls, viewing: ViewingConditions) -> ZcamConditions:
        """Compute the scalars of viewing conditions, with their white's luminance."""
        scale = _scale(viewing)
        white = scale * np.asarray(viewing.white_XYZ)
        D = 1.0 if viewing.discount else viewing.D
        return cls.of(white, viewing.L_A, scale * viewing.Y_b, viewing.factors, D)

    @property
    def brightness_power(self) -> float:
        """Exponent of I_z in Q_z."""
        return float(1.6 * self.F_s / self.F_b**0.12)

    @property
    def brightness_scale(self) -> float:
        """Factor of I_z's power in Q_z."""
        return float(2700.0 * self.F_s**2.2 * self.F_b**0.5 * self.F_L**0.2)

    @property
    def Q_w(self) -> float:
        """Brightness of the white."""
        return float(self.brightness_scale * self.I_w**self.brightness_power)

    @property
    def colourfulness_scale(self) -> float:
        """Factor of e_z^0.068 (a² + b²)^0.37 in M_z."""
        return float(100.0 * self.F_L**0.2 / (self.F_b**0.1 * self.I_w**0.78))

    def forward(self, XYZ: ArrayLike) -> Appearance:
        """Return the appearance of (..., 3) XYZ, cd/m² (steps 3 to 6)."""
        cones = triples(f"{NAME}.XYZ", XYZ) @ (_CONES_FROM_XYZ @ self.adapted_from_XYZ).T
        I, a, b = np.moveaxis(_IAB(cones), -1, 0)  # noqa: E741 - the paper's name
        h = np.degrees(np.arctan2(b, a)) % 360.0
        Q = self.brightness_scale * signed_power(I, self.brightness_power)
        J = 100.0 * Q / self.Q_w
        M = self.colourfulness_scale * _eccentricity(h) * np.hypot(a, b) ** (2.0 * _CHROMA_POWER)
        ratio = np.divide(M, Q, out=np.zeros_like(M), where=Q > 0.0)
        return Appearance(
            J=J,
            C=100.0 * M / self.Q_w,
            h=h,
            defined=np.all(cones >= -ROUNDING * self.Y_w, axis=-1),
            H=quadrature(h, ZCAM_HUES),
            Q=Q,
            M=M,
            s=100.0 * self.F_L**0.6 * np.sqrt(ratio),
        )

    def invert_beyond(self, J: ArrayLike, C: ArrayLike, h: ArrayLike) -> Array:
        """Return the (..., 3) XYZ, cd/m², of J, C and h; NaN past PQ's pole."""
        J, C, h = broadcast(NAME, J, C, h)
        with np.errstate(all="ignore"):
            I = self.I_w * signed_power(J / 100.0, 1.0 / self.brightness_power)  # noqa: E741
            M = np.maximum(C, 0.0) * self.Q_w / 100.0
            radius = M / (self.colourfulness_scale * _eccentricity(h))
            a, b = np.moveaxis(opponents(NAME, I, radius ** (0.5 / _CHROMA_POWER), h), -1, 0)[1:]
            compressed = np.stack([I, a, b], axis=-1) @ np.linalg.inv(_IAB_FROM_CONES).T
            cones = PQ_PEAK * pq_decode(compressed, _PQ_POWER)
            XYZ = cones @ np.linalg.inv(_CONES_FROM_XYZ @ self.adapted_from_XYZ).T
        return np.where(np.isfinite(XYZ).all(axis=-1, keepdims=True), XYZ, np.nan)


def _gains(white: Array, D: float) -> Array:
    """Return the gains of CAT02's responses to equal energy of the white's luminance [2]."""
    RGB = k.CAT02_FROM_XYZ @ white
    floor = 1e-6 * white[1]
    RGB = np.where(np.abs(RGB) < floor, np.copysign(floor, RGB), RGB)
    return np.asarray(D * white[1] / RGB + 1.0 - D)


def _IAB(cones: Array) -> Array:
    """Return I_z, a_z, b_z of cone responses, cd/m²."""
    return np.asarray(pq_encode(cones / PQ_PEAK, _PQ_POWER) @ _IAB_FROM_CONES.T)


def _eccentricity(h: Array) -> Array:
    """Return e_z^0.068."""
    return np.asarray((1.015 + np.cos(np.radians(89.038 + h))) ** 0.068)


def _scale(conditions: ViewingConditions) -> float:
    """Return cd/m² of Y = 1."""
    return conditions.white_luminance / conditions.white_XYZ[1]


def forward(XYZ: ArrayLike, conditions: ViewingConditions) -> Appearance:
    """Return the appearance of XYZ on the white's scale; not `defined` if a cone is below 0."""
    eye = ZcamConditions.of_viewing(conditions)
    return eye.forward(triples(f"{NAME}.XYZ", XYZ) * _scale(conditions))


def inverse(J: ArrayLike, C: ArrayLike, h: ArrayLike, conditions: ViewingConditions) -> Array:
    """Return the XYZ of a lightness, chroma and hue, in closed form; NaN if there is none."""
    XYZ = invert_beyond(J, C, h, conditions)
    return only_defined(XYZ, J, C, h, lambda XYZ: forward(XYZ, conditions))


def invert_beyond(J: ArrayLike, C: ArrayLike, h: ArrayLike, conditions: ViewingConditions) -> Array:
    """Return `inverse`, extended to lightness and cone responses below 0."""
    eye = ZcamConditions.of_viewing(conditions)
    return eye.invert_beyond(J, C, h) / _scale(conditions)
