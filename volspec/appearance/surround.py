"""What surrounds an eye: a surround's factors, and all that it is adapted to.

    [surround] -> display, spec -> passages, models

References
----------
[1] Neumann, Castro, Neumann & Sbert (2004), "Color Appearance in Multispectral Radiosity",
    table 5 and section 7.1, with the errata of CIE 159:2004 (dim: N_c = 0.9).
"""

from __future__ import annotations

import math
import numbers
from dataclasses import dataclass, replace
from types import MappingProxyType
from typing import Any, NamedTuple

import numpy as np

from volspec.errors import ViewingError, nearest, quoted

Triple = tuple[float, float, float]

# What a background may have, beside the white: a window behind a sheet of paper.
MOST_BACKGROUND = 20.0
# Of whites: Y is 100, or thereabouts, and not 1; the others may be next to nothing.
_WHITE_Y, _WHITE_XYZ = (2.0, 1e5), (1e-30, 1e8)


class Surround(NamedTuple):
    """CIECAM02's three factors of a surround; unitless."""

    F: float
    """Largest degree of adaptation."""
    c: float
    """Impact of the surround on lightness."""
    N_c: float
    """Chromatic induction."""


SURROUNDS = MappingProxyType(
    {
        "average": Surround(F=1.0, c=0.69, N_c=1.0),
        "dim": Surround(F=0.9, c=0.59, N_c=0.9),
        "dark": Surround(F=0.8, c=0.525, N_c=0.8),
    }
)


# Luminance of a surround's white over that of the picture's white (CIE 159: dim is below 0.2).
SURROUND_RATIOS = MappingProxyType({"dark": 0.0, "dim": 0.1, "average": 0.2})


def surround_at(surround: str | float) -> Surround:
    """A surround by name or by its ratio, linear between dark, dim and average.

    Parameters
    ----------
    surround : str or float
        One of `SURROUNDS`, or S_R = L_surround / L_white, 0 to 1: dark at 0, dim at 0.1,
        average from 0.2 on [1, section 7.1; CIE 159].

    Raises
    ------
    ViewingError
        If the name is unknown or the ratio outside 0…1.

    Examples
    --------
    >>> surround_at(0.15)
    Surround(F=0.95, c=0.64, N_c=0.95)
    """
    if isinstance(surround, str):
        if surround not in SURROUNDS:
            raise ViewingError(
                f"surround is {surround!r}; {nearest(surround, SURROUNDS)}known: "
                f"{', '.join(SURROUNDS)}, or a ratio to white from 0 (dark) to 1"
            )
        return SURROUNDS[surround]
    if not (is_finite(surround) and 0.0 <= surround <= 1.0):
        raise ViewingError(
            f"surround is {surround!r}; expected 0 (dark) to 1, or one of {', '.join(SURROUNDS)}"
        )
    names = sorted(SURROUNDS, key=SURROUND_RATIOS.__getitem__)
    ratios = [SURROUND_RATIOS[name] for name in names]
    factors = np.array([SURROUNDS[name] for name in names])
    return Surround(*(round(float(np.interp(surround, ratios, f)), 12) for f in factors.T))


def require_known(name: str, value: object, known: tuple[str, ...]) -> None:
    """Refuse a name that is none of those known."""
    if value in known:
        return
    raise ViewingError(
        f"{name} is {value!r}; {nearest(str(value), known)}known: {', '.join(known)}"
    )


def is_finite(value: object) -> bool:
    """Whether it is a real number, and finite."""
    real = isinstance(value, numbers.Real) and not isinstance(value, bool)
    return real and math.isfinite(value)  # type: ignore[arg-type]


def as_triple(value: object) -> Triple | None:
    """Three finite numbers as floats; None where they are anything else, text among it."""
    try:
        x, y, z = tuple(value)  # type: ignore[arg-type, var-annotated]
    except (TypeError, ValueError):
        return None
    if not (is_finite(x) and is_finite(y) and is_finite(z)):
        return None
    return float(x), float(y), float(z)


def require_conditions(name: str, value: object) -> None:
    """Refuse what are no `ViewingConditions`."""
    if not isinstance(value, ViewingConditions):
        raise ViewingError(
            f"{name} is {quoted(value)}; expected viewing conditions, as "
            "ViewingConditions((95.05, 100, 108.88))"
        )


