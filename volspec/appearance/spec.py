"""How a scene is looked at: model, viewing conditions and the display.

    raycast -> relight -> [appearance] -> frame

Surrounds and conditions stand in `volspec.appearance.surround`, displays in
`volspec.appearance.display`; both can be had from here.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import ArrayLike

from volspec.appearance.display import Display
from volspec.appearance.surround import (
    SURROUND_RATIOS,
    SURROUNDS,
    Surround,
    Triple,
    ViewingConditions,
    is_finite,
    require_adaptation,
    require_background,
    require_known,
    require_lux,
    require_not_negative,
    surround_at,
)
from volspec.errors import ViewingError

__all__ = [
    "ADAPTING",
    "MODELS",
    "PER_PIXEL",
    "SURROUNDS",
    "SURROUND_RATIOS",
    "Display",
    "Surround",
    "Triple",
    "Viewing",
    "ViewingConditions",
    "surround_at",
]

MODELS = (
    *("CIECAM02", "CAM16", "CIELAB", "RLAB", "Hunt", "Nayatani95"),
    # An adaptation alone:
    *("none", "von Kries", "Bradford", "Sharp", "CAT02", "CAT16"),
    *("Nayatani", "CIE 1994", "Guth", "Fairchild 1990"),
)
# Where Y_b and L_A come from: as given, or measured in the picture, at its middle or per pixel.
ADAPTING = ("given", "picture", "pixel")
# Models whose conditions may change from pixel to pixel.
PER_PIXEL = ("CIECAM02", "CAM16")
# Twenty stops either way; and degrees that cones of 1° and 11° can be measured in.
EXPOSURES = (1e-6, 1e6)
FIELDS_OF_VIEW_DEG = (0.1, 170.0)


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
        The eye takes the light's colour off whole: ``D`` is 1, and is not given beside.
    exposure : float
        Linear factor on scene XYZ, as a camera's: 1e-6 to 1e6.
    display : Display
        Where the picture is shown.
    adapting : {"given", "picture", "pixel"}
        ``"given"``: Y_b and L_A are those above. ``"picture"``: both are measured in each relit
        picture, by an eye that looks at its middle (`volspec.appearance.measured`); ``"pixel"``:
        by one that looks at each pixel in turn, with CIECAM02 or CAM16. What is measured replaces
        ``Y_b``; an ``L_A`` that is given stays.
    fov_deg : float, optional
        The picture's height as an angle, 0.1 to 170, to measure with; None is that of the camera
        that cast it.

    Raises
    ------
    ViewingError
        If the model, surround or ``adapting`` is unknown, a number is out of range, or the model
        cannot adapt to each pixel.

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
    adapting: str = "given"
    fov_deg: float | None = None

    def __post_init__(self) -> None:
        require_known("Viewing.model", self.model, MODELS)
        require_lux("Viewing.illuminance_lux", self.illuminance_lux)
        if self.L_A is not None:
            require_not_negative("Viewing.L_A", self.L_A, "cd/m²; None takes it from the light")
        require_background("Viewing.Y_b", self.Y_b)
        surround_at(self.surround)
        require_adaptation("Viewing", self.D, self.discount)
        if not (is_finite(self.exposure) and EXPOSURES[0] <= self.exposure <= EXPOSURES[1]):
            raise ViewingError(
                f"Viewing.exposure is {self.exposure!r}; expected a factor of {EXPOSURES[0]:g} to "
                f"{EXPOSURES[1]:g}, where 1 changes nothing"
            )
        if not isinstance(self.display, Display):
            raise ViewingError(f"Viewing.display is {self.display!r}; expected a Display")
        require_known("Viewing.adapting", self.adapting, ADAPTING)
        if self.adapting == "pixel" and self.model not in PER_PIXEL:
            raise ViewingError(
                f"Viewing.adapting is 'pixel', which model {self.model!r} cannot; take "
                f"{' or '.join(PER_PIXEL)}, or adapting='picture'"
            )
        if self.fov_deg is not None:
            require_angle("Viewing.fov_deg", self.fov_deg)

    @property
    def adapting_luminance(self) -> float:
        """L_A of the scene, cd/m²: ``L_A``, or that of a background under ``illuminance_lux``.

        Raises
        ------
        ViewingError
            If it is to be measured.
        """
        if self.L_A is not None:
            return self.L_A
        self._require_given()
        return self.illuminance_lux / math.pi * self.Y_b / 100.0

    def lit_by(self, lux: float | None) -> Viewing:
        """Return the viewing under a light of E_v lux; itself if the light carries none.

        Raises
        ------
        ViewingError
            If it is not above 0.
        """
        return self if lux is None else replace(self, illuminance_lux=lux)

    def conditions(self, white_XYZ: ArrayLike) -> ViewingConditions:
        """What an eye in the scene is adapted to, under a light whose white is given.

        Parameters
        ----------
        white_XYZ : (3,) array_like
            Of a perfect diffuser, Y = 100. A channel that a narrow light leaves without power
            counts as 1e-6 of Y.

        Raises
        ------
        ViewingError
            If they are to be measured.
        """
        self._require_given()
        X, Y, Z = np.maximum(white_XYZ, 1e-6 * np.asarray(white_XYZ)[1]).tolist()
        luminance = self.adapting_luminance
        return ViewingConditions(
            (X, Y, Z), luminance, self.Y_b, self.surround, self.D, self.discount
        )

    def _require_given(self) -> None:
        if self.adapting != "given":
            raise ViewingError(
                f"Viewing.adapting is {self.adapting!r}, so there are no conditions without a "
                "picture; relight one, or take adapting='given'"
            )


def require_angle(name: str, value: object) -> None:
    """Refuse what is no field of view."""
    least, most = FIELDS_OF_VIEW_DEG
    if not (is_finite(value) and least <= value <= most):  # type: ignore[operator]
        raise ViewingError(
            f"{name} is {value!r}; expected {least:g} to {most:g} degrees, the picture's height as "
            "an angle"
        )
