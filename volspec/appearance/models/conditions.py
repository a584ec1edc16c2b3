"""One viewing condition as CIECAM02's and CAM16's scalars, and the passage between two of them.

    Viewing, white -> [Conditions] -> [CamPassage] -> uniforms of shaders/relight.frag

A light change moves the white, so these are computed anew for every frame, in float64 on the
host; a pixel then costs three matrix products and ten powers.

References
----------
[1] Neumann, Castro, Neumann & Sbert (2004), eq. 18-26 and 34-37.
[2] Li et al. (2017), "Comprehensive color solutions: CAM16, CAT16, and CAM16-UCS", Color
    Research & Application 42(6), 703-718. doi:10.1002/col.22131
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from volspec.appearance import constants as k
from volspec.appearance.models import level
from volspec.appearance.passages import triples
from volspec.appearance.spec import SURROUNDS, Surround, ViewingConditions
from volspec.appearance.surround import require_conditions
from volspec.errors import ShapeError, ViewingError

Matrix = NDArray[np.float64]

# XYZ -> the responses that are adapted -> those that are compressed.
_RESPONSES = {
    "CIECAM02": (k.CAT02_FROM_XYZ, k.HPE_FROM_CAT02),
    "CAM16": (k.CAT16_FROM_XYZ, np.eye(3)),
}


def compress(responses: Matrix) -> Matrix:
    """400 f / (27.13 + f), f = |x|^0.42, with the sign of x (eq. 27-29, noise left out).

    The 0.1 of eq. 28 cancels in a and b and is exactly the 0.305 taken off in eq. 35, so it
    is added only where it stays: in p2 and in the sum under t.

    Parameters
    ----------
    responses : (..., 3) float64
        F_L x / 100, x the Hunt-Pointer-Estévez responses.

    Returns
    -------
    (..., 3) float64
        Within (-400, 400).
    """
    f = np.abs(responses) ** k.RESPONSE_POWER
    return np.copysign(k.RESPONSE_POLE * f / (k.RESPONSE_HALF + f), responses)


def expand(compressed: Matrix) -> Matrix:
    """`compress` undone, but for 27.13^(1/0.42): (x / (400 - x))^(1/0.42) with the sign of x.

    Parameters
    ----------
    compressed : (..., 3) float64
        What comes near the pole at 400 is cut.
    """
    x = np.minimum(np.abs(compressed), k.RESPONSE_LIMIT)
    return np.copysign((x / (k.RESPONSE_POLE - x)) ** (1.0 / k.RESPONSE_POWER), compressed)


@dataclass(frozen=True, slots=True)
class Conditions:
    """Viewing-condition scalars of CIECAM02 or CAM16.

    Raises
    ------
    ViewingError
        If the white has no lightness in the model.
    """

    model: str
    """``"CIECAM02"`` or ``"CAM16"``: which responses are adapted, and which compressed."""

    white_XYZ: tuple[float, float, float]
    """The adopted white; Y is usually 100."""
    L_A: float
    """Luminance of the adapting field, cd/m²."""
    Y_b: float
    """Luminance factor of the background."""
    surround: Surround
    """F, c and N_c."""
    D: float
    """Degree of adaptation, 0 to 1."""
    F_L: float
    """Luminance-level adaptation factor."""
    n: float
    """Y_b / Y_w."""
    N_bb: float
    """Background induction; equals N_cb."""
    z: float
    """Base exponent of lightness, 1.48 + √n."""
    D_RGB: tuple[float, float, float]
    """Gains on the adapted responses, CAT02's or CAT16's."""
    white_achromatic: float
    """p2 - 0.305 of the white, so A_w = N_bb times this."""

    def __post_init__(self) -> None:
        if not (np.isfinite(self.white_achromatic) and self.white_achromatic > 0.0):
            raise ViewingError(
                f"viewing conditions: the white XYZ = {_triple(self.white_XYZ)} has no "
                f"lightness in {self.model} at D = {self.D:.3g}; use a broader light, D nearer 1, "
                "or model='none'"
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
    ) -> Conditions:
        """Compute the scalars (eq. 18-26).

        At an L_A or Y_b of 0 they are those of 1e-6 cd/m² and of a background of 1e-4 Y_w; above
        1e9 cd/m² those of that.

        Parameters
        ----------
        white_XYZ : (3,) array_like
            Adopted white.
        L_A : float
            cd/m².
        Y_b : float
            In the units of the white's Y.
        surround : Surround
            F, c, N_c.
        D : float, optional
            Degree of adaptation; None is eq. 24.
        model : {"CIECAM02", "CAM16"}

        Raises
        ------
        ShapeError
            If the white is not three numbers.
        ViewingError
            If the white is not finite or its Y is not positive.
        """
        white = triples("viewing conditions: the white", white_XYZ)
        if white.shape != (3,):
            raise ShapeError(
                f"viewing conditions: the white has shape {white.shape}; expected (3,)"
            )
        if not (np.all(np.isfinite(white)) and white[1] > 0.0):
            raise ViewingError(
                f"viewing conditions: the white XYZ = {_triple(white)} is not a colour; "
                "expected finite numbers and Y above 0. Is the light black?"
            )
        F_L = float(level.level_factor(L_A))
        n = float(level.background_ratio(Y_b, white[1]))
        if D is None:
            D = float(level.degree_of_adaptation(surround.F, L_A))
        adapted_from_XYZ, compressed_from_adapted = _RESPONSES[model]
        RGB_w = adapted_from_XYZ @ white
        # A spectral light can have a zero response: keep its gain finite.
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
            N_bb=float(level.background_induction(n)),
            z=float(level.lightness_exponent(n)),
            D_RGB=_triple(D_RGB),
            white_achromatic=float(k.ACHROMATIC @ compress(responses)),
        )

    @classmethod
    def of_viewing(cls, seen: ViewingConditions, model: str = "CIECAM02") -> Conditions:
        """The scalars of viewing conditions; discounting the illuminant is D = 1."""
        require_conditions(f"{model}: conditions", seen)
        D = 1.0 if seen.discount else seen.D
        return cls.of(seen.white_XYZ, seen.L_A, seen.Y_b, seen.factors, D, model)

    @property
    def N_cb(self) -> float:
        """Chromatic background induction."""
        return self.N_bb

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
        return float(level.chroma_scale(self.n))

    @property
    def eccentricity_scale(self) -> float:
        """50000/13 N_c N_cb / 4, what stands before cos(h + 2) + 3.8 in t (eq. 33-34)."""
        return float(level.eccentricity_scale(self.surround.N_c, self.n))

    def response_from_XYZ(self) -> Matrix:
        """(3, 3): XYZ -> what `compress` takes (eq. 23, 25, 26, and F_L / 100 of eq. 27)."""
        adapted_from_XYZ, compressed_from_adapted = _RESPONSES[self.model]
        adapted = np.asarray(self.D_RGB)[:, None] * adapted_from_XYZ
        return (self.F_L / 100.0) * (compressed_from_adapted @ adapted)


def _triple(values: ArrayLike) -> tuple[float, float, float]:
    x, y, z = (float(v) for v in np.asarray(values))
    return x, y, z


@dataclass(frozen=True, slots=True)
class CamPassage:
    """What carries an appearance (J, C, h) from one viewing condition to another.

    Forward and inverse model cancel but for these numbers: with J, C and h kept, t scales by a
    constant, e_t and the hue fall out, and

        p2' - 0.305 = w' ((p2 - 0.305) / w)^γ
        (a', b')    = κ p2' (a, b) / (p2 + (κ - 1) (11 a + 108 b) / 23)

    where w, w' are the whites' p2 - 0.305. The second line is the inverse model's
    23 t p2' (cos h, sin h) / (23 p1' + 11 t cos h + 108 t sin h) multiplied out with
    t = p1 √(a² + b²) / (R + G + 21/20 B) and 23 (R + G + 21/20 B) + 11 a + 108 b = 23 p2.
    """

    scene: Conditions
    """Where the colours are seen."""
    display: Conditions
    """Where they shall look the same."""
    response_from_XYZ: Matrix
    """(3, 3): scene XYZ -> linear responses; (..., 3, 3) where each colour has its own scene."""
    XYZ_from_response: Matrix
    """(3, 3): x / (400 - x) raised to 1/0.42 -> display XYZ."""
    scene_achromatic: float | Matrix
    """w: p2 - 0.305 of the scene's white; an array (...), as the two below, where each has one."""
    display_achromatic: float
    """w': p2 - 0.305 of the display's white."""
    lightness_power: float | Matrix
    """γ = cz / (c'z')."""
    chroma_gain: float | Matrix
    """κ = (chroma scale / chroma scale')^(1/0.9) · N_c N_cb / (N_c' N_cb')."""

    @classmethod
    def between(cls, scene: Conditions, display: Conditions) -> CamPassage:
        """The passage from ``scene`` to ``display``.

        Raises
        ------
        ViewingError
            If the display's adaptation gains cannot be inverted.
        """
        try:
            inverse = np.linalg.inv(display.response_from_XYZ())
        except np.linalg.LinAlgError as error:
            raise ViewingError(
                f"viewing conditions: the display's gains {display.D_RGB} cannot be inverted; "
                "use another white or D"
            ) from error
        chroma = (scene.chroma_scale / display.chroma_scale) ** (1.0 / k.CHROMA_POWER)
        return cls(
            scene=scene,
            display=display,
            response_from_XYZ=scene.response_from_XYZ(),
            XYZ_from_response=inverse * k.RESPONSE_HALF ** (1.0 / k.RESPONSE_POWER),
            scene_achromatic=scene.white_achromatic,
            display_achromatic=display.white_achromatic,
            lightness_power=scene.lightness_power / display.lightness_power,
            chroma_gain=chroma * scene.eccentricity_scale / display.eccentricity_scale,
        )

    @classmethod
    def seen_by(
        cls, model: str, source: ViewingConditions, target: ViewingConditions
    ) -> CamPassage:
        """The passage between viewing conditions, by ``"CIECAM02"`` or ``"CAM16"``."""
        return cls.between(*(Conditions.of_viewing(each, model) for each in (source, target)))

    def apply(self, XYZ: ArrayLike) -> Matrix:
        """Scene XYZ to the display XYZ of equal J, C and h: the models' inverse after forward.

        The NumPy twin of ``shaders/include/cam.glsl``.

        Parameters
        ----------
        XYZ : (..., 3) array_like
            Scene XYZ, Y = 100 for a perfect diffuser.

        Returns
        -------
        (..., 3) float64
            XYZ, Y = 100 for the display's white.

        Raises
        ------
        ShapeError
            If the last axis is not 3.
        """
        XYZ = triples(f"{self.scene.model}: XYZ", XYZ)
        if self.response_from_XYZ.ndim == 2:
            responses = compress(XYZ @ self.response_from_XYZ.T)
        else:
            responses = compress(np.einsum("...ij,...j", self.response_from_XYZ, XYZ))
        achromatic = responses @ k.ACHROMATIC
        lit = achromatic > 0.0
        achromatic = np.maximum(achromatic, 0.0)
        a, b = responses @ k.OPPONENT_A, responses @ k.OPPONENT_B
        p2 = achromatic + k.ACHROMATIC_NOISE
        display = (
            self.display_achromatic * (achromatic / self.scene_achromatic) ** self.lightness_power
        )
        skew = (self.chroma_gain - 1.0) * (k.CHROMA_SKEW[0] * a + k.CHROMA_SKEW[1] * b)
        chroma = self.chroma_gain * (display + k.ACHROMATIC_NOISE)
        chroma = np.where(lit, chroma / np.maximum(p2 + skew, k.CHROMA_FLOOR * p2), 0.0)
        opponent = np.stack([display, chroma * a, chroma * b], axis=-1)
        return expand(opponent @ k.RESPONSE_FROM_OPPONENT.T) @ self.XYZ_from_response.T

    def undo(self, XYZ: ArrayLike) -> Matrix:
        """Display XYZ back to the scene's; (..., 3)."""
        return CamPassage.between(self.display, self.scene).apply(XYZ)
