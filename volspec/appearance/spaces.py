"""Display colour spaces: primaries, white and a parametric curve, as matrix/TRC profiles are.

    appearance -> [spaces] -> frame | shaders/include/display.glsl

How bright a display's white is, and how dark its black, is the `Display`'s business; a space has
1 for white and 0 for black.

References
----------
[1] IEC 61966-2-1:1999 (sRGB).
[2] Recommendations ITU-R BT.709-6, BT.1886 (2011, gamma 2.4 where black is 0) and BT.2020-2.
[3] SMPTE RP 431-2:2011 (DCI-P3: primaries, white x = 0.314, y = 0.351, gamma 2.6); Apple's
    Display P3 has these primaries with D65 and sRGB's curve.
[4] Adobe RGB (1998) Color Image Encoding, version 2005-05 (gamma 563/256).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from types import MappingProxyType
from typing import Annotated, Any

import numpy as np
from numpy.typing import ArrayLike
from pydantic import AfterValidator, Field

from volspec.appearance.curves import BT_1886, Array, Transfer, sRGB_CURVE
from volspec.errors import ViewingError, nearest, quoted
from volspec.settings import Hint, Name, Pair, settings

XY = tuple[float, float]

# A triangle of primaries with less area than this spans no colours (sRGB's has 0.112).
_LEAST_AREA = 1e-6


def _XYZ_from_xy(xy: XY) -> Array:
    return np.array([xy[0] / xy[1], 1.0, (1.0 - xy[0] - xy[1]) / xy[1]])


def _chromaticity(xy: XY) -> XY:
    if not (np.isfinite(xy).all() and xy[1] != 0.0):
        raise ViewingError("", "give finite numbers, y not 0", code="range", given=xy)
    return xy


Chromaticity = Annotated[Pair, AfterValidator(_chromaticity)]


@settings(ViewingError)
@dataclass(frozen=True, slots=True)
class ColourSpace:
    """An RGB space of a display.

    Raises
    ------
    ViewingError
        If the primaries span no colours or do not mix to the white.

    Examples
    --------
    >>> SPACES["Display P3"].XYZ_from_RGB.sum(axis=1).round(2).tolist()
    [95.05, 100.0, 108.91]
    """

    name: Name
    """Name in pictures' profiles."""
    primaries_xy: Annotated[
        tuple[Chromaticity, Chromaticity, Chromaticity],
        Field(strict=False, examples=[[[0.64, 0.33], [0.30, 0.60], [0.15, 0.06]]]),
        Hint("three pairs of numbers: x, y of red, green and blue", whole=True),
    ]
    """CIE 1931 chromaticities of red, green and blue."""
    white_xy: Annotated[Chromaticity, Field(examples=[[0.313, 0.329]])]
    """CIE 1931 chromaticity of all three together."""
    transfer: Annotated[
        Transfer, Field(examples=[2.2]), Hint("a gamma, as 2.2, or a Transfer", whole=True)
    ]
    """Its gamma, or a table of its curve."""

    @staticmethod
    def from_table(table: Mapping[str, Any], folder: Path | None) -> Mapping[str, Any]:
        """Complete a file's table; a number for the curve is a gamma."""
        gamma = table.get("transfer")
        if isinstance(gamma, int | float) and not isinstance(gamma, bool):
            try:
                table = {**table, "transfer": Transfer.gamma(gamma)}
            except ViewingError as error:
                raise error.at("transfer") from None
        return {"name": "display", **table}

    def __post_init__(self) -> None:
        red, green, blue = primaries = np.array(self.primaries_xy)
        if not self.white_xy[1] > 0.0:
            raise ViewingError.refused("white_xy", self.white_xy, "give y above 0", "range")
        if abs(np.linalg.det([green - red, blue - red])) < 2.0 * _LEAST_AREA:
            raise ViewingError(
                "they lie on a line",
                "give a triangle",
                code="range",
                field="primaries_xy",
                given=self.primaries_xy,
            )
        if not np.all(self.XYZ_from_RGB[1] * np.sign(primaries[:, 1]) > 0.0):
            raise ViewingError(
                f"{self.white_xy} lies outside of the primaries' triangle",
                "give a white inside",
                code="range",
                field="white_xy",
                given=self.white_xy,
            )

    @property
    def XYZ_from_RGB(self) -> Array:
        """(3, 3): linear RGB, 0 to 1, to XYZ with Y = 100 for white."""
        columns = np.stack([_XYZ_from_xy(xy) for xy in self.primaries_xy], axis=1)
        return 100.0 * (columns * np.linalg.solve(columns, _XYZ_from_xy(self.white_xy)))

    @property
    def RGB_from_XYZ(self) -> Array:
        """(3, 3): XYZ with Y = 100 for white to linear RGB."""
        return np.asarray(np.linalg.inv(self.XYZ_from_RGB), dtype=np.float64)

    @property
    def white_XYZ(self) -> Array:
        """(3,): Y = 100."""
        return 100.0 * _XYZ_from_xy(self.white_xy)

    def encode(self, linear: ArrayLike) -> Array:
        """Linear RGB to code values, not clipped; (...) float64."""
        return self.transfer.encode(linear)

    def decode(self, encoded: ArrayLike) -> Array:
        """Code values to linear RGB; (...) float64."""
        return self.transfer.decode(encoded)

    def shader_constants(self) -> dict[str, float | Array]:
        """What ``shaders/include/display.glsl`` and the passages read: name in GLSL -> number."""
        return {
            "RGB_FROM_XYZ": self.RGB_from_XYZ,
            "OETF_TOE": self.transfer.toe,
            "OETF_SLOPE": self.transfer.slope,
            "OETF_GAIN": self.transfer.gain,
            "OETF_POWER": self.transfer.power,
        }


