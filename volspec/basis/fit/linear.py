"""Fit the linear methods: ``reduced-rank``, ``pca`` and ``pca-sharpened``.

    training set -> [linear] -> A, B, D

``reduced-rank`` minimises, over A and B with A B = I and A 1 = 1, B 1 = 1 (white is exact), the
mean square colour error of the exact light matrix

    || G_jk Q diag(E_j) (S_k - B A S_k) ||^2  =  || S_k - B A S_k ||^2_Wk,  summed over j,

with G_jk the CIE94 metric. With one W for all reflectances that is a singular-value
decomposition [1]; from there A and B are solved for in turn with every reflectance's own W_k.
Any m independent mixtures of A's rows are equally good; the mixtures that multiply best
componentwise are chosen (`volspec.basis.fit.sensors.choose_channels`), with their D.

``pca`` and ``pca-sharpened`` use the first m right singular vectors of the colour signals
E_i * S_j, uncentred, with the perfect diffuser added to the reflectances [2]. They differ in the
vectors of that subspace that represent the channels, and so in the quality of a componentwise
product; the full product inside the subspace, `SpectralBasis.illumination_matrix`, is the same. The
papers' spectra span 400-700 nm: on a wider grid the bands outside are weighted little, or the
invisible infrared of incandescent lamps would occupy channels.

References
----------
[1] Marimont, Wandell (1992), "Linear models of surface and illuminant spectra", JOSA A 9(11),
    1905-1913. doi:10.1364/JOSAA.9.001905
[2] Bergner, Drew, Moeller (2009), sections 2.2-2.3.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from volspec.basis.fit.residuals import relative_colours
from volspec.basis.fit.sensors import choose_channels
from volspec.basis.fit.training import Training, check_rank, count_noun
from volspec.errors import BasisError

Array = NDArray[np.float64]

# Two rounds bring most of the gain; more overfit the training set.
_ITERATIONS = 2
# Keeps each solution near the previous one if the training set does not determine it.
_RIDGE = 1e-6
# Directions in which reflectances vary by less than this fraction of the most are left out.
_VARIATION = 1e-5


def reduced_rank(training: Training, size: int) -> tuple[Array, Array, Array]:
    """Fit A, B and D of ``reduced-rank``.

    Raises BasisError if the reflectances and white span fewer than m dimensions.
    """
    frame = _frame(training, size)
    t = training.S @ frame
    W = _colour_weights(training, frame)
    A, B = _one_metric_for_all(t, W, training.grid.size, size)
    for _ in range(_ITERATIONS):
        A = _better_analysis(A, B, t, W)
        B = _better_synthesis(A, B, t, W)
    rows = np.linalg.qr(A.T)[0].T
    T, D = choose_channels(training, rows @ frame.T)
    return T @ rows @ frame.T, frame @ B @ (A @ rows.T) @ np.linalg.inv(T), D


def _frame(training: Training, size: int) -> Array:
    """Return (N, r) orthonormal columns: flat white, then the reflectances' variation about it."""
    N = training.grid.size
    S = training.S * np.sqrt(training.reflectance_weights)[:, None]
    _, strength, directions = np.linalg.svd(S - S.mean(1, keepdims=True), full_matrices=False)
    strength = np.append(np.linalg.norm(S), strength)
    check_rank(strength, size, f"{count_noun(len(S), 'reflectance')} and white")
    count = max(int((strength > strength[0] * _VARIATION).sum()), size)
    return np.column_stack([np.full(N, N**-0.5), directions[: count - 1].T])


def _colour_weights(training: Training, frame: Array) -> Array:
    """Return W_k (K, r, r): the colour error of a reflectance's error, over all lights."""
    white, _, metric = relative_colours(training)
    colours = np.matmul(training.Q * training.E[:, None], frame) / white[..., None]
    rows = np.matmul(metric, colours[:, None])  # (J, K, 3, r)
    rows = rows.swapaxes(0, 1).reshape(len(training.S), -1, frame.shape[1])
    return np.matmul(rows.swapaxes(1, 2), rows)


def _one_metric_for_all(t: Array, W: Array, bands: int, size: int) -> tuple[Array, Array]:
    """Return the best A (m, r) and B (r, m) for the sum of all W, with white as a channel."""
    power, directions = np.linalg.eigh(W.sum(0))
    root = np.sqrt(np.maximum(power, 1e-9 * power[-1]))
    half, inverse = (directions * root) @ directions.T, (directions / root) @ directions.T
    white = half[:, 0] / np.linalg.norm(half[:, 0])
    weighted = t @ half
    residual = weighted - np.outer(weighted @ white, white)
    _, _, components = np.linalg.svd(residual, full_matrices=False)
    frame = np.vstack([white, components[: size - 1]])
    A, B = frame @ half, inverse @ frame.T
    # White is 1 in the first channel and 0 in the others; adding the first makes it 1 in all.
    scale = A[0, 0] * np.sqrt(bands)
    mix = np.eye(size)
    mix[:, 0] = 1.0 / scale
    return mix @ A, B @ np.linalg.inv(mix)


