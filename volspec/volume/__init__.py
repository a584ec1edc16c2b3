"""Scalar volumes: values on a regular lattice, its geometry, and file readers."""

from volspec.volume import phantom
from volspec.volume.load import load_volume
from volspec.volume.model import Volume

__all__ = ["Volume", "load_volume", "phantom"]
