"""Scalar volumes: values on a regular lattice, its geometry, and file readers."""

from volspec.volume import phantom
from volspec.volume.files.query import Choice
from volspec.volume.load import load_volume, volume_choices
from volspec.volume.metadata import Metadata
from volspec.volume.model import Volume
from volspec.volume.series import Series, load_series

__all__ = [
    "Choice",
    "Metadata",
    "Series",
    "Volume",
    "load_series",
    "load_volume",
    "phantom",
    "volume_choices",
]
