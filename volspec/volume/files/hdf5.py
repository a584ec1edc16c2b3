"""Datasets of HDF5 files through h5py.

    file -> dataset (Z, Y, X), or (T, Z, Y, X) -> [hdf5] -> Reading

The spacing is that of ImageJ's HDF5 plugin and ilastik: ``element_size_um`` of the dataset, in
micrometres along z, y, x.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from volspec.errors import DeviceError, VolumeError, nearest, one_line
from volspec.volume.checks import checked_geometry
from volspec.volume.files.lattice import spacing_text
from volspec.volume.files.query import Choice, Query, Reading
from volspec.volume.pyramid import Index, Level, Stack

SUFFIXES = (".h5", ".hdf5", ".he5")
# Voxels along z and y of a chunk of a dataset without chunks.
_ROWS = 16, 128
_DAMAGE = (KeyError, TypeError, ValueError, OSError, RuntimeError)


class Dataset:
    """Array of a dataset, whose file is opened when it is read; it can be pickled."""

    def __init__(self, root: Path, name: str) -> None:
        self.root, self._name = root, name
        with self._opened() as dataset:
            self.shape, self.dtype, self.chunks = dataset.shape, dataset.dtype, dataset.chunks
            self.element_size_um = dataset.attrs.get("element_size_um")

    def __reduce__(self) -> tuple[type[Dataset], tuple[Any, ...]]:
        return type(self), (self.root, self._name)

    def __getitem__(self, index: tuple[int | slice, ...]) -> NDArray[Any]:
        with self._opened() as dataset:
            return np.asarray(dataset[index])

    @contextmanager
    def _opened(self) -> Iterator[Any]:
        import h5py

        with h5py.File(self.root, "r") as file:
            yield file[self._name]


def read_hdf5(query: Query) -> Reading:
    """Read a dataset, or one time step of it."""
    query.allow("dataset", "time", "spacing")
    dataset, at = _selected(query)
    query.end_choices()
    query.reserve(dataset.shape[-3:], dataset.dtype.itemsize)
    spacing = _spacing_mm(query, dataset)
    try:
        return Reading(dataset[at], spacing_mm=spacing)
    except _DAMAGE as error:
        raise VolumeError(
            f"{query.path}: a chunk cannot be read ({one_line(error)[:120]}); copy the file again, "
            "or write it with a compression that h5py has (gzip, lzf)",
            code="damaged",
        ) from error


def hdf5_stack(query: Query) -> Stack | None:
    """Return a dataset that is larger than memory as a level; else None."""
    if query.choices is not None or query.path.stat().st_size <= query.most_bytes // 100:
        return None
    dataset, at = _selected(query)
    z, y, x = dataset.shape[-3:]
    if z * y * x * dataset.dtype.itemsize <= query.most_bytes:
        return None
    _, world = checked_geometry(_spacing_mm(query, dataset), None, str(query.path))
    chunk: Index = (min(_ROWS[0], z), min(_ROWS[1], y), x)
    if dataset.chunks is not None:
        chunk = dataset.chunks[-3:]
    first = len(dataset.shape) - 3
    axes = first, first + 1, first + 2
    return Stack([Level(dataset, axes, (*at, 0, 0, 0), world, chunk)])


def _selected(query: Query) -> tuple[Dataset, tuple[int, ...]]:
    """Return the dataset that the query selects, and its time step, if it has several."""
    path = query.path
    try:
        import h5py
    except ImportError as error:
        raise DeviceError(
            f'{path}: is an HDF5 file, which needs h5py; pip install "volspec[hdf5]"',
            code="unsupported",
        ) from error
    found: dict[str, tuple[int, ...]] = {}

    def add(name: str, each: Any) -> None:
        if isinstance(each, h5py.Dataset) and each.dtype.kind in "buif" and each.ndim in (3, 4):
            found[name] = each.shape

    try:
        with h5py.File(path, "r") as file:
            file.visititems(add)
    except _DAMAGE as error:
        raise VolumeError(
            f"{path}: cannot be read as HDF5 ({one_line(error)[:120]}); is it complete?",
            code="damaged",
        ) from error
    if not found:
        raise VolumeError(
            f"{path}: holds no dataset of numbers with three axes (Z, Y, X), or four (T, Z, Y, X)",
            "save one with h5py",
            code="shape",
        )
    dataset = Dataset(path, _named(query, found))
    times = tuple(query.index("time", n, "time steps") for n in dataset.shape[:-3])
    return dataset, times


def _named(query: Query, found: dict[str, tuple[int, ...]]) -> str:
    """Return the name of the dataset that is given, or else of the only one."""
    given = query.options.get("dataset", "").strip("/")
    names = tuple(sorted(found, key=lambda name: (-math.prod(found[name]), name)))
    if query.choices is not None and len(names) > 1:
        sizes = tuple(f"{name} ({' × '.join(map(str, found[name][::-1]))})" for name in names)
        query.choices.append(Choice("dataset", names, sizes, given if given in found else None))
        if given not in found:
            query.end_choices()  # the others depend on it
    if not given and len(names) == 1:
        return names[0]
    if not given:
        raise VolumeError(
            f"{query.path}: holds {len(names)} datasets",
            f"choose one with {query.example(dataset=names[0])}; there are {_listed(names)}",
            code="missing",
        )
    if given not in found:
        raise VolumeError(
            f"{query.path}: has no dataset {given!r} of three or four axes",
            f"{nearest(given, names, count=1)}there are {_listed(names)}",
            code="unknown",
            given=given,
        )
    return given


def _listed(names: tuple[str, ...], most: int = 8) -> str:
    return ", ".join(names[:most]) + ", …" * (len(names) > most)


def _spacing_mm(query: Query, dataset: Dataset) -> tuple[float, float, float] | None:
    """Return the spacing that the query or the dataset states, along x, y, z."""
    if query.spacing_mm is not None:
        return query.spacing_mm
    stated = dataset.element_size_um
    if stated is None:
        return None
    z, y, x = (float(um) / 1000 for um in np.ravel(stated))
    if not min(x, y, z) > 0:
        raise VolumeError(
            f"{query.path}: its element_size_um is {stated}, which is not positive",
            f"give the spacing as in {query.example(spacing=spacing_text(1, 1, 1))}",
            code="range",
        )
    return x, y, z