def _better_analysis(A: Array, B: Array, t: Array, W: Array) -> Array:
    """Solve for A given B; its first column, which makes white 1 in all channels, stays."""
    A = A.copy()
    A[:, 1:] += _solve_ridge(W, B, t[:, 1:], t - t @ A.T @ B.T)
    return A


def _better_synthesis(A: Array, B: Array, t: Array, W: Array) -> Array:
    """Solve for B given A, among the B with A B = I and the same B 1."""
    m = len(A)
    unseen = np.linalg.svd(A)[2][m:].T
    uneven = np.linalg.svd(np.ones((1, m)))[2][1:].T
    B = _reading_back(A, B, unseen)
    c = t @ A.T
    return B + unseen @ _solve_ridge(W, unseen, c @ uneven, t - c @ B.T) @ uneven.T


def _reading_back(A: Array, B: Array, unseen: Array) -> Array:
    """Return the B with A B = I that keeps white and is nearest to ``B`` in A's null space."""
    pseudo_inverse = np.linalg.pinv(A)
    white = np.eye(A.shape[1])[0] * B.sum(1)[0]
    B = pseudo_inverse + unseen @ (unseen.T @ B)
    return B + np.outer(unseen @ (unseen.T @ (white - B.sum(1))), np.full(len(A), 1 / len(A)))


def _solve_ridge(W: Array, F: Array, x: Array, residual: Array) -> Array:
    """Return the X that minimises sum_k || residual_k - F X x_k ||^2_Wk, with a ridge.

    Shapes: W (K, r, r), F (r, a), x (K, b), rest (K, r); X (a, b).
    """
    FW = np.matmul(F.T, W)  # (K, a, r)
    count, a, b = len(x), F.shape[1], x.shape[1]
    products = (x[:, :, None] * x[:, None]).reshape(count, -1)
    H = np.matmul(FW, F).reshape(count, -1).T @ products
    H = H.reshape(a, a, b, b).swapaxes(1, 2).reshape(a * b, a * b)
    gradient = np.einsum("kar,kr,kb->ab", FW, residual, x, optimize=True).ravel()
    ridge = _RIDGE * np.trace(H) / max(a * b, 1)
    return np.linalg.solve(H + ridge * np.eye(a * b), gradient).reshape(a, b)


_PAPERS_NM = (400.0, 700.0)
# Root weight of a band outside that range: a thousandth in the squares.
_OUTSIDE = 0.03


def pca(training: Training, size: int) -> tuple[Array, Array, Array]:
    """Fit A, B and D, with the principal components, scaled by white, as B's columns."""
    return _scaled_by_white(training, _components(training, size))


def sharpened_pca(training: Training, size: int) -> tuple[Array, Array, Array]:
    """Fit A, B and D with the vectors of the subspace that are narrowest in wavelength.

    B = B0 T, T the eigenvectors of B0^T diag(lambda) B0.
    """
    B0 = _components(training, size)
    _, T = np.linalg.eigh(B0.T @ (training.grid.wavelengths_nm[:, None] * B0))
    return _scaled_by_white(training, B0 @ T)


def _components(training: Training, size: int) -> Array:
    """Return B0 (N, m), orthonormal, for signals times the bands' root weights."""
    spanned = training.with_white()
    # Singular vectors of all J K signals from the N x N sum of their outer products: the sum
    # over lights of diag(E) C diag(E) is C times that of E E^T, entry by entry.
    lights = (spanned.E * spanned.light_weights[:, None]).T @ spanned.E
    root = _band_roots(training)
    strength, directions = np.linalg.eigh(lights * spanned.covariance * np.outer(root, root))
    strength = np.sqrt(np.maximum(strength[::-1], 0.0))
    check_rank(strength, size, training.label)
    return np.asarray(directions[:, ::-1][:, :size])


def _scaled_by_white(training: Training, weighted: Array) -> tuple[Array, Array, Array]:
    """Scale orthonormal ``weighted`` (N, m) to a B for which white's channels are ones; D = Q B.

    A = B^+ for equal band weights. Raises BasisError if a channel does not respond to white.
    """
    root = _band_roots(training)
    A = weighted.T * root
    channel_white = A.sum(1)
    if np.abs(channel_white).min() < 1e-9:
        raise BasisError(
            f"basis size {len(A)}: a channel does not respond to flat white; "
            "add a grey reflectance to the training set or change the size",
            code="impossible",
        )
    B = weighted / root[:, None] * channel_white
    Q = training.Q
    return A / channel_white[:, None], B, Q @ B * (100.0 / Q[1].sum())


def _band_roots(training: Training) -> Array:
    """Return (N,) square roots of the bands' weights."""
    low, high = _PAPERS_NM
    w = training.grid.wavelengths_nm
    return np.where((w >= low) & (w <= high), 1.0, _OUTSIDE)
