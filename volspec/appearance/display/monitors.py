"""The display and its room; rooms by name, each number with its source.

    spaces, profile, surround -> [display] -> Viewing -> scene_to_display, screen

If a source gives no adapting luminance, L_A is a fifth of the white's, the luminance of a grey
background of Y_b = 20.

References
----------
[1] IEC 61966-2-1:1999, reference and typical viewing environment.
[2] Moroney et al. (2002), "The CIECAM02 Color Appearance Model", 10th Color Imaging Conference,
    table 1; CIE 159:2004 has the same.
[3] ISO 3664:2009, viewing conditions P1, P2 and T1.
[4] SMPTE ST 431-1:2006 (ISO 26431-1), screen luminance of digital cinema.
[5] SMPTE 196M-2003, indoor theater screen luminance: 55 cd/m² (16 fL), the gate without film.
[6] Recommendation ITU-R BT.2035 (2013), reference viewing environment for HDTV.
[7] Recommendation ITU-R BT.2100-2 (2018), table 3, reference viewing environment; Report ITU-R
    BT.2408-7 (2023), reference white.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from types import MappingProxyType
from typing import Annotated, Any, ClassVar, Literal, NamedTuple, get_args

from pydantic import BeforeValidator, Discriminator, Field, Tag

from volspec.appearance.display.profile import is_profile, read_profile
from volspec.appearance.display.spaces import SPACES, ColourSpace
from volspec.appearance.surround import (
    Background,
    Luminance,
    SurroundOrRatio,
    Triple,
    ViewingConditions,
)
from volspec.errors import ViewingError, nearest
from volspec.settings import Hint, Positive, Unit, plain, settings, table_of, value_or_table

# Fields that a preset sets.
ROOM = ("white_cd_m2", "L_A", "Y_b", "surround")

Gamut = Literal["clip", "reduce"]
GAMUTS: tuple[Gamut, ...] = get_args(Gamut)


def colour_space(space: str | Path | ColourSpace) -> ColourSpace:
    """Return a space by name, as it is, or from a display's profile, ``FILE.icc``."""
    if isinstance(space, ColourSpace):
        return space
    name = str(space)
    if name in SPACES:
        return SPACES[name]
    if is_profile(name):
        return read_profile(name)
    raise ViewingError.refused(
        "colour space",
        name,
        f"{nearest(name, SPACES)}known: {', '.join(SPACES)}; give others as FILE.icc or a "
        "ColourSpace",
        "unknown",
    )


def _look_up(space: object) -> object:
    if not isinstance(space, str | Path) or space in SPACES:
        return space
    if not is_profile(str(space)):
        remedy = f"{nearest(str(space), SPACES)}known: {', '.join(SPACES)}; others as FILE.icc"
        raise ViewingError("", remedy, code="unknown", given=space)
    try:
        return colour_space(space)  # reads a profile now, once
    except ViewingError as error:
        raise ViewingError(str(error), code=error.code, given=space) from error


