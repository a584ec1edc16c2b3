"""CIECAM02 and CAM16: forward, inverse, and the shader's transform between two conditions.

Hellwig2022 has CAM16's responses and lightness, so it shares their conditions and transform.

    ViewingConditions -> [CamConditions] -> [CamTransform] -> uniforms of shaders/relight.frag
    XYZ -> [forward] -> J, C, h -> [inverse] -> XYZ

The models differ in the responses that are adapted and compressed (see `CamConditions`): CIECAM02
adapts CAT02's and compresses those of cones; CAM16 uses one space for both, in which real colours
are never negative. A change of light moves the white, so the scalars are computed for every new
light, in float64 on the host; a pixel then costs three matrix products and ten powers.

Forward is finite for all finite input: compression preserves the sign of its argument, nothing is
divided by t or by the sine or cosine of the hue, and a negative achromatic response becomes black.
``defined`` marks the domain of the published model, in which the inverse is exact.

References
----------
[1] Neumann, Castro, Neumann & Sbert (2004), "Color Appearance in Multispectral Radiosity",
    appendix, eq. 18-37, with the errata.
[2] Moroney et al. (2002), "The CIECAM02 Color Appearance Model", 10th Color Imaging
    Conference; CIE 159:2004.
[3] Li et al. (2017), "Comprehensive color solutions: CAM16, CAT16, and CAM16-UCS", Color
    Research & Application 42(6), 703-718. doi:10.1002/col.22131
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from volspec.appearance.display import constants as k
from volspec.appearance.hue import quadrature
from volspec.appearance.models.base import Appearance, Array, broadcast, only_defined
from volspec.appearance.surround import (
    SURROUNDS,
    Surround,
    Triple,
    ViewingConditions,
)
from volspec.appearance.transforms import triples
from volspec.errors import ShapeError, ViewingError

HELLWIG_2022 = "Hellwig2022"
# XYZ -> the responses that are adapted -> those that are compressed.
_RESPONSES = {
    "CIECAM02": (k.CAT02_FROM_XYZ, k.HPE_FROM_CAT02),
    "CAM16": (k.CAT16_FROM_XYZ, np.eye(3)),
    HELLWIG_2022: (k.CAT16_FROM_XYZ, np.eye(3)),
}
# Below these the results equal their limits in float32; above is brighter than the sun's disc.
_MIN_L_A, _MIN_N = 1e-6, 1e-4
_MAX_L_A = 1e9
# The inverse is defined as far as `forward`, with a little slack for rounding.
_MIN_UNDER = k.CHROMA_FLOOR * (1.0 - 1e-9)
MAX_RESPONSE = k.RESPONSE_LIMIT * (1.0 + 1e-12)


def level_factor(L_A: ArrayLike) -> Array:
    """Return (...) F_L of an adapting luminance, cd/m² (eq. 18-19)."""
    five_L_A = 5.0 * np.clip(L_A, _MIN_L_A, _MAX_L_A)
    k4 = (five_L_A + 1.0) ** -4
    return np.asarray(0.1 * (2.0 * k4 * five_L_A + (1.0 - k4) ** 2 * np.cbrt(five_L_A)))


def degree_of_adaptation(F: ArrayLike, L_A: ArrayLike) -> Array:
    """Return (...) D of a surround's F and an adapting luminance (eq. 24)."""
    return np.asarray(F) * (1.0 - np.exp(-(np.asarray(L_A) + 42.0) / 92.0) / 3.6)


def background_ratio(Y_b: ArrayLike, Y_w: float) -> Array:
    """Return (...) n = Y_b / Y_w (eq. 20)."""
    return np.maximum(np.asarray(Y_b) / Y_w, _MIN_N)


def background_induction(n: ArrayLike) -> Array:
    """Return (...) N_bb = N_cb (eq. 21)."""
    return np.asarray(0.725 * np.asarray(n) ** -0.2)


def lightness_exponent(n: ArrayLike) -> Array:
    """Return (...) z (eq. 22)."""
    return np.asarray(1.48 + np.sqrt(n))


def chroma_scale(n: ArrayLike) -> Array:
    """Return (...) (1.64 - 0.29^n)^0.73 of eq. 37."""
    return np.asarray((1.64 - 0.29 ** np.asarray(n)) ** 0.73)


