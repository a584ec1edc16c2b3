"""No adaptation: XYZ' = XYZ, so that tungsten light looks orange."""

from __future__ import annotations

import numpy as np

from volspec.appearance.adaptation.base import Adaptation
from volspec.appearance.passages import LinearPassage
from volspec.appearance.spec import ViewingConditions


def passage(source: ViewingConditions, target: ViewingConditions) -> LinearPassage:
    """The identity, whatever the conditions."""
    return LinearPassage(np.eye(3))


PASSAGES: dict[str, Adaptation] = {"none": passage}
