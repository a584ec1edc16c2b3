"""Hunt's model of 1994: cones and rods, bleaching and induction, from starlight to snow.

    XYZ -> cones, adapted, compressed -> hue, chromatic response M -> with rods: Q -> J, C

``M`` of an `Appearance` is the colourfulness M_94, not the chromatic response M of eq. 45.

Responses are odd here, f_n(-I) = -f_n(I), because eq. 15 has a pole at a negative I. The inverse
has one unknown: at a given hue and saturation the adapted cone responses are proportional to
A_c = 2 ρ_a + γ_a + β_a / 20, and brightness increases with A_c.

References
----------
[1] Hunt & Luo (1994), "Evaluation of a model of colour vision by magnitude scalings", Color
    Research & Application 19(1), 27-33; *Color Appearance Models* (survey 002), eq. 8-59, with
    the errata.
[2] McCamy (1992), "Correlated color temperature as an explicit function of chromaticity
    coordinates", Color Research & Application 17(2), 142-144.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Annotated

import numpy as np
from numpy.typing import ArrayLike
from pydantic import AfterValidator, Field

from volspec.appearance.display import constants as k
from volspec.appearance.hue import HUNT_HUES, quadrature
from volspec.appearance.models.base import (
    ROUNDING,
    Appearance,
    Array,
    broadcast,
    cone_adaptation,
    cones_of_white,
    degree_of_discounting,
    interpolate_surround,
    only_defined,
)
from volspec.appearance.models.numeric import find_root
from volspec.appearance.surround import Triple, ViewingConditions
from volspec.appearance.transforms import signed_power, triples
from volspec.errors import ShapeError, ViewingError
from volspec.settings import Positive, Vector
from volspec.settings import settings as checked

__all__ = ["NAME", "HuntSettings", "forward", "inverse"]

NAME = "Hunt"
POLE, HALF, POWER = 40.0, 2.0, 0.73
# A_c of the cones' noise, 1 in each of the three, and the rods' noise.
NOISE_SUM, ROD_NOISE = 3.05, 0.3
_MIN_L_A, _MIN_N = 1e-6, 1e-4


def compress(I: Array) -> Array:  # noqa: E741  (the paper's letter)
    """Return f_n (eq. 15), odd: 40 x / (x + 2), x = |I|^0.73, with the sign of I; within ±40."""
    x = np.abs(I) ** POWER
    return np.asarray(np.copysign(POLE * x / (x + HALF), I))


def expand(response: Array) -> Array:
    """Invert `compress`, clamped below the pole."""
    y = np.minimum(np.abs(response), POLE * (1.0 - 1e-12))
    return np.asarray(np.copysign((HALF * y / (POLE - y)) ** (1.0 / POWER), response))


def _excites(XYZ: Vector) -> Vector:
    if not np.all(k.HPE_FROM_XYZ @ np.asarray(XYZ) > 0.0):
        raise ViewingError("", "give the XYZ of a real colour", code="range", given=XYZ)
    return XYZ


NearField = Annotated[Vector, AfterValidator(_excites)] | None


@checked(ViewingError)
@dataclass(frozen=True, slots=True)
class HuntSettings:
    """Inputs of Hunt's model; what is left out is derived from the viewing conditions."""

    N_c: Positive | None = None
    """Chromatic surround induction. If left out, N_c and N_b are those of projected transparencies
    (0.7, 10) in a dark surround, television (1, 25) in a dim one, normal scenes (1, 75) in an
    average one, interpolated linearly in between. Small areas on uniform fields have 1 and 300,
    large transparencies on light boxes 0.7 and 25."""
    N_b: Positive | None = None
    """Brightness surround induction."""
    L_AS: Positive | None = None
    """Scotopic luminance of the adapting field, scotopic cd/m²; if left out, by eq. 8."""
    CCT_kelvin: Positive | None = None
    """Correlated colour temperature of the light, for eq. 8; if left out, the
    white's, by McCamy."""
    p: Annotated[float, Field(ge=-1, le=1)] = 0.0
    """Chromatic induction by the proximal field: from -1 (contrast) to 1 (assimilation)."""
    proximal_XYZ: NearField = None
    """The field around the colour, for eq. 30-35; if left out, the background."""
    background_XYZ: NearField = None
    """The background around the proximal field; if left out, the white's colour at
    Y_b."""
    helson_judd: bool = False
    """Light greys take on the light's hue, dark greys its complement (eq. 24-26)."""


