"""Transfer functions: opacity and reflectance by scalar value, baked into a table of channels."""

from volspec.transfer.discrete import Isosurfaces, LabelFunction
from volspec.transfer.fields import FieldFunctions, FieldTables, Mask
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
from volspec.volume.channels import MAX_FIELDS

Transfer = TransferFunction | TransferFunction2D | LabelFunction | Isosurfaces
Transfers = Transfer | FieldFunctions
Table = TransferTable | SurfaceTable  # of one field
Tables = Table | FieldTables

__all__ = [
    "MAX_CHANNELS",
    "MAX_FIELDS",
    "MAX_LABEL",
    "MAX_SURFACES",
    "NEAREST_POSITIONS",
    "FieldFunctions",
    "FieldTables",
    "Isosurfaces",
    "LabelFunction",
    "Mask",
    "Region",
    "SurfaceTable",
    "Table",
    "Tables",
    "Transfer",
    "TransferFunction",
    "TransferFunction2D",
    "TransferTable",
    "Transfers",
    "integral_rows",
    "segment_means",
]
