"""Transparency of missing voxels, those that are NaN or infinite in the file.

    transfer function, volume -> [missing] -> table -> raycast

Missing voxels hold a value far below all others (`volspec.volume.checks`), and a table shows
nothing below the least value. An interpolated value next to a missing voxel falls below it at
once, so that a cell of eight voxels is transparent if one of them is missing: no value is made up.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import overload

import numpy as np
from numpy.typing import NDArray

from volspec.errors import TransferError, nearest
from volspec.transfer.discrete import LabelFunction
from volspec.transfer.fields import (
    OWN,
    FieldFunctions,
    FieldTables,
    Label,
    Mask,
    MaskTables,
    scale_taus,
)
from volspec.transfer.kinds import Table, Tables, Transfer, Transfers
from volspec.transfer.label_look import unique_names
from volspec.transfer.model import TransferFunction
from volspec.transfer.table import MAX_LABEL, Entries, SurfaceTable, TransferTable
from volspec.volume import Volume, are_whole

# Most entries of a table.
_MAX_ENTRIES = 1 << 16
# Most labels that a message lists.
_MAX_NAMED = 12


@overload
def bake_for_volume(transfer: Transfer, volume: Volume) -> Table: ...
@overload
def bake_for_volume(transfer: Transfers, volume: Volume) -> Tables: ...
def bake_for_volume(transfer: Transfers, volume: Volume) -> Tables:
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
    masks = {}
    for key, weight in transfer.shown.items():
        name, function = key or volume.name, transfer.functions[key]
        table = _bake(function, fields[name])
        assert isinstance(table, TransferTable)
        tables[name] = scale_taus(table, weight)
        if key in transfer.masks:
            mask = transfer.masks[key]
            curves = [curve for curve in mask.curves if curve is not function]
            where = f"FieldFunctions.masks[{key!r}]"
            try:
                labels = MaskLabels.of(mask.field, volume)
            except TransferError as error:
                raise error.at(f"{where}.field") from None
            masks[name] = MaskTables(
                labels.field.name,
                tuple(
                    scale_taus(_bake_row(curve, fields[name], table), weight) for curve in curves
                ),
                *_rows_between(mask, curves, labels, where),
            )
    if list(tables) == [volume.name] and not masks:
        return tables[volume.name]
    return FieldTables.in_one(tables, masks)


@dataclass(slots=True)
class MaskLabels:
    """A mask's labels and bands of values, as bands of its field's values without overlaps."""

    field: Volume
    bands: list[tuple[float, float, Label]]
    may_be_labels: bool | None = None  # None until that is asked

    @classmethod
    def of(cls, name: str, volume: Volume) -> MaskLabels:
        """Return none yet, of a volume's field. Raises TransferError if there is no such field."""
        fields = volume.by_name
        field = volume if name == OWN else fields.get(name)
        if field is None:
            raise TransferError(
                f"{volume.name} has no field {name!r}",
                f"{nearest(name, fields)}it has {', '.join(fields)}",
                code="unknown",
            )
        return cls(field, [])

    def add(self, label: Label) -> tuple[float, float]:
        """Add a label, or a band of values; return the values (from, to), without ``to``.

        Raises TransferError if the field is no segmentation, names no label so, the number is not
        one of a label, or the values are those of another.
        """
        low, high = label if isinstance(label, tuple) else self._of_label(label)
        for first, last, other in self.bands:
            if low < last and first < high:
                alike = (low, high) == (first, last)
                problem = f"{other!r} {'is the same' if alike else 'has some of the same values'}"
                raise TransferError(problem, "leave out one", code="duplicate")
        self.bands.append((low, high, label))
        return low, high

    def reaches(self, low: float, high: float) -> bool:
        """Return True if the field's range has some of the values (from, to)."""
        minimum, maximum = self.field.range
        return low <= maximum and minimum < high

    def _of_label(self, label: int | str) -> tuple[float, float]:
        field = self.field
        if self.may_be_labels is None:
            self.may_be_labels = are_whole(field.values, field.range)
        if not self.may_be_labels:
            low, high = field.range
            raise TransferError(
                f"the values of {field.name!r}, {low:g} to {high:g}, are not labels",
                f"give a segmentation, whole numbers from 0 to {MAX_LABEL}, or bands of values",
                code="type",
            )
        if not isinstance(label, str):
            if label < 0:
                raise TransferError.refused("", label, "give 0 or more", "range")
            value = field.value_of(label)
            return value, value + 1
        named = {number: entry for number, entry in field.labels.items() if entry.name}
        names = {name: number for number, name in unique_names(named).items()}
        if label not in names:
            more = ", …" if len(names) > _MAX_NAMED else ""
            listed = f"it has {', '.join([*names][:_MAX_NAMED])}{more}"
            choices = listed if names else "it names none"
            raise TransferError(
                f"{field.name!r} has no label {label!r}",
                f"{nearest(label, names)}{choices}; or give its number",
                code="unknown",
            )
        value = field.value_of(names[label])
        return value, value + 1


