"""What fits minimise: errors of XYZ / white as an eye weighs them.

    training set -> [metric] -> residuals, reduced_rank

References
----------
[1] CIE 116:1995, the CIE94 colour difference: CIELAB, with errors of chroma and hue counting
    the less the more chroma there is. The local form of CIEDE2000 but for its corrections of
    blue and of near-grey.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from volspec.appearance.models.cielab import cielab, cielab_derivative
from volspec.basis.display import NO_COLOUR, visible_white
from volspec.basis.fit.training import Training

Array = NDArray[np.float64]

_CHROMA_LOSS, _HUE_LOSS = 0.045, 0.015
_WHITE = np.ones(3)


def relative_colours(training: Training) -> tuple[Array, Array, Array]:
    """Whites (J, 3), XYZ / white (J, K, 3), and G (J, K, 3, 3) of every light on reflectance.

    A pair's weight and the number of pairs are folded into G: the sum of squares of errors
    weighed by it is their mean square.
    """
    E, S, Q = training.E, training.S, training.Q
    white = E @ Q.T
    # Where a light has no X or Z to speak of there is no ratio to fit; `display_matrix`
    # shows that row in proportion to Y.
    seen = white > NO_COLOUR * white[:, 1:2]
    white = visible_white(white)
    ratio = np.matmul(S, (Q * E[:, None]).swapaxes(1, 2)) / white[:, None]
    weights = np.outer(training.light_weights, training.reflectance_weights) / training.pairs
    metric = difference_metric(ratio) * seen[:, None, None, :]
    return white, ratio, metric * np.sqrt(weights)[..., None, None]


def difference_metric(ratio: ArrayLike) -> Array:
    """G with |G d| the CIE94 difference of a small change d of XYZ / white.

    Parameters
    ----------
    ratio : (..., 3) array_like
        XYZ over the white's.

    Returns
    -------
    (..., 3, 3) float64
        Row lightness, chroma or hue; column X, Y or Z.

    Examples
    --------
    >>> step = [0.0, 0.001, 0.0]
    >>> grey, green = ([0.2, 0.2, 0.2], [0.1, 0.2, 0.05])
    >>> [round(float(np.linalg.norm(difference_metric(c) @ step)), 2) for c in (grey, green)]
    [0.54, 0.17]
    """
    slope = cielab_derivative(ratio)
    _, a, b = np.moveaxis(cielab(ratio, _WHITE), -1, 0)
    chroma = np.hypot(a, b)
    # Grey has no hue: any direction does, since both losses are the same there.
    hue = np.arctan2(b, a)
    toward = np.stack([np.cos(hue), np.sin(hue)], axis=-1)
    across = np.stack([-np.sin(hue), np.cos(hue)], axis=-1)
    ab = slope[..., 1:, :]
    by_chroma = np.einsum("...i,...ij->...j", toward, ab) / (1 + _CHROMA_LOSS * chroma)[..., None]
    by_hue = np.einsum("...i,...ij->...j", across, ab) / (1 + _HUE_LOSS * chroma)[..., None]
    return np.stack([slope[..., 0, :], by_chroma, by_hue], axis=-2)
