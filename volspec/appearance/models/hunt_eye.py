"""Hunt's model before it sees a colour: settings, and the scalars of a viewing condition.

    ViewingConditions, HuntSettings -> [Eye] -> hunt

References
----------
[1] *Color Appearance Models* (survey 002), eq. 8-35 and 47-57, with the errata.
[2] McCamy (1992), "Correlated color temperature as an explicit function of chromaticity
    coordinates", Color Research & Application 17(2), 142-144.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from volspec.appearance import constants as k
from volspec.appearance.models.base import Array
from volspec.appearance.models.cones import adaptation, at_surround, cones_of_white, discounting
from volspec.appearance.passages import signed_power
from volspec.appearance.spec import Triple, ViewingConditions
from volspec.appearance.surround import as_triple, is_finite
from volspec.errors import ViewingError, quoted

POLE, HALF, POWER = 40.0, 2.0, 0.73
# 2 ρ_a + γ_a + β_a / 20 of three noises of 1, and the rods' noise.
NOISE_SUM, ROD_NOISE = 3.05, 0.3
_LEAST_L_A, _LEAST_N = 1e-6, 1e-4


def compress(I: Array) -> Array:  # noqa: E741
    """f_n (eq. 15), odd: 40 x / (x + 2), x = |I|^0.73, with the sign of I; within ±40."""
    x = np.abs(I) ** POWER
    return np.asarray(np.copysign(POLE * x / (x + HALF), I))


def expand(response: Array) -> Array:
    """`compress` undone; what comes near the pole is cut."""
    y = np.minimum(np.abs(response), POLE * (1.0 - 1e-12))
    return np.asarray(np.copysign((HALF * y / (POLE - y)) ** (1.0 / POWER), response))


@dataclass(frozen=True, slots=True)
class HuntSettings:
    """What Hunt's model asks beyond `ViewingConditions`; None is what follows from these.

    Parameters
    ----------
    N_c, N_b : float, optional
        Chromatic and brightness surround induction. None: those of projected transparencies
        (0.7, 10) in the dark, television (1, 25) dim, normal scenes (1, 75) average, on straight
        lines between. Small areas on uniform fields have 1 and 300, large transparencies on
        light boxes 0.7 and 25.
    L_AS : float, optional
        Scotopic luminance of the adapting field, scotopic cd/m². None: eq. 8.
    CCT_kelvin : float, optional
        Correlated colour temperature of the light, for eq. 8. None: McCamy's of the white.
    p : float
        Chromatic induction by the proximal field: contrast from -1, assimilation to 1.
    proximal_XYZ, background_XYZ : (X, Y, Z), optional
        The field around the colour and the one around that, for eq. 30-35. None: the
        background; the white's colour at Y_b.
    helson_judd : bool
        Light greys take on the light's hue, dark ones its complement (eq. 24-26).

    Raises
    ------
    ViewingError
        If a number is out of range.
    """

    N_c: float | None = None
    N_b: float | None = None
    L_AS: float | None = None
    CCT_kelvin: float | None = None
    p: float = 0.0
    proximal_XYZ: Triple | None = None
    background_XYZ: Triple | None = None
    helson_judd: bool = False

    def __post_init__(self) -> None:
        for name in ("N_c", "N_b", "L_AS", "CCT_kelvin"):
            value = getattr(self, name)
            if value is not None and not (is_finite(value) and value > 0.0):
                raise ViewingError.refused(
                    f"HuntSettings.{name}",
                    value,
                    "expected a finite number above 0, or None",
                    "type",
                )
        if not (is_finite(self.p) and -1.0 <= self.p <= 1.0):
            raise ViewingError.refused(
                "HuntSettings.p", self.p, "expected -1 (contrast) to 1 (assimilation)", "range"
            )
        for name in ("proximal_XYZ", "background_XYZ"):
            value = getattr(self, name)
            if value is not None and not _excites(value):
                raise ViewingError.refused(
                    f"HuntSettings.{name}", value, "expected the XYZ of a real colour, or None"
                )
        if not isinstance(self.helson_judd, bool):
            raise ViewingError.refused(
                "HuntSettings.helson_judd", self.helson_judd, "expected True or False", "type"
            )


def _excites(value: object) -> bool:
    XYZ = as_triple(value)
    return XYZ is not None and bool(np.all(k.HPE_FROM_XYZ @ np.asarray(XYZ) > 0.0))


def cct_mccamy(white_XYZ: Triple) -> float:
    """McCamy's colour temperature [2], kept within 1667 and 25000 K.

    Examples
    --------
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
class Eye:
    """Scalars and, per cone, triples of Hunt's model under one condition."""

    white_XYZ: Triple
    gain: Array
    """F_L F / ρ'_w, what a cone's response is multiplied with before f_n."""
    bleaching: Array
    """B_ρ, B_γ, B_β (eq. 27-29)."""
    helson_judd: Array
    """ρ_D, γ_D, β_D (eq. 24-26)."""
    n: float
    """Y_b / Y_w."""
    N_c: float
    N_b: float
    N_bb: float
    """Equals N_cb (eq. 9-10)."""
    F_L: float
    F_t: float
    scotopic: float
    """5 L_AS / 2.26."""

    @classmethod
    def of(cls, conditions: ViewingConditions, settings: HuntSettings) -> Eye:
        """Compute them; at an L_A or Y_b of 0 those of 1e-6 cd/m² and of 1e-4 Y_w."""
        if not isinstance(settings, HuntSettings):
            raise ViewingError(f"Hunt: settings are {quoted(settings)}; expected HuntSettings")
        white = cones_of_white("Hunt", conditions)
        L_A = max(conditions.L_A, _LEAST_L_A)
        n = max(conditions.Y_b / conditions.white_XYZ[1], _LEAST_N)
        k4 = (5.0 * L_A + 1.0) ** -4
        F_L = float(k4 * L_A + 0.1 * (1.0 - k4) ** 2 * np.cbrt(5.0 * L_A))
        F = adaptation(white, L_A, discounting(conditions))
        grey = compress(n * F_L * F)
        T = settings.CCT_kelvin or cct_mccamy(conditions.white_XYZ)
        # Eq. 8 ends at 1600 K.
        L_AS = settings.L_AS or 2.26 * L_A * float(np.cbrt(max(T / 4000.0 - 0.4, 1e-3)))
        N_c, N_b, surround = settings.N_c, settings.N_b, conditions.surround
        return cls(
            white_XYZ=conditions.white_XYZ,
            gain=F_L * F / (white * _induction(white * n, settings)),
            bleaching=1e7 / (1e7 + 5.0 * L_A * white / 100.0),
            helson_judd=(grey[1] - grey) * settings.helson_judd,
            n=n,
            N_c=at_surround(surround, dark=0.7, dim=1.0, average=1.0) if N_c is None else N_c,
            N_b=at_surround(surround, dark=10.0, dim=25.0, average=75.0) if N_b is None else N_b,
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
        """The rods' response to S / S_w, or Y / Y_w in its place, without its noise (eq. 47-50)."""
        L = self.scotopic
        j2 = (1e-5 / (L + 1e-5)) ** 2
        F_LS = 3800.0 * j2 * L + 0.2 * (1.0 - j2) ** 4 * L ** (1.0 / 6.0)
        bleached = 0.5 / (1.0 + 0.3 * (L * np.maximum(S, 0.0)) ** 0.3)
        return np.asarray(3.05 * (bleached + 0.5 / (1.0 + 5.0 * L)) * compress(F_LS * S))

    def surround_terms(self, A_w: Array) -> tuple[Array, Array]:
        """N_1 and N_2 (eq. 53-54)."""
        N_1 = np.sqrt(7.0 * A_w) / (5.33 * self.N_b**0.13)
        return np.asarray(N_1), np.asarray(7.0 * A_w * self.N_b**0.362 / 200.0)

    def lit(self, Q_w: Array) -> Array:
        """Q_w, refused where it is not above 0."""
        if not (np.isfinite(Q_w) and Q_w > 0.0):
            raise ViewingError(
                f"Hunt: the white has brightness {float(Q_w):.3g} at N_b = {self.N_b:.4g} and "
                f"n = Y_b / Y_w = {self.n:.3g}; use a smaller N_b or another background"
            )
        return Q_w

    def saturated(self, direction: Array) -> Array:
        """The largest A_c along a direction of the adapted cones, (..., 3) to (...).

        NaN where a cone has no response on its side: glare leaves it so little pigment that its
        least response is above 0.
        """
        end = np.where(direction < 0.0, -POLE, POLE) * (1.0 - 1e-9)
        ends = 1.0 + self.bleaching * (end + self.helson_judd)
        far = np.where(
            direction * ends > 0.0, ends / np.where(direction == 0.0, 1.0, direction), np.nan
        )
        return np.asarray(np.min(np.where(direction == 0.0, np.inf, far), axis=-1))


def _induction(background: Array, settings: HuntSettings) -> Array:
    """ρ'_w / ρ_w (eq. 30-35); the bracket has the ratio p_ρ, not ρ_p as printed."""
    if settings.background_XYZ is not None:
        background = k.HPE_FROM_XYZ @ np.asarray(settings.background_XYZ)
    proximal = background
    if settings.proximal_XYZ is not None:
        proximal = k.HPE_FROM_XYZ @ np.asarray(settings.proximal_XYZ)
    p, ratio = settings.p, proximal / background
    towards, away = (1.0 - p) * ratio + (1.0 + p) / ratio, (1.0 + p) * ratio + (1.0 - p) / ratio
    return signed_power(towards / away, 0.5)
