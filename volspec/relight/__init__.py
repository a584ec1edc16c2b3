"""Post-illumination: a frame of a coefficient image and a light.

raycast -> [relight] -> appearance -> frame
"""

from volspec.relight.error_map import ErrorMap, difference_map, error_map, opacity_error
from volspec.relight.illumination import Illumination
from volspec.relight.look import Look
from volspec.relight.relighter import Relighter, relight
from volspec.relight.spec import LightRig, RelightSpec

__all__ = [
    "ErrorMap",
    "Illumination",
    "LightRig",
    "Look",
    "RelightSpec",
    "Relighter",
    "difference_map",
    "error_map",
    "opacity_error",
    "relight",
]
