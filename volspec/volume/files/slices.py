"""Stacks that are read slice by slice, as levels of volumes that are larger than memory.

reader of a slice -> [slices] -> Level
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import DTypeLike, NDArray

from volspec.volume.checks import checked_geometry
from volspec.volume.pyramid import Index, Level

# Bytes of the slices of a chunk.
_CHUNK_BYTES = 2**24


Read = Callable[[Sequence[int]], Iterable[NDArray[Any]]]
"""Returns slices (Y, X) by their numbers; can be pickled."""


class Slices:
    """Array (Z, Y, X) whose slices are read as a whole.

    Parameters
    ----------
    root : path
        The file or folder.
    shape : (Z, Y, X)
    dtype : dtype
    read : Read
    """

    def __init__(self, root: Path, shape: Index, dtype: DTypeLike, read: Read) -> None:
        self.root, self.shape, self.dtype, self._read = root, shape, np.dtype(dtype), read

    def __reduce__(self) -> tuple[type[Slices], tuple[Any, ...]]:
        return type(self), (self.root, self.shape, self.dtype, self._read)

    def __getitem__(self, index: tuple[slice, slice, slice]) -> NDArray[Any]:
        slices = self._read(range(self.shape[0])[index[0]])
        return np.stack([each[index[1:]] for each in slices])


def level_of_slices(slices: Slices, spacing_mm: tuple[float, float, float] | None) -> Level:
    """Return a stack as a level whose chunks are whole slices. Raises VolumeError for a spacing."""
    _, world = checked_geometry(spacing_mm, None, str(slices.root))
    count, rows, columns = slices.shape
    together = max(min(_CHUNK_BYTES // (rows * columns * slices.dtype.itemsize), 16, count), 1)
    return Level(slices, (0, 1, 2), (0, 0, 0), world, (together, rows, columns))
