"""Viewing conditions: a surround's factors, and everything to which an eye is adapted.

    [surround] -> display, spec -> transforms, models

References
----------
[1] Neumann, Castro, Neumann & Sbert (2004), "Color Appearance in Multispectral Radiosity",
    table 5 and section 7.1, with the errata of CIE 159:2004 (dim: N_c = 0.9).
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from types import MappingProxyType
from typing import Annotated, Any, Literal, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray
from pydantic import AfterValidator, ConfigDict, Field, TypeAdapter, ValidationError

from volspec.errors import ViewingError, nearest
from volspec.settings import (
    Fraction,
    Hint,
    NotNegative,
    Positive,
    Unit,
    Vector,
    settings,
    words_for,
)

Array = NDArray[np.float64]
Triple = tuple[float, float, float]

# A background's upper limit, relative to the white: a window behind a sheet of paper.
MAX_BACKGROUND = 20.0
# Limits of a white: Y is about 100, not 1; X and Z may be close to 0.
_WHITE_Y, _WHITE_XYZ = (2.0, 1e5), (1e-30, 1e8)
# From starlight to the sun's glare.
_WHITE_CD_M2 = (1e-2, 1e6)


class Surround(NamedTuple):
    """CIECAM02's three factors of a surround; unitless."""

    F: float  # largest degree of adaptation
    c: float  # impact of the surround on lightness
    N_c: float  # chromatic induction


SURROUNDS = MappingProxyType(
    {
        "average": Surround(F=1.0, c=0.69, N_c=1.0),
        "dim": Surround(F=0.9, c=0.59, N_c=0.9),
        "dark": Surround(F=0.8, c=0.525, N_c=0.8),
    }
)


# Luminance of a surround's white over that of the picture's white (CIE 159: dim is below 0.2).
SURROUND_RATIOS = MappingProxyType({"dark": 0.0, "dim": 0.1, "average": 0.2})


SurroundName = Literal["average", "dim", "dark"]
SurroundOrRatio = Annotated[
    SurroundName | Fraction, Hint("ratio to white: dark 0, dim 0.1, average 0.2")
]
Background = Annotated[float, Field(ge=0, le=100 * MAX_BACKGROUND), Hint("white is 100, grey 20")]
Luminance = Annotated[NotNegative, Unit("cd/m²")]
Illuminance = Annotated[
    Positive, Unit("lux"), Hint("an office has 500; for an eye in the dark set L_A = 0")
]
_SURROUND: TypeAdapter[Any] = TypeAdapter(SurroundOrRatio, config=ConfigDict(strict=True))


def surround_at(surround: SurroundOrRatio) -> Surround:
    """Return a surround by name or by ratio, interpolated between dark, dim and average.

    Parameters
    ----------
    surround : str or float
        One of `SURROUNDS`, or S_R = L_surround / L_white, 0 to 1: dark at 0, dim at 0.1,
        average from 0.2 up [1, section 7.1; CIE 159].

    Raises
    ------
    ViewingError
        If the name is unknown or the ratio outside 0…1.

    Examples
    --------
    >>> surround_at(0.15)
    Surround(F=0.95, c=0.64, N_c=0.95)
    """
    if isinstance(surround, str) and surround in SURROUNDS:
        return SURROUNDS[surround]
    try:
        ratio = _SURROUND.validate_python(surround)
    except ValidationError:
        guess = nearest(surround, SURROUNDS) if isinstance(surround, str) else ""
        raise ViewingError.refused(
            "surround", surround, f"{guess}give {words_for(SurroundOrRatio)}", "unknown"
        ) from None
    F, c, N_c = (round(float(factor), 12) for factor in surrounds_at(ratio))
    return Surround(F, c, N_c)


def surrounds_at(ratios: ArrayLike) -> tuple[Array, Array, Array]:
    """Return the factors F, c and N_c of surrounds by their ratios, each of the ratios' shape."""
    names = sorted(SURROUNDS, key=SURROUND_RATIOS.__getitem__)
    nodes = [SURROUND_RATIOS[name] for name in names]
    x = np.asarray(ratios, dtype=np.float64)
    factors = np.array([SURROUNDS[name] for name in names])
    F, c, N_c = (np.asarray(np.interp(x, nodes, factor)) for factor in factors.T)
    return F, c, N_c


