"""Viewing conditions: what surrounds the eye in the scene and at the display.

    raycast -> relight -> [appearance] -> frame

References
----------
[1] Neumann, Castro, Neumann & Sbert (2004), "Color Appearance in Multispectral Radiosity",
    table 5 and section 7.1, with the errata of CIE 159:2004 (dim: N_c = 0.9).
[2] IEC 61966-2-1:1999 (sRGB: 64 lx ambient light, background of reflectance 0.2).
"""

from __future__ import annotations

import math
import numbers
from dataclasses import dataclass, field, replace
from types import MappingProxyType
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from volspec.appearance import constants as k
from volspec.errors import ViewingError, nearest

MODELS = (
    *("CIECAM02", "CAM16", "CIELAB", "RLAB", "Hunt", "Nayatani95"),
    # An adaptation alone:
    *("none", "von Kries", "Bradford", "Sharp", "CAT02", "CAT16"),
    *("Nayatani", "CIE 1994", "Guth", "Fairchild 1990"),
)
Triple = tuple[float, float, float]


class Surround(NamedTuple):
    """CIECAM02's three factors of a surround; unitless."""

    F: float
    """Largest degree of adaptation."""
    c: float
    """Impact of the surround on lightness."""
    N_c: float
    """Chromatic induction."""


SURROUNDS = MappingProxyType(
    {
        "average": Surround(F=1.0, c=0.69, N_c=1.0),
        "dim": Surround(F=0.9, c=0.59, N_c=0.9),
        "dark": Surround(F=0.8, c=0.525, N_c=0.8),
    }
)


# Luminance of a surround's white over that of the picture's white (CIE 159: dim is below 0.2).
SURROUND_RATIOS = MappingProxyType({"dark": 0.0, "dim": 0.1, "average": 0.2})


def surround_at(surround: str | float) -> Surround:
    """A surround by name or by its ratio, linear between dark, dim and average.

    Parameters
    ----------
    surround : str or float
        One of `SURROUNDS`, or S_R = L_surround / L_white, 0 to 1: dark at 0, dim at 0.1,
        average from 0.2 on [1, section 7.1; CIE 159].

    Raises
    ------
    ViewingError
        If the name is unknown or the ratio outside 0…1.

    Examples
    --------
    >>> surround_at(0.15)
    Surround(F=0.95, c=0.64, N_c=0.95)
    """
    if isinstance(surround, str):
        _require_known("surround", surround, tuple(SURROUNDS))
        return SURROUNDS[surround]
    if not (_is_finite(surround) and 0.0 <= surround <= 1.0):
        raise ViewingError(
            f"surround is {surround!r}; expected 0 (dark) to 1, or one of {', '.join(SURROUNDS)}"
        )
    names = sorted(SURROUNDS, key=SURROUND_RATIOS.__getitem__)
    ratios = [SURROUND_RATIOS[name] for name in names]
    factors = np.array([SURROUNDS[name] for name in names])
    return Surround(*(round(float(np.interp(surround, ratios, f)), 12) for f in factors.T))


def _require_known(name: str, value: object, known: tuple[str, ...]) -> None:
    if value in known:
        return
    raise ViewingError(
        f"{name} is {value!r}; {nearest(str(value), known)}known: {', '.join(known)}"
    )


def _is_finite(value: object) -> bool:
    real = isinstance(value, numbers.Real) and not isinstance(value, bool)
    return real and math.isfinite(value)  # type: ignore[arg-type]


def _require_not_negative(name: str, value: float, remedy: str) -> None:
    if not (_is_finite(value) and value >= 0.0):
        raise ViewingError(f"{name} is {value!r}; expected a finite number, 0 or above ({remedy})")


def _require_positive(name: str, value: float, remedy: str) -> None:
    if not (_is_finite(value) and value > 0.0):
        raise ViewingError(f"{name} is {value!r}; expected a finite number above 0 ({remedy})")


