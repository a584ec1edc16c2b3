"""The colours of the spectrum, for axes and legends.

wavelengths -> [wavelengths] -> figures, contact sheets
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from volspec.appearance import srgb
from volspec.spectra.datasets import colour_matching_functions
from volspec.spectra.grid import SpectralGrid

_SEEN = SpectralGrid(360.0, 830.0, 2.0)


def spectrum_colours(wavelengths_nm: ArrayLike) -> NDArray[np.float64]:
    """sRGB of monochromatic lights, desaturated into the gamut and dimmed.

    Parameters
    ----------
    wavelengths_nm : (N,) array_like

    Returns
    -------
    (N, 3) float64
        Encoded, 0 to 1; as bright as the eye sees equal power. Black outside 360-830 nm.

    Examples
    --------
    >>> spectrum_colours([540, 620]).argmax(axis=1).tolist()
    [1, 0]
    """
    at = np.asarray(wavelengths_nm, dtype=np.float64)
    linear = _in_gamut(colour_matching_functions(_SEEN).T)
    columns = [np.interp(at, _SEEN.wavelengths_nm, column, 0, 0) for column in linear.T]
    return srgb.encode(np.stack(columns, axis=-1) * (0.7 / linear.max()))


def _in_gamut(XYZ: NDArray[np.float64]) -> NDArray[np.float64]:
    linear = srgb.linear_from_XYZ(100 * XYZ)
    # A little grey besides, so that no channel starts from black with a visible edge.
    return linear - linear.min(axis=-1, keepdims=True).clip(max=0) + 0.12 * XYZ[:, 1:2]
