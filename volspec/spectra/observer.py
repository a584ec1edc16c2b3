"""The standard eye: colour-matching functions.

    grid, datasets -> [observer] -> values, photometry, basis

CIE 1931 2 degrees and CIE 1964 10 degrees (CIE 15:2018, tables T.4 and T.5).
"""

from __future__ import annotations

from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from volspec.errors import SpectrumError
from volspec.spectra.datasets import observers
from volspec.spectra.grid import SpectralGrid

_OBSERVERS = {
    2: "CIE 1931 2 Degree Standard Observer",
    10: "CIE 1964 10 Degree Standard Observer",
}


# One grid in most programs; spectra that are measured or tried bring their own.
@lru_cache(maxsize=64)
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
    try:
        Q = grid.band_means(*observers()[_OBSERVERS[observer_deg]]).T
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
            f"observer_deg {observer_deg!r} is unknown; use 2 (CIE 1931) or 10 (CIE 1964)",
            code="unknown",
        )
