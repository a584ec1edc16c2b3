"""The temperature that a light's colour is named by: correlated, with the distance from Planck's.

    photometry -> [temperature] -> volspec light

References
----------
[1] Ohno (2013), "Practical Use and Calculation of CCT and Duv", LEUKOS 10(1), 47-55.
[2] CIE 15:2004, section 9.5: no correlated temperature further than 0.05 from the locus.
"""

from __future__ import annotations

import warnings
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from volspec.spectra._colour import colour_science

# Where the tables of [1] go to, K, and how far from Planck's locus a temperature has a meaning.
_KELVIN, _FURTHEST = (1_000.0, 100_000.0), 0.05


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
    X, Y, Z = np.asarray(white_XYZ, dtype=np.float64)
    total = X + 15.0 * Y + 3.0 * Z
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # beyond its tables, as is refused below
        found = colour_science().temperature.uv_to_CCT_Ohno2013([4 * X / total, 6 * Y / total])
    kelvin, Duv = (float(value) for value in found)
    if not (_KELVIN[0] <= kelvin <= _KELVIN[1] and abs(Duv) <= _FURTHEST):
        return None
    return Temperature(kelvin, Duv)
