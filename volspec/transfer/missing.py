"""Transparency of missing voxels, those that are NaN or infinite in the file.

    transfer function, volume -> [missing] -> table -> raycast

Missing voxels hold a value far below all others (`volspec.volume.checks`), and a table shows
nothing below the least value. An interpolated value next to a missing voxel falls below it at
once, so that a cell of eight voxels is transparent if one of them is missing: no value is made up.
"""

from __future__ import annotations

from dataclasses import replace
from typing import overload

import numpy as np
from numpy.typing import NDArray

from volspec.errors import TransferError, nearest
from volspec.transfer.discrete import Isosurfaces, LabelFunction
from volspec.transfer.fields import OWN, FieldFunctions, FieldTables, weighted
from volspec.transfer.model import TransferFunction
from volspec.transfer.regions import TransferFunction2D
from volspec.transfer.table import Entries, SurfaceTable, TransferTable
from volspec.volume import Volume

_Transfer = TransferFunction | TransferFunction2D | LabelFunction | Isosurfaces
# Most entries of a table.
_MOST_ENTRIES = 1 << 16


@overload
def bake_for_volume(transfer: _Transfer, volume: Volume) -> TransferTable | SurfaceTable: ...
@overload
def bake_for_volume(
    transfer: _Transfer | FieldFunctions, volume: Volume
) -> TransferTable | SurfaceTable | FieldTables: ...
def bake_for_volume(
    transfer: _Transfer | FieldFunctions, volume: Volume
) -> TransferTable | SurfaceTable | FieldTables:
    """Bake a transfer function for a volume, whose missing voxels are transparent.

    Of several fields, the volume's own alone gives a plain table. Raises TransferError if there is
    a function for a field that the volume lacks.
    """
    if isinstance(transfer, FieldFunctions):
        return _bake_fields(transfer, volume)
    return _bake(transfer, volume)


def _bake_fields(transfer: FieldFunctions, volume: Volume) -> TransferTable | FieldTables:
    tables, fields = {}, volume.by_name
    for name in transfer.functions:
        if name not in fields and name != OWN:
            raise TransferError(
                f"{volume.name} has no field {name!r}",
                f"{nearest(name, fields)}it has {', '.join(fields)}",
                code="unknown",
            )
    if OWN in transfer.functions and volume.name in transfer.functions:
        raise TransferError(
            f"{volume.name} has two transfer functions, one without its name",
            "leave out one",
            code="duplicate",
        )
    for given, weight in transfer.shown.items():
        name = given or volume.name
        table = _bake(transfer.functions[given], fields[name])
        assert isinstance(table, TransferTable)
        tables[name] = weighted(table, weight)
    return tables[volume.name] if list(tables) == [volume.name] else FieldTables.in_one(tables)


def _bake(transfer: _Transfer, volume: Volume) -> TransferTable | SurfaceTable:
    table = transfer.bake(min(volume.spacing_mm))
    # Labels below 0 are transparent anyway.
    if volume.missing is None or isinstance(table, SurfaceTable) or table.labels:
        return table
    return transparent_below(table, volume.range[0])


def transparent_below(table: TransferTable, least: float) -> TransferTable:
    """Return a table that is transparent one entry below a value and lower; the rest stays.

    >>> table = TransferTable((0, 2), [0.5, 0.5, 0.1], [[1], [1], [1]], reference_step_mm=1)
    >>> longer = transparent_below(table, -1)
    >>> longer.domain, longer.opacity.tolist()
    ((-2.0, 2), [0.0, 0.5, 0.5, 0.5, 0.1])
    """
    low, high = table.domain
    count = table.opacity.shape[-1]
    entry = (high - low) / (count - 1)
    more = int(np.ceil(max(low - least, 0.0) / entry - 1e-9)) + 1
    if count + more > _MOST_ENTRIES:  # a narrow function in a wide range: entries are widened
        entry = (high - min(low, least)) / (_MOST_ENTRIES - 2)
        start = high - entry * (_MOST_ENTRIES - 1)
        at = start + entry * np.arange(_MOST_ENTRIES)
        positions = np.clip((at - low) / (high - low) * (count - 1), 0, count - 1)
    else:
        start = low - more * entry
        positions = np.maximum(np.arange(-more, count), 0)
    first = np.minimum(positions.astype(np.intp), count - 1)
    fraction = positions - first

    def resampled(
        here: NDArray[np.float64], limits: NDArray[np.float64], axis: int
    ) -> NDArray[np.float64]:
        f = fraction.reshape([-1 if a == axis else 1 for a in range(here.ndim)])
        below = np.take(here, first, axis)
        above = np.take(limits, np.minimum(first + 1, count - 1), axis)
        return np.asarray(below * (1 - f) + above * f)

    def entries(here: TransferTable, limits: TransferTable) -> Entries:
        along = table.opacity.ndim - 1
        opacity = resampled(here.opacity, limits.opacity, along)
        opacity[..., 0] = 0.0
        weights = resampled(here.material_weights, limits.material_weights, along)
        if here.filters is None or limits.filters is None:
            return Entries(opacity, weights, None)
        return Entries(opacity, weights, resampled(here.filters, limits.filters, 0))

    opacity, weights, filters = entries(table, table.left_limits)
    left = None if table.left is None else entries(table.left_limits, table.left_limits)
    return replace(
        table,
        domain=(start, high),
        opacity=opacity,
        material_weights=weights,
        filters=filters,
        left=left,
    )
