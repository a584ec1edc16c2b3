"""Reflectances as colour-science recovers them: the other methods, by name, on any grid.

    colours -> [recovery] -> construct

Otsu's, Mallett's and Smits's tables are put on the grid and solved there, so that what is left is
the method's own error. Jakob's and Meng's optimisers are given the grid.

References
----------
[1] Smits (1999), "An RGB-to-Spectrum Conversion for Reflectances", J. Graphics Tools 4(4), 11-22.
[2] Meng, Simon, Hanika & Dachsbacher (2015), "Physically Meaningful Rendering using Tristimulus
    Colours", Computer Graphics Forum 34(4), 31-40.
[3] Otsu, Yamamoto & Hachisuka (2018), "Reproducing Spectral Reflectances From Tristimulus
    Colours", Computer Graphics Forum 37(6), 370-381.
[4] Jakob & Hanika (2019), "A Low-Dimensional Function Space for Efficient Spectral Upsampling",
    Computer Graphics Forum 38(2), 147-155.
[5] Mallett & Yuksel (2019), "Spectral Primary Decomposition for Rendering with sRGB
    Reflectance", EGSR.
"""

from __future__ import annotations

import warnings
from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from volspec.errors import SpectrumError
from volspec.spectra._colour import colour_science
from volspec.spectra.construct.colours import XYZ_from_linear_sRGB
from volspec.spectra.observer import color_matching_functions
from volspec.spectra.photometry import XYZ_of, extended_band_means
from volspec.spectra.spectrum import Spectrum

Array = NDArray[np.float64]


def recover(method: str, XYZ: Array, light: Spectrum, observer_deg: int) -> Array:
    """Reflectances by a method of `RECOVERIES`.

    Parameters
    ----------
    method : str
    XYZ : (n, 3) float64
        Y = 100 for white.
    light : Spectrum
        Equidistant, N bands.
    observer_deg : {2, 10}

    Returns
    -------
    (n, N) float64
        Clipped to 0 to 1.

    Raises
    ------
    SpectrumError
        If a method's optimiser does not converge, or its tables do not cover the grid.
    """
    if not len(XYZ):
        return np.empty((0, light.values.size))
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        return np.clip(RECOVERIES[method](XYZ, light, observer_deg), 0.0, 1.0)


def _otsu(XYZ: Array, light: Spectrum, observer_deg: int) -> Array:
    """The mean and three basis functions of the colour's cluster; a 3 x 3 system each."""
    recovery = colour_science().recovery
    shape = recovery.SPECTRAL_SHAPE_OTSU2018
    dataset = recovery.Dataset_Otsu2018(
        shape,
        recovery.BASIS_FUNCTIONS_OTSU2018,
        recovery.CLUSTER_MEANS_OTSU2018,
        recovery.SELECTOR_ARRAY_OTSU2018,
    )
    w = shape.wavelengths
    Q = XYZ_of(light, np.eye(light.values.size), observer_deg).T
    values = np.empty((len(XYZ), light.values.size))
    for row, colour in enumerate(XYZ):
        total = colour.sum()
        xy = colour[:2] / total if total > 0 else np.full(2, 1 / 3)
        basis, mean = dataset.cluster(xy)
        on_grid = extended_band_means(w, np.column_stack([mean, basis.T]), light.grid)
        mean, basis = on_grid[:, 0], on_grid[:, 1:]
        values[row] = mean + basis @ np.linalg.solve(Q @ basis, colour - Q @ mean)
    return values


def _mallett(XYZ: Array, light: Spectrum, observer_deg: int) -> Array:
    recovery = colour_science().recovery
    basis = recovery.MSDS_BASIS_FUNCTIONS_sRGB_MALLETT2019
    return (
        _linear_sRGB(XYZ, light, observer_deg)
        @ extended_band_means(basis.wavelengths, basis.values, light.grid).T
    )


def _smits(XYZ: Array, light: Spectrum, observer_deg: int) -> Array:
    recovery = colour_science().recovery
    spectra = [recovery.RGB_to_sd_Smits1999(rgb) for rgb in _linear_sRGB(XYZ, light, observer_deg)]
    columns = np.column_stack([spectrum.values for spectrum in spectra])
    return extended_band_means(spectra[0].wavelengths, columns, light.grid).T


def _linear_sRGB(XYZ: Array, light: Spectrum, observer_deg: int) -> Array:
    white = XYZ_of(light, np.ones(light.values.size), observer_deg)
    return np.clip(XYZ @ np.linalg.inv(XYZ_from_linear_sRGB(white)).T, 0.0, 1.0)


def _optimised(name: str) -> Callable[[Array, Spectrum, int], Array]:
    def made(XYZ: Array, light: Spectrum, observer_deg: int) -> Array:
        colour = colour_science()
        # Keyed by what is exactly the grid: rounding in wavelengths would be another shape.
        w = light.wavelengths_nm
        Q = color_matching_functions(light.grid, observer_deg)
        cmfs = colour.MultiSpectralDistributions(Q.T, w)
        lamp = colour.SpectralDistribution(light.values, w)
        method: Any = getattr(colour.recovery, name)
        rows = []
        for triple in XYZ:
            try:
                rows.append(method(triple / 100.0, cmfs, lamp).values)
            except RuntimeError as error:
                raise SpectrumError(
                    f"colour X Y Z {triple[0]:g} {triple[1]:g} {triple[2]:g}: {name} does not "
                    "converge; take another method, such as delaunay"
                ) from error
        return np.array(rows)

    return made


RECOVERIES: dict[str, Callable[[Array, Spectrum, int], Array]] = {
    "otsu-2018": _otsu,
    "jakob-2019": _optimised("XYZ_to_sd_Jakob2019"),
    "meng-2015": _optimised("XYZ_to_sd_Meng2015"),
    "mallett-2019": _mallett,
    "smits-1999": _smits,
}
"""By name: from (n, 3) XYZ, a light and an observer to (n, N)."""
