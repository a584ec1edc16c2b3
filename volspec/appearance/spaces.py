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

import numpy as np
from numpy.typing import ArrayLike

from volspec.appearance.curves import BT_1886, Array, Transfer, sRGB_CURVE
from volspec.errors import ViewingError, nearest, quoted

XY = tuple[float, float]

# A triangle of primaries with less area than this spans no colours (sRGB's has 0.112).
_LEAST_AREA = 1e-6


def _XYZ_from_xy(xy: XY) -> Array:
    return np.array([xy[0] / xy[1], 1.0, (1.0 - xy[0] - xy[1]) / xy[1]])


@dataclass(frozen=True, slots=True)
class ColourSpace:
    """An RGB space of a display.

    Parameters
    ----------
    name : str
    primaries_xy : (3, 2)
        CIE 1931 chromaticities of red, green and blue.
    white_xy : (2,)
        Of R = G = B = 1.
    transfer : Transfer

    Raises
    ------
    ViewingError
        If the primaries span no colours or do not mix to the white.

    Examples
    --------
    >>> SPACES["Display P3"].XYZ_from_RGB.sum(axis=1).round(2).tolist()
    [95.05, 100.0, 108.91]
    """

    name: str
    primaries_xy: tuple[XY, XY, XY]
    white_xy: XY
    transfer: Transfer

    def __post_init__(self) -> None:
        try:
            primaries = np.asarray(self.primaries_xy, dtype=np.float64)
            white = np.asarray(self.white_xy, dtype=np.float64)
        except (TypeError, ValueError):
            raise ViewingError(
                f"space {self.name!r}: primaries are {quoted(self.primaries_xy)}, the white "
                f"{quoted(self.white_xy)}; expected numbers, (3, 2) and (2,)"
            ) from None
        if not isinstance(self.transfer, Transfer):
            raise ViewingError.refused(
                f"space {self.name!r}: transfer",
                self.transfer,
                "expected a Transfer, as Transfer.gamma(2.2)",
                "type",
            )
        if primaries.shape != (3, 2) or white.shape != (2,):
            raise ViewingError(
                f"space {self.name!r}: primaries have shape {primaries.shape}, the white "
                f"{white.shape}; expected (3, 2) and (2,)"
            )
        every = np.vstack([primaries, white])
        if not np.all(np.isfinite(every)) or np.any(every[:, 1] == 0.0) or not white[1] > 0.0:
            raise ViewingError(
                f"space {self.name!r}: chromaticities {every.tolist()}; expected finite numbers, "
                "y not 0 and the white's above 0"
            )
        red, green, blue = primaries
        if abs(np.linalg.det([green - red, blue - red])) < 2.0 * _LEAST_AREA:
            raise ViewingError(
                f"space {self.name!r}: the primaries {primaries.tolist()} lie on a line; expected "
                "a triangle"
            )
        as_pairs = tuple((float(x), float(y)) for x, y in primaries)
        object.__setattr__(self, "primaries_xy", as_pairs)
        object.__setattr__(self, "white_xy", (float(white[0]), float(white[1])))
        if not np.all(self.XYZ_from_RGB[1] * np.sign(primaries[:, 1]) > 0.0):
            raise ViewingError(
                f"space {self.name!r}: the white {white.tolist()} lies outside of the primaries' "
                "triangle; expected inside"
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
    if name.lower().endswith((".icc", ".icm")):
        # Late: a profile's white is adapted by what stands downstream of this module.
        from volspec.appearance.profile import read_profile

        return read_profile(name)
    raise ViewingError(
        f"colour space {quoted(name)} is unknown; {nearest(name, SPACES)}known: "
        f"{', '.join(SPACES)}; any other as FILE.icc or as a ColourSpace",
        code="unknown",
    )
