"""Scalar grids: values on a regular lattice, and where that lattice lies in the world."""

from volspec.volume import phantom
from volspec.volume.load import load_volume
from volspec.volume.model import Volume

__all__ = ["Volume", "load_volume", "phantom"]
