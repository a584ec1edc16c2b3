"""One viewing condition as CIECAM02's scalars, and the passage between two of them.

    Viewing, white -> [Conditions] -> [Transport] -> uniforms of shaders/relight.frag

A light change moves the white, so these are computed anew for every frame, in float64 on the
host; a pixel then costs three matrix products and ten powers.

References
----------
[1] Neumann, Castro, Neumann & Sbert (2004), eq. 18-26 and 34-37.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from volspec.appearance import constants as k
from volspec.appearance.spec import SURROUNDS, Display, Surround, Viewing
from volspec.errors import ShapeError, ViewingError

Matrix = NDArray[np.float64]


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


@dataclass(frozen=True, slots=True)
class Conditions:
    """CIECAM02's viewing-condition scalars.

    Raises
    ------
    ViewingError
        If the white has no lightness in CIECAM02.
    """

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
    """Gains on the CAT02 responses."""
    white_achromatic: float
    """p2 - 0.305 of the white, so A_w = N_bb times this."""

    def __post_init__(self) -> None:
        if not (np.isfinite(self.white_achromatic) and self.white_achromatic > 0.0):
            raise ViewingError(
                f"viewing conditions: the white XYZ = {_triple(self.white_XYZ)} has no "
                f"lightness in CIECAM02 at D = {self.D:.3g}; use a broader light, D nearer 1, "
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
    ) -> Conditions:
        """Compute the scalars (eq. 18-26).

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

        Raises
        ------
        ShapeError
            If the white is not three numbers.
        ViewingError
            If the white is not finite or its Y is not positive.
        """
        white = np.asarray(white_XYZ, dtype=np.float64)
        if white.shape != (3,):
            raise ShapeError(
                f"viewing conditions: the white has shape {white.shape}; expected (3,)"
            )
        if not (np.all(np.isfinite(white)) and white[1] > 0.0):
            raise ViewingError(
                f"viewing conditions: the white XYZ = {_triple(white)} is not a colour; "
                "expected finite numbers and Y above 0. Is the light black?"
            )
        five_L_A = 5.0 * L_A
        k4 = (five_L_A + 1.0) ** -4
        F_L = 0.1 * (2.0 * k4 * five_L_A + (1.0 - k4) ** 2 * np.cbrt(five_L_A))
        n = Y_b / white[1]
        if D is None:
            D = float(surround.F * (1.0 - np.exp(-(L_A + 42.0) / 92.0) / 3.6))
        RGB_w = k.CAT02_FROM_XYZ @ white
        # A spectral light can have a zero CAT02 response: keep its gain finite.
        floor = 1e-6 * white[1]
        RGB_w = np.where(np.abs(RGB_w) < floor, np.copysign(floor, RGB_w), RGB_w)
        D_RGB = white[1] * D / RGB_w + 1.0 - D
        responses = (F_L / 100.0) * (k.HPE_FROM_CAT02 @ (D_RGB * (k.CAT02_FROM_XYZ @ white)))
        return cls(
            white_XYZ=_triple(white),
            L_A=float(L_A),
            Y_b=float(Y_b),
            surround=surround,
            D=float(D),
            F_L=float(F_L),
            n=float(n),
            N_bb=float(0.725 * n**-0.2),
            z=float(1.48 + np.sqrt(n)),
            D_RGB=_triple(D_RGB),
            white_achromatic=float(k.ACHROMATIC @ compress(responses)),
        )

    @classmethod
    def of_scene(cls, viewing: Viewing, white_XYZ: ArrayLike) -> Conditions:
        """The scene's conditions under a white, as `of` computes them."""
        surround = SURROUNDS[viewing.surround]
        return cls.of(white_XYZ, viewing.adapting_luminance, viewing.Y_b, surround, viewing.D)

    @classmethod
    def of_display(cls, display: Display) -> Conditions:
        """The display's conditions, as `of` computes them."""
        surround = SURROUNDS[display.surround]
        return cls.of(k.DISPLAY_WHITE_XYZ, display.L_A, display.Y_b, surround)

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
        return float((1.64 - 0.29**self.n) ** 0.73)

    @property
    def eccentricity_scale(self) -> float:
        """50000/13 N_c N_cb / 4, what stands before cos(h + 2) + 3.8 in t (eq. 33-34)."""
        return k.ECCENTRICITY_SCALE * self.surround.N_c * self.N_cb / 4.0

    def response_from_XYZ(self) -> Matrix:
        """(3, 3): XYZ -> what `compress` takes (eq. 23, 25, 26, and F_L / 100 of eq. 27)."""
        adapted = np.asarray(self.D_RGB)[:, None] * k.CAT02_FROM_XYZ
        return (self.F_L / 100.0) * (k.HPE_FROM_CAT02 @ adapted)


def _triple(values: ArrayLike) -> tuple[float, float, float]:
    x, y, z = (float(v) for v in np.asarray(values))
    return x, y, z


@dataclass(frozen=True, slots=True)
class Transport:
    """What carries an appearance (J, C, h) from one viewing condition to another.

    Forward and inverse model cancel but for these numbers: with J, C and h kept, t scales by a
    constant, e_t and the hue fall out, and

        p2' - 0.305 = w' ((p2 - 0.305) / w)^γ
        (a', b')    = κ p2' (a, b) / (p2 + (κ - 1) (11 a + 108 b) / 23)

    where w, w' are the whites' p2 - 0.305. The second line is the inverse model's
    23 t p2' (cos h, sin h) / (23 p1' + 11 t cos h + 108 t sin h) multiplied out with
    t = p1 √(a² + b²) / (R + G + 21/20 B) and 23 (R + G + 21/20 B) + 11 a + 108 b = 23 p2.
    """

    response_from_XYZ: Matrix
    """(3, 3): scene XYZ -> linear responses."""
    XYZ_from_response: Matrix
    """(3, 3): x / (400 - x) raised to 1/0.42 -> display XYZ."""
    scene_achromatic: float
    """w: p2 - 0.305 of the scene's white."""
    display_achromatic: float
    """w': p2 - 0.305 of the display's white."""
    lightness_power: float
    """γ = cz / (c'z')."""
    chroma_gain: float
    """κ = (chroma scale / chroma scale')^(1/0.9) · N_c N_cb / (N_c' N_cb')."""

    @classmethod
    def between(cls, scene: Conditions, display: Conditions) -> Transport:
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
            response_from_XYZ=scene.response_from_XYZ(),
            XYZ_from_response=inverse * k.RESPONSE_HALF ** (1.0 / k.RESPONSE_POWER),
            scene_achromatic=scene.white_achromatic,
            display_achromatic=display.white_achromatic,
            lightness_power=scene.lightness_power / display.lightness_power,
            chroma_gain=chroma * scene.eccentricity_scale / display.eccentricity_scale,
        )

    @classmethod
    def for_viewing(cls, viewing: Viewing, white_XYZ: ArrayLike) -> Transport:
        """From the scene under ``white_XYZ`` to the viewing's display."""
        scene = Conditions.of_scene(viewing, white_XYZ)
        return cls.between(scene, Conditions.of_display(viewing.display))
