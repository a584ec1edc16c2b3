"""What every appearance model gives, and the three functions that each is made of.

A model is a module: its ``NAME``, ``forward``, ``inverse`` and ``continued``. Learn one, know all.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray

from volspec.appearance.spec import ViewingConditions
from volspec.errors import ShapeError, quoted

Array = NDArray[np.float64]

ROUNDING = 1e-12
"""So far below 0, the white being 1, a response still counts as 0: the last digits of sums."""
# So near, in J and the two parts of C and beside the greater of them, a look comes back. Next to
# where a model ends the last digit of XYZ is this much; all else comes back within 1e-9.
_BACK = 1e-6


@dataclass(frozen=True, slots=True, eq=False)
class Appearance:
    """What a colour looks like: correlates, each (...) float64; None where a model has none."""

    J: Array
    """Lightness, 0 to 100 for surfaces."""
    C: Array
    """Chroma."""
    h: Array
    """Hue angle, degrees within [0, 360)."""
    defined: NDArray[np.bool_]
    """True where the model says something: there, and nowhere else, the inverse comes back."""
    H: Array | None = None
    """Hue quadrature, 0 to 400: red 0, yellow 100, green 200, blue 300."""
    Q: Array | None = None
    """Brightness."""
    M: Array | None = None
    """Colourfulness."""
    s: Array | None = None
    """Saturation."""
    Q_WB: Array | None = None
    """Whiteness-blackness: above 0 what is brighter than the background, below 0 what is darker."""
    L_N: Array | None = None
    """Normalised lightness: brightness relative to the white's, 100 for the white."""


class Model(Protocol):
    """An appearance model."""

    NAME: str

    def forward(self, XYZ: ArrayLike, conditions: ViewingConditions) -> Appearance:
        """(..., 3) XYZ on the white's scale to what they look like."""

    def inverse(
        self, J: ArrayLike, C: ArrayLike, h: ArrayLike, conditions: ViewingConditions
    ) -> Array:
        """Lightness, chroma and hue, each (...), to the (..., 3) XYZ that look so.

        NaN where no XYZ that is `defined` does.
        """

    def continued(
        self, J: ArrayLike, C: ArrayLike, h: ArrayLike, conditions: ViewingConditions
    ) -> Array:
        """`inverse`, smoothly on beyond what is `defined`, as pictures need; NaN at its end."""


def broadcast(name: str, J: ArrayLike, C: ArrayLike, h: ArrayLike) -> tuple[Array, Array, Array]:
    """J, C and h as float64 of one shape.

    Raises
    ------
    ShapeError
        If they are no numbers, or do not broadcast together.
    """
    try:
        values = [np.asarray(each, dtype=np.float64) for each in (J, C, h)]
    except (TypeError, ValueError):
        given = ", ".join(quoted(each) for each in (J, C, h))
        raise ShapeError(f"{name}: J, C, h are {given}; expected numbers") from None
    try:
        J, C, h = np.broadcast_arrays(*values)
    except ValueError as error:
        shapes = ", ".join(str(each.shape) for each in values)
        raise ShapeError(f"{name}: J, C, h have shapes {shapes}; expected equal ones") from error
    return J, C, h


def opponents(name: str, J: ArrayLike, C: ArrayLike, h: ArrayLike) -> Array:
    """J, C cos h and C sin h of broadcast J, C and h, (..., 3); chroma below 0 counts as 0.

    Raises
    ------
    ShapeError
        If they do not broadcast together.
    """
    J, C, h = broadcast(name, J, C, h)
    C, angle = np.maximum(C, 0.0), np.radians(h)
    return np.stack([J, C * np.cos(angle), C * np.sin(angle)], axis=-1)


def only_defined(
    XYZ: Array, J: ArrayLike, C: ArrayLike, h: ArrayLike, forward: Callable[[Array], Appearance]
) -> Array:
    """The domain of an inverse, which is that of its forward.

    Parameters
    ----------
    XYZ : (..., 3) float64
        What shall look so.
    J, C, h : (...) array_like
        What was asked for; chroma below 0 counts as 0.
    forward : callable
        The model's, of XYZ alone.

    Returns
    -------
    (..., 3) float64
        XYZ where forward is `defined` and gives the look again, NaN elsewhere.
    """
    with np.errstate(all="ignore"):
        asked, seen = opponents("inverse", J, C, h), forward(XYZ)
        off = np.abs(opponents("inverse", seen.J, seen.C, seen.h) - asked).max(axis=-1)
        back = off <= _BACK * np.maximum(np.abs(asked).max(axis=-1), 1.0)
    return np.where((seen.defined & back)[..., None], XYZ, np.nan)
