"""Coefficient images: files, layers of opacity, effects of depth, reprojection."""

from volspec.image.depth import DepthEffects
from volspec.image.model import CoefficientImage

__all__ = ["CoefficientImage", "DepthEffects"]
