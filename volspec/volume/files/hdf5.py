"""Datasets of HDF5 files through h5py: plain ones, ilastik's, NeXus' and BigDataViewer's.

    file -> dataset -> [hdf5] -> Reading

The axes of a dataset are those that it states: ``axistags`` of ilastik (vigra), the axes of NeXus'
``NXdata``, the labels of HDF5's dimensions; else (Z, Y, X), or (T, Z, Y, X). The spacing is
``element_size_um`` of ImageJ's HDF5 plugin and ilastik, in micrometres along z, y, x, or that of
NeXus' coordinates, or of BigDataViewer's project next to the file.

References
----------
[1] BigDataViewer, https://imagej.net/plugins/bdv: ``t00000/s00/0/cells`` are time, setup and level;
    int16 means uint16 unless the setup states a ``dataType``.
"""

from __future__ import annotations

import json
import re
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from volspec.errors import DeviceError, VolumeError, one_line
from volspec.volume.checks import checked_geometry
from volspec.volume.files.bdv import data_of, project_of
from volspec.volume.files.lattice import mm_per_unit
from volspec.volume.files.omezarr import ome_zarr_stack, read_ome_zarr
from volspec.volume.files.query import Query, Reading
from volspec.volume.metadata import NO_SPACING, NO_UNIT, Metadata
from volspec.volume.pyramid import Index, Level, Stack

# Voxels along z and y of a chunk of a dataset without chunks.
_ROWS = 16, 128
DAMAGE = (KeyError, TypeError, ValueError, OSError, RuntimeError)
# Names of axes by the number of a dataset's, if it states none.
_AXES = {3: "zyx", 4: "tzyx"}
_CELLS = re.compile(r"t(\d+)/s(\d+)/(\d+)/cells")


class Dataset:
    """Array of a dataset, whose file is opened when it is read; it can be pickled."""

    def __init__(self, root: Path, name: str) -> None:
        self.root, self._name = root, name
        self.unsigned, self.has_unit = False, True
        with self._opened() as dataset:
            self.shape, self.dtype, self.chunks = dataset.shape, dataset.dtype, dataset.chunks
            self.axes = _axes(dataset)
            self.step_mm = _step_mm(dataset, self.axes)
            if (cells := _CELLS.fullmatch(name)) and self.dtype == np.int16:
                setup = dataset.file.get(f"s{cells[2]}")
                self.unsigned = not (setup and ("dataType" in setup or "dataType" in setup.attrs))
                self.dtype = np.dtype(np.uint16) if self.unsigned else self.dtype

    def __getitem__(self, index: tuple[int | slice, ...]) -> NDArray[Any]:
        with self._opened() as dataset:
            values = np.asarray(dataset[index])
        return values.view(np.uint16) if self.unsigned else values

    @property
    def metadata(self) -> Metadata:
        """Assumptions about its lengths."""
        if self.step_mm is None:
            return Metadata(assumed=(NO_SPACING,))
        return Metadata(assumed=() if self.has_unit else (NO_UNIT,))

    @property
    def zyx(self) -> Index:
        """Places of z, y and x among the axes."""
        z, y, x = (self.axes.index(name) for name in "zyx")
        return z, y, x

    @contextmanager
    def _opened(self) -> Iterator[Any]:
        import h5py

        with h5py.File(self.root, "r") as file:
            yield file[self._name]


def _axes(dataset: Any) -> str:
    """Return a letter for each axis of a dataset, such as ``zyxc``; empty if it has no volume."""
    count, named = dataset.ndim, ""
    try:
        tags = json.loads(dataset.attrs.get("axistags", "{}")).get("axes", ())
        named = "".join(str(each.get("key", ""))[:1] for each in tags)
        signal = texts(dataset.parent.attrs.get("axes", ()))
        if not named and len(signal) == count:
            named = "".join(each[-1:].lower() for each in signal)
        labels = [each.label for each in dataset.dims]
        if not named and all(labels):
            named = "".join(label[:1].lower() for label in labels)
    except DAMAGE:
        named = ""
    if len(named) != count or len({*named}) != count or not {*"zyx"} <= {*named} <= {*"tczyx"}:
        named = _AXES.get(count, "")
    return named


def texts(attribute: Any) -> list[str]:
    """Return the words of an attribute, which writers of HDF5 store as text or as bytes."""
    return [each.decode() if isinstance(each, bytes) else str(each) for each in np.ravel(attribute)]


def _step_mm(dataset: Any, axes: str) -> Any:
    """Return the spacing that a file states along x, y, z, text that cannot be read, or None."""
    stated = dataset.attrs.get("element_size_um")
    if stated is not None:
        try:
            z, y, x = (float(um) / 1000 for um in np.ravel(stated))
        except (TypeError, ValueError):
            return str(stated)
        return (x, y, z) if min(x, y, z) > 0 else str(stated)
    signal = texts(dataset.parent.attrs.get("axes", ()))
    if len(signal) != dataset.ndim:
        return None
    found = {}
    for letter, name in zip(axes, signal, strict=True):
        with_places = dataset.parent.get(name)
        [unit_name] = texts(getattr(with_places, "attrs", {}).get("units", "")) or [""]
        unit = mm_per_unit(unit_name)
        if unit and with_places.shape == (dataset.shape[axes.index(letter)],):
            places = np.asarray(with_places, np.float64)
            found[letter] = abs(places[-1] - places[0]) / max(len(places) - 1, 1) * unit
    return tuple(found[each] for each in "xyz") if {*"xyz"} <= {*found} else None


