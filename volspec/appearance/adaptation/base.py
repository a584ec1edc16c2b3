"""What every chromatic adaptation gives, and what they share.

    ViewingConditions × 2 -> [adaptation] -> Passage -> host | shaders/relight.frag

An adaptation is a module: its equations, its reference, and ``PASSAGES``, which maps its names to
functions of two conditions. Learn one, know all.

Colours are taken on their white's scale, so that all is in percent of Y_w: a white of Y = 50
plays the part of one of Y = 100.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import ArrayLike, NDArray

from volspec.appearance.passages import CurvePassage, Passage, triples
from volspec.appearance.spec import ViewingConditions
from volspec.errors import ViewingError

Array = NDArray[np.float64]
Adaptation = Callable[[ViewingConditions, ViewingConditions], Passage]

# Hunt-Pointer-Estévez cones normalised to D65 with the five digits of CIE 109. The survey prints
# the same matrix with three and four.
CONES_FROM_XYZ: Array = np.array(
    [[0.40024, 0.70760, -0.08081], [-0.22630, 1.16532, 0.04570], [0.0, 0.0, 0.91822]]
)
CONES_FROM_XYZ.flags.writeable = False

# Responses to a white over its luminance are taken no nearer to 0 and no further from it. Real
# lights' reach 164 (violet of 380 nm).
_LEAST, _MOST = 1e-6, 1e6
# cd/m²: what the models are fed at most and at least. C of Fairchild's is singular outside of
# 1e-10 to 1e9; starlight on paper is 1e-4, and the sun's disc 1e9.
LUMINANCES = (1e-4, 1e6)
_LEAST_N = 1e-4


def scale(conditions: ViewingConditions) -> float:
    """100 / Y_w: XYZ to percent of the white."""
    return 100.0 / conditions.white_XYZ[1]


def inverse(matrix: Array) -> Array:
    """(3, 3) float64."""
    return np.asarray(np.linalg.inv(matrix), dtype=np.float64)


def bounded(values: Array) -> Array:
    """Values between 1e-6 and 1e6, with the sign they have."""
    return np.asarray(np.copysign(np.clip(np.abs(values), _LEAST, _MOST), values))


def relative_white(matrix: Array, conditions: ViewingConditions) -> Array:
    """Responses to the white over its Y; (3,). Saturated lights can have negative ones."""
    return bounded(matrix @ np.divide(conditions.white_XYZ, conditions.white_XYZ[1]))


def cones_of_white(conditions: ViewingConditions) -> Array:
    """Cone responses to the white over its Y, kept above 0: (3,); D65 has ones."""
    return np.maximum(relative_white(CONES_FROM_XYZ, conditions), _LEAST)


def white_luminance(conditions: ViewingConditions) -> float:
    """Y_n = L_A Y_w / Y_b in cd/m², within `LUMINANCES`.

    A background darker than 1e-4 of the white counts as that, as in CIECAM02.
    """
    Y_n = conditions.L_A / max(conditions.Y_b / conditions.white_XYZ[1], _LEAST_N)
    return float(np.clip(Y_n, *LUMINANCES))


def outside(XYZ: ArrayLike, passage: Passage) -> NDArray[np.bool_]:
    """Where a passage is asked for what its equations do not define: powers of negative numbers.

    `Passage.apply` goes on there with |x|^p and the sign of x, so that no NaN reaches a picture.

    Parameters
    ----------
    XYZ : (..., 3) array_like
        On the source white's scale.
    passage : Passage

    Returns
    -------
    (...) bool
        True where a response lies below 0 (Nayatani: below -n), or XYZ is not finite. Matrices
        are defined everywhere.

    Raises
    ------
    ShapeError
        If they are no numbers, or the last axis is not 3.
    ViewingError
        If ``passage`` is none.

    Examples
    --------
    >>> from volspec.appearance import ViewingConditions
    >>> from volspec.appearance.adaptation import adaptation
    >>> sun, sky = ViewingConditions((100, 100, 60)), ViewingConditions((92, 100, 140))
    >>> outside([[20, 20, 20], [90, 5, 0]], adaptation("Nayatani")(sun, sky)).tolist()
    [False, True]
    """
    if not isinstance(passage, Passage):
        raise ViewingError.refused(
            "adaptation.passage",
            passage,
            "expected one of `adaptation`, as adaptation('CAT02')(source, target)",
            "type",
        )
    colours = triples("adaptation: XYZ", XYZ)
    lost = ~np.isfinite(colours).all(axis=-1)
    if isinstance(passage, CurvePassage):
        with np.errstate(invalid="ignore"):
            base = colours @ passage.response_from_XYZ.T + passage.shift
        lost |= (base < 0.0).any(axis=-1)
    return np.asarray(lost, dtype=np.bool_)
