"""CIECAM02, the CIE's model of 2002 and the default.

References
----------
[1] CIE 159:2004; Neumann, Castro, Neumann & Sbert (2004), appendix.
"""

from __future__ import annotations

from numpy.typing import ArrayLike

from volspec.appearance.models import cam
from volspec.appearance.models.base import Appearance, Array
from volspec.appearance.models.conditions import CamPassage, Conditions
from volspec.appearance.spec import ViewingConditions

NAME = "CIECAM02"


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
