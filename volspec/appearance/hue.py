"""Hue quadrature and composition: percentages of the four unique hues.

    model -> hue angle -> [quadrature -> composition] -> readout

References
----------
[1] CIE 159:2004, table 3; *Color Appearance Models* (survey 002), eq. 41, table 1 with the
    errata, sections 2.2 and 16.3.
[2] Fairchild (2013), *Color Appearance Models*, 3rd ed., worked examples of the Hunt model.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from volspec.appearance.display import constants as k

Array = NDArray[np.float64]

LETTERS = "RYGB"
"""Red, yellow, green, blue: at H = 0, 100, 200, 300."""


class UniqueHues(NamedTuple):
    """A model's unique hues: increasing angles, with eccentricity e and H."""

    degrees: tuple[float, ...]
    eccentricity: tuple[float, ...]
    H: tuple[float, ...] = tuple(k.UNIQUE_HUES_H[:4].tolist())


def _equal_eccentricity(*degrees: float) -> UniqueHues:
    return UniqueHues(degrees, (1.0,) * len(degrees))


CIE_HUES = UniqueHues(
    tuple(k.UNIQUE_HUES_DEG[:4].tolist()), tuple(k.UNIQUE_HUES_ECCENTRICITY[:4].tolist())
)
"""Unique hues of CIECAM02 and CAM16."""
HUNT_HUES = UniqueHues(
    (*CIE_HUES.degrees, 360.0), (*CIE_HUES.eccentricity, 0.856), (*CIE_HUES.H, 385.9)
)
"""Hunt's own computation has a knot at h = 0 between blue and red [2]; the survey omits it."""
CIELAB_HUES = _equal_eccentricity(24.0, 90.0, 162.0, 246.0)
"""Unique hues of CIELAB and RLAB. Table 1's other rows are linear between these, so its R83B is at
270 degrees, not at the printed 276."""
NAYATANI_HUES = _equal_eccentricity(20.14, 90.0, 164.25, 231.0)
"""Unique hues of Nayatani's model."""


def quadrature(h: ArrayLike, hues: UniqueHues = CIE_HUES) -> Array:
    """Return hue quadrature H, 0 to 400, of hue angles within [0, 360] degrees (eq. 41)."""
    angles = np.array([*hues.degrees, hues.degrees[0] + 360.0])
    factors = np.array([*hues.eccentricity, hues.eccentricity[0]])
    quarters = np.array([*hues.H, 400.0])
    h = np.asarray(h, dtype=np.float64)
    turned = np.where(h < angles[0], h + 360.0, h)
    i = np.clip(np.searchsorted(angles, turned, side="right") - 1, 0, len(angles) - 2)
    before = (turned - angles[i]) / factors[i]
    after = (angles[i + 1] - turned) / factors[i + 1]
    between = quarters[i + 1] - quarters[i]
    return np.asarray(quarters[i] + between * before / (before + after), dtype=np.float64)


def composition(H: ArrayLike) -> str | NDArray[np.str_]:
    """Write hue quadrature as percentages of the two unique hues around it, the larger first.

    >>> composition([0.0, 105.0, 382.6]).tolist()
    ['100R', '95Y 5G', '83R 17B']
    """
    quarters = np.asarray(H, dtype=np.float64) % 400.0
    texts = [_percentages(value) for value in quarters.ravel().tolist()]
    if quarters.ndim == 0:
        return texts[0]
    return np.array(texts, dtype=np.str_).reshape(quarters.shape)


def _percentages(H: float) -> str:
    quarter = int(H // 100.0)
    second = round(H - 100.0 * quarter)
    parts = [(100 - second, LETTERS[quarter % 4]), (second, LETTERS[(quarter + 1) % 4])]
    parts.sort(key=lambda part: -part[0])
    return " ".join(f"{percent}{letter}" for percent, letter in parts if percent > 0)
