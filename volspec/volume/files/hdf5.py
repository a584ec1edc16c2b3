"""Datasets of HDF5 files through h5py: plain ones, ilastik's, NeXus' and BigDataViewer's.

    file -> dataset -> [hdf5] -> Stack -> Reading

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
import math
import os
import re
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from volspec._confine import confined_folder, require_inside
from volspec._extras import require_extra
from volspec.errors import VolumeError, one_line
from volspec.volume.checks import checked_geometry
from volspec.volume.files.bdv import Size, choose_view, data_of
from volspec.volume.files.lattice import mm_per_unit
from volspec.volume.files.layout import damage_error
from volspec.volume.files.n5 import are_axes
from volspec.volume.files.omezarr import (
    DAMAGE,
    ome_zarr_stack,
    read_level,
    read_ome_zarr,
    selected_index,
)
from volspec.volume.files.query import OneSlice, Query, Reading
from volspec.volume.levels.pyramid import Level, Stack
from volspec.volume.metadata import NO_SPACING, NO_UNIT, Metadata

# Voxels along z and y of a chunk of a dataset without chunks.
_ROWS = 16, 128
# Names of axes by the number of a dataset's, if it states none.
_AXES = {2: "zyx", 3: "zyx", 4: "tzyx"}  # a picture is read as one slice
_CELLS = re.compile(r"t(\d+)/s(\d+)/(\d+)/cells")


class Dataset:
    """Array of a dataset, whose file is opened when it is read; it can be pickled."""

    def __init__(self, root: Path, file: Any, name: str) -> None:
        self.root, self._name = root, name
        dataset = file[name]
        self.shape, self.dtype, self.chunks = dataset.shape, dataset.dtype, dataset.chunks
        if (cells := _CELLS.fullmatch(name)) and self.dtype == np.int16:
            setup = file.get(f"s{cells[2]}")
            data_type: Any = "uint16"
            if setup is not None:
                in_attributes = setup.attrs.get("dataType", data_type)
                data_type = setup["dataType"][()] if "dataType" in setup else in_attributes
            if texts(data_type) == ["uint16"]:
                self.dtype = np.dtype(np.uint16)

    def __getitem__(self, index: tuple[int | slice, ...]) -> NDArray[Any]:
        import h5py

        with h5py.File(self.root, "r") as file:
            values = np.asarray(file[self._name][index])
        return values.view(self.dtype) if self.dtype == np.uint16 else values


@contextmanager
def open_hdf5(query: Query) -> Iterator[Any]:
    """Open a file by h5py; the error of a damaged one becomes one line."""
    require_extra("hdf5", str(query.path))
    import h5py

    try:
        with h5py.File(query.path, "r") as file:
            yield file
    except VolumeError:
        raise
    except DAMAGE as error:
        problem = f"cannot be read as HDF5 ({one_line(error)[:120]})"
        raise damage_error(query.path, problem) from error


def texts(attribute: Any) -> list[str]:
    """Return the words of an attribute, which writers of HDF5 store as text or as bytes."""
    return [text.decode() if isinstance(text, bytes) else str(text) for text in np.ravel(attribute)]


def read_finest(query: Query, stack: Stack) -> Reading:
    """Read the finest level of a file."""
    finest = stack.levels[0]
    remedy = "copy the file again, or write it with a compression that h5py has (gzip, lzf)"
    values = read_level(query, finest, remedy)
    world = finest.world_from_index
    return Reading(values, None, world, channel=stack.channel, metadata=stack.metadata)


def if_larger(query: Query, levels_of: Callable[[Query], Stack]) -> Stack | None:
    """Return the levels of a file that is larger than memory; else None."""
    if query.choices is not None or query.path.stat().st_size <= query.most_bytes // 100:
        return None
    stack = levels_of(query)
    return None if stack.levels[0].nbytes <= query.most_bytes else stack


def require_parts_inside(path: Path) -> None:
    """Raise VolumeError if a file of HDF5 leads to others that must not be opened."""
    if confined_folder() is None:
        return
    with suppress(ImportError):
        import h5py

        if not h5py.is_hdf5(path):
            return
    with open_hdf5(Query(path)) as file:
        for name in _parts(file):
            require_inside(path.parent / name, VolumeError)
            for folder in (Path(), path.resolve().parent):  # where HDF5 looks, too
                if (folder / name).exists():
                    require_inside(folder / name, VolumeError)


def _parts(file: Any) -> Iterator[str]:
    """Yield the files in which a file has links, virtual or raw data."""
    import h5py

    groups, visited = [file], set()
    while groups:
        group = groups.pop()
        for name in group:
            link = group.get(name, getlink=True)
            if isinstance(link, h5py.ExternalLink):
                yield link.filename
            if not isinstance(link, h5py.HardLink):  # what a soft link leads to has another
                continue
            node = group[name]
            address = h5py.h5o.get_info(node.id).addr
            if address in visited:
                continue
            visited.add(address)
            if isinstance(node, h5py.Group):
                groups.append(node)
            elif isinstance(node, h5py.Dataset):
                yield from (part[0] for part in node.external or ())
                sources = node.virtual_sources() if node.is_virtual else ()
                yield from {source.file_name for source in sources}


def read_hdf5(query: Query) -> Reading:
    """Read a dataset, or one time step and one channel of it."""
    query.allow("dataset", "time", "channel", "spacing")
    return read_finest(query, _select_stack(query))


def hdf5_stack(query: Query) -> Stack | None:
    """Return a dataset that is larger than memory as a level; else None."""
    return if_larger(query, _select_stack)


def read_project(query: Query) -> Reading:
    """Read the HDF5 or N5 of a BigDataViewer project."""
    query = _of_project(query)
    return read_ome_zarr(query) if query.path.is_dir() else read_hdf5(query)


def _of_project(query: Query) -> Query:
    path = data_of(query.path)
    if not path.is_dir():
        require_parts_inside(path)
    return replace(query, path=path)


def project_stack(query: Query) -> Stack | None:
    """Return the levels of a project's voxels that are larger than memory; else None."""
    query = _of_project(query)
    return ome_zarr_stack(query) if query.path.is_dir() else hdf5_stack(query)