@dataclass(frozen=True, slots=True)
class ViewingConditions:
    """What an eye is adapted to: all that an adaptation or an appearance model asks.

    Parameters
    ----------
    white_XYZ : (X, Y, Z)
        The adopted white; Y = 100 for a perfect diffuser.
    L_A : float
        Luminance of the adapting field, cd/m². At 0 models take the limit from above.
    Y_b : float
        Luminance factor of the background, on the white's scale. 0 likewise.
    surround : str or float
        As `surround_at`.
    D : float, optional
        Degree of adaptation, 0 to 1; None is the model's own.
    discount : bool
        The eye takes the light's colour off whole, as it does with things it knows to be lit.

    Raises
    ------
    ViewingError
        If the white has a channel that is not above 0, or a number is out of range.

    Examples
    --------
    >>> round(ViewingConditions.of_lux((95.05, 100, 108.88), 1000).L_A, 2)
    63.66
    """

    white_XYZ: Triple
    L_A: float = 64.0 / math.pi * 0.2
    Y_b: float = 20.0
    surround: str | float = "average"
    D: float | None = None
    discount: bool = False

    def __post_init__(self) -> None:
        white = tuple(float(value) for value in self.white_XYZ)
        if len(white) != 3 or not all(math.isfinite(value) and value > 0 for value in white):
            raise ViewingError(
                f"ViewingConditions.white_XYZ is {self.white_XYZ}; expected three finite numbers "
                "above 0, as (95.05, 100, 108.88)"
            )
        object.__setattr__(self, "white_XYZ", white)
        _require_not_negative("ViewingConditions.L_A", self.L_A, "cd/m²")
        _require_not_negative("ViewingConditions.Y_b", self.Y_b, "percent of white; grey is 20")
        surround_at(self.surround)
        if self.D is not None and not 0.0 <= self.D <= 1.0:
            raise ViewingError(
                f"ViewingConditions.D is {self.D!r}; expected 0 (no adaptation) to 1 (complete), "
                "or None for the model's own"
            )

    @classmethod
    def of_lux(cls, white_XYZ: Triple, illuminance_lux: float, **others: Any) -> ViewingConditions:
        """Conditions under a light of E_v lux: L_A = E_v/π · Y_b/Y_w.

        Parameters
        ----------
        white_XYZ : (X, Y, Z)
        illuminance_lux : float
        **others
            As the constructor's, but L_A.
        """
        _require_not_negative("illuminance_lux", illuminance_lux, "an office has 500")
        dark = cls(white_XYZ, 0.0, **others)
        return replace(dark, L_A=illuminance_lux / math.pi * dark.Y_b / dark.white_XYZ[1])

    @property
    def factors(self) -> Surround:
        """F, c and N_c of the surround."""
        return surround_at(self.surround)


@dataclass(frozen=True, slots=True)
class Display:
    """An sRGB display and the room it stands in.

    Parameters
    ----------
    L_A : float
        Luminance of the adapting field, cd/m². The default is sRGB's: a diffuser of
        reflectance 0.2 under 64 lx.
    Y_b : float
        Luminance factor of the background, percent of the display's white.
    surround : str or float
        As `surround_at`.

    Raises
    ------
    ViewingError
        If a number is not positive or the surround is unknown.

    Notes
    -----
    Primaries, white (D65, x = 0.3127, y = 0.3290) and transfer function are sRGB's [2].
    """

    L_A: float = 64.0 / math.pi * 0.2
    Y_b: float = 20.0
    surround: str | float = "average"

    def __post_init__(self) -> None:
        _require_not_negative("Display.L_A", self.L_A, "cd/m²; sRGB's is 4.07")
        _require_not_negative("Display.Y_b", self.Y_b, "percent of white; grey is 20")
        surround_at(self.surround)

    @property
    def conditions(self) -> ViewingConditions:
        """What the eye before it is adapted to; Y = 100 for its white."""
        X, Y, Z = k.DISPLAY_WHITE_XYZ.tolist()
        return ViewingConditions((X, Y, Z), self.L_A, self.Y_b, self.surround)


