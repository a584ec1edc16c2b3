"""What scene files and palettes share: how a table is read, the viewing, and complaints in words.

appearance -> [_tables] -> palette, scene
"""

from volspec._tables.base import Box, Name, Pair, Table, Vector, value_or_table
from volspec._tables.messages import explained, faults
from volspec._tables.viewing import CurveTable, DisplayTable, SpaceTable, ViewedTable

__all__ = [
    "Box",
    "CurveTable",
    "DisplayTable",
    "Name",
    "Pair",
    "SpaceTable",
    "Table",
    "Vector",
    "ViewedTable",
    "explained",
    "faults",
    "value_or_table",
]
