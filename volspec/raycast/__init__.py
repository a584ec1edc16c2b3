"""Volume and transfer function to coefficient image: the slow stage, once per view."""

from volspec.raycast.image import CoefficientImage
from volspec.raycast.spec import Camera, RaycastSpec

__all__ = ["Camera", "CoefficientImage", "RaycastSpec"]