def _select_stack(query: Query) -> Stack:
    """Return the dataset, time step and channel that the query selects, as a level."""
    with open_hdf5(query) as file:
        broken: dict[str, str] = {}
        arrays = _datasets(file, broken)
        if not arrays and broken:
            name, target = next(iter(broken.items()))
            raise VolumeError(
                f"{query.path}: its link {name!r} leads to {target}, which is missing",
                "copy the file with the voxels to its place, or give that file",
                code="not-found",
            )
        if not arrays:
            raise VolumeError(
                f"{query.path}: holds no dataset of numbers with three axes (Z, Y, X), or four; "
                "save one with h5py",
                code="shape",
            )
        cells = [match for name in arrays if (match := _CELLS.fullmatch(name)) and match[3] == "0"]
        size: Size | None = None
        if cells and "dataset" not in query.options:
            name, size = choose_view(query, {(match[2], match[1]): match[0] for match in cells})
        else:
            name = query.array_named({name: array.shape for name, array in arrays.items()})
        _require_sources(query, arrays[name])
        dataset: Any = Dataset(query.path, file, name)
        axes = _axes(arrays[name])
        dataset = OneSlice(dataset) if len(dataset.shape) == 2 else dataset
        size = size or _voxel_size(query, arrays[name], axes)
    unit_mm = mm_per_unit(size[1]) if size else None
    assumed = () if unit_mm else (NO_UNIT,) if size else (NO_SPACING,)
    x, y, z = np.multiply(size[0], unit_mm or 1.0).tolist() if size else (1.0, 1.0, 1.0)
    _, world = checked_geometry(query.spacing_mm or (x, y, z), None, str(query.path))
    index = selected_index(query, axes, dataset.shape)
    k, j, i = (axes.index(letter) for letter in "zyx")
    chunk = dataset.chunks
    z, y, x = ((chunk or dataset.shape)[axis] for axis in (k, j, i))
    if chunk is None:
        z, y = min(_ROWS[0], z), min(_ROWS[1], y)
    level = Level(dataset, (k, j, i), index, world, (z, y, x))
    return Stack([level], metadata=Metadata(assumed=assumed))


