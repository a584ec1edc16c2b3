"""The coefficient image of all values of a volume, with which slices are lit.

    volume, transfer -> [slice_table] -> CoefficientImage -> Relighter -> slice_pictures

A slice's colours depend on its voxels' values alone, so relighting a table of all values takes
the same few milliseconds however large the slices are. Slices of several fields are images of
their own.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from volspec.basis import Basis
from volspec.image import CoefficientImage
from volspec.raycast import RaycastSpec
from volspec.raycast.launch import MaskLattice, extinction_per_mm
from volspec.transfer import (
    MAX_LABEL,
    FieldTables,
    LabelFunction,
    SurfaceTable,
    Transfer,
    Transfers,
    TransferTable,
    bake_for_volume,
)
from volspec.volume import Volume

# Entries of a table, except for volumes of small integers.
ENTRIES = 4096
# A voxel is as opaque as a slab of this many reference steps; the rest stays grey.
SLAB_STEPS = 16
# Approximate exponent from a display's greys to reflectances.
_GAMMA = 2.2


@dataclass(frozen=True, slots=True)
class ValueEntries:
    """Values of a table: ``dense`` integers from ``first`` on, then ``sparse`` ones to ``last``.

    The last ones are evenly spaced.
    """

    first: float
    dense: int
    last: float
    sparse: int

    @property
    def count(self) -> int:
        """Number of entries."""
        return self.dense + self.sparse

    @property
    def values(self) -> NDArray[np.float64]:
        """(count,) ascending values."""
        after = self.first + self.dense
        evenly = np.linspace(min(after, self.last), self.last, self.sparse)
        return np.r_[self.first + np.arange(self.dense), evenly]

    def codes(self, values: NDArray[np.generic]) -> NDArray[np.uint32]:
        """Return the indices of the nearest entries."""
        index = values.astype(np.float64) - self.first
        if self.sparse:
            span = self.last - self.first - self.dense
            scale = (self.sparse - 1) / span if span > 0 else 0.0
            index = np.where(index < self.dense, index, self.dense + (index - self.dense) * scale)
        return np.rint(np.clip(index, 0, self.count - 1)).astype(np.uint32)


def table_entries(volume: Volume, labels: bool) -> ValueEntries:
    """Return a volume's entries: every value if these are few integers, or every label.

    Labels in volumes of floats are integers too.
    """
    low, high = volume.typical_range
    count = int(high - low) + 1
    if volume.values.dtype.kind in "iu" and count <= ENTRIES:
        return ValueEntries(low, count, high, 0)
    if volume.missing is not None:  # the first entry is for missing voxels
        low -= (high - low) / ENTRIES
    if not labels:
        return ValueEntries(low, 0, high, ENTRIES)
    first = max(low, -1.0)  # lower ones are transparent as well
    named = max(int(min(high, MAX_LABEL) - first) + 1, 0)
    return ValueEntries(first, named, high, ENTRIES if high > MAX_LABEL else 0)


def greys(
    entries: ValueEntries, span: tuple[float, float], window: tuple[float, float]
) -> NDArray[np.float64]:
    """(count,) greys of a table's entries, 0 to 1; a window of width 0 is a step."""
    low, high = window
    width = span[1] - span[0]
    fraction = (entries.values - span[0]) / width if width > 0 else np.zeros(entries.count)
    return np.clip((fraction - low) / max(high - low, 1e-6), 0.0, 1.0)


def table_image(
    volume: Volume, transfer: Transfer, shading: RaycastSpec, window: tuple[float, float]
) -> CoefficientImage:
    """Return a coefficient image of one row: all values of a volume, in each light group of a cast.

    Values that the transfer function shows have their materials' reflectance, others a grey.
    """
    entries = table_entries(volume, isinstance(transfer, LabelFunction))
    table = bake_for_volume(transfer, volume)
    opacity, weights = _look_up(table, entries.values)
    alpha = (1 - (1 - opacity) ** SLAB_STEPS)[:, None]
    grey = greys(entries, volume.typical_range, window)[:, None] ** _GAMMA * table.white
    channels = alpha * (weights @ table.channels) + (1 - alpha) * grey
    groups = shading.shares()
    # A slice faces every source.
    layers = np.concatenate([channels * part for part in groups.values()], axis=1)
    ones = np.ones((1, entries.count), np.float32)
    pixels = layers[None].astype(np.float32)
    return CoefficientImage(pixels, ones, ones, transfer.basis, groups=groups)


