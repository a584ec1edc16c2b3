"""Volume and transfer function to coefficient image: the slow stage, once per view."""

from volspec.raycast.lights import Ambient, Directional, Headlight, LightGroup, Point
from volspec.raycast.spec import ClipPlane, RaycastSpec

__all__ = [
    "Ambient",
    "ClipPlane",
    "Directional",
    "Headlight",
    "LightGroup",
    "Point",
    "RaycastSpec",
]
