"""Advice on lights whose colours a picture's mode does not hold.

    basis, light, mode -> [advice] -> warning of frames, note of pages

The estimate needs no picture: the colours of the basis' samples under the light, in the mode and in
full bands.
"""

from __future__ import annotations

import warnings
from functools import lru_cache

import numpy as np

from volspec.basis import Basis, Mode, SpectralBasis, sample_errors
from volspec.errors import VolspecWarning
from volspec.relight.spec import LightRig
from volspec.spectra import Spectrum, light_power

# Mean CIEDE2000 from which a light is beyond a mode, and the part of it that a cure leaves.
_BEYOND, _CURED = 1.0, 0.5
_CURES: tuple[Mode, ...] = ("fitted", "exact")


def mode_advice(basis: Basis, light: Spectrum, mode: Mode) -> str | None:
    """Return a warning if a mode is off by more than CIEDE2000 1 on average under a light.

    It names the mode that is better, or a basis without such errors. None if the mode holds the
    light, as all do with a `MaterialBasis`. Cached. Errors are those of `colour_matrix`.

    >>> from volspec.spectra import light
    >>> basis = SpectralBasis.load("general-7")
    >>> mode_advice(basis, light("D65"), "componentwise") is None
    True
    >>> mode_advice(basis, light("led:470"), "componentwise").partition("; ")[2]
    'use the mode fitted (1.8)'
    """
    if not isinstance(basis, SpectralBasis):
        return None
    power = light_power(light, basis.grid)
    return _advice(basis, power.tobytes(), light.name or "the light", mode)


def warn_of_lights(
    basis: Basis, rig: LightRig, mode: Mode, warned: set[str], stacklevel: int
) -> None:
    """Warn of each light that is on and that the mode does not hold, once per set of ``warned``."""
    for light, weight in zip(rig.lights, rig.weights, strict=True):
        advice = mode_advice(basis, light, mode) if weight else None
        if advice is not None and advice not in warned:
            warned.add(advice)
            warnings.warn(advice, VolspecWarning, stacklevel=stacklevel + 1)


@lru_cache(maxsize=64)
def _advice(basis: SpectralBasis, power: bytes, name: str, mode: Mode) -> str | None:
    light = Spectrum(basis.grid.wavelengths_nm, np.frombuffer(power))

    def mean(candidate: Mode) -> float:
        return float(sample_errors(basis, light, candidate).mean())

    off = mean(mode)
    if not off > _BEYOND:
        return None
    problem = f"{name}: {mode} colours are off by ΔE00 {off:.1f}, the mean of the basis' samples"
    left, cure = min((mean(candidate), candidate) for candidate in _CURES if candidate != mode)
    if left < _CURED * off:
        return f"{problem}; use the mode {cure} ({left:.1f})"
    return f"{problem}, more than {basis.size} channels can hold; cast with more, or the materials"
