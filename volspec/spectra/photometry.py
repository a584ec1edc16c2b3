"""Tristimulus values, lux, candela and correlated colour temperature of spectra.

    grid, datasets, spectrum -> [photometry] -> lights, basis, appearance, relight

XYZ = kappa Q (E * S), with kappa such that a perfect diffuser has Y = 100; the absolute scale is
683 lm/W. Lux and candela are defined for the 2 degree observer.

References
----------
[1] Ohno (2013), "Practical Use and Calculation of CCT and Duv", LEUKOS 10(1), 47-55: a table of
    the Planckian locus, and a parabola through the distances from it.
[2] CIE 15:2004, section 9.5: no correlated temperature farther than 0.05 from the locus.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import cache
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from volspec.spectra.datasets import Observer, colour_matching_functions, observers
from volspec.spectra.grid import SpectralGrid
from volspec.spectra.spectrum import Spectrum, light_leaving, light_power

LUMINOUS_EFFICACY = 683.0
"""lm/W at 555 nm."""

INVISIBLE = 0.01
"""Luminous efficacy, by that of flat light, below which a light is set by its power."""


def XYZ_from_spectra(
    light: Spectrum,
    reflectances: Spectrum | Sequence[Spectrum] | ArrayLike,
    observer_deg: Observer = 2,
) -> NDArray[np.float64]:
    """Return the colour (..., 3) of reflectances under a light; Y = 100 for a perfect diffuser.

    What fluorescent ones emit is included.

    Parameters
    ----------
    light : Spectrum
        On an equidistant grid of N bands.
    reflectances : Spectrum, list of Spectrum, or (..., N) array
        Spectra are resampled to the light's grid; arrays must be on that grid.
    observer_deg : Observer
        See `colour_matching_functions`.

    Raises
    ------
    SpectrumError
        If shapes differ, the light is not equidistant, or not a valid light (`light_power`).
    """
    grid = light.grid
    E = light_power(light, grid)
    Q = colour_matching_functions(grid, observer_deg)
    return light_leaving(reflectances, E, grid) @ (Q.T * (100.0 / (Q[1] @ E)))


def white_XYZ(light: Spectrum, observer_deg: Observer = 2) -> NDArray[np.float64]:
    """Return the (3,) XYZ of the perfect diffuser, Y = 100: the light's adopted white."""
    return XYZ_from_spectra(light, np.ones(light.values.size), observer_deg)


def illuminance_lux(spectrum: Spectrum) -> float:
    """Return E_v = 683 sum E V dlambda, lux, of a spectral irradiance in W / (m^2 nm)."""
    grid = spectrum.grid
    V = colour_matching_functions(grid)[1]
    return float(LUMINOUS_EFFICACY * grid.step_nm * (V @ spectrum.values))


def luminous_mean(
    power: NDArray[np.float64], grid: SpectralGrid, observer_deg: Observer = 2
) -> float:
    """Return the V-weighted mean of a light's (N,) power, 1 for flat light of ones."""
    V = colour_matching_functions(grid, observer_deg)[1]
    return float(V @ power / V.sum())


def light_level(
    power: NDArray[np.float64], grid: SpectralGrid, observer_deg: Observer = 2
) -> float:
    """Return `luminous_mean`; of a nearly invisible light, such as ultraviolet, its mean power."""
    luminous, mean = luminous_mean(power, grid, observer_deg), float(power.mean())
    return luminous if luminous >= INVISIBLE * mean else mean


def luminance(spectrum: Spectrum) -> float:
    """Return L = E_v / pi, cd/m^2, of a perfect diffuser under a spectral irradiance."""
    return illuminance_lux(spectrum) / np.pi


C2_NM_K = 1.438776877e7
"""Second radiation constant h c / k (CODATA 2018)."""

# Ends of the table, K, and the largest distance from Planck's locus [2].
_KELVIN, _FURTHEST = (1_000.0, 100_000.0), 0.05
# Temperature ratio of neighbouring rows.
_RATIO = 1.002


class Temperature(NamedTuple):
    """Nearest Planck radiator in CIE 1960 u, v."""

    kelvin: float
    Duv: float  # distance from the radiator: above 0 greener, below 0 pinker


def correlated_temperature(white_XYZ: ArrayLike) -> Temperature | None:
    """Return correlated colour temperature and Duv of a light's white XYZ, on any scale [1].

    None if the light is too far from Planck's locus, or outside of 1000 K to 100 000 K.
    """
    u, v = _uv(np.asarray(white_XYZ, dtype=np.float64))
    kelvin, locus = _planckian()
    squares = ((locus - [u, v]) ** 2).sum(axis=1)
    nearest = int(squares.argmin())
    if not 0 < nearest < len(kelvin) - 1:
        return None
    # Vertex of the parabola through three squares: distances have a kink on the locus.
    before, here, after = squares[nearest - 1 : nearest + 2]
    rows = 0.5 * (before - after) / (before - 2.0 * here + after)
    CCT_K = float(kelvin[nearest] * _RATIO**rows)
    u_0, v_0 = _uv(_planck_XYZ(np.array([CCT_K])))[0]
    Duv = float(np.copysign(np.hypot(u - u_0, v - v_0), v - v_0))
    if not (_KELVIN[0] <= CCT_K <= _KELVIN[1] and abs(Duv) <= _FURTHEST):
        return None
    return Temperature(CCT_K, Duv)


@cache
def _planckian() -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return temperatures (K,) and their u, v (K, 2), one row beyond `_KELVIN` at each end."""
    low, high = np.log(_KELVIN) / np.log(_RATIO)
    kelvin = _RATIO ** np.arange(low - 1.0, high + 2.0)
    return kelvin, _uv(_planck_XYZ(kelvin))


def _planck_XYZ(kelvin: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return (K, 3) XYZ of Planck radiators, unscaled."""
    nm, xyz = observers()["CIE 1931 2 Degree Standard Observer"]
    power = (560.0 / nm) ** 5 / np.expm1(C2_NM_K / (nm * kelvin[:, None]))
    return power @ xyz


def _uv(XYZ: NDArray[np.float64]) -> NDArray[np.float64]:
    """Convert to (..., 2) CIE 1960 u, v."""
    X, Y, Z = np.moveaxis(XYZ, -1, 0)
    return np.stack([4.0 * X, 6.0 * Y], axis=-1) / (X + 15.0 * Y + 3.0 * Z)[..., None]
