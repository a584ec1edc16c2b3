"""From a scalar to what is seen: opacity and reflectance, baked to a table of channels."""

from volspec.transfer.labels import LabelFunction
from volspec.transfer.model import TransferFunction
from volspec.transfer.preintegrated import NEAREST_POSITIONS, integral_rows, segment_means
from volspec.transfer.regions import Region, TransferFunction2D
from volspec.transfer.surfaces import Isosurfaces
from volspec.transfer.table import (
    MAX_CHANNELS,
    MAX_LABEL,
    MAX_SURFACES,
    SurfaceTable,
    TransferTable,
)

Transfer = TransferFunction | TransferFunction2D | LabelFunction | Isosurfaces

__all__ = [
    "MAX_CHANNELS",
    "MAX_LABEL",
    "MAX_SURFACES",
    "NEAREST_POSITIONS",
    "Isosurfaces",
    "LabelFunction",
    "Region",
    "SurfaceTable",
    "Transfer",
    "TransferFunction",
    "TransferFunction2D",
    "TransferTable",
    "integral_rows",
    "segment_means",
]
