"""XYZ to an sRGB display's code values, and back.

    appearance -> [srgb] -> frame

References
----------
[1] IEC 61966-2-1:1999.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from volspec.appearance import constants as k
from volspec.appearance.curves import sRGB_CURVE

Array = NDArray[np.float64]


def linear_from_XYZ(XYZ: ArrayLike) -> Array:
    """Linear sRGB, 1 for the display's white; outside 0 to 1 where the colour is out of gamut.

    Parameters
    ----------
    XYZ : (..., 3) array_like
        Y = 100 for the display's white.

    Returns
    -------
    (..., 3) float64
    """
    return np.asarray(XYZ, dtype=np.float64) @ k.sRGB_FROM_XYZ.T


def encode(linear: ArrayLike) -> Array:
    """Clip to the gamut and apply sRGB's transfer function.

    Parameters
    ----------
    linear : (..., 3) array_like
        Linear sRGB.

    Returns
    -------
    (..., 3) float64
        Encoded values, 0 to 1.

    Examples
    --------
    >>> encode([0.0, 0.5, 2.0]).round(4).tolist()
    [0.0, 0.7354, 1.0]
    """
    return sRGB_CURVE.encode(np.clip(np.asarray(linear, dtype=np.float64), 0.0, 1.0))


def decode(encoded: ArrayLike) -> Array:
    """Linear sRGB from encoded values: `encode` undone.

    Parameters
    ----------
    encoded : (..., 3) array_like
        0 to 1.

    Returns
    -------
    (..., 3) float64
    """
    return sRGB_CURVE.decode(encoded)


def to_uint8(encoded: ArrayLike) -> NDArray[np.uint8]:
    """Round encoded values, 0 to 1, to 8-bit codes as GL does: the nearest of 255 steps."""
    return np.rint(np.clip(np.asarray(encoded), 0.0, 1.0) * 255.0).astype(np.uint8)