def cct_mccamy(white_XYZ: Triple) -> float:
    """Return McCamy's colour temperature [2], clamped to 1667…25000 K.

    >>> round(cct_mccamy((95.047, 100, 108.883)))
    6507
    """
    X, Y, Z = white_XYZ
    total = X + Y + Z
    down = 0.1858 - Y / total
    slope = (X / total - 0.3320) / (down if abs(down) > 1e-6 else -1e-6)
    slope = min(max(slope, -10.0), 10.0)
    return min(max(((437.0 * slope + 3601.0) * slope + 6861.0) * slope + 5517.0, 1667.0), 25000.0)


@dataclass(frozen=True, slots=True, eq=False)
class HuntConditions:
    """Scalars and, per cone, triples of Hunt's model under one viewing condition."""

    white_XYZ: Triple
    gain: Array  # F_L F / ρ'_w: the factor of a cone's response before f_n
    bleaching: Array  # B_ρ, B_γ, B_β (eq. 27-29)
    helson_judd: Array  # ρ_D, γ_D, β_D (eq. 24-26)
    n: float  # Y_b / Y_w
    N_c: float
    N_b: float
    N_bb: float  # equals N_cb (eq. 9-10)
    F_L: float
    F_t: float
    scotopic: float  # 5 L_AS / 2.26

    @classmethod
    def of(cls, conditions: ViewingConditions, settings: HuntSettings) -> HuntConditions:
        """Compute the scalars, with L_A and Y_b clamped to at least 1e-6 cd/m² and 1e-4 Y_w."""
        white = cones_of_white("Hunt", conditions)
        L_A = max(conditions.L_A, _MIN_L_A)
        n = max(conditions.Y_b / conditions.white_XYZ[1], _MIN_N)
        k4 = (5.0 * L_A + 1.0) ** -4
        F_L = float(k4 * L_A + 0.1 * (1.0 - k4) ** 2 * np.cbrt(5.0 * L_A))
        F = cone_adaptation(white, L_A, degree_of_discounting(conditions))
        grey = compress(n * F_L * F)
        T = settings.CCT_kelvin or cct_mccamy(conditions.white_XYZ)
        # Eq. 8 is limited to above 1600 K.
        L_AS = settings.L_AS or 2.26 * L_A * float(np.cbrt(max(T / 4000.0 - 0.4, 1e-3)))
        N_c, N_b, surround = settings.N_c, settings.N_b, conditions.surround
        return cls(
            white_XYZ=conditions.white_XYZ,
            gain=F_L * F / (white * _induction(white * n, settings)),
            bleaching=1e7 / (1e7 + 5.0 * L_A * white / 100.0),
            helson_judd=(grey[1] - grey) * settings.helson_judd,
            n=n,
            N_c=interpolate_surround(surround, 0.7, 1.0, 1.0) if N_c is None else N_c,
            N_b=interpolate_surround(surround, 10.0, 25.0, 75.0) if N_b is None else N_b,
            N_bb=0.725 * n**-0.2,
            F_L=F_L,
            F_t=L_A / (L_A + 0.1),
            scotopic=5.0 * L_AS / 2.26,
        )

    @property
    def Y_w(self) -> float:
        """Y of the white."""
        return self.white_XYZ[1]

    @property
    def z(self) -> float:
        """Exponent of lightness (eq. 57)."""
        return 1.0 + math.sqrt(self.n)

    def rods(self, S: Array) -> Array:
        """Return the rods' response to S / S_w (or Y / Y_w), without its noise (eq. 47-50)."""
        L = self.scotopic
        j2 = (1e-5 / (L + 1e-5)) ** 2
        F_LS = 3800.0 * j2 * L + 0.2 * (1.0 - j2) ** 4 * L ** (1.0 / 6.0)
        bleached = 0.5 / (1.0 + 0.3 * (L * np.maximum(S, 0.0)) ** 0.3)
        return np.asarray(3.05 * (bleached + 0.5 / (1.0 + 5.0 * L)) * compress(F_LS * S))

    def surround_terms(self, A_w: Array) -> tuple[Array, Array]:
        """Return N_1 and N_2 (eq. 53-54)."""
        N_1 = np.sqrt(7.0 * A_w) / (5.33 * self.N_b**0.13)
        return np.asarray(N_1), np.asarray(7.0 * A_w * self.N_b**0.362 / 200.0)

    def require_brightness(self, Q_w: Array) -> Array:
        """Return Q_w; raise ViewingError if it is not above 0."""
        if not (np.isfinite(Q_w) and Q_w > 0.0):
            raise ViewingError(
                f"the white has brightness {float(Q_w):.3g} at N_b = {self.N_b:.4g} and "
                f"n = Y_b / Y_w = {self.n:.3g}",
                "use a smaller N_b or another background",
                code="range",
                field="Hunt",
            )
        return Q_w

    def largest_A_c(self, direction: Array) -> Array:
        """Return the largest A_c along a direction of the adapted cones, (..., 3) to (...).

        NaN if no response of a cone has the required sign: glare bleaches so much pigment that the
        smallest response is above 0.
        """
        end = np.where(direction < 0.0, -POLE, POLE) * (1.0 - 1e-9)
        ends = 1.0 + self.bleaching * (end + self.helson_judd)
        far = np.where(
            direction * ends > 0.0, ends / np.where(direction == 0.0, 1.0, direction), np.nan
        )
        return np.asarray(np.min(np.where(direction == 0.0, np.inf, far), axis=-1))


