"""The temperature that a light's colour is named by: correlated, with the distance from Planck's.

    datasets, lights -> [temperature] -> volspec light

References
----------
[1] Ohno (2013), "Practical Use and Calculation of CCT and Duv", LEUKOS 10(1), 47-55: a table of
    the locus, and a parabola through the distances from it.
[2] CIE 15:2004, section 9.5: no correlated temperature further than 0.05 from the locus.
"""

from __future__ import annotations

from functools import cache
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from volspec.spectra.datasets import observers
from volspec.spectra.lights import C2_NM_K

# Where the table goes to, K, and how far from Planck's locus a temperature has a meaning.
_KELVIN, _FURTHEST = (1_000.0, 100_000.0), 0.05
# From row to row.
_RATIO = 1.002


class Temperature(NamedTuple):
    """Of the nearest Planck radiator in CIE 1960 u, v."""

    kelvin: float
    Duv: float
    """Distance from it: above 0 greener, below 0 pinker."""


def correlated_temperature(white_XYZ: ArrayLike) -> Temperature | None:
    """Correlated colour temperature and Duv of a light.

    Parameters
    ----------
    white_XYZ : (3,) array_like
        On any scale.

    Returns
    -------
    Temperature or None
        None where the light is too far from Planck's locus to have one, or colder than 1000 K or
        hotter than 100 000 K.

    Examples
    --------
    >>> kelvin, Duv = correlated_temperature([95.047, 100, 108.883])
    >>> round(kelvin), round(Duv, 4)
    (6503, 0.0032)
    """
    u, v = _uv(np.asarray(white_XYZ, dtype=np.float64))
    kelvin, locus = _planckian()
    squares = ((locus - [u, v]) ** 2).sum(axis=1)
    nearest = int(squares.argmin())
    if not 0 < nearest < len(kelvin) - 1:
        return None
    # The vertex of the parabola through three squares: unlike distances, they have no kink where
    # the light is on the locus.
    before, here, after = squares[nearest - 1 : nearest + 2]
    rows = 0.5 * (before - after) / (before - 2.0 * here + after)
    found = float(kelvin[nearest] * _RATIO**rows)
    u_0, v_0 = _uv(_planck_XYZ(np.array([found])))[0]
    Duv = float(np.copysign(np.hypot(u - u_0, v - v_0), v - v_0))
    if not (_KELVIN[0] <= found <= _KELVIN[1] and abs(Duv) <= _FURTHEST):
        return None
    return Temperature(found, Duv)


@cache
def _planckian() -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Temperatures (K,) and their u, v (K, 2), a row further than `_KELVIN` at both ends."""
    low, high = np.log(_KELVIN) / np.log(_RATIO)
    kelvin = _RATIO ** np.arange(low - 1.0, high + 2.0)
    return kelvin, _uv(_planck_XYZ(kelvin))


def _planck_XYZ(kelvin: NDArray[np.float64]) -> NDArray[np.float64]:
    """(K, 3), on no scale."""
    nm, xyz = observers()["CIE 1931 2 Degree Standard Observer"]
    power = (560.0 / nm) ** 5 / np.expm1(C2_NM_K / (nm * kelvin[:, None]))
    return power @ xyz


def _uv(XYZ: NDArray[np.float64]) -> NDArray[np.float64]:
    """(..., 2) CIE 1960 u, v."""
    X, Y, Z = np.moveaxis(XYZ, -1, 0)
    return np.stack([4.0 * X, 6.0 * Y], axis=-1) / (X + 15.0 * Y + 3.0 * Z)[..., None]