def eccentricity_scale(N_c: ArrayLike, n: ArrayLike) -> Array:
    """Return (...) 50000/13 N_c N_cb / 4, the factor of cos(h + 2) + 3.8 in t (eq. 33-34)."""
    return np.asarray(k.ECCENTRICITY_SCALE * np.asarray(N_c) * background_induction(n) / 4.0)


def compress(responses: Array) -> Array:
    """Return 400 f / (27.13 + f), f = |x|^0.42, with the sign of x (eq. 27-29 without noise).

    x is F_L / 100 times the cone responses. The 0.1 of eq. 28 cancels in a and b and is exactly the
    0.305 subtracted in eq. 35, so it is added only where it remains: in p2 and in t's denominator.
    """
    f = np.abs(responses) ** k.RESPONSE_POWER
    return np.copysign(k.RESPONSE_POLE * f / (k.RESPONSE_HALF + f), responses)


def expand(compressed: Array) -> Array:
    """Invert `compress` up to 27.13^(1/0.42): (x / (400 - x))^(1/0.42), clamped below the pole."""
    x = np.minimum(np.abs(compressed), k.RESPONSE_LIMIT)
    return np.copysign((x / (k.RESPONSE_POLE - x)) ** (1.0 / k.RESPONSE_POWER), compressed)


@dataclass(frozen=True, slots=True)
class CamConditions:
    """Scalars of CIECAM02, CAM16 or Hellwig2022; ViewingError if the white has no lightness."""

    model: str  # selects the responses to adapt and to compress
    white_XYZ: Triple  # the adopted white; Y is usually 100
    L_A: float  # luminance of the adapting field, cd/m²
    Y_b: float  # luminance factor of the background
    surround: Surround  # F, c and N_c
    D: float  # degree of adaptation, 0 to 1
    F_L: float  # luminance-level adaptation factor
    n: float  # Y_b / Y_w
    N_bb: float  # background induction; equals N_cb
    z: float  # base exponent of lightness, 1.48 + √n
    D_RGB: Triple  # gains on the adapted responses, CAT02's or CAT16's
    white_achromatic: float  # p2 - 0.305 of the white, so A_w = N_bb times this

    def __post_init__(self) -> None:
        if not (np.isfinite(self.white_achromatic) and self.white_achromatic > 0.0):
            raise ViewingError(
                f"the white XYZ = {_triple(self.white_XYZ)} has no lightness in {self.model} at "
                f"D = {self.D:.3g}",
                "use a broader light, D nearer 1, or model='none'",
                code="impossible",
                field="viewing conditions",
            )

    @classmethod
    def of(
        cls,
        white_XYZ: ArrayLike,
        L_A: float,
        Y_b: float,
        surround: Surround = SURROUNDS["average"],
        D: float | None = None,
        model: str = "CIECAM02",
    ) -> CamConditions:
        """Compute the scalars (eq. 18-26); if ``D`` is None, with eq. 24.

        ``L_A`` is clamped to 1e-6…1e9 cd/m², ``Y_b`` to at least 1e-4 Y_w.
        """
        field = "viewing conditions.white_XYZ"
        white = triples(field, white_XYZ)
        if white.shape != (3,):
            raise ShapeError(f"has shape {white.shape}", "expected (3,)", field=field)
        if not (np.all(np.isfinite(white)) and white[1] > 0.0):
            raise ViewingError(
                f"{_triple(white)} is not a colour",
                "expected finite numbers and Y above 0. Is the light black?",
                code="range",
                field=field,
                given=white_XYZ,
            )
        F_L = float(level_factor(L_A))
        n = float(background_ratio(Y_b, white[1]))
        if D is None:
            D = float(degree_of_adaptation(surround.F, L_A))
        adapted_from_XYZ, compressed_from_adapted = _RESPONSES[model]
        RGB_w = adapted_from_XYZ @ white
        # A spectral light can have a response of 0; its gain must be finite.
        floor = 1e-6 * white[1]
        RGB_w = np.where(np.abs(RGB_w) < floor, np.copysign(floor, RGB_w), RGB_w)
        D_RGB = white[1] * D / RGB_w + 1.0 - D
        responses = (F_L / 100.0) * (compressed_from_adapted @ (D_RGB * (adapted_from_XYZ @ white)))
        return cls(
            model=model,
            white_XYZ=_triple(white),
            L_A=float(L_A),
            Y_b=float(Y_b),
            surround=surround,
            D=float(D),
            F_L=F_L,
            n=n,
            N_bb=float(background_induction(n)),
            z=float(lightness_exponent(n)),
            D_RGB=_triple(D_RGB),
            white_achromatic=float(k.ACHROMATIC @ compress(responses)),
        )

    @classmethod
    def of_viewing(cls, viewing: ViewingConditions, model: str = "CIECAM02") -> CamConditions:
        """Compute the scalars of viewing conditions; discounting the illuminant means D = 1."""
        D = 1.0 if viewing.discount else viewing.D
        return cls.of(viewing.white_XYZ, viewing.L_A, viewing.Y_b, viewing.factors, D, model)

    @property
    def A_w(self) -> float:
        """Achromatic response of the white (eq. 35)."""
        return self.N_bb * self.white_achromatic

    @property
    def lightness_power(self) -> float:
        """cz of eq. 36."""
        return self.surround.c * self.z

    @property
    def chroma_scale(self) -> float:
        """(1.64 - 0.29^n)^0.73 of eq. 37."""
        return float(chroma_scale(self.n))

    @property
    def eccentricity_scale(self) -> float:
        """50000/13 N_c N_cb / 4, the factor of cos(h + 2) + 3.8 in t (eq. 33-34)."""
        return float(eccentricity_scale(self.surround.N_c, self.n))

    def chroma_gain(self, display: CamConditions) -> float:
        """Return κ of `CamTransform`, from these conditions to a display's."""
        if self.model == HELLWIG_2022:  # C is proportional to N_c √(a² + b²) / w
            scene, target = (eye.surround.N_c / eye.white_achromatic for eye in (self, display))
            return scene / target
        chroma = (self.chroma_scale / display.chroma_scale) ** (1.0 / k.CHROMA_POWER)
        return chroma * self.eccentricity_scale / display.eccentricity_scale

    def response_from_XYZ(self) -> Array:
        """(3, 3): XYZ -> the argument of `compress` (eq. 23, 25, 26, and F_L / 100 of eq. 27)."""
        adapted_from_XYZ, compressed_from_adapted = _RESPONSES[self.model]
        adapted = np.asarray(self.D_RGB)[:, None] * adapted_from_XYZ
        return (self.F_L / 100.0) * (compressed_from_adapted @ adapted)