def _induction(background: Array, settings: HuntSettings) -> Array:
    """Return ρ'_w / ρ_w (eq. 30-35); the bracket contains the ratio p_ρ, not ρ_p as printed."""
    if settings.background_XYZ is not None:
        background = k.HPE_FROM_XYZ @ np.asarray(settings.background_XYZ)
    proximal = background
    if settings.proximal_XYZ is not None:
        proximal = k.HPE_FROM_XYZ @ np.asarray(settings.proximal_XYZ)
    p, ratio = settings.p, proximal / background
    above, below = (1.0 - p) * ratio + (1.0 + p) / ratio, (1.0 + p) * ratio + (1.0 - p) / ratio
    return signed_power(above / below, 0.5)


NORMAL = HuntSettings()

# e_s is interpolated linearly; its value at h = 0 is the one at 360.
_HUES_DEG = np.array([0.0, *HUNT_HUES.degrees])
_ECCENTRICITY = np.array([HUNT_HUES.eccentricity[-1], *HUNT_HUES.eccentricity])
# ρ_a + γ_a + β_a of black is 3; for imaginary colours it may be 0 or less.
_MIN_SUM = 0.03


def _chromatic(h: Array, eye: HuntConditions) -> Array:
    """Return M / √(a² + b²), M the chromatic response at a hue (eq. 42-45)."""
    angle = np.radians(h)
    e_s = np.interp(h % 360.0, _HUES_DEG, _ECCENTRICITY)
    tritanopic = np.hypot(np.cos(angle), eye.F_t * np.sin(angle))
    return np.asarray(100.0 * e_s * (10.0 / 13.0) * eye.N_c * eye.N_bb * tritanopic)


def _achromatic(A_c: Array, S: Array, eye: HuntConditions) -> Array:
    """Return A from A_c = 2 ρ_a + γ_a + β_a / 20 and S / S_w (eq. 36, 47-51)."""
    noise = np.hypot(1.0, ROD_NOISE) - NOISE_SUM
    return np.asarray(eye.N_bb * (A_c + eye.rods(S) + noise))