def require_adaptation(name: str, D: object, discount: object) -> None:
    """A degree of adaptation and whether the light is discounted."""
    if D is not None and not (is_finite(D) and 0.0 <= D <= 1.0):  # type: ignore[operator]
        raise ViewingError(
            f"{name}.D is {D!r}; expected 0 (no adaptation) to 1 (complete), or None for the "
            "model's own"
        )
    if not isinstance(discount, bool):
        raise ViewingError(f"{name}.discount is {discount!r}; expected True or False")
    if discount and D is not None:
        raise ViewingError(f"{name}.D is {D!r} and discount True, which is D = 1; give one of them")


def require_not_negative(name: str, value: float, remedy: str) -> None:
    """Refuse what is no finite number of 0 or above."""
    if not (is_finite(value) and value >= 0.0):
        raise ViewingError(f"{name} is {value!r}; expected a finite number, 0 or above ({remedy})")


def require_positive(name: str, value: float, remedy: str) -> None:
    """Refuse what is no finite number above 0."""
    if not (is_finite(value) and value > 0.0):
        raise ViewingError(f"{name} is {value!r}; expected a finite number above 0 ({remedy})")


def require_background(name: str, Y_b: float, white: float = 100.0) -> None:
    """Refuse a luminance factor that is below 0 or far above the white's."""
    most = MOST_BACKGROUND * white
    if not (is_finite(Y_b) and 0.0 <= Y_b <= most):
        raise ViewingError(
            f"{name} is {Y_b!r}; expected 0 to {most:g}, where white is {white:g} (grey is "
            f"{0.2 * white:g})"
        )


def require_lux(name: str, value: float) -> None:
    """Refuse an illuminance that is not above 0."""
    require_positive(name, value, "an office has 500; for an eye in the dark give L_A = 0")


@dataclass(frozen=True, slots=True)
class ViewingConditions:
    """What an eye is adapted to: all that an adaptation or an appearance model asks.

    Parameters
    ----------
    white_XYZ : (X, Y, Z)
        The adopted white; Y = 100 for a perfect diffuser.
    L_A : float
        Luminance of the adapting field, cd/m². At 0 models take the limit from above.
    Y_b : float
        Luminance factor of the background, on the white's scale: to 20 times the white. 0 as L_A.
    surround : str or float
        As `surround_at`.
    D : float, optional
        Degree of adaptation, 0 to 1; None is the model's own.
    discount : bool
        The eye takes the light's colour off whole, as it does with things it knows to be lit: D is
        1, and is not given beside.

    Raises
    ------
    ViewingError
        If the white has a channel that is not above 0 or is on another scale, as 0 to 1, or a
        number is out of range.

    Examples
    --------
    >>> round(ViewingConditions.of_lux((95.05, 100, 108.88), 1000).L_A, 2)
    63.66
    """

    white_XYZ: Triple
    L_A: float = 64.0 / math.pi * 0.2
    Y_b: float = 20.0
    surround: str | float = "average"
    D: float | None = None
    discount: bool = False

    def __post_init__(self) -> None:
        white = as_triple(self.white_XYZ)
        if white is None or min(white) <= 0.0:
            raise ViewingError(
                f"ViewingConditions.white_XYZ is {quoted(self.white_XYZ)}; expected three finite "
                "numbers above 0, as (95.05, 100, 108.88)"
            )
        if not (
            _WHITE_Y[0] <= white[1] <= _WHITE_Y[1]
            and _WHITE_XYZ[0] <= min(white)
            and max(white) <= _WHITE_XYZ[1]
        ):
            raise ViewingError(
                f"ViewingConditions.white_XYZ is {quoted(self.white_XYZ)}; expected Y = 100 for "
                "white, as (95.05, 100, 108.88); scale white and colours to that"
            )
        object.__setattr__(self, "white_XYZ", white)
        require_not_negative("ViewingConditions.L_A", self.L_A, "cd/m²")
        require_background("ViewingConditions.Y_b", self.Y_b, white[1])
        surround_at(self.surround)
        require_adaptation("ViewingConditions", self.D, self.discount)

    @classmethod
    def of_lux(cls, white_XYZ: Triple, illuminance_lux: float, **others: Any) -> ViewingConditions:
        """Conditions under a light of E_v lux: L_A = E_v/π · Y_b/Y_w.

        Parameters
        ----------
        white_XYZ : (X, Y, Z)
        illuminance_lux : float
            Above 0.
        **others
            As the constructor's, but L_A.
        """
        require_lux("illuminance_lux", illuminance_lux)
        dark = cls(white_XYZ, 0.0, **others)
        return replace(dark, L_A=illuminance_lux / math.pi * dark.Y_b / dark.white_XYZ[1])

    @property
    def factors(self) -> Surround:
        """F, c and N_c of the surround."""
        return surround_at(self.surround)