def _triple(values: ArrayLike) -> Triple:
    x, y, z = (float(v) for v in np.asarray(values))
    return x, y, z


@dataclass(frozen=True, slots=True)
class CamTransform:
    """The transform to colours of equal J, C and h under another viewing condition.

    Forward and inverse model cancel except for these numbers: at constant J, C and h, t scales by a
    constant, e_t and the hue drop out, and

        p2' - 0.305 = w' ((p2 - 0.305) / w)^γ
        (a', b')    = κ p2' (a, b) / (p2 + (κ - 1) (11 a + 108 b) / 23)

    where w, w' are the whites' p2 - 0.305. The second line is the inverse model's
    23 t p2' (cos h, sin h) / (23 p1' + 11 t cos h + 108 t sin h) multiplied out with
    t = p1 √(a² + b²) / (R + G + 21/20 B) and 23 (R + G + 21/20 B) + 11 a + 108 b = 23 p2.
    In Hellwig2022 chroma is proportional to √(a² + b²), and (a', b') = κ (a, b).
    """

    scene: CamConditions  # the source's conditions
    display: CamConditions  # the target's
    response_from_XYZ: Array
    """(3, 3): scene XYZ -> linear responses; (..., 3, 3) if each colour has its own scene."""
    XYZ_from_response: Array  # (3, 3): x / (400 - x) raised to 1/0.42 -> display XYZ
    scene_achromatic: float | Array
    """w: p2 - 0.305 of the scene's white; here and in γ and κ an array (...) if colours differ."""
    display_achromatic: float  # w': p2 - 0.305 of the display's white
    lightness_power: float | Array  # γ = cz / (c'z')
    chroma_gain: float | Array
    """κ = (chroma scale / chroma scale')^(1/0.9) · N_c N_cb / (N_c' N_cb'); in Hellwig2022
    N_c w' / (N_c' w)."""

    @classmethod
    def between(cls, scene: CamConditions, display: CamConditions) -> CamTransform:
        """Make the transform; raise ViewingError if the display's gains cannot be inverted."""
        try:
            inverse = np.linalg.inv(display.response_from_XYZ())
        except np.linalg.LinAlgError as error:
            raise ViewingError(
                f"the display's gains {display.D_RGB} cannot be inverted",
                "use another white or D",
                code="impossible",
                field="viewing conditions",
            ) from error
        return cls(
            scene=scene,
            display=display,
            response_from_XYZ=scene.response_from_XYZ(),
            XYZ_from_response=inverse * k.RESPONSE_HALF ** (1.0 / k.RESPONSE_POWER),
            scene_achromatic=scene.white_achromatic,
            display_achromatic=display.white_achromatic,
            lightness_power=scene.lightness_power / display.lightness_power,
            chroma_gain=scene.chroma_gain(display),
        )

    @classmethod
    def for_viewing(
        cls, model: str, source: ViewingConditions, target: ViewingConditions
    ) -> CamTransform:
        """Make the transform between viewing conditions, by a model of `CamConditions`."""
        scene, display = (CamConditions.of_viewing(view, model) for view in (source, target))
        return cls.between(scene, display)

    @property
    def is_proportional(self) -> bool:
        """True if (a', b') = κ (a, b)."""
        return self.scene.model == HELLWIG_2022

    def apply(self, XYZ: ArrayLike) -> Array:
        """Return the display XYZ (..., 3) of equal J, C and h: inverse after forward.

        The NumPy twin of ``shaders/include/cam.glsl``.
        """
        XYZ = triples(f"{self.scene.model}.XYZ", XYZ)
        if self.response_from_XYZ.ndim == 2:
            responses = compress(XYZ @ self.response_from_XYZ.T)
        else:
            responses = compress(np.einsum("...ij,...j", self.response_from_XYZ, XYZ))
        achromatic = responses @ k.ACHROMATIC
        positive = achromatic > 0.0
        achromatic = np.maximum(achromatic, 0.0)
        a, b = responses @ k.OPPONENT_A, responses @ k.OPPONENT_B
        p2 = achromatic + k.ACHROMATIC_NOISE
        display = (
            self.display_achromatic * (achromatic / self.scene_achromatic) ** self.lightness_power
        )
        if self.is_proportional:
            chroma = np.where(positive, self.chroma_gain, 0.0)
        else:
            skew = (self.chroma_gain - 1.0) * (k.CHROMA_SKEW[0] * a + k.CHROMA_SKEW[1] * b)
            chroma = self.chroma_gain * (display + k.ACHROMATIC_NOISE)
            chroma = np.where(positive, chroma / np.maximum(p2 + skew, k.CHROMA_FLOOR * p2), 0.0)
        opponent = np.stack([display, chroma * a, chroma * b], axis=-1)
        return expand(opponent @ k.RESPONSE_FROM_OPPONENT.T) @ self.XYZ_from_response.T

    def undo(self, XYZ: ArrayLike) -> Array:
        """Return the (..., 3) scene XYZ of display XYZ."""
        return CamTransform.between(self.display, self.scene).apply(XYZ)