def read_hdf5(query: Query) -> Reading:
    """Read a dataset, or one time step and one channel of it."""
    query.allow("dataset", "time", "channel", "spacing")
    dataset, at = _selected(query)
    query.end_choices()
    query.reserve(tuple(dataset.shape[axis] for axis in dataset.zyx), dataset.dtype.itemsize)
    spacing = _spacing_mm(query, dataset)
    index = tuple(
        slice(None) if each in "zyx" else n for each, n in zip(dataset.axes, at, strict=True)
    )
    left = [each for each in dataset.axes if each in "zyx"]
    try:
        values = dataset[index].transpose([left.index(each) for each in "zyx"])
    except DAMAGE as error:
        raise VolumeError(
            f"{query.path}: a chunk cannot be read ({one_line(error)[:120]}); copy the file again, "
            "or write it with a compression that h5py has (gzip, lzf)",
            code="damaged",
        ) from error
    return Reading(values, spacing_mm=spacing, metadata=dataset.metadata)


def read_project(query: Query) -> Reading:
    """Read the HDF5 or N5 of a BigDataViewer project."""
    data = data_of(query.path)
    read = read_ome_zarr if data.is_dir() else read_hdf5
    return read(replace(query, path=data))


def project_stack(query: Query) -> Stack | None:
    """Return the levels of a project's voxels that are larger than memory; else None."""
    data = data_of(query.path)
    find = ome_zarr_stack if data.is_dir() else hdf5_stack
    return find(replace(query, path=data))


def hdf5_stack(query: Query) -> Stack | None:
    """Return a dataset that is larger than memory as a level; else None."""
    if query.choices is not None or query.path.stat().st_size <= query.most_bytes // 100:
        return None
    dataset, at = _selected(query)
    z, y, x = (dataset.shape[axis] for axis in dataset.zyx)
    if z * y * x * dataset.dtype.itemsize <= query.most_bytes:
        return None
    _, world = checked_geometry(_spacing_mm(query, dataset), None, str(query.path))
    chunk: Index = (min(_ROWS[0], z), min(_ROWS[1], y), x)
    if dataset.chunks is not None:
        k, j, i = (dataset.chunks[axis] for axis in dataset.zyx)
        chunk = (k, j, i)
    level = Level(dataset, dataset.zyx, at, world, chunk)
    return Stack([level], metadata=dataset.metadata)


def _selected(query: Query) -> tuple[Dataset, tuple[int, ...]]:
    """Return the dataset that the query selects, and the index along each of its axes."""
    path = query.path
    try:
        import h5py
    except ImportError as error:
        raise DeviceError(
            f'{path}: is an HDF5 file, which needs h5py; pip install "volspec[hdf5]"',
            code="unsupported",
        ) from error
    found: dict[str, tuple[int, ...]] = {}

    seen: list[Any] = []  # groups, as links may lead back

    def search(group: Any, place: str) -> None:
        seen.append(group)
        for name in group:  # through links, which h5py's visititems does not follow
            each = group.get(name)
            if isinstance(each, h5py.Group) and each not in seen:
                search(each, f"{place}{name}/")
            elif isinstance(each, h5py.Dataset) and each.dtype.kind in "buif" and _axes(each):
                found[place + name] = each.shape

    try:
        with h5py.File(path, "r") as file:
            search(file, "")
    except DAMAGE as error:
        raise VolumeError(
            f"{path}: cannot be read as HDF5 ({one_line(error)[:120]}); is it complete?",
            code="damaged",
        ) from error
    if not found:
        raise VolumeError(
            f"{path}: holds no dataset of numbers with three axes (Z, Y, X), or four",
            "save one with h5py",
            code="shape",
        )
    cells = {name: match for name in found if (match := _CELLS.fullmatch(name))}
    if cells and "dataset" not in query.options:
        return _of_viewer(query, cells)
    dataset = Dataset(path, query.array_named(found))
    at = [0] * len(dataset.axes)
    for key, letter, what in (("time", "t", "time steps"), ("channel", "c", "channels")):
        if (place := dataset.axes.find(letter)) >= 0:
            at[place] = query.index(key, dataset.shape[place], what)
    return dataset, tuple(at)


def _of_viewer(query: Query, cells: dict[str, re.Match[str]]) -> tuple[Dataset, tuple[int, ...]]:
    """Return the finest level of a time step and setup of BigDataViewer's."""
    times, setups = (sorted({match[group] for match in cells.values()}) for group in (1, 2))
    project = project_of(query.path)
    names = [project.names.get(int(setup), "") for setup in setups] if project else []
    time = times[query.index("time", len(times), "time steps")]
    setup = setups[query.index("channel", len(setups), "channels (setups)", names)]
    dataset = Dataset(query.path, f"t{time}/s{setup}/0/cells")
    if project and int(setup) in project.sizes:
        size, unit = project.sizes[int(setup)]
        unit_mm = mm_per_unit(unit)
        dataset.step_mm = tuple(step * (unit_mm or 1.0) for step in size)
        dataset.has_unit = unit_mm is not None
    return dataset, (0, 0, 0)


def _spacing_mm(query: Query, dataset: Dataset) -> tuple[float, float, float] | None:
    """Return the spacing that the query or the dataset states, along x, y, z."""
    if query.spacing_mm is not None:
        return query.spacing_mm
    stated = dataset.step_mm
    if isinstance(stated, str):
        raise VolumeError(
            f"{query.path}: its element_size_um is {stated!r:.40}, not three positive numbers of "
            "micrometres along z, y, x",
            f"give the spacing as in {query.example(spacing='1,1,1')}",
            code="range",
        )
    return stated
