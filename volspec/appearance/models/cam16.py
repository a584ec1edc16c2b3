"""CAM16: CIECAM02 with one space for adaptation and compression, where nothing turns negative.

References
----------
[1] Li et al. (2017), "Comprehensive color solutions: CAM16, CAT16, and CAM16-UCS", Color
    Research & Application 42(6), 703-718. doi:10.1002/col.22131
"""

from __future__ import annotations

from numpy.typing import ArrayLike

from volspec.appearance.models import cam
from volspec.appearance.models.base import Appearance, Array
from volspec.appearance.models.conditions import CamPassage, Conditions
from volspec.appearance.spec import ViewingConditions

NAME = "CAM16"


def forward(XYZ: ArrayLike, conditions: ViewingConditions) -> Appearance:
    """See `volspec.appearance.models.base.Model.forward`."""
    return cam.forward(XYZ, Conditions.of_viewing(conditions, NAME))


def inverse(J: ArrayLike, C: ArrayLike, h: ArrayLike, conditions: ViewingConditions) -> Array:
    """See `volspec.appearance.models.base.Model.inverse`."""
    return cam.inverse(J, C, h, Conditions.of_viewing(conditions, NAME))


continued = inverse
"""Beyond what is defined there is nothing."""


def passage(source: ViewingConditions, target: ViewingConditions) -> CamPassage:
    """XYZ under one condition to those of equal J, C and h under another, in closed form."""
    return CamPassage.seen_by(NAME, source, target)