def _eccentricity(cos_h: Array, sin_h: Array) -> Array:
    """Return cos(h + 2) + 3.8 (eq. 33) without computing an angle."""
    cos_2, sin_2 = np.cos(k.ECCENTRICITY_PHASE), np.sin(k.ECCENTRICITY_PHASE)
    return cos_h * cos_2 - sin_h * sin_2 + k.ECCENTRICITY_OFFSET


def forward(XYZ: ArrayLike, conditions: CamConditions) -> Appearance:
    """Return the appearance of XYZ (eq. 23-37).

    Not `defined` where the published formulas take a power of a negative number (NaN): the
    achromatic response A (eq. 35-36) or t's denominator (eq. 34); where either is below a hundredth
    of the other, so that floors apply; and where a response is near its pole. Black is defined. A
    negative R', G' or B' alone is within the domain: eq. 29 preserves its sign.
    """
    responses = compress(triples(f"{conditions.model}.XYZ", XYZ) @ conditions.response_from_XYZ().T)
    signal = responses @ k.ACHROMATIC
    achromatic = np.maximum(signal, 0.0)
    a, b = responses @ k.OPPONENT_A, responses @ k.OPPONENT_B
    radius = np.hypot(a, b)
    h = np.degrees(np.arctan2(b, a)) % 360.0
    # Without chroma any hue will do; cos h = 1 avoids a division by 0.
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


