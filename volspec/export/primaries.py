"""Colour spaces of linear files: their primaries, and white that stays white from one to another.

[primaries] -> pixels, spectral, compositing, overview
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from types import MappingProxyType

import numpy as np
from numpy.typing import NDArray

from volspec.appearance.curves import Transfer
from volspec.appearance.profile import D50_from_white
from volspec.appearance.spaces import SPACES, ColourSpace

_LINEAR = Transfer.gamma(1.0)
_ACES_WHITE_XY = (0.32168, 0.33767)
PRIMARIES: Mapping[str, ColourSpace] = MappingProxyType(
    {
        "Rec. 709": replace(SPACES["Rec. 709"], transfer=_LINEAR),
        # SMPTE ST 2065-1 and the Academy's S-2014-004.
        "ACES AP0": ColourSpace(
            *("ACES AP0", ((0.7347, 0.2653), (0.0, 1.0), (0.0001, -0.077))),
            *(_ACES_WHITE_XY, _LINEAR),
        ),
        "ACES AP1": ColourSpace(
            *("ACES AP1", ((0.713, 0.293), (0.165, 0.830), (0.128, 0.044))),
            *(_ACES_WHITE_XY, _LINEAR),
        ),
    }
)


def XYZ_adapted(space: ColourSpace, to: ColourSpace) -> NDArray[np.float64]:
    """(3, 3): XYZ beside one space's white to XYZ beside another's (Bradford)."""
    if space.white_xy == to.white_xy:
        return np.eye(3)
    return np.asarray(
        np.linalg.solve(D50_from_white(to.white_XYZ / 100.0), D50_from_white(space.white_XYZ / 100))
    )
