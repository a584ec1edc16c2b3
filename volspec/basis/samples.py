"""Samples of a basis: errors under a light, and a synthesis exact for them.

basis, light -> [samples] -> errors, full bands
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from volspec.appearance.models import cielab, delta_E_2000
from volspec.basis import display
from volspec.basis.model import SpectralBasis, training_reflectances
from volspec.spectra import Spectrum, XYZ_from_spectra, light_level, luminous_mean, white_XYZ

Array = NDArray[np.float64]

# Of samples: ratio of singular values below which their channels depend on each other, and largest
# deviation from a reflectance. Gain: float16 rounds channels to 2.4e-4 of their value.
_DEPENDENT, _UNLIKE, _MAX_GAIN = 1e-4, 1e-3, 20.0


def sample_errors(basis: SpectralBasis, light: Spectrum, mode: str) -> NDArray[np.float64]:
    """Return CIEDE2000 (K,) of the samples' colours under a light, or of the training set's.

    Estimates, without a picture, how well a mode holds a light. Errors: `colour_matrix`.
    """
    samples = basis.samples
    S = samples if samples is not None and len(samples) else training_reflectances(basis.grid)
    light = light.on(basis.grid)
    white = display.visible_white(white_XYZ(light, basis.observer_deg))
    # Pictures show a nearly invisible light nearly black, and its errors with it.
    arguments = light.values, basis.grid, basis.observer_deg
    gain = luminous_mean(*arguments) / light_level(*arguments)
    predicted = gain * basis.analyse(S) @ basis.colour_matrix(light, mode).T
    true = gain * XYZ_from_spectra(light, S, basis.observer_deg)
    return delta_E_2000(cielab(true, white), cielab(predicted, white))


def through_samples(basis: SpectralBasis) -> SpectralBasis | None:
    """Return a basis with a synthesis that is exact for its samples and their mixtures.

    Its ``"exact"`` mode then has the colours of full spectra. None if there are no samples, or
    the channels do not distinguish them from each other and from white.
    """
    S = basis.samples
    if S is None or not len(S):
        return None
    channels = np.vstack([basis.analyse(S), basis.white])
    residual = np.vstack([S, np.ones(basis.grid.size)]) - channels @ basis.synthesis.T
    change = np.linalg.pinv(channels, rcond=_DEPENDENT) @ residual
    if np.abs(change).max() > _MAX_GAIN or np.abs(residual - channels @ change).max() > _UNLIKE:
        return None
    return replace(basis, synthesis=basis.synthesis + change.T)