def _signals(XYZ: Array, S: Array, eye: HuntConditions) -> tuple[Array, Array, Array, Array]:
    """Return adapted cones (..., 3), hue, M and A (eq. 12-51)."""
    cones = XYZ @ k.HPE_FROM_XYZ.T
    adapted = eye.bleaching * (compress(eye.gain * cones) + eye.helson_judd) + 1.0
    a, b = adapted @ k.OPPONENT_A, adapted @ k.OPPONENT_B
    h = np.degrees(np.arctan2(b, a)) % 360.0
    M = _chromatic(h, eye) * np.hypot(a, b)
    return adapted, h, M, _achromatic(adapted @ k.ACHROMATIC, S, eye)


def _brightness(response: Array, A_w: Array, eye: HuntConditions) -> Array:
    """Return Q from A + M / 100 (eq. 52-54)."""
    N_1, N_2 = eye.surround_terms(A_w)
    return signed_power(7.0 * response, 0.6) * N_1 - N_2


def _white(eye: HuntConditions) -> tuple[Array, Array]:
    """Return A_w and Q_w; the white passes through the whole model with its own hue."""
    _, _, M_w, A_w = _signals(np.asarray(eye.white_XYZ), np.ones(()), eye)
    return A_w, eye.require_brightness(_brightness(A_w + M_w / 100.0, A_w, eye))


def _background(A_w: Array, eye: HuntConditions, settings: HuntSettings) -> Array:
    """Return Q_b; the background, too, passes through the whole model."""
    field = settings.background_XYZ
    XYZ = np.asarray(eye.white_XYZ) * eye.n if field is None else np.asarray(field, np.float64)
    _, _, M_b, A_b = _signals(XYZ, XYZ[1] / eye.Y_w, eye)
    return _brightness(A_b + M_b / 100.0, A_w, eye)


def _scotopic(S: ArrayLike, colours: Array) -> Array:
    """Return S / S_w, one for each colour."""
    try:
        return np.broadcast_to(np.asarray(S, dtype=np.float64), colours.shape)
    except (TypeError, ValueError):
        raise ShapeError.refused(
            "Hunt.S", S, f"expected one number, or one for each of the colours {colours.shape}"
        ) from None


def forward(
    XYZ: ArrayLike,
    conditions: ViewingConditions,
    settings: HuntSettings = NORMAL,
    S: ArrayLike | None = None,
) -> Appearance:
    """Return the appearance of XYZ (eq. 8-59).

    ``S`` (...) is the scotopic response of each colour over the white's; None is Y / Y_w.
    Discounting, or D = 1, makes adaptation complete; a smaller D, partly so, as in RLAB.

    Not `defined` where a cone's response, S or the brightness falls below 0, as for black in bright
    light; there J keeps the sign of Q, and C uses its magnitude. Q_WB is eq. 55, with the signs of
    Q and Q_b preserved by the powers. Raises ViewingError if a cone's response to the white is not
    above 0, or the white has no brightness.
    """
    XYZ = triples("Hunt.XYZ", XYZ)
    eye = HuntConditions.of(conditions, settings)
    A_w, Q_w = _white(eye)
    rod_response = XYZ[..., 1] / eye.Y_w if S is None else _scotopic(S, XYZ[..., 1])
    adapted, h, M, A = _signals(XYZ, rod_response, eye)
    s = 50.0 * M / np.maximum(adapted.sum(axis=-1), _MIN_SUM)
    Q = _brightness(A + M / 100.0, A_w, eye)
    C = 2.44 * s**0.69 * np.abs(Q / Q_w) ** eye.n * (1.64 - 0.29**eye.n)
    cones, angle = XYZ @ k.HPE_FROM_XYZ.T, np.radians(h)
    red, yellow = np.cos(angle), eye.F_t * np.sin(angle)
    return Appearance(
        J=100.0 * signed_power(Q / Q_w, eye.z),
        C=C,
        h=h,
        H=quadrature(h, HUNT_HUES),
        Q=Q,
        M=C * eye.F_L**0.15,
        M_RG=M * red / np.hypot(red, yellow),
        M_YB=M * yellow / np.hypot(red, yellow),
        s=s,
        Q_WB=20.0 * (signed_power(Q, 0.7) - signed_power(_background(A_w, eye, settings), 0.7)),
        defined=np.all(cones >= -ROUNDING * eye.Y_w, axis=-1)
        & (rod_response >= -ROUNDING)
        & (Q / Q_w >= -ROUNDING),
    )