def inverse(J: ArrayLike, C: ArrayLike, h: ArrayLike, conditions: CamConditions) -> Array:
    """Return the XYZ of a lightness, chroma and hue; exact where `forward` is defined.

    NaN if no `defined` XYZ has this appearance: J below 0, chroma at J = 0, and anything brighter
    or more chromatic than the responses can represent.
    """
    J, C, h = broadcast(conditions.model, J, C, h)
    positive = J > 0.0
    level = np.where(positive, J, 1.0) / 100.0
    cos_h, sin_h = np.cos(np.radians(h)), np.sin(np.radians(h))
    t = np.maximum(C, 0.0) / (np.sqrt(level) * conditions.chroma_scale)
    t = t ** (1.0 / k.CHROMA_POWER)
    p1 = conditions.eccentricity_scale * _eccentricity(cos_h, sin_h)
    achromatic = conditions.white_achromatic * level ** (1.0 / conditions.lightness_power)
    p2 = achromatic + k.ACHROMATIC_NOISE
    skew = k.CHROMA_SKEW[0] * cos_h + k.CHROMA_SKEW[1] * sin_h
    # p1 p2 over t's denominator: at or below 0, no colour has that chroma at that hue.
    under = p1 + t * skew
    chroma = t * p2 / np.maximum(under, k.CHROMA_FLOOR * p1)
    opponent = np.stack([achromatic, chroma * cos_h, chroma * sin_h], axis=-1)
    compressed = opponent @ k.RESPONSE_FROM_OPPONENT.T
    valid = (under > _MIN_UNDER * p1) & np.all(np.abs(compressed) <= MAX_RESPONSE, axis=-1)
    XYZ_from_response = np.linalg.inv(conditions.response_from_XYZ())
    scale = k.RESPONSE_HALF ** (1.0 / k.RESPONSE_POWER)
    XYZ = np.where(valid[..., None], expand(compressed) @ XYZ_from_response.T * scale, np.nan)
    unlit = np.where((J == 0.0) & (C <= 0.0), 0.0, np.nan)
    XYZ = np.where(positive[..., None], XYZ, unlit[..., None])
    return only_defined(XYZ, J, C, h, lambda XYZ: forward(XYZ, conditions))


@dataclass(frozen=True, slots=True)
class CamModel:
    """CIECAM02 or CAM16 as a `volspec.appearance.models.Model`."""

    NAME: str

    def forward(self, XYZ: ArrayLike, conditions: ViewingConditions) -> Appearance:
        """See `volspec.appearance.models.Model.forward`."""
        return forward(XYZ, CamConditions.of_viewing(conditions, self.NAME))

    def inverse(
        self, J: ArrayLike, C: ArrayLike, h: ArrayLike, conditions: ViewingConditions
    ) -> Array:
        """See `volspec.appearance.models.Model.inverse`."""
        return inverse(J, C, h, CamConditions.of_viewing(conditions, self.NAME))

    def invert_beyond(
        self, J: ArrayLike, C: ArrayLike, h: ArrayLike, conditions: ViewingConditions
    ) -> Array:
        """Return `inverse`, which has no continuation beyond its domain."""
        return self.inverse(J, C, h, conditions)

    def view_transform(self, source: ViewingConditions, target: ViewingConditions) -> CamTransform:
        """Make the transform to colours of equal J, C and h, in closed form."""
        return CamTransform.for_viewing(self.NAME, source, target)


ciecam02 = CamModel("CIECAM02")
"""The CIE's model of 2002, the default."""
cam16 = CamModel("CAM16")
"""CIECAM02's successor, with one space for adaptation and compression."""