@settings(ViewingError)
@dataclass(frozen=True, slots=True)
class Display:
    """A display and the room it is in.

    Examples
    --------
    >>> round(Display(space="DCI-P3", surround="dark", white_cd_m2=48, L_A=None).conditions.L_A, 2)
    9.6
    """

    file_keys: ClassVar = {
        "preset": Field("sRGB", description="Room and luminance by name, for the keys left out.")
    }
    L_A: Luminance | None = 64.0 / math.pi * 0.2
    """Luminance of the adapting field. The default is sRGB's room: a diffuser of reflectance 0.2
    under 64 lx. None means ``Y_b`` percent of ``white_cd_m2``, as if the display were the only
    light source; so does a file that gives ``white_cd_m2`` but not ``L_A``."""
    Y_b: Background = 20.0
    """Luminance factor of the background, percent of the display's white."""
    surround: SurroundOrRatio = "average"
    """average, dim, dark, or its ratio to white, 0 to 1."""
    space: Annotated[
        Annotated[str | Path, Tag("<value>")] | Annotated[ColourSpace, Tag("<table>")],
        Discriminator(value_or_table),
        BeforeValidator(_look_up),
        Hint("a name such as sRGB, a profile FILE.icc, or its numbers", whole=True),
    ] = "sRGB"
    """Primaries, white and curve: sRGB, Display P3, DCI-P3, Rec. 709, Rec. 2020, Adobe RGB (1998),
    a display's profile FILE.icc, or its numbers. The picture is converted to this space, and the
    eye adapts to its white."""
    gamut: Gamut = "clip"
    """Colours outside of the display's gamut: each channel clipped to 0…1, or chroma reduced at
    constant lightness and hue."""
    mark: bool = False
    """Hatch the pixels with colours outside of the display's gamut."""
    white_cd_m2: Annotated[Positive, Unit("cd/m²"), Hint("sRGB's is 80")] = 80.0
    """Luminance of the display's white. Used only if ``L_A`` is None, and by ZCAM: other models
    work with luminances relative to the white."""

    @staticmethod
    def from_table(table: Mapping[str, Any], folder: Path | None) -> dict[str, Any]:
        """Complete a file's table from its preset; a profile's path is relative to ``folder``."""
        fields = dict(table)
        try:
            room = preset(fields.pop("preset", "sRGB")).display()
        except ViewingError as error:
            raise error.at("preset") from None
        if "white_cd_m2" in fields and "L_A" not in fields:
            fields["L_A"] = None
        space = fields.get("space")
        if isinstance(space, str) and is_profile(space):
            fields["space"] = (folder or Path()) / space
        return {key: getattr(room, key) for key in ROOM} | fields

    def to_table(self) -> dict[str, Any]:
        """Return the table for a file, with a preset's name or the numbers."""
        table = table_of(self)
        if isinstance(self.space, ColourSpace):
            table["space"] = plain(self.space)
        table = {key: value for key, value in table.items() if key not in ROOM}
        rooms = {name: entry.display() for name, entry in PRESETS.items()}
        values = [getattr(self, key) for key in ROOM]
        for name, room in rooms.items():
            if values == [getattr(room, key) for key in ROOM]:
                return ({"preset": name} if name != "sRGB" else {}) | table
        usual = Display()
        has_white = self.L_A is None or self.white_cd_m2 != usual.white_cd_m2
        numbers = {key: getattr(self, key) for key in ROOM}
        numbers = {key: v for key, v in numbers.items() if v != getattr(usual, key)}
        if has_white:  # white_cd_m2 alone would also determine L_A
            numbers |= {"white_cd_m2": self.white_cd_m2, "L_A": self.L_A}
        return {key: plain(v) for key, v in numbers.items() if v is not None} | table

    @property
    def adapting_luminance(self) -> float:
        """L_A, cd/m²: ``L_A``, or the luminance of a background lit by the display alone."""
        return self.white_cd_m2 * self.Y_b / 100.0 if self.L_A is None else self.L_A

    @property
    def colours(self) -> ColourSpace:
        """``space``, looked up."""
        return colour_space(self.space)

    @property
    def conditions(self) -> ViewingConditions:
        """Viewing conditions of a viewer in front of the display; its white has Y = 100."""
        X, Y, Z = self.colours.white_XYZ.tolist()
        return ViewingConditions(
            *((X, Y, Z), self.adapting_luminance, self.Y_b, self.surround),
            white_cd_m2=self.white_cd_m2,
        )


class Sources(NamedTuple):
    """Source of each number of a preset."""

    white_luminance: str
    surround: str
    L_A: str
    Y_b: str


@dataclass(frozen=True, slots=True)
class RoomPreset:
    """Viewing conditions that a standard or a paper describes."""

    name: str
    L_A: float
    """Luminance of the adapting field, cd/m²."""
    Y_b: float
    """Luminance factor of the background, percent of white."""
    surround: SurroundOrRatio
    """Name or ratio, see `surround_at`."""
    white_luminance: float
    """Luminance of the display's white or of a perfect diffuser, cd/m²."""
    space: str
    """The usual display, a name in `SPACES`; ``""`` if there is none."""
    sources: Sources

    def display(self, space: str | Path | ColourSpace = "sRGB", gamut: Gamut = "clip") -> Display:
        """Make a display under these conditions, with the picture's ``space``, not the preset's."""
        return Display(
            L_A=self.L_A,
            Y_b=self.Y_b,
            surround=self.surround,
            space=space,
            gamut=gamut,
            white_cd_m2=self.white_luminance,
        )

    def conditions(self, white_XYZ: Triple) -> ViewingConditions:
        """Make the conditions of a scene, under a white with Y = 100."""
        values = (white_XYZ, self.L_A, self.Y_b, self.surround)
        return ViewingConditions(*values, white_cd_m2=self.white_luminance)


