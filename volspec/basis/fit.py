"""Fit a basis: check the data, run the method, add the synthesis.

    lights x reflectances -> [fit] -> SpectralBasis

Methods: ``virtual-sensors`` (`volspec.basis.sensors`), the best componentwise colour, and
``pca-sharpened``, the papers' model (Bergner, Drew, Moeller 2009, sections 2.2-2.3).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from volspec.basis.sensors import fit_sensors
from volspec.errors import BasisError, SpectrumError, nearest
from volspec.spectra.grid import SpectralGrid
from volspec.spectra.photometry import color_matching_functions, light_power, stack
from volspec.spectra.spectrum import Spectrum

Array = NDArray[np.float64]

METHODS = ("virtual-sensors", "pca-sharpened")
DEFAULT_SMOOTHNESS = 3e-5
# Up to this many light-reflectance pairs the fit is for a scene: restarts are cheap, and
# designed spectra oscillate, so that the sensors must be allowed to.
_FEW_PAIRS = 150
_SCENE_SMOOTHNESS = 1e-6
_SCENE_RESTARTS = 4
# The perfect diffuser's share of the training set: channels are scaled by white, so that
# white should lie in the subspace.
_WHITE_SHARE = 0.08
# Strength of the prior "spectra are smooth" against the training spectra's own covariance.
_PRIOR = 1e-5
_PRIOR_WIDTH_NM = 40.0


def fit_basis(
    make: Callable[..., Any],
    lights: Sequence[Spectrum] | ArrayLike,
    reflectances: Sequence[Spectrum] | ArrayLike,
    *,
    size: int,
    method: str,
    positive: bool,
    grid: SpectralGrid,
    name: str = "",
    trained_on: str = "",
    smoothness: float | None = None,
    restarts: int | None = None,
    light_weights: ArrayLike | None = None,
) -> Any:
    """Fit and build; `SpectralBasis.fit` is the public face and documents the arguments."""
    if method not in METHODS:
        raise BasisError(
            f"basis method {method!r} is unknown; {nearest(method, METHODS)}"
            f"choose {' or '.join(METHODS)}"
        )
    E, S = _rows(lights, grid, "lights"), _rows(reflectances, grid, "reflectances")
    _check_size(size, grid)
    E = _powers(E, lights, grid)
    if not np.any(S > 0):
        raise BasisError("reflectances are all black: there is nothing to fit")
    if method == "pca-sharpened":
        if positive:
            raise BasisError(
                "pca-sharpened cannot keep its analysis positive; use method='virtual-sensors'"
            )
        A, B, D = sharpened_pca(E, S, grid, size)
    else:
        weights = None if light_weights is None else np.asarray(light_weights, dtype=np.float64)
        if weights is not None and (weights.shape != (len(E),) or not (weights > 0).all()):
            raise BasisError(
                f"light_weights have shape {weights.shape}; expected ({len(E)},), all positive"
            )
        A, D = fit_sensors(
            E,
            S,
            grid,
            size,
            positive=positive,
            smoothness=_smoothness(smoothness, len(E) * len(S)),
            restarts=_restarts(restarts, len(E) * len(S)),
            light_weights=weights,
        )
        B = best_synthesis(A, S, grid)
    made_from = trained_on or f"{len(E)} lights x {len(S)} reflectances"
    return make(
        name=name or f"{method}-{size}",
        method=method,
        grid=grid,
        analysis=A,
        synthesis=B,
        XYZ_from_channels=D,
        trained_on=made_from,
    )


def sharpened_pca(E: Array, S: Array, grid: SpectralGrid, size: int) -> tuple[Array, Array, Array]:
    """A, B and D of ``pca-sharpened``.

    B0: first m right singular vectors of the colour signals E_i * S_j, uncentred, with the
    perfect diffuser added to the reflectances at a twelfth of their weight. T:
    eigenvectors of B0^T diag(lambda) B0, which makes each column as narrow in wavelength as
    the subspace allows. B = B0 T scaled so that white analyses to ones, A = B^+, D = Q B.

    Raises
    ------
    BasisError
        If the colour signals span fewer than m dimensions, or a channel does not see white.
    """
    white = np.full((1, grid.size), np.sqrt(_WHITE_SHARE * len(S)))
    signals = (E[:, None] * np.concatenate([S, white])).reshape(-1, grid.size)
    _, strength, directions = np.linalg.svd(signals, full_matrices=False)
    rank = int((strength > strength[0] * 1e-10).sum())
    if size > rank:
        raise BasisError(
            f"basis size {size} exceeds the {rank} dimensions that {len(E)} lights x {len(S)} "
            f"reflectances span; use a size of {rank} or less, or more spectra"
        )
    B0 = directions[:size].T
    _, T = np.linalg.eigh(B0.T @ (grid.wavelengths_nm[:, None] * B0))
    B = B0 @ T
    channel_white = np.linalg.pinv(B).sum(1)
    if np.abs(channel_white).min() < 1e-9:
        raise BasisError(
            f"basis size {size}: a channel does not respond to flat white; "
            "add a grey reflectance to the training set or change the size"
        )
    B = B * channel_white
    Q = color_matching_functions(grid)
    return np.linalg.pinv(B), B, Q @ B * (100.0 / Q[1].sum())


def best_synthesis(A: Array, S: Array, grid: SpectralGrid) -> Array:
    """B (N, m): the reflectances most likely to have given coefficients, with B 1 = 1.

    Linear regression of spectra on their channels, B = C A^T (A C A^T)^-1 with C the training
    covariance plus a weak smooth prior (so that m may exceed the number of reflectances),
    then constrained to keep flat white. A B = I: what B makes, A reads back.
    """
    w = grid.wavelengths_nm
    smooth = np.exp(-0.5 * ((w[:, None] - w) / _PRIOR_WIDTH_NM) ** 2)
    # A little independent variation keeps the smooth prior from being singular on fine grids.
    prior = smooth + 1e-2 * np.eye(grid.size)
    C = S.T @ S / len(S)
    C = C + _PRIOR * np.trace(C) / grid.size * prior
    gram = A @ C @ A.T
    B = np.linalg.solve(gram, A @ C).T
    toward = np.linalg.solve(gram, np.ones(len(A)))
    return B + np.outer(1.0 - B.sum(1), toward / toward.sum())


def _rows(spectra: Sequence[Spectrum] | ArrayLike, grid: SpectralGrid, what: str) -> Array:
    if np.size(np.asarray(spectra, dtype=object)) == 0:
        raise BasisError(f"{what}: the list is empty; give at least one spectrum")
    try:
        array = stack(spectra, grid)
    except SpectrumError as error:
        raise BasisError(f"{what}: {error}") from None
    return array.reshape(-1, grid.size)


def _check_size(size: int, grid: SpectralGrid) -> None:
    if isinstance(size, bool) or int(size) != size or not 3 <= size <= grid.size:
        raise BasisError(
            f"basis size {size} is not a whole number from 3 to {grid.size}, the grid's bands; "
            "5 to 9 is usual"
        )


def _powers(E: Array, lights: Sequence[Spectrum] | ArrayLike, grid: SpectralGrid) -> Array:
    powers = np.empty_like(E)
    for k, row in enumerate(E):
        label = f"light {k + 1}"
        if isinstance(lights, list | tuple) and isinstance(lights[k], Spectrum):
            label += f" ({lights[k].name})"
        try:
            powers[k] = light_power(row, grid, label)
        except SpectrumError as error:
            raise BasisError(str(error)) from None
    return powers


def _smoothness(value: float | None, pairs: int) -> float:
    if value is None:
        return _SCENE_SMOOTHNESS if pairs <= _FEW_PAIRS else DEFAULT_SMOOTHNESS
    if not (np.isfinite(value) and value >= 0):
        raise BasisError(f"smoothness {value} is not 0 or more; {DEFAULT_SMOOTHNESS:g} is usual")
    return float(value)


def _restarts(value: int | None, pairs: int) -> int:
    if value is None:
        return _SCENE_RESTARTS if pairs <= _FEW_PAIRS else 0
    if int(value) != value or value < 0:
        raise BasisError(f"restarts {value} is not a whole number of 0 or more")
    return int(value)