@dataclass(frozen=True, slots=True, eq=False)
class FieldSlices:
    """Tables of several fields, and lattices of their masks, for slices."""

    volume: Volume
    basis: Basis
    tables: FieldTables
    masks: Mapping[str, MaskLattice]

    @classmethod
    def of(
        cls, volume: Volume, transfer: Transfers, before: FieldSlices | None = None
    ) -> FieldSlices:
        """Bake the transfer functions of a volume's fields.

        Lattices of masks are those of ``before`` if it has the same.
        """
        tables = bake_for_volume(transfer, volume)
        if not isinstance(tables, FieldTables):
            assert isinstance(tables, TransferTable)  # of one field alone
            tables = FieldTables.in_one({volume.name: tables})
        cache = {}
        if before is not None and before.volume is volume:
            cache = {before.tables.masks[name].key: grid for name, grid in before.masks.items()}
        masks = {
            name: cache.get(mask.key) or MaskLattice.of(volume, name, mask)
            for name, mask in tables.masks.items()
        }
        return cls(volume, transfer.basis, tables, masks)

    def image(
        self, index: NDArray[np.float64], window: tuple[float, float], shading: RaycastSpec
    ) -> CoefficientImage:
        """Return the slice at (rows, columns, 3) indices of the volume, in each light group.

        Extinctions of a slab add, as in a cast; what it lets through is a grey of the volume's own
        field.
        """
        size, volume = index.shape[:2], self.volume
        place = index.reshape(-1, 3)
        depth, mixed = np.zeros(len(place)), np.zeros((len(place), self.tables.size))
        slab_mm = SLAB_STEPS * min(volume.spacing_mm)
        for name in self.tables.tables:
            field = volume.by_name[name]
            values, voxels, inside = _values_at(field, volume, place)
            rows = self.tables.rows(name)
            weights = inside[:, None].astype(np.float64)
            if name in self.masks:
                weights = weights * self.masks[name].weights(voxels, len(rows))
            for weight, table in zip(weights.T, rows, strict=True):
                opacity, mix = _look_up(table, values)
                per_mm = extinction_per_mm(opacity, table.reference_step_mm)
                part = weight * slab_mm * per_mm
                depth += part
                mixed += part[:, None] * (mix @ table.channels)
        alpha = -np.expm1(-depth)[:, None]
        low, high = volume.typical_range
        greyscale = (_values_at(volume, volume, place)[0] - low) / ((high - low) or 1.0)
        shade = np.clip((greyscale - window[0]) / max(window[1] - window[0], 1e-6), 0.0, 1.0)
        grey = shade[:, None] ** _GAMMA * self.tables.white
        channels = alpha * mixed / np.maximum(depth, 1e-30)[:, None] + (1 - alpha) * grey
        groups = shading.shares()
        layers = np.concatenate([channels * part for part in groups.values()], axis=1)
        ones = np.ones(size, np.float32)
        pixels = layers.reshape(*size, -1).astype(np.float32)
        return CoefficientImage(pixels, ones, ones, self.basis, groups=groups)


def _values_at(
    field: Volume, volume: Volume, place: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.bool_]]:
    """Return a field's values nearest to (N, 3) indices of a volume, and where these are in it.

    The last array is False outside the field, where the values are those of its border.
    """
    voxels = place
    if not field.has_lattice_of(volume):
        matrix = field.index_from_world @ volume.world_from_index
        voxels = place @ matrix[:3, :3].T + matrix[:3, 3]
    last = np.array(field.shape_xyz) - 1
    inside = np.asarray(((voxels >= -0.5) & (voxels <= last + 0.5)).all(axis=1))
    x, y, z = np.clip(np.rint(voxels), 0, last).astype(np.intp).T
    return field.values[z, y, x].astype(np.float64), voxels, inside


def _look_up(
    table: TransferTable | SurfaceTable, values: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return (N,) opacities and (N, K) material weights of values."""
    if isinstance(table, SurfaceTable):  # the inside of a surface has its material
        inside = np.searchsorted(table.values, values, side="right") - 1
        return np.where(inside < 0, 0.0, table.opacity[inside]), table.material_weights[inside]
    opacity, mix = table.opacity, table.material_weights
    if opacity.ndim == 2:  # varies with the gradient; a slice shows the mean
        weights = np.maximum(opacity, 1e-9)[..., None]
        mix = (mix * weights).sum(axis=0) / weights.sum(axis=0)
        opacity = opacity.max(axis=0)
    low, high = table.domain
    position = np.clip((values - low) / (high - low), 0.0, 1.0) * (len(opacity) - 1)
    nearest = np.rint(position).astype(np.intp)
    beyond = table.labels & (values > high)
    return np.where(beyond, 0.0, opacity[nearest]), mix[nearest]
