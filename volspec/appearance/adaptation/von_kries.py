"""Von Kries: each response is divided by the white's, in one of five spaces.

    R   = M · XYZ · 100/Y_w
    R_c = (D · 100/R_w + 1 − D) · R         R_w of the white in percent, D of the side
    XYZ' : the same undone under the target, with the target's white and the target's D

The two sides meet in R_c, each with its own D, as CIECAM02's do (and Zhai and Luo's two steps by
way of equal energy). At D = 1 on both this is M⁻¹ · diag(R_w'/R_w) · M, and swapping source and
target is the exact inverse at any D.

====================  ====================================================  ================
name                  M                                                     D = None means
====================  ====================================================  ================
``"von Kries"``       Hunt-Pointer-Estévez cones, normalised to D65         1
``"Bradford"``        Lam's sharpened cones [3]                             1
``"Sharp"``           Finlayson and Süsstrunk's [4]                         1
``"CAT02"``           CIECAM02's [1, 2]                                     eq. 24 of [2]
``"CAT16"``           CAM16's [5]                                           the same
====================  ====================================================  ================

``discount`` is D = 1 in all of them.

References
----------
[1] Pirsivash, "Viewing Conditions and Chromatic Adaptation" (after Fairchild, Color Appearance
    Models), sections von Kries and CAT02. M stands before X₁ there too (erratum).
[2] Neumann, Castro, Neumann & Sbert (2004), eq. 22-24.
[3] Lam (1985), "Metamerism and colour constancy", PhD thesis, University of Bradford.
[4] Finlayson & Süsstrunk (2000), "Performance of a chromatic adaptation transform based on
    spectral sharpening", Color Imaging Conference 8, 49-55.
[5] Li et al. (2017), "Comprehensive color solutions: CAM16, CAT16, and CAM16-UCS", Color
    Research & Application 42(6), 703-718. doi:10.1002/col.22131
"""

from __future__ import annotations

from functools import partial

import numpy as np

from volspec.appearance import constants as k
from volspec.appearance.adaptation.base import (
    CONES_FROM_XYZ,
    Adaptation,
    Array,
    bounded,
    inverse,
    relative_white,
    scale,
)
from volspec.appearance.passages import LinearPassage
from volspec.appearance.spec import ViewingConditions

BRADFORD_FROM_XYZ = np.array(
    [[0.8951, 0.2664, -0.1614], [-0.7502, 1.7135, 0.0367], [0.0389, -0.0685, 1.0296]]
)
SHARP_FROM_XYZ = np.array(
    [[1.2694, -0.0988, -0.1706], [-0.8364, 1.8006, 0.0357], [0.0297, -0.0315, 1.0018]]
)


def complete(conditions: ViewingConditions) -> float:
    """D of the bare matrices: 1 unless given."""
    return 1.0 if conditions.D is None or conditions.discount else conditions.D


def partial_by_luminance(conditions: ViewingConditions) -> float:
    """D of CIECAM02: F (1 − exp(−(L_A + 42)/92) / 3.6) unless given."""
    if conditions.D is not None or conditions.discount:
        return complete(conditions)
    return float(conditions.factors.F * (1.0 - np.exp(-(conditions.L_A + 42.0) / 92.0) / 3.6))


SPACES = {
    "von Kries": (CONES_FROM_XYZ, complete),
    "Bradford": (BRADFORD_FROM_XYZ, complete),
    "Sharp": (SHARP_FROM_XYZ, complete),
    "CAT02": (k.CAT02_FROM_XYZ, partial_by_luminance),
    "CAT16": (k.CAT16_FROM_XYZ, partial_by_luminance),
}


def adapted_from_XYZ(name: str, conditions: ViewingConditions) -> Array:
    """(3, 3): XYZ to R_c."""
    matrix, degree = SPACES[name]
    D = degree(conditions)
    # Gains vanish at one D for a light whose response is negative; they are kept off 0 too.
    gains = bounded(D / relative_white(matrix, conditions) + 1.0 - D)
    return scale(conditions) * gains[:, None] * matrix


def passage(name: str, source: ViewingConditions, target: ViewingConditions) -> LinearPassage:
    """The passage in the space of that name."""
    XYZ_from_adapted = inverse(adapted_from_XYZ(name, target))
    return LinearPassage(XYZ_from_adapted @ adapted_from_XYZ(name, source))


PASSAGES: dict[str, Adaptation] = {name: partial(passage, name) for name in SPACES}
