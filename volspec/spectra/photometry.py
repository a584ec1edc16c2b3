"""What the standard eye makes of a spectrum: tristimulus values, lux, candela.

    grid, spectrum -> [photometry] -> basis, appearance, room

XYZ = kappa Q (E * S), kappa such that a perfect diffuser has Y = 100; absolute scale
683 lm/W. Colour-matching functions: CIE 1931 2 degrees and CIE 1964 10 degrees (CIE 15:2018,
tables T.4 and T.5); lux and candela are defined by the former.
"""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from functools import cache
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from volspec.errors import SpectrumError, VolspecWarning
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
# Above this a reflectance is no fluorescence but a percentage, or a light.
_MOST_REFLECTED = 2.0
# Less light than this cannot be scaled to Y = 100.
_LEAST_LIGHT = 1e-300


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
    whole = isinstance(observer_deg, int | np.integer) and not isinstance(observer_deg, bool)
    if not whole or observer_deg not in (2, 10):
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
        rows = []
        for number, spectrum in enumerate(spectra, start=1):
            try:
                row = stack(spectrum, grid)
            except SpectrumError as error:
                own = isinstance(spectrum, Spectrum) and spectrum.name
                raise SpectrumError(str(error) if own else f"number {number}: {error}") from None
            rows.append(row)
            if row.shape != rows[0].shape:
                raise SpectrumError(
                    f"spectrum number {number} is an array of shape {row.shape}; give one "
                    "spectrum at a time"
                )
        return np.array(rows)
    array = real_array(spectra, "spectra")
    if array.ndim == 0 or array.shape[-1] != grid.size:
        raise SpectrumError(
            f"spectra have shape {array.shape}; expected (..., {grid.size}) on the grid {grid}. "
            "Were they sampled on another grid?"
        )
    finite = np.isfinite(array).all(-1)
    if not finite.all():
        which = (
            f"spectrum number {int(finite.argmin()) + 1} holds" if finite.ndim else "spectra hold"
        )
        raise SpectrumError(f"{which} values that are not finite (NaN or infinity)")
    return array


def real_array(values: Any, what: str) -> NDArray[np.float64]:
    """Numbers as float64; text is none, even where it could be read as one.

    Raises
    ------
    SpectrumError
        Under the name of ``what`` they are, in the plural.
    """
    try:
        array = np.asarray(values)
    except (TypeError, ValueError):
        raise SpectrumError(f"{what} are not a regular array of numbers: rows differ") from None
    if array.dtype.kind not in "biuf":
        raise SpectrumError(
            f"{what} are not a regular array of numbers: {values!r:.40}; give a list or an array"
        )
    return array.astype(np.float64)


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
    if not total > _LEAST_LIGHT:
        raise SpectrumError(
            f"{label} has no luminous energy (sum E V = {total:g}); "
            f"give power within {grid.start_nm:g}-{grid.stop_nm:g} nm, or leave it out"
        )
    return E


def reflectance_values(
    spectra: Spectrum | Sequence[Spectrum] | ArrayLike, grid: SpectralGrid, label: str
) -> NDArray[np.float64]:
    """Reflectances on a grid, checked: what a surface can do.

    Parameters
    ----------
    spectra : Spectrum, list of Spectrum, or (..., N) array
    grid : SpectralGrid
        N bands.
    label : str
        What messages call them.

    Returns
    -------
    (N,) or (..., N) float64
        At least 0: what lies below by no more than a millionth of the peak becomes 0.

    Raises
    ------
    SpectrumError
        If a spectrum does not cover the grid, is negative, or above 2: a percentage or a light.

    Warns
    -----
    VolspecWarning
        If one is above 1, which only fluorescence makes.

    Examples
    --------
    >>> reflectance_values([[0.5, -1e-9]], SpectralGrid(500, 600, 100), "paint").tolist()
    [[0.5, 0.0]]
    """
    try:
        S = stack(spectra, grid)
    except SpectrumError as error:
        raise SpectrumError(f"{label}: {error}") from None
    rows = S.reshape(-1, grid.size)
    names = [getattr(s, "name", "") for s in spectra] if isinstance(spectra, list | tuple) else []

    def at(row: int, band: int) -> str:
        which = f": number {row + 1}" if S.ndim > 1 else ""
        which += f" ({names[row]})" if S.ndim == 2 and names and names[row] else ""
        return f"{label}{which} reflects {rows[row, band]:g} at {grid.wavelengths_nm[band]:g} nm"

    negative = rows < -_ROUNDING * np.abs(rows).max(1, keepdims=True)
    if negative.any():
        row = int(negative.any(1).argmax())
        raise SpectrumError(f"{at(row, int(rows[row].argmin()))}; a reflectance is 0 or more")
    row, band = divmod(int(rows.argmax()), grid.size) if rows.size else (0, 0)
    largest = rows[row, band] if rows.size else 0.0
    if largest > _MOST_REFLECTED:
        raise SpectrumError(
            f"{at(row, band)}; a reflectance is 0 to 1: divide per cent by 100, and give no light"
        )
    if largest > 1 + _ROUNDING:
        warnings.warn(
            f"{at(row, band)}, more than falls on it; right only if it is fluorescent",
            VolspecWarning,
            stacklevel=3,
        )
    return np.where(S > 0, S, 0.0)


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
