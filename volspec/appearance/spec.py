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
from dataclasses import dataclass, field
from types import MappingProxyType
from typing import NamedTuple

from volspec.errors import ViewingError, nearest

MODELS = ("CIECAM02", "none")


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


def _require_known(name: str, value: object, known: tuple[str, ...]) -> None:
    if value in known:
        return
    raise ViewingError(
        f"{name} is {value!r}; {nearest(str(value), known)}known: {', '.join(known)}"
    )


def _require_positive(name: str, value: float, remedy: str) -> None:
    real = isinstance(value, numbers.Real) and not isinstance(value, bool)
    if not (real and math.isfinite(value) and value > 0.0):
        raise ViewingError(f"{name} is {value!r}; expected a finite number above 0 ({remedy})")


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
    surround : str
        ``"average"``, ``"dim"`` or ``"dark"`` (`SURROUNDS`).

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
    surround: str = "average"

    def __post_init__(self) -> None:
        _require_positive("Display.L_A", self.L_A, "cd/m²; sRGB's is 4.07")
        _require_positive("Display.Y_b", self.Y_b, "percent of white; grey is 20")
        _require_known("Display.surround", self.surround, tuple(SURROUNDS))


@dataclass(frozen=True, slots=True)
class Viewing:
    """How the scene is looked at, and on what display the picture will be shown.

    Parameters
    ----------
    model : str
        ``"CIECAM02"`` shows what an eye adapted to the scene's light sees; ``"none"`` shows
        scene XYZ as they are beside the display's white, so tungsten looks orange.
    illuminance_lux : float
        E_v of the light on the scene, lux, where the light itself carries none. Also the
        level that ``level="absolute"`` compares lights with.
    L_A : float, optional
        Luminance of the scene's adapting field, cd/m²; None is E_v/π · Y_b/100, with the E_v
        of a `volspec.LightRig` that carries one, else ``illuminance_lux``.
    Y_b : float
        Luminance factor of the scene's background, percent of a perfect diffuser.
    surround : str
        ``"average"``, ``"dim"`` or ``"dark"`` (`SURROUNDS`).
    D : float, optional
        Degree of adaptation to the scene's white, 0 (none) to 1 (complete); None is
        CIECAM02's, from F and L_A.
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
    volspec.errors.ViewingError: Viewing.model is 'CIECAM2'; did you mean 'CIECAM02'? ...
    """

    model: str = "CIECAM02"
    illuminance_lux: float = 1000.0
    L_A: float | None = None
    Y_b: float = 20.0
    surround: str = "average"
    D: float | None = None
    exposure: float = 1.0
    display: Display = field(default_factory=Display)

    def __post_init__(self) -> None:
        _require_known("Viewing.model", self.model, MODELS)
        _require_positive("Viewing.illuminance_lux", self.illuminance_lux, "an office has 500")
        if self.L_A is not None:
            _require_positive("Viewing.L_A", self.L_A, "cd/m²; None takes it from the light")
        _require_positive("Viewing.Y_b", self.Y_b, "percent of white; grey is 20")
        _require_known("Viewing.surround", self.surround, tuple(SURROUNDS))
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
