"""N5 folders: datasets, multiscale groups and BigDataViewer's, through TensorStore.

    folder -> attributes.json -> [n5] -> array, axes, matrix

Axes are x, y, z, fastest first, as N5 states them. Of a multiscale group, ``s0`` is read.

References
----------
[1] N5 specification, github.com/saalfeldlab/n5; ``resolution``, ``units``, ``pixelResolution`` and
    ``downsamplingFactors`` as in github.com/saalfeldlab/n5-viewer.
"""

from __future__ import annotations

import json
import os
import re
from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from volspec.errors import VolumeError, one_line
from volspec.volume.files.bdv import choose_view
from volspec.volume.files.query import Query
from volspec.volume.files.tensors import Tensor, import_zarr

Axes = list[dict[str, Any]]
_ATTRIBUTES = "attributes.json"
_COARSER = re.compile(r"s[1-9]\d*")
_SETUP = re.compile(r"setup(\d+)/timepoint(\d+)/s0")


def is_n5(folder: Path) -> bool:
    """Return True if a folder is an N5 group or dataset."""
    named = folder.suffix.lower() == ".n5"
    return named or not {"n5", "dimensions"}.isdisjoint(_attributes(folder))


def _attributes(folder: Path) -> dict[str, Any]:
    """Return what a group or dataset states; nothing if it is damaged or states nothing."""
    with suppress(OSError, ValueError, RecursionError):
        attrs = json.loads((folder / _ATTRIBUTES).read_text("utf-8"))
        return attrs if isinstance(attrs, dict) else {}
    return {}


def open_n5(query: Query) -> tuple[Tensor, Axes, NDArray[np.float64], bool]:
    """Return the selected dataset, its axes, its map to their units, and False if it has none."""
    path = query.path
    sizes: dict[str, list[int]] = {}
    for place, inner, _ in os.walk(path):
        size = _attributes(Path(place)).get("dimensions", [])
        if len(size) >= 3:
            sizes[Path(place).relative_to(path).as_posix()] = size[::-1]
        finest = "s0" in inner
        inner[:] = [n for n in inner if not size and not (finest and _COARSER.fullmatch(n))]
    if not sizes:
        raise VolumeError(
            f"{path}: holds no dataset of three axes or more; give the folder of one", code="shape"
        )
    attrs: dict[str, Any] = {}
    views = {(match[1], match[2]): name for name in sizes if (match := _SETUP.fullmatch(name))}
    if views and "dataset" not in query.options:
        name, voxel = choose_view(query, views)
        if voxel is not None:
            attrs = {"resolution": voxel[0], "unit": voxel[1]}
    else:
        name = query.array_named(sizes)
    for part in (Path(name), *Path(name).parents):
        attrs = _attributes(path / part) | attrs
    import_zarr(path)
    try:
        store = {"driver": "file", "path": f"{(path / name).absolute()}/"}
        array = Tensor({"driver": "n5", "kvstore": store}, path / name)
    except ValueError as error:
        raise VolumeError(
            f"{path / name}: its {_ATTRIBUTES} cannot be read ({one_line(error)[:120]})",
            "copy it again, or write it with gzip, blosc, zstd or without compression",
            code="damaged",
        ) from error
    letters = [str(axis).lower()[:1] for axis in attrs.get("axes", ())]
    return array, *_lattice(attrs, named_axes(query, array.shape, letters, "xyzct"))


def _lattice(attrs: dict[str, Any], letters: list[str]) -> tuple[Axes, NDArray[np.float64], bool]:
    """Return the axes with units, the map from index to place, and False if none is stated."""
    axes: Axes = [{"name": name} for name in letters]
    matrix = np.eye(len(letters) + 1)
    pixel = attrs.get("pixelResolution")
    pixel = pixel if isinstance(pixel, dict) else {"dimensions": pixel}
    with suppress(TypeError, ValueError, KeyError, IndexError):
        step = np.array(attrs.get("resolution") or pixel["dimensions"], float)
        factors = np.array(attrs.get("downsamplingFactors") or [1] * len(step), float)
        factors = factors if factors.ndim == 1 else factors[0]
        units = attrs.get("units") or [attrs.get("unit") or pixel.get("unit")] * len(step)
        columns = [letters.index(name) for name in "xyz"] if len(step) == 3 else range(len(letters))
        spaced = matrix.copy()
        spaced[columns, columns], spaced[columns, -1] = step * factors, step * (factors - 1) / 2
        for place, unit in zip(columns, units, strict=True):
            axes[place]["unit"] = unit
        return axes, spaced, bool((step > 0).all())
    return axes, matrix, False


def are_axes(names: Sequence[str], count: int) -> bool:
    """Return True for a letter each of ``count`` axes, of which x, y and z are three."""
    return len(names) == len({*names}) == count and {*"xyz"} <= {*names} <= {*"tczyx"}


def named_axes(query: Query, shape: Sequence[int], names: Sequence[str], usual: str) -> list[str]:
    """Return a letter for each axis of an array: those of ``axes=``, those stated, or three."""
    count = len(shape)
    if "axes" in query.options:
        names = query.options["axes"]
    elif count == 3 and not are_axes(names, 3) and not {*"tc"} & {*names}:
        names = [name for name in usual if name in "xyz"]
    if count == 2:
        return [name for name in usual if name in "xy"]
    if count < 2:
        raise VolumeError(
            f"{query.path}: is an array of {count} axes ({' × '.join(map(str, shape))}); a volume "
            "has three (x, y, z)",
            code="shape",
        )
    if not are_axes(names, count):
        example = "".join(name for name in usual if name in "xyztc"[:count])
        raise VolumeError(
            f"{query.path}: is an array of {count} axes ({' × '.join(map(str, shape))}), and does "
            "not say which of them are x, y, z, channels and time",
            f"name them, as in {query.example(axes=example)}",
            code="shape",
            given=query.options.get("axes"),
        )
    return [*names]