def refuse_two_degrees(D: float | None, discount: bool) -> None:
    """Refuse a degree of adaptation given together with ``discount``."""
    if discount and D is not None:
        raise ViewingError(
            f"{D!r} contradicts discount, which means D = 1",
            "give only one of them",
            code="conflict",
            field="D",
            given=D,
        )


def _white(white_XYZ: Vector) -> Vector:
    X, Y, Z = white_XYZ
    low, high = _WHITE_XYZ
    if min(white_XYZ) <= 0.0:
        remedy = "give three finite numbers above 0, such as (95.05, 100, 108.88)"
    elif not (_WHITE_Y[0] <= Y <= _WHITE_Y[1] and low <= min(X, Z) and max(X, Z) <= high):
        remedy = "scale white and colours to Y = 100 for white, as in (95.05, 100, 108.88)"
    else:
        return white_XYZ
    raise ViewingError("", remedy, code="range", given=white_XYZ)


White = Annotated[Vector, AfterValidator(_white)]


@settings(ViewingError)
@dataclass(frozen=True, slots=True)
class ViewingConditions:
    """Everything to which an eye is adapted, as an adaptation or an appearance model needs it.

    Raises
    ------
    ViewingError
        If the white has a channel that is not above 0 or is on another scale, such as 0 to 1, or
        a number is out of range.

    Examples
    --------
    >>> round(ViewingConditions.of_lux((95.05, 100, 108.88), 1000).L_A, 2)
    63.66
    """

    white_XYZ: White
    """The adopted white; Y = 100 for a perfect diffuser."""
    L_A: Luminance = 64.0 / math.pi * 0.2
    """Luminance of the adapting field. At 0, models use the limit from above."""
    Y_b: NotNegative = 20.0
    """Luminance factor of the background, on the white's scale: up to 20 times the white."""
    surround: SurroundOrRatio = "average"
    """Name or ratio, see `surround_at`."""
    D: Fraction | None = None
    """Degree of adaptation; if left out, the model's own."""
    discount: bool = False
    """The eye discounts the light's colour, as it does for objects that it knows to be lit: D is 1
    and must be left out."""
    white_cd_m2: Annotated[Positive, Unit("cd/m²")] | None = None
    """Luminance of the white, for ZCAM; if left out, that of which the background's is L_A."""

    def __post_init__(self) -> None:
        white = self.white_XYZ[1]
        if self.Y_b > MAX_BACKGROUND * white:
            remedy = f"give 0 to {MAX_BACKGROUND * white:g}, on a scale where white is {white:g}"
            raise ViewingError.refused("Y_b", self.Y_b, remedy, "range")
        refuse_two_degrees(self.D, self.discount)

    @classmethod
    def of_lux(cls, white_XYZ: Triple, illuminance_lux: float, **fields: Any) -> ViewingConditions:
        """Make the conditions under a light of E_v lux: L_A = E_v/π · Y_b/Y_w."""
        if not (math.isfinite(illuminance_lux) and illuminance_lux > 0.0):
            remedy = f"give {words_for(Illuminance)}"
            raise ViewingError.refused("illuminance_lux", illuminance_lux, remedy, "range")
        dark = cls(white_XYZ, 0.0, **fields, white_cd_m2=illuminance_lux / math.pi)
        return replace(dark, L_A=illuminance_lux / math.pi * dark.Y_b / dark.white_XYZ[1])

    @property
    def white_luminance(self) -> float:
        """Luminance of the white, cd/m², within 0.01 to 1e6."""
        luminance = self.white_cd_m2
        if luminance is None:
            luminance = self.L_A * self.white_XYZ[1] / max(self.Y_b, 1e-4 * self.white_XYZ[1])
        return min(max(luminance, _WHITE_CD_M2[0]), _WHITE_CD_M2[1])

    @property
    def factors(self) -> Surround:
        """F, c and N_c of the surround."""
        return surround_at(self.surround)
