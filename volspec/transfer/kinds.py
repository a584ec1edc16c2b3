"""Kinds of transfer functions and of their tables, as types."""

from typing import TypeAlias

from volspec.transfer.discrete import Isosurfaces, LabelFunction
from volspec.transfer.fields import FieldFunctions, FieldTables
from volspec.transfer.model import TransferFunction
from volspec.transfer.regions import TransferFunction2D
from volspec.transfer.table import SurfaceTable, TransferTable

Transfer: TypeAlias = TransferFunction | TransferFunction2D | LabelFunction | Isosurfaces
Transfers: TypeAlias = Transfer | FieldFunctions
Table: TypeAlias = TransferTable | SurfaceTable  # of one field
Tables: TypeAlias = Table | FieldTables
