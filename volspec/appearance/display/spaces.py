"""Display colour spaces: primaries, white and a parametric curve, the data of matrix/TRC profiles.

    appearance -> [spaces] -> frame | shaders/include/display.glsl

The luminances of a display's white and black belong to `Display`; in a space white is 1 and black
is 0.

References
----------
[1] IEC 61966-2-1:1999 (sRGB).
[2] Recommendations ITU-R BT.709-6, BT.1886 (2011, gamma 2.4 where black is 0) and BT.2020-2.
[3] SMPTE RP 431-2:2011 (DCI-P3: primaries, white x = 0.314, y = 0.351, gamma 2.6); Apple's
    Display P3 has these primaries with D65 and sRGB's curve.
[4] Adobe RGB (1998) Color Image Encoding, version 2005-05 (gamma 563/256).
[5] ICC.1:2022, 10.18 parametricCurveType.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from types import MappingProxyType
from typing import Annotated, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray
from pydantic import AfterValidator, Field

from volspec.appearance.display.constants import frozen
from volspec.errors import ViewingError
from volspec.settings import Hint, Name, Pair, Positive, settings
from volspec.spectra import SpectralGrid, colour_matching_functions

Array = NDArray[np.float64]
XY = tuple[float, float]

# Jumps up to this count as rounding of a profile's fixed-point numbers: a quarter of an 8-bit step.
_ROUNDING = 1e-3
# Smallest area of a primaries' triangle (sRGB's has 0.112).
_MIN_AREA = 1e-6


@settings(ViewingError)
@dataclass(frozen=True, slots=True)
class Transfer:
    """A curve between linear light and code values, odd about 0, with 0 and 1 fixed.

    V = slope · L                          L <= toe
    V = gain · L^power - (gain - 1)        above
    """

    power: Annotated[Positive, Field(examples=[0.4545])]
    """1/γ."""
    gain: Positive = 1.0
    """Factor of the power, at least 1; 1 without a toe."""
    slope: Positive = 1.0
    """Factor of linear light up to the toe."""
    toe: Annotated[float, Field(ge=0, lt=1)] = 0.0
    """Linear light at which the power begins; 0 without a toe."""

    def __post_init__(self) -> None:
        jump = self.slope * self.toe - self.gain * self.toe**self.power + self.gain - 1.0
        if not abs(jump) <= _ROUNDING:
            raise ViewingError(
                f"at linear {self.toe:g} the segments are {jump:.3g} apart",
                f"check slope {self.slope:g}, toe {self.toe:g}, gain {self.gain:g} and power "
                f"{self.power:g}",
                code="conflict",
            )

    @classmethod
    def gamma(cls, exponent: float) -> Transfer:
        """Make the curve L = V^γ."""
        if not (math.isfinite(exponent) and exponent > 0.0):
            raise ViewingError.refused(
                "Transfer.gamma", exponent, "expected a number above 0, such as 2.2", "range"
            )
        return cls(power=1.0 / exponent)

    @classmethod
    def icc(
        cls,
        g: float,
        a: float = 1.0,
        b: float = 0.0,
        c: float = 1.0,
        d: float = 0.0,
        e: float = 0.0,
        f: float = 0.0,
    ) -> Transfer:
        """Make an ICC profile's parametricCurveType: L = (aV + b)^g + e for V >= d, else cV + f.

        Types 0 (g), 3 (g, a, b, c, d) and 4 with e = f = 0; types 1 and 2 lift black, which is not
        supported. Raises ViewingError if g <= 0, white is not 1, black is not 0 or the segments do
        not meet.
        """
        curve = "Transfer.icc"
        for name, value in {"g": g, "a": a, "b": b, "c": c, "d": d, "e": e, "f": f}.items():
            if not math.isfinite(value):
                raise ViewingError.refused(
                    f"{curve}.{name}", value, "give a finite number", "range"
                )
        if not g > 0.0:
            raise ViewingError.refused(f"{curve}.g", g, "expected above 0, such as 2.2", "range")
        if e or f:
            raise ViewingError(
                f"the curve adds e = {e:g}, f = {f:g} to linear light",
                "expected 0, because a space's black is 0",
                code="unsupported",
                field=curve,
            )
        if not (a > 0.0 and abs(a + b - 1.0) <= _ROUNDING):
            raise ViewingError(
                f"the curve's a + b is {a + b:g} with a = {a:g}",
                "expected 1, so that white is 1",
                code="range",
                field=curve,
            )
        if not c > 0.0 and d > 0.0:
            raise ViewingError.refused(f"{curve}.c", c, "expected above 0", "range")
        slope, toe = (1.0 / c, c * d) if d > 0.0 else (1.0, 0.0)
        return cls(1.0 / g, 1.0 / a, slope, toe)

    def encode(self, linear: ArrayLike) -> Array:
        """Return code values of linear light, (...) float64; odd about 0."""
        signed = np.asarray(linear, dtype=np.float64)
        x = np.abs(signed)
        curve = self.gain * x**self.power - (self.gain - 1.0)
        return np.copysign(np.where(x <= self.toe, self.slope * x, curve), signed)

    def decode(self, encoded: ArrayLike) -> Array:
        """Return linear light of code values, (...) float64: the inverse of `encode`."""
        signed = np.asarray(encoded, dtype=np.float64)
        x = np.abs(signed)
        curve = ((x + self.gain - 1.0) / self.gain) ** (1.0 / self.power)
        return np.copysign(np.where(x <= self.slope * self.toe, x / self.slope, curve), signed)


sRGB_CURVE = Transfer(power=1.0 / 2.4, gain=1.055, slope=12.92, toe=0.0031308)
BT_1886 = Transfer.gamma(2.4)
"""A television's curve, with black at 0; its inverse is not a camera's OETF."""


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

    >>> SPACES["Display P3"].XYZ_from_RGB.sum(axis=1).round(2).tolist()
    [95.05, 100.0, 108.91]
    """

    name: Name
    """Name in the profiles of pictures."""
    primaries_xy: Annotated[
        tuple[Chromaticity, Chromaticity, Chromaticity],
        Field(strict=False, examples=[[[0.64, 0.33], [0.30, 0.60], [0.15, 0.06]]]),
        Hint("three pairs of numbers: x, y for red, green and blue", whole=True),
    ]
    """CIE 1931 chromaticities of red, green and blue."""
    white_xy: Annotated[Chromaticity, Field(examples=[[0.313, 0.329]])]
    """CIE 1931 chromaticity of all three together."""
    transfer: Annotated[
        Transfer,
        Field(examples=[2.2]),
        Hint("a gamma such as 2.2, or a table of the curve", whole=True),
    ]
    """A gamma, or a table of the curve."""

    @staticmethod
    def from_table(table: Mapping[str, Any], folder: Path | None) -> Mapping[str, Any]:
        """Complete a file's table; a curve given as a number is a gamma."""
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
        if abs(np.linalg.det([green - red, blue - red])) < 2.0 * _MIN_AREA:
            raise ViewingError(
                "the primaries lie on a line",
                "give a triangle",
                code="range",
                field="primaries_xy",
                given=self.primaries_xy,
            )
        if not np.all(self.XYZ_from_RGB[1] * np.sign(primaries[:, 1]) > 0.0):
            raise ViewingError(
                f"{self.white_xy} lies outside of the primaries' triangle",
                "give a white inside of it",
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
        """Return code values of linear RGB, not clipped; (...) float64."""
        return self.transfer.encode(linear)

    def decode(self, encoded: ArrayLike) -> Array:
        """Return linear RGB of code values; (...) float64."""
        return self.transfer.decode(encoded)

    def shader_constants(self) -> dict[str, float | Array]:
        """Return the numbers of ``shaders/include/display.glsl`` by GLSL name."""
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


# From here on XYZ have Y = 100 for the display's white; linear sRGB is 0 to 1.
XYZ_FROM_sRGB = frozen(SPACES["sRGB"].XYZ_from_RGB)
sRGB_FROM_XYZ = frozen(SPACES["sRGB"].RGB_from_XYZ)
sRGB_WHITE_XYZ = frozen(SPACES["sRGB"].white_XYZ)


def linear_sRGB_from_XYZ(XYZ: ArrayLike) -> Array:
    """Return linear sRGB, 1 for the display's white; outside of 0 to 1 if out of gamut."""
    return np.asarray(XYZ, dtype=np.float64) @ sRGB_FROM_XYZ.T


def encode_sRGB(linear: ArrayLike) -> Array:
    """Clip linear sRGB to the gamut and encode it: codes, 0 to 1."""
    return sRGB_CURVE.encode(np.clip(np.asarray(linear, dtype=np.float64), 0.0, 1.0))


def decode_sRGB(encoded: ArrayLike) -> Array:
    """Return linear sRGB of codes, 0 to 1; (..., 3) float64."""
    return sRGB_CURVE.decode(encoded)


def to_uint8(encoded: ArrayLike) -> NDArray[np.uint8]:
    """Round codes, 0 to 1, to 8 bits as GL does: the nearest of 255 steps."""
    return np.rint(np.clip(np.asarray(encoded), 0.0, 1.0) * 255.0).astype(np.uint8)


def to_uint16(encoded: ArrayLike) -> NDArray[np.uint16]:
    """Round codes 0 to 1 to 16 bits; NaN becomes black."""
    codes = np.nan_to_num(np.asarray(encoded), nan=0.0)
    return np.rint(np.clip(codes, 0.0, 1.0) * 65535.0).astype(np.uint16)


_VISIBLE = SpectralGrid(360.0, 830.0, 2.0)


def spectrum_colours(wavelengths_nm: ArrayLike) -> Array:
    """Return sRGB codes (N, 3) of monochromatic lights for axes, desaturated and dimmed to fit.

    Brightness is the eye's for equal power; black outside of 360-830 nm.

    >>> spectrum_colours([540, 620]).argmax(axis=1).tolist()
    [1, 0]
    """
    XYZ = colour_matching_functions(_VISIBLE).T
    linear = linear_sRGB_from_XYZ(100 * XYZ)
    # Add a little grey, so that no channel starts from black with a visible edge.
    linear = linear - linear.min(axis=-1, keepdims=True).clip(max=0) + 0.12 * XYZ[:, 1:2]
    nm = np.asarray(wavelengths_nm, dtype=np.float64)
    columns = [np.interp(nm, _VISIBLE.wavelengths_nm, column, 0, 0) for column in linear.T]
    return encode_sRGB(np.stack(columns, axis=-1) * (0.7 / linear.max()))
