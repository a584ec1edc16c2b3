"""Spectra as arrays of numbers that can be lights or reflectances.

spectra, grid -> [values] -> photometry, basis
"""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from volspec.errors import SpectrumError, VolspecWarning
from volspec.spectra.grid import SpectralGrid
from volspec.spectra.observer import color_matching_functions
from volspec.spectra.spectrum import Spectrum

# Band means of a measured table may dip this far below zero, as a share of the peak.
_ROUNDING = 1e-6
# Above this a reflectance is no fluorescence but a percentage, or a light.
_MOST_REFLECTED = 2.0
# Less light than this cannot be scaled to Y = 100.
_LEAST_LIGHT = 1e-300


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
            f"give power within {grid.start_nm:g}-{grid.stop_nm:g} nm, or leave it out",
            code="conflict",
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
