"""Fit ``pca`` and ``pca-sharpened``: the papers' linear models.

    training set -> [pca] -> A, B, D

The first m right singular vectors of the colour signals E_i * S_j, uncentred, with the
perfect diffuser added to the reflectances: the subspace both methods share. They differ in
which vectors of it carry the channels, and so in how well a componentwise product does; the
full product inside the subspace, `SpectralBasis.illumination_matrix`, is the same.

The papers' spectra span 400-700 nm. On a wider grid the bands outside count for little, or the
infrared of incandescent lamps, which nobody sees, would take up channels.

References
----------
[1] Bergner, Drew, Moeller (2009), sections 2.2-2.3.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from volspec.basis.fit.training import Training, check_rank
from volspec.errors import BasisError

Array = NDArray[np.float64]

_PAPERS_NM = (400.0, 700.0)
# Root weight of a band outside: a thousandth of the squares.
_OUTSIDE = 0.03


def pca(training: Training, size: int) -> tuple[Array, Array, Array]:
    """A, B and D with the principal components themselves, scaled by white, as B's columns."""
    return _scaled_by_white(training, _components(training, size))


def sharpened_pca(training: Training, size: int) -> tuple[Array, Array, Array]:
    """A, B and D with the subspace's vectors that are as narrow in wavelength as it allows.

    B = B0 T, T the eigenvectors of B0^T diag(lambda) B0.
    """
    B0 = _components(training, size)
    _, T = np.linalg.eigh(B0.T @ (training.grid.wavelengths_nm[:, None] * B0))
    return _scaled_by_white(training, B0 @ T)


def _components(training: Training, size: int) -> Array:
    """B0 (N, m), orthonormal, of signals times the bands' root weights."""
    spanned = training.with_white()
    # Singular vectors of all J K signals from the N x N sum of their outer products: the sum
    # over lights of diag(E) C diag(E) is C times that of E E^T, entry by entry.
    lights = (spanned.E * spanned.light_weights[:, None]).T @ spanned.E
    root = _band_roots(training)
    strength, directions = np.linalg.eigh(lights * spanned.covariance * np.outer(root, root))
    strength = np.sqrt(np.maximum(strength[::-1], 0.0))
    check_rank(strength, size, training.label)
    return np.asarray(directions[:, ::-1][:, :size])


def _scaled_by_white(training: Training, weighed: Array) -> tuple[Array, Array, Array]:
    """From orthonormal ``weighed`` (N, m): B's columns such that white analyses to ones, D = Q B.

    A = B^+ where the bands count alike.

    Raises
    ------
    BasisError
        If a channel does not see white.
    """
    root = _band_roots(training)
    A = weighed.T * root
    channel_white = A.sum(1)
    if np.abs(channel_white).min() < 1e-9:
        raise BasisError(
            f"basis size {len(A)}: a channel does not respond to flat white; "
            "add a grey reflectance to the training set or change the size"
        )
    B = weighed / root[:, None] * channel_white
    Q = training.Q
    return A / channel_white[:, None], B, Q @ B * (100.0 / Q[1].sum())


def _band_roots(training: Training) -> Array:
    """(N,) square roots of the bands' weights."""
    low, high = _PAPERS_NM
    w = training.grid.wavelengths_nm
    return np.where((w >= low) & (w <= high), 1.0, _OUTSIDE)