def _bake_row(
    function: TransferFunction | None, volume: Volume, base: TransferTable
) -> TransferTable:
    """Bake the function of a label; without one, the transparent one."""
    if function is not None:
        table = _bake(function, volume)
        assert isinstance(table, TransferTable)
        return table
    weights = np.zeros((2, base.material_weights.shape[1]))
    return replace(base, opacity=np.zeros(2), material_weights=weights, left=None)


def _rows_between(
    mask: Mask, curves: Sequence[TransferFunction | None], labels: MaskLabels, where: str
) -> tuple[NDArray[np.float64], NDArray[np.uint8]]:
    """Return the values at which rows change, and the rows: 1 for the first curve, 0 for none."""
    rows = {id(curve): row for row, curve in enumerate(curves, start=1)}
    bands = []
    for label, function in mask.functions.items():
        try:
            bands.append((*labels.add(label), rows.get(id(function), 0)))
        except TransferError as error:
            raise error.at(f"{where}.functions[{label!r}]") from None
    edges = np.unique([end for band in bands for end in band[:2]])
    between = np.zeros(len(edges) + 1, np.uint8)
    for low, high, row in bands:
        between[np.searchsorted(edges, low) + 1 : np.searchsorted(edges, high) + 1] = row
    return edges, between


def _bake(transfer: Transfer, volume: Volume) -> Table:
    if isinstance(transfer, LabelFunction):
        _require_values(transfer, volume)
        return transfer.bake(volume.smallest_mm, volume.numbers)
    table = transfer.bake(volume.smallest_mm)
    if volume.missing is None or isinstance(table, SurfaceTable):
        return table
    return transparent_below(table, volume.range[0])


def _require_values(transfer: LabelFunction, volume: Volume) -> None:
    """Refuse labels that voxels have, but cannot be cast as they are."""
    largest = max(transfer.labels)
    if not volume.numbers and MAX_LABEL < largest <= volume.range[1]:
        raise TransferError(
            f"label {largest} of {volume.name} is above {MAX_LABEL}",
            "make the volume with its labels, Volume(values, labels={number: Label(name), …})",
            code="range",
            field="LabelFunction.labels",
            given=largest,
        )


def transparent_below(table: TransferTable, minimum: float) -> TransferTable:
    """Return a table that is transparent one entry below a value and lower; the rest stays.

    >>> table = TransferTable((0, 2), [0.5, 0.5, 0.1], [[1], [1], [1]], reference_step_mm=1)
    >>> longer = transparent_below(table, -1)
    >>> longer.domain, longer.opacity.tolist()
    ((-2.0, 2), [0.0, 0.5, 0.5, 0.5, 0.1])
    """
    low, high = table.domain
    count = table.opacity.shape[-1]
    entry = (high - low) / (count - 1)
    more = int(np.ceil(max(low - minimum, 0.0) / entry - 1e-9)) + 1
    if count + more > _MAX_ENTRIES:  # a narrow function in a wide range: entries are widened
        entry = (high - min(low, minimum)) / (_MAX_ENTRIES - 2)
        start = high - entry * (_MAX_ENTRIES - 1)
        values = start + entry * np.arange(_MAX_ENTRIES)
        positions = np.clip((values - low) / (high - low) * (count - 1), 0, count - 1)
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
        axis = table.opacity.ndim - 1
        opacity = resampled(here.opacity, limits.opacity, axis)
        opacity[..., 0] = 0.0
        weights = resampled(here.material_weights, limits.material_weights, axis)
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