_FIFTH = "a fifth of the white's"
_GREY = "grey, the models' usual"
_sRGB_WHITE = "IEC 61966-2-1: 80 cd/m²"
_sRGB_GREY = "IEC 61966-2-1: surround of reflectance 0.2"
_MORONEY_WHITE = "Moroney 2002: 80 cd/m²"
_THEATRE = "a darkened theatre: S_R = 0"
_PRINT_LIGHT = "lit as the print is: S_R = 1 [2]"


def _preset(
    name: str, white: float, surround: SurroundOrRatio, space: str, L_A: float | None, *sources: str
) -> RoomPreset:
    """Make a preset; sources are for the white, the surround, L_A and Y_b, in this order."""
    luminance = 0.2 * white if L_A is None else L_A
    all_sources = (*sources, *(_FIFTH, _GREY)[len(sources) - 2 :])
    return RoomPreset(name, luminance, 20.0, surround, white, space, Sources(*all_sources))


# fmt: off
_PRESETS = (
    _preset("sRGB", 80.0, "average", "sRGB", 64.0 / math.pi * 0.2, _sRGB_WHITE,
            "64 lx on white is 20 cd/m², a quarter of the display's: S_R = 0.25 [2]",
            "IEC 61966-2-1: 64 lx on reflectance 0.2, 64/π · 0.2", _sRGB_GREY),
    _preset("sRGB office", 80.0, "average", "sRGB", 200.0 / math.pi * 0.2, _sRGB_WHITE,
            "200 lx on white is 64 cd/m²: S_R = 0.8 [2]",
            "IEC 61966-2-1, typical: 200 lx on reflectance 0.2, 200/π · 0.2", _sRGB_GREY),
    _preset("bright office", 80.0, "average", "sRGB", 15.0, _MORONEY_WHITE,
            "Moroney 2002: 500 lx, S_R = 2", "Moroney 2002: 15 cd/m²"),
    _preset("dim room", 80.0, "dim", "sRGB", 20.0, _MORONEY_WHITE,
            "Moroney 2002, display at home: 38 lx, S_R = 0.15, dim", "Moroney 2002: 20 cd/m²"),
    _preset("television studio", 100.0, "dim", "Rec. 709", None, "BT.2035: 100 cd/m²",
            "BT.2035: a tenth of the white's, S_R = 0.1"),
    _preset("HDR studio", 203.0, round(5.0 / 203.0, 4), "Rec. 2020", None, "BT.2408: 203 cd/m²",
            "BT.2100: 5 cd/m², S_R = 5/203"),
    _preset("cinema", 48.0, "dark", "DCI-P3", None, "SMPTE ST 431-1: 48 cd/m²", _THEATRE),
    _preset("film projector", 55.0, "dark", "", None, "SMPTE 196M: 55 cd/m², no film", _THEATRE),
    _preset("projector", 150.0, "dark", "sRGB", 30.0, "Moroney 2002, slides: 150 cd/m²",
            "Moroney 2002: 0 lx, S_R = 0", "Moroney 2002: 30 cd/m²"),
    _preset("light box", 1270.0, "dim", "", None, "ISO 3664 T1: 1270 cd/m²",
            "ISO 3664 T1: at most a tenth of the white's"),
    _preset("light booth", 2000.0 / math.pi, "average", "", None, "ISO 3664 P1: 2000 lx",
            _PRINT_LIGHT),
    _preset("print", 500.0 / math.pi, "average", "", None, "ISO 3664 P2: 500 lx", _PRINT_LIGHT),
)
# fmt: on
PRESETS: Mapping[str, RoomPreset] = MappingProxyType({preset.name: preset for preset in _PRESETS})


def preset(name: str) -> RoomPreset:
    """Return a preset by name; raise ViewingError if the name is unknown."""
    if isinstance(name, str) and name in PRESETS:
        return PRESETS[name]
    raise ViewingError(
        f"viewing preset {name!r} is unknown",
        f"{nearest(str(name), PRESETS)}known: {', '.join(PRESETS)}",
        code="unknown",
    )
