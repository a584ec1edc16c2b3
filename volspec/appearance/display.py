"""A display and the room it stands in: what the picture is made for.

    spaces, surround -> [display] -> Viewing -> passages, screen

References
----------
[1] IEC 61966-2-1:1999 (sRGB: white of 80 cd/m², 64 lx ambient light, background of
    reflectance 0.2).
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path

from volspec.appearance.spaces import ColourSpace, space_of
from volspec.appearance.surround import (
    ViewingConditions,
    require_background,
    require_known,
    require_not_negative,
    require_positive,
    surround_at,
)
from volspec.errors import ViewingError

GAMUTS = ("clip", "reduce")


@dataclass(frozen=True, slots=True)
class Display:
    """A display and the room it stands in.

    Parameters
    ----------
    L_A : float, optional
        Luminance of the adapting field, cd/m². The default is that of sRGB's room: a diffuser of
        reflectance 0.2 under 64 lx. None is ``Y_b`` percent of ``white_cd_m2``, as where the
        display alone gives light.
    Y_b : float
        Luminance factor of the background, percent of the display's white.
    surround : str or float
        As `surround_at`.
    space : str, path or ColourSpace
        Primaries, white and curve: a name of `volspec.appearance.spaces.SPACES`, such as
        ``"Display P3"``, a display's profile, ``FILE.icc``, or any other. White and primaries are
        where the picture's colours go, and the white is what the eye before it adapts to.
    gamut : {"clip", "reduce"}
        What becomes of colours that it cannot show: each channel cut to 0…1, or chroma lowered at
        constant lightness and hue (`volspec.appearance.gamut`).
    mark : bool
        Hatch the pixels whose colours it cannot show.
    white_cd_m2 : float
        Luminance of its white, cd/m²; sRGB's is 80. It enters where ``L_A`` is None, and nowhere
        else: appearance models take luminances relative to the white's.

    Raises
    ------
    ViewingError
        If a number is out of range or a name unknown.

    Examples
    --------
    >>> round(Display(space="DCI-P3", surround="dark", white_cd_m2=48, L_A=None).conditions.L_A, 2)
    9.6
    """

    L_A: float | None = 64.0 / math.pi * 0.2
    Y_b: float = 20.0
    surround: str | float = "average"
    space: str | Path | ColourSpace = "sRGB"
    gamut: str = "clip"
    mark: bool = False
    white_cd_m2: float = 80.0

    def __post_init__(self) -> None:
        if self.L_A is not None:
            require_not_negative("Display.L_A", self.L_A, "cd/m²; sRGB's is 4.07")
        require_background("Display.Y_b", self.Y_b)
        surround_at(self.surround)
        if not isinstance(self.space, str | Path | ColourSpace):
            raise ViewingError(
                f"Display.space is {self.space!r:.60}; expected a name, as 'sRGB', "
                "a profile, FILE.icc, or a ColourSpace"
            )
        found = space_of(self.space)
        if self.space != found.name:  # a profile is read once, now
            object.__setattr__(self, "space", found)
        require_known("Display.gamut", self.gamut, GAMUTS)
        if not isinstance(self.mark, bool):
            raise ViewingError(f"Display.mark is {self.mark!r}; expected True or False")
        require_positive("Display.white_cd_m2", self.white_cd_m2, "cd/m²; sRGB's is 80")

    @property
    def adapting_luminance(self) -> float:
        """L_A, cd/m²: ``L_A``, or that of a background lit by the display alone."""
        return self.white_cd_m2 * self.Y_b / 100.0 if self.L_A is None else self.L_A

    @property
    def colours(self) -> ColourSpace:
        """``space``, looked up."""
        return space_of(self.space)

    @property
    def conditions(self) -> ViewingConditions:
        """What the eye before it is adapted to; Y = 100 for its white."""
        X, Y, Z = self.colours.white_XYZ.tolist()
        return ViewingConditions((X, Y, Z), self.adapting_luminance, self.Y_b, self.surround)
