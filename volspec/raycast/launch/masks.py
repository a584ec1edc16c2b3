"""Rows of a mask on its lattice: which of a field's transfer functions is at a place.

    Volume, MaskTables -> [masks] -> raycast

Row 0 is the field's own function, also around the lattice, which is one voxel wider on every side
than the field of labels. The weights of a place's corners are those of their rows:

    w_r = sum of the trilinear weights of the corners that have row r
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import reduce

import numpy as np
from numpy.typing import NDArray

from volspec.raycast.launch.bricks import BRICK, brick_ranges
from volspec.transfer import MaskTables
from volspec.volume import Volume

Array = NDArray[np.float64]
Rows = NDArray[np.uint8]
MIXED = 256
"""Set in the code of a voxel whose cell, from it to the next along each axis, has several rows."""
# Voxels by which places on a lattice may be off, by rounding.
_ON_VOXEL = 1e-6


@dataclass(frozen=True, slots=True, eq=False)
class MaskLattice:
    """Rows around the voxels of a field of labels, for the masked field."""

    rows: Rows  # (Z + 2, Y + 2, X + 2)
    from_index: Array  # (3, 4): from the masked field's index to one of `rows`
    field: Volume
    same: bool  # both fields have the same lattice

    @classmethod
    def of(cls, volume: Volume, name: str, mask: MaskTables) -> MaskLattice:
        """Return the rows for a volume's field."""
        labels, field = volume.by_name[mask.field], volume.by_name[name]
        rows = np.zeros([n + 2 for n in labels.values.shape], np.uint8)
        table, first = None, 0
        if labels.values.dtype.kind in "iu":
            codes = np.iinfo(labels.values.dtype)
            table, first = mask.rows_at(np.arange(codes.min, codes.max + 1)), codes.min
        for inner, plane in zip(rows[1:-1, 1:-1, 1:-1], labels.values, strict=True):
            inner[:] = (
                mask.rows_at(plane) if table is None else table[plane.astype(np.int32) - first]
            )
            if labels.missing is not None:
                inner[plane == labels.missing] = 0
        same = field.has_lattice_of(labels)
        matrix = np.eye(4) if same else labels.index_from_world @ field.world_from_index
        return cls(rows, matrix[:3] + np.eye(4)[3], field, same)

    @property
    def last(self) -> NDArray[np.int64]:
        """(3,) largest index along x, y, z."""
        return np.array(self.rows.shape[::-1]) - 1

    def codes(self) -> NDArray[np.uint16]:
        """Return the rows as the kernel reads them, with `MIXED`."""
        minimum, maximum = self.rows, self.rows
        for axis in range(3):
            minimum, maximum = (
                extreme(bound, np.roll(bound, -1, axis))
                for extreme, bound in ((np.minimum, minimum), (np.maximum, maximum))
            )
        codes = self.rows.astype(np.uint16)
        codes[minimum != maximum] |= MIXED
        return codes

    def weights(self, point: Array, count: int) -> Array:
        """Return the (R, count) weights of rows at (R, 3) indices of the field."""
        position = np.clip(point @ self.from_index[:, :3].T + self.from_index[:, 3], 0, self.last)
        base = np.minimum(position.astype(int), self.last - 1)
        sides = np.stack([1 - (position - base), position - base])
        weights = np.zeros((len(point), count))
        for corner in np.ndindex(2, 2, 2):
            x, y, z = (base + corner).T
            factors = (sides[side, :, axis] for axis, side in enumerate(corner))
            np.add.at(
                weights, (np.arange(len(point)), self.rows[z, y, x]), reduce(np.multiply, factors)
            )
        return weights

    def nearest(self, point: Array) -> Rows:
        """Return the rows (…,) of the voxels nearest to (…, 3) indices of the field."""
        position = np.floor(point @ self.from_index[:, :3].T + self.from_index[:, 3] + 0.5)
        x, y, z = np.moveaxis(np.clip(position, 0, self.last).astype(int), -1, 0)
        return np.asarray(self.rows[z, y, x])

    def nearest_to_voxels(self, steps: tuple[int, int, int] = (1, 1, 1)) -> Rows:
        """Return the rows (Z, Y, X) nearest to the field's voxels, or to every n-th of them."""
        axes = [np.arange(0, n, s) for n, s in zip(self.field.values.shape, steps, strict=True)]
        places = np.stack(np.meshgrid(*axes[1:], indexing="ij")[::-1], axis=-1)
        planes = [np.insert(places.astype(np.float64), 2, z, axis=-1) for z in axes[0]]
        return np.stack([self.nearest(plane) for plane in planes])

    def brick_ranges(self) -> tuple[Rows, Rows]:
        """Return the least and the greatest row in each of the field's bricks."""
        if self.same:
            return brick_ranges(self.rows[1:-1, 1:-1, 1:-1])
        # Imported late: it takes a quarter of a second, and few masks differ in lattice.
        from scipy.ndimage import maximum_filter, minimum_filter

        bricks = [-(-n // BRICK) for n in self.field.values.shape]
        middles = np.moveaxis(np.indices(bricks)[::-1], 0, -1) * BRICK + BRICK / 2
        position = middles @ self.from_index[:, :3].T + self.from_index[:, 3]
        half = np.abs(self.from_index[:, :3]).sum(axis=1) * BRICK / 2
        size = [2 * math.ceil(h + 0.5 - _ON_VOXEL) + 1 for h in half[::-1]]
        x, y, z = np.moveaxis(np.clip(np.rint(position), 0, self.last).astype(int), -1, 0)
        minimum, maximum = (
            extremum(self.rows, size, mode="nearest")[z, y, x]
            for extremum in (minimum_filter, maximum_filter)
        )
        return minimum, maximum
