"""Post-illumination: a coefficient image and a light become a frame.

raycast -> [relight] -> appearance -> frame
"""

from volspec.relight.check import componentwise_error
from volspec.relight.illumination import Illumination
from volspec.relight.relighter import Relighter, relight
from volspec.relight.spec import LightRig, RelightSpec

__all__ = [
    "Illumination",
    "LightRig",
    "RelightSpec",
    "Relighter",
    "componentwise_error",
    "relight",
]
