"""Hunt's model of 1994: cones and rods, bleaching, induction, from starlight to snow.

    XYZ -> cones, adapted, compressed -> hue, chromatic response M -> with rods: Q -> J, C

``M`` of an `Appearance` is the colourfulness M_94, not the chromatic response M of eq. 45.

The responses are odd here, f_n(-I) = -f_n(I): eq. 15 has a pole at a negative I. The inverse
is one unknown: at a hue and saturation the adapted cones go with A_c = 2 ρ_a + γ_a + β_a / 20,
and brightness rises with it.

References
----------
[1] Hunt & Luo (1994), "Evaluation of a model of colour vision by magnitude scalings", Color
    Research & Application 19(1), 27-33; *Color Appearance Models* (survey 002), eq. 8-59, with
    the errata.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from volspec.appearance import constants as k
from volspec.appearance.hue import HUNT_HUES, quadrature
from volspec.appearance.models.base import (
    ROUNDING,
    Appearance,
    Array,
    broadcast,
    only_defined,
)
from volspec.appearance.models.hunt_eye import (
    NOISE_SUM,
    ROD_NOISE,
    Eye,
    HuntSettings,
    compress,
    expand,
)
from volspec.appearance.models.numeric import root
from volspec.appearance.passages import signed_power, triples
from volspec.appearance.spec import ViewingConditions
from volspec.errors import ShapeError

__all__ = ["NAME", "HuntSettings", "forward", "inverse"]

NAME = "Hunt"
NORMAL = HuntSettings()

# e_s on straight lines; at h = 0 it is as at 360.
_HUES_DEG = np.array([0.0, *HUNT_HUES.degrees])
_ECCENTRICITY = np.array([HUNT_HUES.eccentricity[-1], *HUNT_HUES.eccentricity])
# ρ_a + γ_a + β_a of black is 3; imaginary colours may sum to nothing.
_LEAST_SUM = 0.03


def _chromatic(h: Array, eye: Eye) -> Array:
    """What of √(a² + b²) is the chromatic response M at a hue (eq. 42-45)."""
    angle = np.radians(h)
    e_s = np.interp(h % 360.0, _HUES_DEG, _ECCENTRICITY)
    tritanopic = np.hypot(np.cos(angle), eye.F_t * np.sin(angle))
    return np.asarray(100.0 * e_s * (10.0 / 13.0) * eye.N_c * eye.N_bb * tritanopic)


def _achromatic(A_c: Array, S: Array, eye: Eye) -> Array:
    """A from 2 ρ_a + γ_a + β_a / 20 and S / S_w (eq. 36, 47-51)."""
    noise = np.hypot(1.0, ROD_NOISE) - NOISE_SUM
    return np.asarray(eye.N_bb * (A_c + eye.rods(S) + noise))


def _signals(XYZ: Array, S: Array, eye: Eye) -> tuple[Array, Array, Array, Array]:
    """Adapted cones (..., 3), hue, M and A (eq. 12-51)."""
    cones = XYZ @ k.HPE_FROM_XYZ.T
    adapted = eye.bleaching * (compress(eye.gain * cones) + eye.helson_judd) + 1.0
    a, b = adapted @ k.OPPONENT_A, adapted @ k.OPPONENT_B
    h = np.degrees(np.arctan2(b, a)) % 360.0
    M = _chromatic(h, eye) * np.hypot(a, b)
    return adapted, h, M, _achromatic(adapted @ k.ACHROMATIC, S, eye)


def _brightness(response: Array, A_w: Array, eye: Eye) -> Array:
    """Q from A + M / 100 (eq. 52-54)."""
    N_1, N_2 = eye.surround_terms(A_w)
    return signed_power(7.0 * response, 0.6) * N_1 - N_2


def _white(eye: Eye) -> tuple[Array, Array]:
    """A_w and Q_w: the white goes through the whole model with its own hue."""
    _, _, M_w, A_w = _signals(np.asarray(eye.white_XYZ), np.ones(()), eye)
    return A_w, eye.lit(_brightness(A_w + M_w / 100.0, A_w, eye))


def _background(A_w: Array, eye: Eye, settings: HuntSettings) -> Array:
    """Q_b: the background goes through the whole model, too."""
    given = settings.background_XYZ
    XYZ = np.asarray(eye.white_XYZ) * eye.n if given is None else np.asarray(given, np.float64)
    _, _, M_b, A_b = _signals(XYZ, XYZ[1] / eye.Y_w, eye)
    return _brightness(A_b + M_b / 100.0, A_w, eye)


def _scotopic(S: ArrayLike, like: Array) -> Array:
    """S / S_w, one for each colour.

    Raises
    ------
    ShapeError
        If there are not as many, or they are no numbers.
    """
    try:
        return np.broadcast_to(np.asarray(S, dtype=np.float64), like.shape)
    except (TypeError, ValueError):
        raise ShapeError.refused(
            "Hunt: S", S, f"expected numbers, one or for each of the colours {like.shape}"
        ) from None


def forward(
    XYZ: ArrayLike,
    conditions: ViewingConditions,
    settings: HuntSettings = NORMAL,
    S: ArrayLike | None = None,
) -> Appearance:
    """XYZ to what the eye makes of them (eq. 8-59).

    Parameters
    ----------
    XYZ : (..., 3) array_like
        On the white's scale.
    conditions : ViewingConditions
        Discounting, or D = 1, makes adaptation complete; D below 1 does so in part, as in RLAB.
    settings : HuntSettings
        What else the model asks.
    S : (...) array_like, optional
        Scotopic response of each colour over the white's, S / S_w, for rods that see other than
        cones. None: Y / Y_w.

    Returns
    -------
    Appearance
        Each correlate of shape (...). Not `defined` where a cone's response, S or the brightness
        falls below 0, as that of black does in bright light; J keeps the sign of Q
        there, and C goes with its size. Q_WB is eq. 55, with the sign of Q and Q_b in the powers.

    Raises
    ------
    ViewingError
        If the white excites a cone by nothing or less, or has no brightness.
    ShapeError
        If the last axis is not 3, or S has not the colours' shape.

    Examples
    --------
    >>> D65 = ViewingConditions((95.05, 100, 108.88), L_A=318.31, Y_b=100, discount=True)
    >>> seen = forward([19.01, 20.0, 21.78], D65, HuntSettings(CCT_kelvin=6504))
    >>> [round(float(each), 3) for each in (seen.J, seen.C, seen.h)]
    [30.046, 0.121, 269.274]
    """
    XYZ = triples("Hunt: XYZ", XYZ)
    eye = Eye.of(conditions, settings)
    A_w, Q_w = _white(eye)
    rods_see = XYZ[..., 1] / eye.Y_w if S is None else _scotopic(S, XYZ[..., 1])
    adapted, h, M, A = _signals(XYZ, rods_see, eye)
    s = 50.0 * M / np.maximum(adapted.sum(axis=-1), _LEAST_SUM)
    Q = _brightness(A + M / 100.0, A_w, eye)
    C = 2.44 * s**0.69 * np.abs(Q / Q_w) ** eye.n * (1.64 - 0.29**eye.n)
    cones = XYZ @ k.HPE_FROM_XYZ.T
    return Appearance(
        J=100.0 * signed_power(Q / Q_w, eye.z),
        C=C,
        h=h,
        H=quadrature(h, HUNT_HUES),
        Q=Q,
        M=C * eye.F_L**0.15,
        s=s,
        Q_WB=20.0 * (signed_power(Q, 0.7) - signed_power(_background(A_w, eye, settings), 0.7)),
        defined=np.all(cones >= -ROUNDING * eye.Y_w, axis=-1)
        & (rods_see >= -ROUNDING)
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
    """Lightness, chroma and hue to the XYZ that look so.

    Parameters
    ----------
    J, C, h : (...) array_like
        Lightness, chroma, hue angle in degrees. Chroma below 0 counts as 0.
    conditions : ViewingConditions
        Where the colours shall be seen.
    settings : HuntSettings
        What else the model asks.
    S : (...) array_like, optional
        As in `forward`: what the rods see, whatever the XYZ. None: Y / Y_w.

    Returns
    -------
    (..., 3) float64
        XYZ on the white's scale; NaN where none that is `defined` looks so. (Black has some
        lightness.)

    Raises
    ------
    ShapeError
        If the three do not broadcast together, or S has not their shape.
    """
    XYZ = continued(J, C, h, conditions, settings, S)
    return only_defined(XYZ, J, C, h, lambda each: forward(each, conditions, settings, S))


def continued(
    J: ArrayLike,
    C: ArrayLike,
    h: ArrayLike,
    conditions: ViewingConditions,
    settings: HuntSettings = NORMAL,
    S: ArrayLike | None = None,
) -> Array:
    """`inverse` on to cones and brightness below 0; NaN where no XYZ looks so."""
    J, C, h = broadcast(NAME, J, C, h)
    rods_see = None if S is None else _scotopic(S, J)
    eye = Eye.of(conditions, settings)
    A_w, Q_w = _white(eye)
    relative = signed_power(J / 100.0, 1.0 / eye.z)
    N_1, N_2 = eye.surround_terms(A_w)
    response = signed_power((relative * Q_w + N_2) / N_1, 1.0 / 0.6) / 7.0
    with np.errstate(all="ignore"):
        chroma = np.maximum(C, 0.0) / (2.44 * (1.64 - 0.29**eye.n))
        s = np.where(chroma > 0.0, (chroma / np.abs(relative) ** eye.n) ** (1 / 0.69), 0.0)
        # √(a² + b²) = κ A_c: s (ρ_a + γ_a + β_a) = 50 M, and the sum is A_c and a share of a, b.
        share = np.ones(3) @ k.RESPONSE_FROM_OPPONENT
        angle = np.radians(h)
        skew = share[1] * np.cos(angle) + share[2] * np.sin(angle)
        m = _chromatic(h, eye)
        kappa = s * share[0] / (50.0 * m - s * skew)
    known = np.isfinite(kappa) & (kappa >= 0.0) & np.isfinite(response)
    kappa = np.where(known, kappa, 0.0)
    opponent = np.stack([np.ones_like(h), kappa * np.cos(angle), kappa * np.sin(angle)], axis=-1)
    direction = opponent @ k.RESPONSE_FROM_OPPONENT.T
    XYZ_from_cones = np.linalg.inv(k.HPE_FROM_XYZ)

    def XYZ_at(A_c: Array) -> Array:
        adapted = direction * A_c[..., None]
        cones = expand((adapted - 1.0) / eye.bleaching - eye.helson_judd) / eye.gain
        return np.asarray(cones @ XYZ_from_cones.T)

    def excess(A_c: Array) -> Array:
        A = _achromatic(A_c, XYZ_at(A_c)[..., 1] / eye.Y_w if rods_see is None else rods_see, eye)
        return np.asarray(A + m * kappa * A_c / 100.0 - response)

    # The rods add to brightness: without them it takes more of the cones. (Rounded up for black.)
    cones_alone = response - _achromatic(np.zeros_like(h), np.zeros_like(h), eye)
    cones_alone = np.maximum(cones_alone / (eye.N_bb + m * kappa / 100.0), 0.0) * (1.0 + 1e-9)
    A_c = root(excess, np.zeros_like(h), np.minimum(cones_alone, eye.saturated(direction)))
    return np.where((known & np.isfinite(A_c))[..., None], XYZ_at(A_c), np.nan)
