"""Settings for viewing a scene: model, viewing conditions and display.

    raycast -> relight -> [appearance] -> frame

Surrounds and conditions are in `volspec.appearance.surround`, displays in
`volspec.appearance.display.monitors`; both can be imported from here.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace
from typing import Annotated, Literal, get_args

import numpy as np
from numpy.typing import ArrayLike
from pydantic import Field

from volspec.appearance.display.deficiency import DeficiencyName
from volspec.appearance.display.monitors import Display
from volspec.appearance.models.hunt import HuntSettings
from volspec.appearance.models.nayatani95 import NayataniSettings
from volspec.appearance.surround import (
    SURROUND_RATIOS,
    SURROUNDS,
    Background,
    Illuminance,
    Luminance,
    Surround,
    SurroundName,
    Triple,
    ViewingConditions,
    White,
    refuse_two_degrees,
    surround_at,
)
from volspec.errors import ViewingError
from volspec.settings import Fraction, Hint, Unit, settings, words_for

__all__ = [
    "ADAPTING",
    "MODELS",
    "PER_PIXEL",
    "SURROUNDS",
    "SURROUND_RATIOS",
    "Display",
    "HuntSettings",
    "NayataniSettings",
    "Surround",
    "Triple",
    "Viewing",
    "ViewingConditions",
    "surround_at",
]

Model = Literal[
    "CIECAM02",
    "CAM16",
    "CIELAB",
    "RLAB",
    "Hunt",
    "Nayatani95",
    "Hellwig2022",
    "ZCAM",
    # An adaptation alone:
    "none",
    "von Kries",
    "Bradford",
    "Sharp",
    "CAT02",
    "CAT16",
    "Nayatani",
    "CIE 1994",
    "Guth",
    "Fairchild 1990",
]
MODELS: tuple[Model, ...] = get_args(Model)
# Y_b and L_A: as given, or measured in the picture, at its centre or per pixel.
Adapting = Literal["given", "picture", "pixel"]
ADAPTING: tuple[Adapting, ...] = get_args(Adapting)
# Models whose conditions may change from pixel to pixel.
PER_PIXEL: tuple[Model, ...] = ("CIECAM02", "CAM16", "Hellwig2022")
# Twenty stops either way; and the range of angles in which cones of 1° and 11° can be measured.
EXPOSURES = (1e-6, 1e6)
FIELDS_OF_VIEW_DEG = (0.1, 170.0)
FieldOfView = Annotated[
    float, Field(ge=FIELDS_OF_VIEW_DEG[0], le=FIELDS_OF_VIEW_DEG[1]), Unit("degrees")
]


SceneSurround = Annotated[
    SurroundName | Literal["measured"] | Fraction,
    Hint("ratio to white: dark 0, dim 0.1, average 0.2"),
]
AdoptedWhite = Annotated[
    Literal["light", "scene"] | White, Hint("light, scene, or X, Y, Z with Y = 100", whole=True)
]


@settings(ViewingError)
@dataclass(frozen=True, slots=True)
class Viewing:
    """Appearance model, the scene's viewing conditions, and the display of the picture.

    Examples
    --------
    >>> round(Viewing().adapting_luminance, 2)
    63.66
    """

    model: Model = "CIECAM02"
    """An appearance model such as CIECAM02 shows the scene as an eye adapted to its light sees it;
    a chromatic adaptation such as CAT02 moves the white and leaves tones as they are; none shows
    scene XYZ relative to the display's white, so tungsten looks orange."""
    illuminance_lux: Illuminance = 1000.0
    """Illuminance of the scene's light, if the light itself has none. Also the level with which
    ``level = "absolute"`` compares lights."""
    L_A: Luminance | None = None
    """Luminance of the scene's adapting field; if left out, E_v/π · Y_b/100, with the light's own
    illuminance E_v or else ``illuminance_lux``."""
    Y_b: Background = 20.0
    """Luminance factor of the scene's background, percent of a perfect diffuser."""
    surround: SceneSurround = "average"
    """average, dim, dark, or its ratio to white, 0 to 1; measured: in each relit picture, the
    luminance of the field 11 to 90 degrees from the line of sight over that of a white."""
    adopted_white: AdoptedWhite = "light"
    """light: a perfect diffuser that faces every source; scene: the same in the light that falls
    on what the picture shows, most of all near the line of sight, which differs if light groups
    have different lights; or X, Y, Z."""
    D: Fraction | None = None
    """Degree of adaptation to the scene's white, 0 (none) to 1; if left out, the model's."""
    discount: bool = False
    """The eye discounts the light's colour completely: ``D`` is 1 and must be left out."""
    exposure: Annotated[
        float, Field(ge=EXPOSURES[0], le=EXPOSURES[1]), Hint("1 changes nothing")
    ] = 1.0
    """Linear factor on scene XYZ, like a camera's exposure."""
    display: Display = field(default_factory=Display)
    """Display and room for which the picture is made."""
    adapting: Adapting = "given"
    """given: use Y_b and L_A above; picture: measure both in each relit picture, for an eye that
    looks at its centre; pixel: for an eye that looks at each pixel in turn (CIECAM02, CAM16,
    Hellwig2022). The measured background replaces ``Y_b``; an ``L_A`` that is given is kept."""
    fov_deg: FieldOfView | None = None
    """The picture's height as an angle, for measuring; if left out, the camera's."""
    hunt: HuntSettings = field(default_factory=HuntSettings)
    """Further inputs of model Hunt, for the scene."""
    nayatani: NayataniSettings = field(default_factory=NayataniSettings)
    """Further inputs of model Nayatani95, for the scene."""
    Y_A: Background | None = None
    """Luminance factor of the scene's adapting field, if it is not the background's: L_A, if left
    out, is E_v/π · Y_A/100."""
    deficiency: DeficiencyName = "none"
    """Colour-vision deficiency to simulate, for a viewer with normal vision: protan lacks L cones,
    deutan M cones, tritan S cones. Applied to the display's linear RGB, after gamut mapping."""
    severity: Annotated[Fraction, Hint("1: the cone is lacking")] = 1.0
    """Severity of the deficiency; below 1 the cone is there, but its sensitivity is shifted towards
    another's (anomalous trichromacy). At 0 pictures are those of normal vision."""

    def __post_init__(self) -> None:
        refuse_two_degrees(self.D, self.discount)
        if self.adapting == "pixel" and self.model not in PER_PIXEL:
            raise ViewingError(
                f"'pixel' is not available for model {self.model!r}",
                f'give {" or ".join(PER_PIXEL)}, or adapting "picture"',
                code="conflict",
                field="adapting",
                given=self.adapting,
            )

    @property
    def is_measured(self) -> bool:
        """True if a condition is measured in the picture."""
        return (
            self.adapting != "given" or self.surround == "measured" or self.adopted_white == "scene"
        )

    def unmeasured(self) -> Viewing:
        """Return the viewing without a picture: what would be measured has its default."""
        return replace(
            self,
            adapting="given",
            fov_deg=None,
            surround="average" if self.surround == "measured" else self.surround,
            adopted_white="light" if self.adopted_white == "scene" else self.adopted_white,
        )

    @property
    def adapting_luminance(self) -> float:
        """L_A of the scene, cd/m²: ``L_A``, or a background's luminance under ``illuminance_lux``.

        Raises ViewingError if L_A is to be measured.
        """
        if self.L_A is not None:
            return self.L_A
        self._require_given("adapting", self.adapting != "given")
        Y_A = self.Y_b if self.Y_A is None else self.Y_A
        return self.illuminance_lux / math.pi * Y_A / 100.0

    def lit_by(self, lux: float | None) -> Viewing:
        """Return the viewing under a light of ``lux``; unchanged if the light has none."""
        return self if lux is None else replace(self, illuminance_lux=lux)

    def conditions(self, white_XYZ: ArrayLike) -> ViewingConditions:
        """Return the conditions of an eye in the scene, under a light with a white (3,), Y = 100.

        A channel in which a narrow light has no power counts as 1e-6 of Y. Raises ViewingError if
        the conditions are to be measured.
        """
        self._require_given("adapting", self.adapting != "given")
        self._require_given("surround", self.surround == "measured")
        self._require_given("adopted_white", self.adopted_white == "scene")
        white = white_XYZ if isinstance(self.adopted_white, str) else self.adopted_white
        X, Y, Z = np.maximum(white, 1e-6 * np.asarray(white)[1]).tolist()
        assert self.surround != "measured"
        return ViewingConditions(
            *((X, Y, Z), self.adapting_luminance, self.Y_b, self.surround, self.D, self.discount),
            white_cd_m2=self.illuminance_lux / math.pi,
        )

    def _require_given(self, name: str, measured: bool) -> None:
        if measured:
            value = getattr(self, name)
            default = getattr(self.unmeasured(), name)
            raise ViewingError(
                f"{value!r}, so there are no conditions without a picture",
                f'relight one, or set {name} = "{default}"',
                code="conflict",
                field=f"Viewing.{name}",
                given=value,
            )


def require_angle(name: str, value: float) -> None:
    """Raise ViewingError unless the value is a field of view."""
    low, high = FIELDS_OF_VIEW_DEG
    if not low <= value <= high:
        raise ViewingError.refused(name, value, f"give {words_for(FieldOfView)}", "range")
