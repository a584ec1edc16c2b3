"""What the standard eye makes of a spectrum: tristimulus values, lux, candela.

    grid, spectrum -> [photometry] -> basis, appearance, room

XYZ = kappa Q (E * S), kappa such that a perfect diffuser has Y = 100; absolute scale
683 lm/W. Colour-matching functions: CIE 1931 2 degrees (CIE 15:2018, table T.4).
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import cache

import numpy as np
from numpy.typing import ArrayLike, NDArray

from volspec.errors import SpectrumError
from volspec.spectra._colour import colour_science
from volspec.spectra.grid import SpectralGrid
from volspec.spectra.spectrum import Spectrum

LUMINOUS_EFFICACY = 683.0
"""lm/W at 555 nm."""

_FULL_RANGE_NM = (360.0, 830.0)


@cache
def color_matching_functions(grid: SpectralGrid) -> NDArray[np.float64]:
    """CIE 1931 2 degree colour-matching functions as band means.

    Parameters
    ----------
    grid : SpectralGrid
        Within 360-830 nm.

    Returns
    -------
    (3, N) float64, read-only
        x, y, z; unitless.

    Raises
    ------
    SpectrumError
        If the grid leaves 360-830 nm.
    """
    cmfs = colour_science().MSDS_CMFS["CIE 1931 2 Degree Standard Observer"]
    try:
        Q = grid.band_means(cmfs.wavelengths, cmfs.values).T
    except SpectrumError:
        raise SpectrumError(
            f"grid {grid}: the eye's colour-matching functions span 360-830 nm; stay within"
        ) from None
    Q = np.ascontiguousarray(Q)
    Q.flags.writeable = False
    return Q


def XYZ_of(
    light: Spectrum, reflectances: Spectrum | Sequence[Spectrum] | ArrayLike
) -> NDArray[np.float64]:
    """Colour of reflectances under a light.

    Parameters
    ----------
    light : Spectrum
        On an equidistant grid of N bands.
    reflectances : Spectrum, list of Spectrum, or (..., N) array
        Spectra are put on the light's grid; arrays must already be on it.

    Returns
    -------
    (3,) or (..., 3) float64
        Y = 100 for a perfect diffuser.

    Raises
    ------
    SpectrumError
        If shapes differ, the light is not equidistant, or it has no luminous energy.
    """
    grid = light.grid
    S = stack(reflectances, grid)
    Q = color_matching_functions(grid)
    return (S * light.values) @ (Q.T * (100.0 / _luminous_sum(light, Q)))


def white_XYZ(light: Spectrum) -> NDArray[np.float64]:
    """(3,) XYZ of the perfect diffuser, Y = 100: the light's adopted white."""
    return XYZ_of(light, np.ones(light.values.size))


def illuminance_lux(spectrum: Spectrum) -> float:
    """E_v = 683 sum E V dlambda, lux, for a spectral irradiance in W / (m^2 nm)."""
    grid = spectrum.grid
    V = color_matching_functions(grid)[1]
    return float(LUMINOUS_EFFICACY * grid.step_nm * (V @ spectrum.values))


def luminance(spectrum: Spectrum) -> float:
    """L = E_v / pi, cd/m^2: a perfect diffuser under that spectral irradiance."""
    return illuminance_lux(spectrum) / np.pi


def stack(
    spectra: Spectrum | Sequence[Spectrum] | ArrayLike, grid: SpectralGrid
) -> NDArray[np.float64]:
    """Spectra as one (..., N) array on a grid; arrays only have their shape checked."""
    if isinstance(spectra, Spectrum):
        return spectra.on(grid).values
    if isinstance(spectra, list | tuple) and any(isinstance(s, Spectrum) for s in spectra):
        return np.array([stack(s, grid) for s in spectra])
    try:
        array = np.asarray(spectra, dtype=np.float64)
    except (TypeError, ValueError) as error:
        raise SpectrumError(f"spectra are not a regular array of numbers: {error}") from None
    if array.ndim == 0 or array.shape[-1] != grid.size:
        raise SpectrumError(
            f"spectra have shape {array.shape}; expected (..., {grid.size}) on the grid {grid}. "
            "Were they sampled on another grid?"
        )
    if not np.isfinite(array).all():
        raise SpectrumError("spectra hold values that are not finite (NaN or infinity)")
    return array


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


def _luminous_sum(light: Spectrum, Q: NDArray[np.float64]) -> float:
    total = float(Q[1] @ light.values)
    if not total > 0:
        raise SpectrumError(
            f"light {light.name!r} has no luminous energy (sum E V = {total:g}); "
            "give a light with power between 400 and 700 nm"
        )
    return total
