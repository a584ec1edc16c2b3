"""What every appearance model gives, and the two functions that each is made of.

A model is a module: its ``NAME``, ``forward`` and ``inverse``. Learn one, know all.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray

from volspec.appearance.spec import ViewingConditions

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True, eq=False)
class Appearance:
    """What a colour looks like: correlates, each (...) float64; None where a model has none."""

    J: Array
    """Lightness, 0 to 100 for surfaces."""
    C: Array
    """Chroma."""
    h: Array
    """Hue angle, degrees within [0, 360)."""
    H: Array | None = None
    """Hue quadrature, 0 to 400: red 0, yellow 100, green 200, blue 300."""
    Q: Array | None = None
    """Brightness."""
    M: Array | None = None
    """Colourfulness."""
    s: Array | None = None
    """Saturation."""
    defined: NDArray[np.bool_] | None = None
    """False where the colour lies outside of what the model was made for; None: nowhere."""


class Model(Protocol):
    """An appearance model."""

    NAME: str

    def forward(self, XYZ: ArrayLike, conditions: ViewingConditions) -> Appearance:
        """(..., 3) XYZ on the white's scale to what they look like."""

    def inverse(
        self, J: ArrayLike, C: ArrayLike, h: ArrayLike, conditions: ViewingConditions
    ) -> Array:
        """Lightness, chroma and hue, each (...), to the (..., 3) XYZ that look so.

        NaN where no XYZ does.
        """
