"""Colour differences by name: CIEDE2000, and the distance in CAM16-UCS.

    XYZ, white -> [difference] -> error maps, palette reports

CAM16-UCS is a space for differences of any size and for palettes: equal distances look equally
large. CIEDE2000 was fitted to small differences of surfaces.

References
----------
[1] Li et al. (2017), "Comprehensive color solutions: CAM16, CAT16, and CAM16-UCS", Color Research &
    Application 42(6), 703-718. doi:10.1002/col.22131
[2] Luo, Cui & Li (2006), "Uniform colour spaces based on CIECAM02 colour appearance model", Color
    Research & Application 31(4), 320-330: the coefficients.
"""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType
from typing import Literal, get_args

import numpy as np
from numpy.typing import ArrayLike, NDArray

from volspec.appearance.models.cam import CamConditions, cam16
from volspec.appearance.models.lab import cielab, delta_E_2000
from volspec.appearance.surround import ViewingConditions
from volspec.appearance.transforms import triples
from volspec.errors import ViewingError, nearest

Array = NDArray[np.float64]

Difference = Literal["CIEDE2000", "CAM16-UCS"]
DIFFERENCES: tuple[Difference, ...] = get_args(Difference)
SYMBOLS: Mapping[str, str] = MappingProxyType({"CIEDE2000": "ΔE00", "CAM16-UCS": "ΔE′"})
"""A difference's symbol by its name."""
# c1 of J', c2 of M'.
_LIGHTNESS, _COLOURFULNESS = 0.007, 0.0228


def cam16_ucs(XYZ: ArrayLike, conditions: ViewingConditions) -> Array:
    """Return (..., 3) J', a', b' of XYZ [1].

    >>> daylight = ViewingConditions((95.05, 100, 108.88))
    >>> cam16_ucs([[95.05, 100, 108.88], [0, 0, 0]], daylight).round(1).tolist()
    [[100.0, -1.9, -1.1], [0.0, 0.0, 0.0]]
    """
    look = cam16.forward(XYZ, conditions)
    assert look.M is not None
    J = (1.0 + 100.0 * _LIGHTNESS) * look.J / (1.0 + _LIGHTNESS * look.J)
    M, h = np.log1p(_COLOURFULNESS * look.M) / _COLOURFULNESS, np.radians(look.h)
    return np.stack([J, M * np.cos(h), M * np.sin(h)], axis=-1)


def XYZ_from_cam16_ucs(Jab: ArrayLike, conditions: ViewingConditions) -> Array:
    """Return (..., 3) XYZ of J', a', b': the inverse of `cam16_ucs`; NaN if there is none."""
    J, a, b = np.moveaxis(triples("CAM16-UCS", Jab), -1, 0)
    J = J / (1.0 + 100.0 * _LIGHTNESS - _LIGHTNESS * J)
    M = np.expm1(_COLOURFULNESS * np.hypot(a, b)) / _COLOURFULNESS
    F_L = CamConditions.of_viewing(conditions, "CAM16").F_L
    return cam16.inverse(J, M / F_L**0.25, np.degrees(np.arctan2(b, a)) % 360.0, conditions)


def delta_E_CAM16(one: ArrayLike, other: ArrayLike) -> Array:
    """Return (...) distances between (..., 3) J', a', b'."""
    difference = triples("CAM16-UCS", one) - triples("CAM16-UCS", other)
    return np.asarray(np.linalg.norm(difference, axis=-1))


def uniform(name: str, XYZ: ArrayLike, white_XYZ: ArrayLike) -> Array:
    """Return the (..., 3) coordinates in which a difference is measured: CIELAB, or J', a', b'.

    CAM16-UCS is used in an sRGB room, 4.07 cd/m², with the white's colour discounted, since CIELAB
    does that too.
    """
    _require(name)
    if name == "CIEDE2000":
        return cielab(XYZ, white_XYZ)
    X, Y, Z = np.asarray(white_XYZ, dtype=np.float64).tolist()
    return cam16_ucs(XYZ, ViewingConditions((X, Y, Z), discount=True))


def distance(name: str, one: ArrayLike, other: ArrayLike) -> Array:
    """Return (...) differences of (..., 3) colours in the coordinates of `uniform`."""
    _require(name)
    return delta_E_2000(one, other) if name == "CIEDE2000" else delta_E_CAM16(one, other)


def _require(name: str) -> None:
    if name not in DIFFERENCES:
        remedy = f"{nearest(str(name), DIFFERENCES)}known: {', '.join(DIFFERENCES)}"
        raise ViewingError.refused("difference", name, remedy, "unknown")
