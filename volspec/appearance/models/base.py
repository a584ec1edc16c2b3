"""The contract of an appearance model, and the parts that several models share.

A model has a ``NAME``, ``forward``, ``inverse`` and ``invert_beyond``; most models are modules.

References
----------
[1] *Color Appearance Models* (survey 002), eq. 11, 18-23 and 73-81.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray

from volspec.appearance.display import constants as k
from volspec.appearance.surround import SURROUND_RATIOS, ViewingConditions
from volspec.errors import ShapeError, ViewingError

Array = NDArray[np.float64]

ROUNDING = 1e-12
"""Responses down to this far below 0 (relative to the white) are rounding error and count as 0."""
# Round-trip tolerance for J and the two parts of C, relative to the largest of them. At the edge of
# a model's domain, the last digit of XYZ changes them this much; elsewhere 1e-9 is reached.
_ROUND_TRIP = 1e-6


@dataclass(frozen=True, slots=True, eq=False)
class Appearance:
    """Correlates of colours, each (...) float64; None if a model has no such correlate."""

    J: Array
    """Lightness, 0 to 100 for surfaces."""
    C: Array
    """Chroma."""
    h: Array
    """Hue angle, degrees within [0, 360)."""
    defined: NDArray[np.bool_]
    """True if the model is defined for the colour; only then ``inverse(forward(x)) == x``."""
    H: Array | None = None
    """Hue quadrature, 0 to 400: red 0, yellow 100, green 200, blue 300."""
    Q: Array | None = None
    """Brightness."""
    M: Array | None = None
    """Colourfulness."""
    M_RG: Array | None = None
    """Redness, below 0 greenness: a component of the chromatic response [1] (eq. 43, 122)."""
    M_YB: Array | None = None
    """Yellowness, below 0 blueness (eq. 42, 123)."""
    s: Array | None = None
    """Saturation."""
    Q_WB: Array | None = None
    """Whiteness-blackness: above 0 if brighter than the background, below 0 if darker."""
    L_N: Array | None = None
    """Normalised lightness: brightness relative to the white's, 100 for the white."""
    J_HK: Array | None = None
    """Lightness with the Helmholtz-Kohlrausch effect: saturated colours look lighter."""


class Model(Protocol):
    """An appearance model."""

    @property
    def NAME(self) -> str:
        """The name in `Viewing.model`."""

    def forward(self, XYZ: ArrayLike, conditions: ViewingConditions) -> Appearance:
        """Return the appearance of (..., 3) XYZ on the white's scale."""

    def inverse(
        self, J: ArrayLike, C: ArrayLike, h: ArrayLike, conditions: ViewingConditions
    ) -> Array:
        """Return the (..., 3) XYZ of a lightness, chroma and hue, each (...).

        NaN if no `defined` XYZ has this appearance.
        """

    def invert_beyond(
        self, J: ArrayLike, C: ArrayLike, h: ArrayLike, conditions: ViewingConditions
    ) -> Array:
        """Return `inverse`, extended smoothly beyond its domain for pictures; NaN past that."""


def broadcast(name: str, J: ArrayLike, C: ArrayLike, h: ArrayLike) -> tuple[Array, Array, Array]:
    """Return J, C and h as float64, broadcast to one shape; raise ShapeError if they cannot be."""
    values = [np.asarray(value, dtype=np.float64) for value in (J, C, h)]
    try:
        J, C, h = np.broadcast_arrays(*values)
    except ValueError as error:
        shapes = ", ".join(str(value.shape) for value in values)
        raise ShapeError(f"J, C, h have shapes {shapes}", "make them equal", field=name) from (
            error
        )
    return J, C, h


def opponents(name: str, J: ArrayLike, C: ArrayLike, h: ArrayLike) -> Array:
    """Return J, C cos h and C sin h, (..., 3), without hue's seam; negative chroma counts as 0."""
    J, C, h = broadcast(name, J, C, h)
    C, angle = np.maximum(C, 0.0), np.radians(h)
    return np.stack([J, C * np.cos(angle), C * np.sin(angle)], axis=-1)


def only_defined(
    XYZ: Array, J: ArrayLike, C: ArrayLike, h: ArrayLike, forward: Callable[[Array], Appearance]
) -> Array:
    """Return an inverse's XYZ, or NaN unless ``forward`` is `defined` and returns J, C and h."""
    with np.errstate(all="ignore"):
        target, look = opponents("inverse", J, C, h), forward(XYZ)
        off = np.abs(opponents("inverse", look.J, look.C, look.h) - target).max(axis=-1)
        returns = off <= _ROUND_TRIP * np.maximum(np.abs(target).max(axis=-1), 1.0)
    return np.where((look.defined & returns)[..., None], XYZ, np.nan)


def cones_of_white(name: str, conditions: ViewingConditions) -> Array:
    """Return the (3,) Hunt-Pointer-Estévez responses of the adopted white (eq. 11)."""
    return require_real_white(name, conditions, k.HPE_FROM_XYZ @ np.asarray(conditions.white_XYZ))


def require_real_white(name: str, conditions: ViewingConditions, cones: Array) -> Array:
    """Return a white's cone responses; raise ViewingError unless all are above 0."""
    if not np.all(cones > 0.0):
        raise ViewingError(
            f"the white XYZ = {conditions.white_XYZ} has the cone responses "
            f"{cones.round(4).tolist()}",
            "expected all above 0. Is it the white of a real light?",
            code="range",
            field=f"{name}.white_XYZ",
            given=conditions.white_XYZ,
        )
    return np.asarray(cones, dtype=np.float64)


def degree_of_discounting(conditions: ViewingConditions) -> float:
    """Return D of eq. 73-75: the fraction of the light's colour that is discounted, 0 to 1."""
    if conditions.discount:
        return 1.0
    return 0.0 if conditions.D is None else conditions.D


def cone_adaptation(white_cones: Array, luminance: float, D: float) -> Array:
    """Return (3,) degrees of cone adaptation to a white (eq. 18-23, 73-81); all 1 at D = 1.

    ``luminance`` is the adapting field's, cd/m².
    """
    fraction = 3.0 * white_cones / white_cones.sum()
    level = 1.0 + np.cbrt(luminance)
    p = (level + fraction) / (level + 1.0 / fraction)
    return np.asarray(p + D * (1.0 - p), dtype=np.float64)


def interpolate_surround(surround: str | float, dark: float, dim: float, average: float) -> float:
    """Interpolate a number given for three surrounds, linearly in the surround's ratio."""
    ratio = SURROUND_RATIOS[surround] if isinstance(surround, str) else float(surround)
    ratios = [SURROUND_RATIOS[name] for name in ("dark", "dim", "average")]
    return float(np.interp(ratio, ratios, (dark, dim, average)))
