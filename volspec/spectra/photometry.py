"""What the standard eye makes of a spectrum: tristimulus values, lux, candela.

    grid, spectrum, observer, values -> [photometry] -> basis, appearance, room

XYZ = kappa Q (E * S), kappa such that a perfect diffuser has Y = 100; absolute scale
683 lm/W. Lux and candela are defined by the 2 degree observer.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike, NDArray

from volspec.spectra.grid import SpectralGrid
from volspec.spectra.observer import color_matching_functions
from volspec.spectra.spectrum import Spectrum
from volspec.spectra.values import light_power, stack

LUMINOUS_EFFICACY = 683.0
"""lm/W at 555 nm."""

_FULL_RANGE_NM = (360.0, 830.0)


def XYZ_of(
    light: Spectrum,
    reflectances: Spectrum | Sequence[Spectrum] | ArrayLike,
    observer_deg: int = 2,
) -> NDArray[np.float64]:
    """Colour of reflectances under a light.

    Parameters
    ----------
    light : Spectrum
        On an equidistant grid of N bands.
    reflectances : Spectrum, list of Spectrum, or (..., N) array
        Spectra are put on the light's grid; arrays must already be on it.
    observer_deg : {2, 10}
        As `color_matching_functions`.

    Returns
    -------
    (3,) or (..., 3) float64
        Y = 100 for a perfect diffuser.

    Raises
    ------
    SpectrumError
        If shapes differ, the light is not equidistant, or it is no light (`light_power`).
    """
    grid = light.grid
    S = stack(reflectances, grid)
    E = light_power(light, grid)
    Q = color_matching_functions(grid, observer_deg)
    return (S * E) @ (Q.T * (100.0 / (Q[1] @ E)))


def white_XYZ(light: Spectrum, observer_deg: int = 2) -> NDArray[np.float64]:
    """(3,) XYZ of the perfect diffuser, Y = 100: the light's adopted white."""
    return XYZ_of(light, np.ones(light.values.size), observer_deg)


def illuminance_lux(spectrum: Spectrum) -> float:
    """E_v = 683 sum E V dlambda, lux, for a spectral irradiance in W / (m^2 nm)."""
    grid = spectrum.grid
    V = color_matching_functions(grid)[1]
    return float(LUMINOUS_EFFICACY * grid.step_nm * (V @ spectrum.values))


def luminance(spectrum: Spectrum) -> float:
    """L = E_v / pi, cd/m^2: a perfect diffuser under that spectral irradiance."""
    return illuminance_lux(spectrum) / np.pi


def extended_band_means(
    wavelengths_nm: NDArray[np.float64], values: NDArray[np.float64], grid: SpectralGrid
) -> NDArray[np.float64]:
    """Band means of a table, continued by its end values where the eye hardly sees.

    Allowed while each colour-matching function has under 1 % of its area in the missing
    range (400-700 nm data pass, 350-560 nm data do not); otherwise the grid's error stands.
    """
    low, high = wavelengths_nm[0], wavelengths_nm[-1]
    if low <= grid.start_nm and high >= grid.stop_nm:
        return grid.band_means(wavelengths_nm, values)
    full = SpectralGrid(*_FULL_RANGE_NM, 1.0)
    Q = color_matching_functions(full)
    missing = (full.wavelengths_nm < low) | (full.wavelengths_nm > high)
    if (Q[:, missing].sum(1) < 0.01 * Q.sum(1)).all():
        pad = (int(low > grid.start_nm), int(high < grid.stop_nm))
        wavelengths_nm = np.concatenate(
            [[grid.start_nm] * pad[0], wavelengths_nm, [grid.stop_nm] * pad[1]]
        )
        values = np.pad(values, [pad] + [(0, 0)] * (values.ndim - 1), mode="edge")
    return grid.band_means(wavelengths_nm, values)
