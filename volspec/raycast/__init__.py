"""Volume and transfer function to coefficient image: the slow stage, once per view."""

from volspec.raycast.camera import Camera
from volspec.raycast.depth import DepthEffects
from volspec.raycast.image import CoefficientImage
from volspec.raycast.lights import Ambient, Directional, Headlight, LightGroup, Point
from volspec.raycast.spec import ClipPlane, RaycastSpec

__all__ = [
    "Ambient",
    "Camera",
    "ClipPlane",
    "CoefficientImage",
    "DepthEffects",
    "Directional",
    "Headlight",
    "LightGroup",
    "Point",
    "RaycastSpec",
]
