"""What white paper and materials look like under lights: to the display, and to an adapted eye.

lights, RelightSpec -> [colours] -> swatches
"""

from __future__ import annotations

from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from volspec.appearance import passage_of
from volspec.appearance.passages import Passage
from volspec.appearance.srgb import encode, linear_from_XYZ
from volspec.errors import VolspecError
from volspec.relight import LightRig, RelightSpec
from volspec.spectra import white_XYZ
from volspec.viewer.model.lights.viewing import given_viewing

Colour = tuple[float, float, float]
Array = NDArray[np.float64]
# Of white paper, which reflects less than a perfect diffuser.
_PAPER = 0.96


def white_of(rig: LightRig) -> Array:
    """(3,) XYZ of a perfect diffuser under a light."""
    return white_XYZ(rig.mixed(rig.lights[0].grid))


def as_colour(codes: Array) -> Colour:
    """(3,) codes as plain numbers."""
    r, g, b = codes.tolist()
    return r, g, b


@lru_cache(maxsize=512)
def raw_colour(rig: LightRig) -> Colour:
    """A light on white paper beside the display's white; sRGB codes 0 to 1, the most 1."""
    linear = np.maximum(linear_from_XYZ(white_of(rig)), 0.0)
    return as_colour(encode(linear / max(float(linear.max()), 1e-9)))


# Rows are few; a temperature that is dragged makes many.
@lru_cache(maxsize=256)
def adapted_colour(rig: LightRig, seen: RelightSpec) -> Colour:
    """The same to an eye adapted to the light; as it is where there is nothing to adapt to."""
    white = white_of(rig)
    passage = adapted_to(rig, seen, white)
    if passage is None:
        return raw_colour(rig)
    return as_colour(encode(linear_from_XYZ(passage.apply(_PAPER * white))))


def adapted_to(rig: LightRig, seen: RelightSpec, white: Array) -> Passage | None:
    """What makes of XYZ under a light those that look alike on the display.

    Parameters
    ----------
    rig : LightRig
    seen : RelightSpec
    white : (3,) float64
        XYZ of a perfect diffuser under it.

    Returns
    -------
    Passage or None
        None where the light has no white to adapt to.
    """
    try:
        return passage_of(given_viewing(seen.viewing, rig.total_lux), white)
    except VolspecError:
        return None
