"""``[viewing]`` and ``[viewing.display]``, as scenes and palettes both have them.

base, appearance -> [viewing] -> Viewing
"""

from __future__ import annotations

from dataclasses import asdict, replace
from pathlib import Path
from typing import Annotated, Any, Self

from pydantic import Discriminator, Field, Tag

from volspec._tables.base import Box, Name, Pair, Table, value_or_table
from volspec.appearance import Display, Viewing
from volspec.appearance.presets import preset
from volspec.appearance.profile import read_profile
from volspec.appearance.spaces import SPACES, ColourSpace, Transfer

_VIEW = Viewing()


class CurveTable(Table):
    """``transfer`` of a space: see `volspec.appearance.spaces.Transfer`."""

    power: Annotated[float, Field(examples=[0.4545])]
    """1 / gamma."""
    gain: float = 1.0
    """Factor of the power; 1 without a toe."""
    slope: float = 1.0
    """Factor of linear light up to the toe."""
    toe: float = 0.0
    """Where the power begins, in linear light."""


class SpaceTable(Table):
    """``space`` of a display in numbers: see `volspec.appearance.spaces.ColourSpace`."""

    name: Name = "display"
    """What pictures' profiles call it."""
    primaries_xy: Annotated[Box, Field(examples=[[[0.64, 0.33], [0.30, 0.60], [0.15, 0.06]]])]
    """CIE 1931 chromaticities of red, green and blue."""
    white_xy: Annotated[Pair, Field(examples=[[0.313, 0.329]])]
    """CIE 1931 chromaticity of all three together."""
    transfer: Annotated[
        Annotated[float, Tag("<value>")] | Annotated[CurveTable, Tag("<table>")],
        Discriminator(value_or_table),
        Field(examples=[2.2]),
    ]
    """Its gamma, or a table of its curve."""

    @classmethod
    def of(cls, space: ColourSpace) -> SpaceTable:
        """The table of a space."""
        curve = CurveTable(**asdict(space.transfer))
        return cls(
            name=space.name,
            primaries_xy=space.primaries_xy,
            white_xy=space.white_xy,
            transfer=curve,
        )

    def colours(self) -> ColourSpace:
        """The space.

        Raises
        ------
        ViewingError
            If there is none of these numbers.
        """
        given = self.transfer
        if isinstance(given, CurveTable):
            curve = Transfer(**given.model_dump())
        else:
            curve = Transfer.gamma(given)
        return ColourSpace(self.name, self.primaries_xy, self.white_xy, curve)


class DisplayTable(Table):
    """``[viewing.display]``: see `volspec.Display`; what is left out is the preset's."""

    preset: str = "sRGB"
    """A room and a display's luminance by name, for what is left out below."""
    space: Annotated[
        Annotated[str, Tag("<value>")] | Annotated[SpaceTable, Tag("<table>")],
        Discriminator(value_or_table),
    ] = "sRGB"
    """A colour space by name, a display's profile (FILE.icc), or its numbers as a table."""
    gamut: str = "clip"
    """What becomes of colours it cannot show: clip, or reduce their chroma."""
    mark: bool = False
    """Hatch what it cannot show."""
    white_cd_m2: float | None = None
    """Luminance of its white, cd/m²."""
    L_A: float | None = None
    """Adapting luminance before it, cd/m²."""
    Y_b: float | None = None
    """The background's luminance, the display's white 100."""
    surround: str | float | None = None
    """average, dim, dark, or a ratio."""

    @classmethod
    def of(cls, display: Display) -> DisplayTable:
        """The table of a display, whatever it was made from."""
        space = display.colours
        named = SPACES.get(space.name) == space
        return cls(
            space=space.name if named else SpaceTable.of(space),
            gamut=display.gamut,
            mark=display.mark,
            white_cd_m2=display.white_cd_m2,
            L_A=display.L_A,
            Y_b=display.Y_b,
            surround=display.surround,
        )

    @property
    def profile(self) -> str | None:
        """The profile's file that ``space`` names; None where it is a name or numbers."""
        named = isinstance(self.space, str) and self.space.lower().endswith((".icc", ".icm"))
        return str(self.space) if named else None

    def display(self) -> Display:
        """The display that is meant.

        Where the white's luminance is given and ``L_A`` is not, that is ``Y_b`` percent of it.

        Raises
        ------
        ViewingError
            If a name is unknown or a number out of range.
        """
        space = self.space if isinstance(self.space, str) else self.space.colours()
        seen = preset(self.preset).display(space, self.gamut)  # type: ignore[arg-type]
        given = self.model_dump(exclude={"preset", "space", "gamut"}, exclude_none=True)
        if self.white_cd_m2 is not None and self.L_A is None:
            given["L_A"] = None
        return replace(seen, **given)


class ViewedTable(Table):
    """``[viewing]``: see `volspec.Viewing`; what belongs to pictures alone is the scene's."""

    model: str = _VIEW.model
    """An appearance model, a chromatic adaptation, or none."""
    illuminance_lux: float = _VIEW.illuminance_lux
    """Where the lights carry none."""
    L_A: float | None = _VIEW.L_A
    """Adapting luminance, cd/m²; left out, from the lux."""
    Y_b: float = _VIEW.Y_b
    """The background's luminance, white 100."""
    surround: str | float = _VIEW.surround
    """average, dim, dark, or a ratio."""
    D: float | None = _VIEW.D
    """Degree of adaptation, 0 to 1; left out, from the model."""
    discount: bool = _VIEW.discount
    """The eye takes the light's colour off whole."""
    display: DisplayTable = Field(default_factory=DisplayTable)
    """What the picture is made for."""

    def beside(self, folder: Path) -> Self:
        """The same, with what a display's profile in a folder says in place of its name.

        So an image's note needs no file.

        Raises
        ------
        ViewingError
            If the profile cannot be used.
        """
        profile = self.display.profile
        if profile is None:
            return self
        space = SpaceTable.of(read_profile(folder / profile))
        display = self.display.model_copy(update={"space": space})
        return self.model_copy(update={"display": display})

    def viewed(self, settings: dict[str, Any]) -> Viewing:
        """The viewing of this display under settings, which a subclass says.

        Raises
        ------
        ViewingError
            If one is out of range.
        """
        return Viewing(**settings, display=self.display.display())
