"""Display XYZ to the codes of its pixels: what it cannot show mapped or marked, then encoded.

    passage -> [screen] -> frame | shaders/include/gamut.glsl, display.glsl

Every form of passage ends here, so all models share one mapping. Its lightness and hue are
CIECAM02's, or CAM16's where that is the model, under the display's conditions.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import lru_cache
from types import MappingProxyType

import numpy as np
from numpy.typing import ArrayLike, NDArray

from volspec.appearance.display import Display
from volspec.appearance.gamut import (
    DisplayGamut,
    opponents,
    reduce_chroma_opponent,
)
from volspec.appearance.models.conditions import Conditions
from volspec.appearance.passages import triples
from volspec.appearance.spaces import ColourSpace
from volspec.appearance.spec import Viewing

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

# So far outside of 0 to 1 linear RGB counts as inside, and is clipped: under D65
# Nayatani and Guth miss the white by up to 2.3e-4, and software GL's powers are 5e-5 off.
SLACK = 2.5e-4
# Pixels from one band to the next, and of a band, along rows and columns.
HATCH_PERIOD, HATCH_WIDTH = 8, 3
# Magenta: no grey, and as far from saturated green as from skin.
HATCH_CODE = (0.85, 0.10, 0.60)

SHADER_CONSTANTS: Mapping[str, ArrayLike] = MappingProxyType(
    {
        "GAMUT_SLACK": SLACK,
        "HATCH_PERIOD": HATCH_PERIOD,
        "HATCH_WIDTH": HATCH_WIDTH,
        "HATCH_CODE": HATCH_CODE,
    }
)


@dataclass(frozen=True, slots=True, eq=False)
class Screen:
    """What becomes of a colour at a display.

    Parameters
    ----------
    space : ColourSpace
    RGB_from_XYZ : (3, 3)
        The space's.
    gamut : DisplayGamut, optional
        How colours are paled; None clips.
    mark : bool
        Whether pixels whose colours cannot be shown are hatched.
    """

    space: ColourSpace
    RGB_from_XYZ: Array
    gamut: DisplayGamut | None
    mark: bool

    @classmethod
    def of(cls, display: Display, model: str = "CIECAM02") -> Screen:
        """The screen of a display, in front of an eye that a model describes.

        Raises
        ------
        ViewingError
            If chroma shall be reduced and the display shows no colour without any, as
            `DisplayGamut.of`.
        """
        space = display.colours
        gamut = None
        if display.gamut == "reduce":
            cam = "CAM16" if model == "CAM16" else "CIECAM02"
            gamut = DisplayGamut.of(Conditions.of_viewing(display.conditions, cam), space)
        return cls(space, space.RGB_from_XYZ, gamut, display.mark)

    def linear(self, XYZ: ArrayLike) -> tuple[Array, Mask]:
        """Linear RGB, paled where that is asked for, and which colours cannot be shown.

        Parameters
        ----------
        XYZ : (..., 3) array_like
            Y = 100 for the display's white.

        Returns
        -------
        linear : (..., 3) float64
            Not clipped.
        outside : (...) bool
        """
        given = triples("screen: XYZ", XYZ)
        linear = given @ self.RGB_from_XYZ.T
        outside = np.any((linear < -SLACK) | (linear > 1.0 + SLACK), axis=-1)
        if self.gamut is not None and outside.any():
            x, a, b = opponents(given[outside], self.gamut.conditions).T
            linear[outside], _ = reduce_chroma_opponent(x, a, b, self.gamut, slack=SLACK)
        return linear, np.asarray(outside)

    def codes(self, XYZ: ArrayLike, first_row: int = 0) -> Array:
        """Code values of rows of a picture.

        Parameters
        ----------
        XYZ : (H, W, 3) array_like
            Y = 100 for the display's white.
        first_row : int
            Where in the picture the first of these rows stands; the hatch goes by it.

        Returns
        -------
        (H, W, 3) float64
            0 to 1.
        """
        linear, outside = self.linear(XYZ)
        codes = self.space.encode(np.clip(linear, 0.0, 1.0))
        return marked(codes, outside, first_row) if self.mark else codes


def marked(codes: Array, outside: ArrayLike, first_row: int = 0) -> Array:
    """Hatch pixels: diagonal bands over the pixel's own grey.

    Parameters
    ----------
    codes : (H, W, 3) float64
    outside : (H, W) bool
        Those to be hatched. All change, but greys between the bands.
    first_row : int
        As `Screen.codes`.
    """
    height, width = codes.shape[:2]
    diagonal = (np.arange(height) + first_row)[:, None] + np.arange(width)
    band = diagonal % HATCH_PERIOD < HATCH_WIDTH
    grey = codes.mean(axis=-1, keepdims=True)
    hatch = np.where(band[..., None], HATCH_CODE, grey)
    return np.where(np.asarray(outside)[..., None], hatch, codes)


@lru_cache(maxsize=16)
def _screen(display: Display, model: str) -> Screen:
    return Screen.of(display, model)


def screen_of(viewing: Viewing) -> Screen:
    """The screen that a viewing asks for; the last few are kept, as frames follow each other.

    Raises
    ------
    ViewingError
        As `Screen.of`.
    """
    return _screen(viewing.display, "CAM16" if viewing.model == "CAM16" else "CIECAM02")
