"""Scalar volumes: values on a regular lattice, its geometry, and file readers."""

from volspec.volume import phantom
from volspec.volume.files.query import Choice
from volspec.volume.load import load_volume, volume_choices
from volspec.volume.model import Volume

__all__ = ["Choice", "Volume", "load_volume", "phantom", "volume_choices"]