_D65 = (0.3127, 0.3290)
_sRGB_XY = ((0.64, 0.33), (0.30, 0.60), (0.15, 0.06))
_P3_XY = ((0.680, 0.320), (0.265, 0.690), (0.150, 0.060))
_2020_XY = ((0.708, 0.292), (0.170, 0.797), (0.131, 0.046))
_ADOBE_XY = ((0.64, 0.33), (0.21, 0.71), (0.15, 0.06))

SPACES: Mapping[str, ColourSpace] = MappingProxyType(
    {
        space.name: space
        for space in (
            ColourSpace("sRGB", _sRGB_XY, _D65, sRGB_CURVE),
            ColourSpace("Display P3", _P3_XY, _D65, sRGB_CURVE),
            ColourSpace("DCI-P3", _P3_XY, (0.314, 0.351), Transfer.gamma(2.6)),
            ColourSpace("Rec. 709", _sRGB_XY, _D65, BT_1886),
            ColourSpace("Rec. 2020", _2020_XY, _D65, BT_1886),
            ColourSpace("Adobe RGB (1998)", _ADOBE_XY, _D65, Transfer.gamma(563 / 256)),
        )
    }
)


def is_profile(name: str) -> bool:
    """Return True for the name of an ICC profile's file."""
    return name.lower().endswith((".icc", ".icm"))


def space_of(space: str | Path | ColourSpace) -> ColourSpace:
    """A space by name, as it is, or of a display's profile, ``FILE.icc``.

    Raises
    ------
    ViewingError
        If there is none of that name, or the profile cannot be used.
    """
    if isinstance(space, ColourSpace):
        return space
    name = str(space)
    if name in SPACES:
        return SPACES[name]
    if is_profile(name):
        # Late: a profile's white is adapted by what stands downstream of this module.
        from volspec.appearance.profile import read_profile

        return read_profile(name)
    raise ViewingError(
        f"colour space {quoted(name)} is unknown; {nearest(name, SPACES)}known: "
        f"{', '.join(SPACES)}; any other as FILE.icc or as a ColourSpace",
        code="unknown",
    )