def inverse(
    J: ArrayLike,
    C: ArrayLike,
    h: ArrayLike,
    conditions: ViewingConditions,
    settings: HuntSettings = NORMAL,
    S: ArrayLike | None = None,
) -> Array:
    """Return the XYZ of a lightness, chroma and hue; ``S`` as in `forward`, independent of XYZ.

    NaN if no `defined` XYZ has this appearance. (Black has some lightness.)
    """
    XYZ = invert_beyond(J, C, h, conditions, settings, S)
    return only_defined(XYZ, J, C, h, lambda XYZ: forward(XYZ, conditions, settings, S))


def invert_beyond(
    J: ArrayLike,
    C: ArrayLike,
    h: ArrayLike,
    conditions: ViewingConditions,
    settings: HuntSettings = NORMAL,
    S: ArrayLike | None = None,
) -> Array:
    """Return `inverse`, extended to cones and brightness below 0; NaN if there is no such XYZ."""
    J, C, h = broadcast(NAME, J, C, h)
    rod_response = None if S is None else _scotopic(S, J)
    eye = HuntConditions.of(conditions, settings)
    A_w, Q_w = _white(eye)
    relative = signed_power(J / 100.0, 1.0 / eye.z)
    N_1, N_2 = eye.surround_terms(A_w)
    response = signed_power((relative * Q_w + N_2) / N_1, 1.0 / 0.6) / 7.0
    with np.errstate(all="ignore"):
        chroma = np.maximum(C, 0.0) / (2.44 * (1.64 - 0.29**eye.n))
        s = np.where(chroma > 0.0, (chroma / np.abs(relative) ** eye.n) ** (1 / 0.69), 0.0)
        # √(a² + b²) = κ A_c: s (ρ_a + γ_a + β_a) = 50 M, and the sum is linear in A_c, a and b.
        sums = np.ones(3) @ k.RESPONSE_FROM_OPPONENT
        angle = np.radians(h)
        skew = sums[1] * np.cos(angle) + sums[2] * np.sin(angle)
        m = _chromatic(h, eye)
        kappa = s * sums[0] / (50.0 * m - s * skew)
    valid = np.isfinite(kappa) & (kappa >= 0.0) & np.isfinite(response)
    kappa = np.where(valid, kappa, 0.0)
    opponent = np.stack([np.ones_like(h), kappa * np.cos(angle), kappa * np.sin(angle)], axis=-1)
    direction = opponent @ k.RESPONSE_FROM_OPPONENT.T
    XYZ_from_cones = np.linalg.inv(k.HPE_FROM_XYZ)

    def XYZ_at(A_c: Array) -> Array:
        adapted = direction * A_c[..., None]
        cones = expand((adapted - 1.0) / eye.bleaching - eye.helson_judd) / eye.gain
        return np.asarray(cones @ XYZ_from_cones.T)

    def excess(A_c: Array) -> Array:
        A = _achromatic(
            A_c, XYZ_at(A_c)[..., 1] / eye.Y_w if rod_response is None else rod_response, eye
        )
        return np.asarray(A + m * kappa * A_c / 100.0 - response)

    # Upper bound: without the rods the cones alone make the brightness. (Rounded up for black.)
    cones_alone = response - _achromatic(np.zeros_like(h), np.zeros_like(h), eye)
    cones_alone = np.maximum(cones_alone / (eye.N_bb + m * kappa / 100.0), 0.0) * (1.0 + 1e-9)
    upper = np.minimum(cones_alone, eye.largest_A_c(direction))
    A_c = find_root(excess, np.zeros_like(h), upper)
    return np.where((valid & np.isfinite(A_c))[..., None], XYZ_at(A_c), np.nan)
