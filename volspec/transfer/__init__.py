"""Transfer functions: opacity and reflectance by scalar value, baked into a table of channels."""

from volspec.transfer.discrete import Isosurfaces, LabelFunction
from volspec.transfer.model import TransferFunction
from volspec.transfer.regions import Region, TransferFunction2D
from volspec.transfer.table import (
    MAX_CHANNELS,
    MAX_LABEL,
    MAX_SURFACES,
    NEAREST_POSITIONS,
    SurfaceTable,
    TransferTable,
    integral_rows,
    segment_means,
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
