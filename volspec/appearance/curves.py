"""Parametric curves between linear light and code values, as displays and ICC profiles have them.

    [curves] -> spaces -> encode

References
----------
[1] IEC 61966-2-1:1999 (sRGB).
[2] Recommendations ITU-R BT.1886 (2011) and BT.2020-2, table 4.
[3] ICC.1:2022, 10.18 parametricCurveType.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

import numpy as np
from numpy.typing import ArrayLike, NDArray
from pydantic import Field

from volspec.appearance import constants as k
from volspec.appearance.surround import is_finite
from volspec.errors import ShapeError, ViewingError, quoted
from volspec.settings import Positive, settings

Array = NDArray[np.float64]

# Jumps up to this are rounding in a profile's fixed-point numbers: a quarter of an 8-bit step.
_ROUNDING = 1e-3


@settings(ViewingError)
@dataclass(frozen=True, slots=True)
class Transfer:
    """A curve between linear light and code values, odd about 0, with 0 and 1 fixed.

        V = slope · L                          L <= toe
        V = gain · L^power - (gain - 1)        above

    Raises
    ------
    ViewingError
        If a number is out of range or the pieces do not meet.
    """

    power: Annotated[Positive, Field(examples=[0.4545])]
    """1/γ."""
    gain: Positive = 1.0
    """Factor of the power, 1 and more; 1 without a toe."""
    slope: Positive = 1.0
    """Factor of linear light up to the toe."""
    toe: Annotated[float, Field(ge=0, lt=1)] = 0.0
    """Linear light at which the power begins; 0 without a toe."""

    def __post_init__(self) -> None:
        jump = self.slope * self.toe - self.gain * self.toe**self.power + self.gain - 1.0
        if not abs(jump) <= _ROUNDING:
            raise ViewingError(
                f"at linear {self.toe:g} the pieces are {jump:.3g} apart",
                f"check slope {self.slope:g}, toe {self.toe:g}, gain {self.gain:g} and power "
                f"{self.power:g}",
                code="conflict",
            )

    @classmethod
    def gamma(cls, exponent: float) -> Transfer:
        """L = V^γ.

        Raises
        ------
        ViewingError
            If γ is not above 0.
        """
        if not (is_finite(exponent) and exponent > 0.0):
            raise ViewingError.refused(
                "Transfer: gamma", exponent, "expected a number above 0, as 2.2", "type"
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
        """An ICC profile's parametricCurveType: L = (aV + b)^g + e for V >= d, cV + f below.

        Types 0 (g), 3 (g, a, b, c, d) and 4 with e = f = 0; types 1 and 2 lift black, which no
        space does here.

        Raises
        ------
        ViewingError
            If g <= 0, white is not 1, black is not 0 or the pieces do not meet.

        Examples
        --------
        >>> round(float(Transfer.icc(2.4, 1 / 1.055, 0.055 / 1.055, 1 / 12.92, 0.04045).gain), 6)
        1.055
        """
        for name, value in {"g": g, "a": a, "b": b, "c": c, "d": d, "e": e, "f": f}.items():
            if not is_finite(value):
                raise ViewingError.refused(
                    f"Transfer: the ICC curve's {name}", value, "expected a finite number", "type"
                )
        if not g > 0.0:
            raise ViewingError.refused(
                "Transfer: the ICC curve's g", g, "expected above 0, as 2.2", "range"
            )
        if e or f:
            raise ViewingError(
                f"Transfer: the ICC curve adds e = {e:g}, f = {f:g} to linear light; expected 0, "
                "as a space's black is 0"
            )
        if not (a > 0.0 and abs(a + b - 1.0) <= _ROUNDING):
            raise ViewingError(
                f"Transfer: the ICC curve's a + b is {a + b:g} with a = {a:g}; expected 1, so that "
                "white is 1"
            )
        if not c > 0.0 and d > 0.0:
            raise ViewingError.refused(
                "Transfer: the ICC curve's c", c, "expected above 0", "range"
            )
        straight = d > 0.0
        slope, toe = (1.0 / c, c * d) if straight else (1.0, 0.0)
        return cls(1.0 / g, 1.0 / a, slope, toe)

    def encode(self, linear: ArrayLike) -> Array:
        """Code values of linear light, (...) float64; negative light gives negative codes.

        Raises
        ------
        ShapeError
            If they are no numbers.
        """
        signed = _numbers("linear light", linear)
        x = np.abs(signed)
        curve = self.gain * x**self.power - (self.gain - 1.0)
        return np.copysign(np.where(x <= self.toe, self.slope * x, curve), signed)

    def decode(self, encoded: ArrayLike) -> Array:
        """`encode` undone, (...) float64.

        Raises
        ------
        ShapeError
            If they are no numbers.
        """
        signed = _numbers("code values", encoded)
        x = np.abs(signed)
        curve = ((x + self.gain - 1.0) / self.gain) ** (1.0 / self.power)
        return np.copysign(np.where(x <= self.slope * self.toe, x / self.slope, curve), signed)


def _numbers(what: str, values: ArrayLike) -> Array:
    try:
        return np.asarray(values, dtype=np.float64)
    except (TypeError, ValueError):
        raise ShapeError(
            f"Transfer: {what} are {quoted(values)}; expected a number or an array of numbers"
        ) from None


sRGB_CURVE = Transfer(k.OETF_POWER, k.OETF_GAIN, k.OETF_SLOPE, k.OETF_TOE)
BT_1886 = Transfer.gamma(2.4)
"""What a television displays, where its black is 0; its inverse is no camera's OETF."""
REC_2020_OETF = Transfer(0.45, 1.09929682680944, 4.5, 0.018053968510807)
"""What a camera encodes (BT.709 and BT.2020), for files that hold scene light."""
