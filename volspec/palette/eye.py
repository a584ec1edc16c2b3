"""What an eye sees of a palette's colours, and how that changes with them: straight pieces.

    appearance -> [eye] -> criteria, report

Everything here is linear RGB of the display, 1 for its white: there wanted colours are given, and
there an optimum of squares is looked for.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import ArrayLike, NDArray

from volspec.appearance.live import passage_of
from volspec.appearance.models.cielab import XYZ_from_cielab, cielab, cielab_chord
from volspec.appearance.passages import ClosedPassage, LinearPassage
from volspec.appearance.spaces import ColourSpace
from volspec.appearance.spec import Viewing
from volspec.errors import PaletteError

Array = NDArray[np.float64]

# Half the step of a difference quotient, in units of Y = 100 for white.
_STEP = 0.01


@dataclass(frozen=True, slots=True, eq=False)
class Eye:
    """An eye under one light, in front of its display.

    Parameters
    ----------
    passage : ClosedPassage
        Scene XYZ to the display's.
    exposure : float
        `Viewing.exposure`.
    space : ColourSpace
        The display's.
    """

    passage: ClosedPassage
    exposure: float
    space: ColourSpace

    @classmethod
    def of(cls, viewing: Viewing, white_XYZ: ArrayLike) -> Eye:
        """The eye of a viewing, adapted to a light's white.

        Raises
        ------
        PaletteError
            If the viewing's model has no inverse in closed form.
        """
        passage = passage_of(viewing, white_XYZ)
        if not isinstance(passage, ClosedPassage):
            raise PaletteError(
                f"palette: viewing model {viewing.model!r} has no inverse in closed form to design "
                "with; use CIECAM02, CAM16, CIELAB, RLAB, an adaptation as CAT02, or none",
                code="state",
            )
        return cls(passage, viewing.exposure, viewing.display.colours)

    def linear(self, XYZ: ArrayLike) -> Array:
        """(..., 3) scene XYZ, Y = 100 for a perfect diffuser, to linear RGB of the display."""
        scene = self.exposure * np.asarray(XYZ, dtype=np.float64)
        return self.passage.apply(scene) @ _RGB_from_XYZ(self.space).T

    def XYZ(self, linear: ArrayLike) -> Array:
        """`linear` undone."""
        display = np.asarray(linear) @ _XYZ_from_RGB(self.space).T
        undone: Array = self.passage.undo(display)
        return undone / self.exposure

    def slopes(self, XYZ: ArrayLike) -> Array:
        """(..., 3, 3): change of linear RGB with scene XYZ."""
        scene = np.asarray(XYZ, dtype=np.float64)
        if isinstance(self.passage, LinearPassage):
            slope = self.exposure * _RGB_from_XYZ(self.space) @ self.passage.matrix
            return np.broadcast_to(slope, (*scene.shape, 3))
        around = scene[..., None, None, :] + _STEP * np.stack([np.eye(3), -np.eye(3)])
        seen = self.linear(around)
        return np.swapaxes((seen[..., 0, :, :] - seen[..., 1, :, :]) / (2.0 * _STEP), -1, -2)

    def Lab(self, linear: ArrayLike) -> Array:
        """(..., 3) linear RGB to CIELAB before the display's white."""
        XYZ = np.asarray(linear) @ _XYZ_from_RGB(self.space).T
        return cielab(XYZ, self.space.white_XYZ)

    def linear_from_Lab(self, Lab: ArrayLike) -> Array:
        """`Lab` undone."""
        return XYZ_from_cielab(Lab, self.space.white_XYZ) @ _RGB_from_XYZ(self.space).T

    def Lab_slopes(self, one: ArrayLike, other: ArrayLike) -> Array:
        """(..., 3, 3) W of the chord: Lab(one) - Lab(other) = W (one - other), of linear RGB."""
        ratio_from_RGB = _XYZ_from_RGB(self.space) / self.space.white_XYZ[:, None]
        one, other = np.asarray(one) @ ratio_from_RGB.T, np.asarray(other) @ ratio_from_RGB.T
        return cielab_chord(one, other) @ ratio_from_RGB


@lru_cache(maxsize=16)
def _XYZ_from_RGB(space: ColourSpace) -> Array:
    return space.XYZ_from_RGB


@lru_cache(maxsize=16)
def _RGB_from_XYZ(space: ColourSpace) -> Array:
    return space.RGB_from_XYZ
