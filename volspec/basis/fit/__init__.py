"""Fit a basis: dispatch to the method, resolve its options, add the synthesis.

    training set -> [fit] -> A, B, D

======================  ==========================================================================
``virtual-sensors``     the best componentwise colour (`volspec.basis.fit.sensors`)
``reduced-rank``        the best colour with the exact light matrix (`volspec.basis.fit.linear`)
``pca-sharpened``       the papers' spectral factor model (`volspec.basis.fit.linear`)
``pca``                 the papers' linear model, its reference (`volspec.basis.fit.linear`)
======================  ==========================================================================
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray
from threadpoolctl import threadpool_limits

from volspec.basis.base import ROUND_TRIP_TOLERANCE, round_trip_loss
from volspec.basis.fit.linear import pca, reduced_rank, sharpened_pca
from volspec.basis.fit.sensors import MAX_ALIKE, fit_sensors
from volspec.basis.fit.training import MIN_SIZE, Training, smaller_size
from volspec.errors import BasisError, nearest

Array = NDArray[np.float64]

_LINEAR = {"reduced-rank": reduced_rank, "pca-sharpened": sharpened_pca, "pca": pca}
METHODS = ("virtual-sensors", *_LINEAR)
DEFAULT_SMOOTHNESS = 5e-6
# Few light-reflectance pairs mean designed spectra, which oscillate: sensors must follow them.
_FEW_PAIRS = 150
_SCENE_SMOOTHNESS = 2e-7
# Number of perturbed starts by number of pairs: few spectra have several minima, and each start is
# cheap.
_RESTARTS = ((_FEW_PAIRS, 4), (2000, 2))
# Strength of the prior "spectra are smooth" against the training spectra's own covariance.
_PRIOR = 1e-5
_PRIOR_WIDTH_NM = 40.0
# A penalty as large as the colour errors themselves leaves only straight lines.
_MAX_SMOOTHNESS = 1.0
_USUAL_SIZES = (5, 9)
# Sensors with a larger condition number are refused.
_REFUSED_ALIKE = 100.0


def fit_basis(
    training: Training,
    size: int,
    method: str,
    *,
    positive: bool,
    smoothness: float | None,
    restarts: int | None,
) -> tuple[Array, Array, Array]:
    """Fit A, B and D; `SpectralBasis.fit` documents the arguments.

    Runs on one thread: for small matrices more threads gain nothing, and change the last bits.
    """
    _check_method(method)
    _check_size(size, training)
    if method in _LINEAR:
        _refuse_options(method, positive=positive, smoothness=smoothness, restarts=restarts)
    options = _smoothness(smoothness, training), _restarts(restarts, training)
    with threadpool_limits(1):
        try:
            if method in _LINEAR:
                A, B, D = _LINEAR[method](training, size)
            else:
                A, D = fit_sensors(
                    training, size, positive=positive, smoothness=options[0], restarts=options[1]
                )
                B = best_synthesis(A, training)
        except np.linalg.LinAlgError as error:
            raise BasisError(
                f"basis size {size}: {training.label} do not determine it ({error}); "
                "use a smaller size or more spectra",
                code="impossible",
            ) from None
        alike = np.inf if method in _LINEAR else _REFUSED_ALIKE
        _check_determined(A, B, training, alike=alike)
        return A, B, D


def best_synthesis(A: Array, training: Training) -> Array:
    """Return B (N, m): the most likely reflectances for given coefficients, with B 1 = 1.

    Linear regression of spectra on their channels, B = C A^T (A C A^T)^-1 with C the training
    covariance plus a weak smooth prior (so that m may exceed the number of reflectances),
    then constrained to preserve flat white. A B = I.
    """
    w = training.grid.wavelengths_nm
    smooth = np.exp(-0.5 * ((w[:, None] - w) / _PRIOR_WIDTH_NM) ** 2)
    # A little independent variation keeps the smooth prior from being singular on fine grids.
    prior = smooth + 1e-2 * np.eye(w.size)
    C = training.covariance
    C = C + _PRIOR * np.trace(C) / w.size * prior
    gram = A @ C @ A.T
    B = np.linalg.solve(gram, A @ C).T
    toward = np.linalg.solve(gram, np.ones(len(A)))
    return B + np.outer(1.0 - B.sum(1), toward / toward.sum())


def _check_method(method: Any) -> None:
    if method == "materials":
        raise BasisError(
            "materials are channels of a volspec.MaterialBasis(materials), which is not fitted",
            code="conflict",
        )
    if method not in METHODS:
        raise BasisError(
            f"basis method {method!r} is unknown; {nearest(str(method), METHODS)}"
            f"choose {', '.join(METHODS)}",
            code="unknown",
        )


def _check_size(size: Any, training: Training) -> None:
    bands = training.grid.size
    if bands < MIN_SIZE:
        raise BasisError(
            f"a grid of {bands} bands is too coarse for a basis, which has {MIN_SIZE} channels "
            "or more; use a finer step_nm",
            code="shape",
        )
    if not _is_whole(size) or not MIN_SIZE <= size <= bands:
        low, high = _USUAL_SIZES
        usual = f"; {low} to {high} is usual" if bands > high else ""
        raise BasisError(
            f"basis size {size!r:.40} is not a whole number from {MIN_SIZE} to {bands}, the "
            f"grid's bands{usual}",
            code="range",
        )


def _check_determined(A: Array, B: Array, training: Training, *, alike: float) -> None:
    """Raise BasisError for sensors too alike to recover spectra from their channels."""
    strength = np.linalg.svd(A, compute_uv=False)
    if strength[0] <= alike * strength[-1] and round_trip_loss(A, B) <= ROUND_TRIP_TOLERANCE:
        return
    rank = min(int((strength > strength[0] / MAX_ALIKE).sum()), len(A) - 1)
    raise BasisError(
        f"basis size {len(A)}: {training.label} do not determine this many channels, which became "
        f"mixtures of each other; {smaller_size(rank)}",
        code="impossible",
    )


def _refuse_options(method: str, **options: Any) -> None:
    """Raise BasisError for options that belong to ``virtual-sensors``."""
    if options.pop("positive"):
        raise BasisError(
            f"{method} cannot keep its analysis positive; use method='virtual-sensors'",
            code="conflict",
        )
    for name, value in options.items():
        if value is not None:
            raise BasisError(
                f"{method} has no option {name}; leave it out, or use method='virtual-sensors'",
                code="conflict",
            )


def _is_whole(value: Any) -> bool:
    return isinstance(value, int | np.integer) and not isinstance(value, bool)


def _smoothness(value: Any, training: Training) -> float:
    if value is None:
        return _SCENE_SMOOTHNESS if training.pairs <= _FEW_PAIRS else DEFAULT_SMOOTHNESS
    number = _is_whole(value) or isinstance(value, float | np.floating)
    if not number or not 0 <= value <= _MAX_SMOOTHNESS:
        raise BasisError(
            f"smoothness {value!r:.40} is not a number from 0 to {_MAX_SMOOTHNESS:g}; "
            f"{DEFAULT_SMOOTHNESS:g} is usual",
            code="range",
        )
    return float(value)


def _restarts(value: Any, training: Training) -> int:
    if value is None:
        return next((count for limit, count in _RESTARTS if training.pairs <= limit), 0)
    if not _is_whole(value) or value < 0:
        raise BasisError(f"restarts {value!r:.40} is not a whole number of 0 or more", code="range")
    return int(value)
