"""Cache of fitted bases, keyed by the training spectra, the options and the code.

lights, reflectances -> [fit_cache] -> scene
"""

from __future__ import annotations

import hashlib
from collections.abc import Sequence
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from volspec import __version__
from volspec._cache import cached_arrays
from volspec.basis.model import SpectralBasis
from volspec.spectra import Spectrum, colour_matching_functions, stack

# Source files that determine a fit's result.
_SOURCES = (
    *("basis/fit/*.py", "basis/model.py", "basis/base.py", "appearance/models/lab.py"),
    *("spectra/spectrum.py", "spectra/grid.py"),
)
_MATRICES = ("analysis", "synthesis", "XYZ_from_channels")


def fit_cached(
    lights: Sequence[Spectrum],
    reflectances: Sequence[Spectrum],
    *,
    name: str,
    trained_on: str,
    light_weights: ArrayLike,
    reflectance_weights: ArrayLike,
    **options: Any,
) -> SpectralBasis:
    """Fit a basis, or read it from the user's cache folder; arguments: see `SpectralBasis.fit`.

    ``options`` are size, method, positive, grid and observer_deg. Without the cache, a scene's
    basis would be fitted whenever the scene is opened.
    """
    weights: dict[str, Any] = {
        "light_weights": light_weights,
        "reflectance_weights": reflectance_weights,
    }

    def fit() -> dict[str, NDArray[np.float64]]:
        basis = SpectralBasis.fit(lights, reflectances, **options, **weights)
        return {key: getattr(basis, key) for key in _MATRICES}

    method, grid, observer_deg = (options[key] for key in ("method", "grid", "observer_deg"))
    digest = hashlib.sha256(_code().encode())
    counts = len(lights), len(reflectances)
    kind = options["size"], method, options["positive"], grid, observer_deg
    digest.update(repr((*kind, *counts)).encode())
    arrays = [colour_matching_functions(grid, observer_deg)]
    for spectrum in (*lights, *reflectances):
        arrays += [spectrum.wavelengths_nm, spectrum.values]
    for array in (*arrays, *map(np.asarray, weights.values())):
        digest.update(f"{array.dtype} {array.shape} ".encode() + array.tobytes())
    maker = digest.hexdigest()
    matrices = cached_arrays(f"bases/{maker[:20]}", maker, fit)
    return SpectralBasis(
        name,
        method,
        grid,
        **matrices,
        trained_on=trained_on,
        observer_deg=observer_deg,
        samples=stack(reflectances, grid),
    )


@cache
def _code() -> str:
    """Return a hash of the fit's sources and of NumPy's version."""
    root = Path(__file__).resolve().parent.parent
    files = sorted(file for pattern in _SOURCES for file in root.glob(pattern))
    digest = hashlib.sha256(f"{__version__} {np.__version__}".encode())
    for file in files:
        digest.update(file.read_bytes())
    return digest.hexdigest()
