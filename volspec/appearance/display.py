"""The display and its room.

    spaces, profile, surround -> [display] -> Viewing -> scene_to_display, screen

References
----------
[1] IEC 61966-2-1:1999 (sRGB: white of 80 cd/m², 64 lx ambient light, background of
    reflectance 0.2).
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, ClassVar, Literal, get_args

from pydantic import BeforeValidator, Discriminator, Field, Tag

from volspec.appearance.profile import is_profile, read_profile
from volspec.appearance.spaces import SPACES, ColourSpace
from volspec.appearance.surround import Background, Luminance, SurroundOrRatio, ViewingConditions
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
    """Primaries, white and curve: a space by name, a display's profile FILE.icc, or its numbers.
    The picture is converted to this space, and the eye adapts to its white."""
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
        from volspec.appearance.presets import preset

        given = dict(table)
        try:
            room = preset(given.pop("preset", "sRGB")).display()
        except ViewingError as error:
            raise error.at("preset") from None
        if "white_cd_m2" in given and "L_A" not in given:
            given["L_A"] = None
        space = given.get("space")
        if isinstance(space, str) and is_profile(space):
            given["space"] = (folder or Path()) / space
        return {key: getattr(room, key) for key in ROOM} | given

    def to_table(self) -> dict[str, Any]:
        """Return the table for a file, with a preset's name or the numbers."""
        from volspec.appearance.presets import PRESETS

        table = table_of(self)
        if isinstance(self.space, ColourSpace):
            table["space"] = plain(self.space)
        table = {key: value for key, value in table.items() if key not in ROOM}
        rooms = {name: each.display() for name, each in PRESETS.items()}
        own = [getattr(self, key) for key in ROOM]
        for name, room in rooms.items():
            if own == [getattr(room, key) for key in ROOM]:
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
