"""Samples of a basis: a matrix fitted to each light, errors, and a synthesis exact for them.

basis, light -> [samples] -> 3 x m matrix, errors, full bands
"""

from __future__ import annotations

from dataclasses import replace
from functools import lru_cache
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from volspec.appearance.models.cielab import cielab, delta_E_2000
from volspec.basis import display
from volspec.errors import BasisError
from volspec.spectra.grid import SpectralGrid
from volspec.spectra.photometry import XYZ_from_spectra, light_level, luminous_mean, white_XYZ
from volspec.spectra.reflectances import reflectance_set
from volspec.spectra.spectrum import Spectrum

if TYPE_CHECKING:
    from volspec.basis.model import SpectralBasis

Array = NDArray[np.float64]

# Weight of the library's training set next to a basis' own samples.
_LIBRARY_WEIGHT = 1e-4
# Of samples: ratio of singular values below which their channels depend on each other, and largest
# deviation from a reflectance. Gain: float16 rounds channels to 2.4e-4 of their value.
_DEPENDENT, _UNLIKE, _MOST_GAIN = 1e-4, 1e-3, 20.0


@lru_cache(maxsize=32)
def _training_set(grid: SpectralGrid) -> NDArray[np.float64]:
    return reflectance_set("training", grid)


# Lights of a session: a slider moves their weights, not their matrices.
@lru_cache(maxsize=64)
def fitted_matrix(basis: SpectralBasis, power: bytes) -> Array:
    """Return `SpectralBasis.fitted_matrix` under a light of (N,) power, as bytes; cached."""
    if basis.samples is None:
        raise BasisError(
            f"basis {basis.name!r} has no samples to fit a light's matrix to; fit the basis again",
            code="missing",
        )
    light = Spectrum(basis.grid.wavelengths_nm, np.frombuffer(power))
    own, library = basis.samples, _training_set(basis.grid)
    S = np.concatenate([own, library])
    others = _LIBRARY_WEIGHT if len(own) else 1.0
    weights = np.repeat([1.0, others], [len(own), len(library)])
    weights /= np.repeat([max(len(own), 1), len(library)], [len(own), len(library)])
    matrix = display.fitted_matrix(
        basis.analyse(S),
        XYZ_from_spectra(light, S, basis.observer_deg),
        weights,
        white_XYZ(light, basis.observer_deg),
        basis.light_matrix(light),
    )
    matrix.flags.writeable = False
    return matrix


def sample_errors(basis: SpectralBasis, light: Spectrum, mode: str) -> NDArray[np.float64]:
    """Return CIEDE2000 (K,) of the samples' colours under a light, or of the training set's.

    Estimates, without a picture, how well a mode holds a light. Errors: `colour_matrix`.
    """
    own = basis.samples
    S = own if own is not None and len(own) else _training_set(basis.grid)
    light = light.on(basis.grid)
    white = display.visible_white(white_XYZ(light, basis.observer_deg))
    # Pictures show a nearly invisible light nearly black, and its errors with it.
    seen = light.values, basis.grid, basis.observer_deg
    gain = luminous_mean(*seen) / light_level(*seen)
    shown = gain * basis.analyse(S) @ basis.colour_matrix(light, mode).T
    true = gain * XYZ_from_spectra(light, S, basis.observer_deg)
    return delta_E_2000(cielab(true, white), cielab(shown, white))


def through_samples(basis: SpectralBasis) -> SpectralBasis | None:
    """Return a basis with a synthesis that is exact for its samples and their mixtures.

    Its ``"exact"`` mode then has the colours of full spectra. None if there are no samples, or
    the channels do not distinguish them from each other and from white.
    """
    S = basis.samples
    if S is None or not len(S):
        return None
    channels = np.vstack([basis.analyse(S), basis.white])
    rest = np.vstack([S, np.ones(basis.grid.size)]) - channels @ basis.synthesis.T
    change = np.linalg.pinv(channels, rcond=_DEPENDENT) @ rest
    if np.abs(change).max() > _MOST_GAIN or np.abs(rest - channels @ change).max() > _UNLIKE:
        return None
    return replace(basis, synthesis=basis.synthesis + change.T)