def _require_sources(query: Query, dataset: Any) -> None:
    """Refuse a virtual dataset with missing files, whose voxels HDF5 would fill with one value."""
    file, prefix = Path(dataset.file.filename), Path(os.getenv("HDF5_VDS_PREFIX", ""))
    sources = dataset.virtual_sources() if dataset.is_virtual else ()
    # A dot is the file itself; a name with %b is of many blocks.
    for name in sorted(
        {source.file_name for source in sources if "%b" not in source.file_name} - {"."}
    ):
        # HDF5 looks for an absolute path that is missing next to the file, too.
        names = (name, Path(name).name) if Path(name).is_absolute() else (name,)
        folders = file.parent, file.resolve().parent, prefix, Path()
        if not any((folder / name).exists() for folder in folders for name in names):
            raise VolumeError(
                f"{query.path}: its dataset {dataset.name!r} is made of other files, of which "
                f"{name} is missing; copy it to {file.parent / name}",
                code="not-found",
            )


def _datasets(file: Any, broken: dict[str, str]) -> dict[str, Any]:
    """Return the datasets that may be volumes, also behind links, which `visititems` ignores.

    Links to what is missing are added to ``broken``.
    """
    arrays: dict[str, Any] = {}
    visited: list[Any] = []  # groups, as links may lead back

    def search(group: Any, place: str) -> None:
        visited.append(group)
        for name in group:
            node = group.get(name)
            if node is None:
                link = group.get(name, getlink=True)
                broken[place + name] = f"{getattr(link, 'filename', '')}:{link.path}".lstrip(":")
            elif hasattr(node, "keys") and node not in visited:
                search(node, f"{place}{name}/")
            elif hasattr(node, "shape") and node.dtype.kind in "buif" and _axes(node):
                arrays[place + name] = node

    search(file, "")
    deep = {name: array for name, array in arrays.items() if array.ndim > 2}
    return deep or arrays


def _axes(dataset: Any) -> str:
    """Return a letter for each axis of a dataset, such as ``zyxc``; empty if it has no volume."""
    named = []
    with suppress(*DAMAGE):
        tags = json.loads(dataset.attrs.get("axistags", "{}")).get("axes", ())
        named.append("".join(str(tag.get("key", ""))[:1] for tag in tags))
        signal = texts(dataset.parent.attrs.get("axes", ()))
        named.append("".join(label[-1:].lower() for label in signal))
        named.append("".join(dim.label[:1].lower() for dim in dataset.dims))
    usual = _AXES.get(dataset.ndim, "")
    return next((letters for letters in named if are_axes(letters, dataset.ndim)), usual)


def _voxel_size(query: Query, dataset: Any, axes: str) -> Size | None:
    """Return the size of a voxel that a file states; None if it states none."""
    size_um = dataset.attrs.get("element_size_um")
    if size_um is not None and query.spacing_mm is None:
        try:
            z, y, x = map(float, np.ravel(size_um))
        except (TypeError, ValueError):
            x = y = z = 0.0
        if not all(0 < size < math.inf for size in (x, y, z)):
            raise VolumeError(
                f"{query.path}: its element_size_um is {str(size_um)!r:.40}, not three positive "
                "numbers of micrometres along z, y, x",
                f"give the spacing as in {query.example(spacing='1,1,1')}",
                code="range",
            )
        return (x, y, z), "um"
    steps = {}
    signal = texts(dataset.parent.attrs.get("axes", ()))
    for letter, name in zip(axes, signal, strict=True) if len(signal) == len(axes) else ():
        coordinates = dataset.parent.get(name)
        unit = "".join(texts(getattr(coordinates, "attrs", {}).get("units", "")))
        if mm_per_unit(unit) and coordinates.shape == (dataset.shape[axes.index(letter)],):
            places = np.asarray(coordinates, np.float64)
            step = abs(places[-1] - places[0]) / max(len(places) - 1, 1)
            if 0 < step < math.inf:
                steps[letter] = step * (mm_per_unit(unit) or 1.0)
    return ((steps["x"], steps["y"], steps["z"]), "mm") if {*"xyz"} <= {*steps} else None
