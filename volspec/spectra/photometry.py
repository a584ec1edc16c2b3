"""What the standard eye makes of a spectrum: tristimulus values, lux, candela.

    grid, spectrum -> [photometry] -> basis, appearance, room

XYZ = kappa Q (E * S), kappa such that a perfect diffuser has Y = 100; absolute scale
683 lm/W. Colour-matching functions: CIE 1931 2 degrees and CIE 1964 10 degrees (CIE 15:2018,
tables T.4 and T.5); lux and candela are defined by the former.
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

_OBSERVERS = {
    2: "CIE 1931 2 Degree Standard Observer",
    10: "CIE 1964 10 Degree Standard Observer",
}
_FULL_RANGE_NM = (360.0, 830.0)
# Band means of a measured table may dip this far below zero, as a share of the peak.
_ROUNDING = 1e-6


@cache
def color_matching_functions(grid: SpectralGrid, observer_deg: int = 2) -> NDArray[np.float64]:
    """Colour-matching functions of a standard observer as band means.

    Parameters
    ----------
    grid : SpectralGrid
        Within 360-830 nm.
    observer_deg : {2, 10}
        CIE 1931 2 degrees, or CIE 1964 10 degrees.

    Returns
    -------
    (3, N) float64, read-only
        x, y, z; unitless.

    Raises
    ------
    SpectrumError
        If the grid leaves 360-830 nm or the observer is another.
    """
    check_observer(observer_deg)
    cmfs = colour_science().MSDS_CMFS[_OBSERVERS[observer_deg]]
    try:
        Q = grid.band_means(cmfs.wavelengths, cmfs.values).T
    except SpectrumError:
        raise SpectrumError(
            f"grid {grid}: the eye's colour-matching functions span 360-830 nm; stay within"
        ) from None
    Q = np.ascontiguousarray(Q)
    Q.flags.writeable = False
    return Q


def check_observer(observer_deg: object) -> None:
    """Refuse what is neither the 2 nor the 10 degree observer.

    Raises
    ------
    SpectrumError
    """
    if isinstance(observer_deg, bool) or observer_deg not in (2, 10):
        raise SpectrumError(
            f"observer_deg {observer_deg!r} is unknown; use 2 (CIE 1931) or 10 (CIE 1964)"
        )


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


def light_power(
    light: Spectrum | ArrayLike, grid: SpectralGrid, label: str = ""
) -> NDArray[np.float64]:
    """The power of one light on a grid, checked: what can be seen by.

    Parameters
    ----------
    light : Spectrum or (N,) array
        Relative or absolute spectral power.
    grid : SpectralGrid
        N bands within 360-830 nm.
    label : str, optional
        What messages call it; the light's own name by default.

    Returns
    -------
    (N,) float64
        At least 0: what lies below by no more than a millionth of the peak becomes 0.

    Raises
    ------
    SpectrumError
        If it is more than one light, does not cover the grid, has negative power or no
        luminous energy.
    """
    E = stack(light, grid)
    own = f"light {light.name!r}" if isinstance(light, Spectrum) and light.name else "light"
    label = label or own
    if E.ndim != 1:
        raise SpectrumError(f"{label}: an array of shape {E.shape}; give one light at a time")
    lowest = int(E.argmin())
    if E[lowest] < -_ROUNDING * np.abs(E).max():
        raise SpectrumError(
            f"{label} has negative power, {E[lowest]:g} at {grid.wavelengths_nm[lowest]:g} nm; "
            "a light's values are 0 or more"
        )
    E = np.maximum(E, 0.0)
    total = float(color_matching_functions(grid)[1] @ E)
    if not total > 0:
        raise SpectrumError(
            f"{label} has no luminous energy (sum E V = {total:g}); "
            f"give power within {grid.start_nm:g}-{grid.stop_nm:g} nm, or leave it out"
        )
    return E


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