@dataclass(frozen=True, slots=True)
class Viewing:
    """How the scene is looked at, and on what display the picture will be shown.

    Parameters
    ----------
    model : str
        One of `MODELS`: an appearance model, such as ``"CIECAM02"``, shows what an eye adapted to
        the scene's light sees; an adaptation alone, such as ``"CAT02"``, moves the white and leaves
        tones as they are; ``"none"`` shows scene XYZ as they are beside the display's white, so
        tungsten looks orange.
    illuminance_lux : float
        E_v of the light on the scene, lux, where the light itself carries none. Also the
        level that ``level="absolute"`` compares lights with.
    L_A : float, optional
        Luminance of the scene's adapting field, cd/m²; None is E_v/π · Y_b/100, with the E_v
        of a `volspec.LightRig` that carries one, else ``illuminance_lux``.
    Y_b : float
        Luminance factor of the scene's background, percent of a perfect diffuser.
    surround : str or float
        As `surround_at`.
    D : float, optional
        Degree of adaptation to the scene's white, 0 (none) to 1 (complete); None is
        the model's, for CIECAM02 from F and L_A.
    discount : bool
        The eye takes the light's colour off whole.
    exposure : float
        Linear factor on scene XYZ, as a camera's.
    display : Display
        Where the picture is shown.

    Raises
    ------
    ViewingError
        If the model or surround is unknown, or a number is out of range.

    Examples
    --------
    >>> round(Viewing().adapting_luminance, 2)
    63.66
    >>> Viewing(model="CIECAM2")
    Traceback (most recent call last):
    ...
    volspec.errors.ViewingError: Viewing.model is 'CIECAM2'; did you mean 'CIECAM02'...
    """

    model: str = "CIECAM02"
    illuminance_lux: float = 1000.0
    L_A: float | None = None
    Y_b: float = 20.0
    surround: str | float = "average"
    D: float | None = None
    discount: bool = False
    exposure: float = 1.0
    display: Display = field(default_factory=Display)

    def __post_init__(self) -> None:
        _require_known("Viewing.model", self.model, MODELS)
        _require_positive("Viewing.illuminance_lux", self.illuminance_lux, "an office has 500")
        if self.L_A is not None:
            _require_not_negative("Viewing.L_A", self.L_A, "cd/m²; None takes it from the light")
        _require_not_negative("Viewing.Y_b", self.Y_b, "percent of white; grey is 20")
        surround_at(self.surround)
        if self.D is not None and not 0.0 <= self.D <= 1.0:
            raise ViewingError(
                f"Viewing.D is {self.D!r}; expected 0 (no adaptation) to 1 (complete), "
                "or None for CIECAM02's own"
            )
        _require_positive("Viewing.exposure", self.exposure, "1 changes nothing")
        if not isinstance(self.display, Display):
            raise ViewingError(f"Viewing.display is {self.display!r}; expected a Display")

    @property
    def adapting_luminance(self) -> float:
        """L_A of the scene, cd/m²: ``L_A``, or that of a background under ``illuminance_lux``."""
        if self.L_A is not None:
            return self.L_A
        return self.illuminance_lux / math.pi * self.Y_b / 100.0

    def conditions(self, white_XYZ: ArrayLike) -> ViewingConditions:
        """What an eye in the scene is adapted to, under a light whose white is given.

        Parameters
        ----------
        white_XYZ : (3,) array_like
            Of a perfect diffuser, Y = 100. A channel that a narrow light leaves without power
            counts as 1e-6 of Y.
        """
        X, Y, Z = np.maximum(white_XYZ, 1e-6 * np.asarray(white_XYZ)[1]).tolist()
        luminance = self.adapting_luminance
        return ViewingConditions(
            (X, Y, Z), luminance, self.Y_b, self.surround, self.D, self.discount
        )
