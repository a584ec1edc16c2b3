"""The colours of all values that a volume has: what slices are lit by.

    volume, transfer -> [slice_table] -> CoefficientImage -> Relighter -> slice_pictures

What a slice shows depends on the voxels' values alone. So a light is not put on pixels but on the
table of all values, a coefficient image of some thousand pixels: a swap takes the same few
milliseconds however large the slices are.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from volspec.raycast import CoefficientImage, RaycastSpec
from volspec.transfer import MAX_LABEL, LabelFunction, SurfaceTable, Transfer, TransferTable
from volspec.volume import Volume

# Entries of a table of values that are no small integers.
ENTRIES = 4096
# A voxel shows its material as a slab of so many reference steps would; the rest stays grey.
SLAB_STEPS = 16
# Greys of a display stand for reflectances by about this power.
_GAMMA = 2.2


@dataclass(frozen=True, slots=True)
class Entries:
    """The values that a table of colours has: whole numbers one by one, then others evenly.

    Parameters
    ----------
    first : float
    whole : int
        How many whole numbers from there on.
    last : float
    rest : int
        How many values from the whole ones on to the last.
    """

    first: float
    whole: int
    last: float
    rest: int

    @property
    def count(self) -> int:
        """How many."""
        return self.whole + self.rest

    @property
    def values(self) -> NDArray[np.float64]:
        """(count,) rising."""
        after = self.first + self.whole
        evenly = np.linspace(min(after, self.last), self.last, self.rest)
        return np.r_[self.first + np.arange(self.whole), evenly]

    def codes(self, values: NDArray[np.generic]) -> NDArray[np.uint32]:
        """Where values stand: the nearest entry."""
        at = values.astype(np.float64) - self.first
        if self.rest:
            span = self.last - self.first - self.whole
            scale = (self.rest - 1) / span if span > 0 else 0.0
            at = np.where(at < self.whole, at, self.whole + (at - self.whole) * scale)
        return np.rint(np.clip(at, 0, self.count - 1)).astype(np.uint32)


def entries_of(volume: Volume, labels: bool) -> Entries:
    """A volume's: one a value where these are few whole numbers, or labels that can be named.

    Labels of volumes of floats are whole numbers too.
    """
    low, high = volume.range
    count = int(high - low) + 1
    if volume.values.dtype.kind in "iu" and count <= ENTRIES:
        return Entries(low, count, high, 0)
    if not labels:
        return Entries(low, 0, high, ENTRIES)
    first = max(low, -1.0)  # what is less is as transparent
    named = max(int(min(high, MAX_LABEL) - first) + 1, 0)
    return Entries(first, named, high, ENTRIES if high > MAX_LABEL else 0)


def greys(
    entries: Entries, span: tuple[float, float], window: tuple[float, float]
) -> NDArray[np.float64]:
    """(count,) 0 to 1 for a table's entries; a window of no width is a step."""
    low, high = window
    width = span[1] - span[0]
    at = (entries.values - span[0]) / width if width > 0 else np.zeros(entries.count)
    return np.clip((at - low) / max(high - low, 1e-6), 0.0, 1.0)


def table_image(
    volume: Volume, transfer: Transfer, shading: RaycastSpec, window: tuple[float, float]
) -> CoefficientImage:
    """All values of a volume as a coefficient image of one row, in each of a cast's light groups.

    Values that the transfer function shows have their materials' reflectance, others a grey.
    """
    entries = entries_of(volume, isinstance(transfer, LabelFunction))
    values, count = entries.values, entries.count
    table = transfer.bake(min(volume.spacing_mm))
    opacity, shares = _looked_up(table, values)
    share = (1 - (1 - opacity) ** SLAB_STEPS)[:, None]
    grey = greys(entries, volume.range, window)[:, None] ** _GAMMA * table.white
    channels = share * (shares @ table.channels) + (1 - share) * grey
    groups = shading.shares()
    # A slice faces every source.
    layers = np.concatenate([channels * part for part in groups.values()], axis=1)
    ones = np.ones((1, count), np.float32)
    return CoefficientImage(
        layers[None].astype(np.float32), ones, ones, transfer.basis, groups=groups
    )


def _looked_up(
    table: TransferTable | SurfaceTable, values: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """(N,) opacity and (N, K) shares of values."""
    if isinstance(table, SurfaceTable):  # what is inside a surface is made of it
        inside = np.searchsorted(table.values, values, side="right") - 1
        return np.where(inside < 0, 0.0, table.opacity[inside]), table.shares[inside]
    opacity, shares = table.opacity, table.shares
    if opacity.ndim == 2:  # over gradients, which a slice does not tell: their mean
        weights = np.maximum(opacity, 1e-9)[..., None]
        shares = (shares * weights).sum(axis=0) / weights.sum(axis=0)
        opacity = opacity.max(axis=0)
    low, high = table.domain
    at = np.clip((values - low) / (high - low), 0.0, 1.0) * (len(opacity) - 1)
    nearest = np.rint(at).astype(np.intp)
    beyond = table.labels & (values > high)
    return np.where(beyond, 0.0, opacity[nearest]), shares[nearest]
