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

from volspec.errors import DeviceError, VolumeError, one_line
from volspec.volume.files.bdv import project_of
from volspec.volume.files.query import Query
from volspec.volume.files.tensors import Tensor

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
        stated = json.loads((folder / _ATTRIBUTES).read_text("utf-8"))
        return stated if isinstance(stated, dict) else {}
    return {}


def open_n5(query: Query) -> tuple[Tensor, Axes, NDArray[np.float64], bool]:
    """Return the selected dataset, its axes, its map to their units, and False if it has none."""
    path = query.path
    sizes: dict[str, list[int]] = {}
    for place, inner, names in os.walk(path):
        size = _attributes(Path(place)).get("dimensions", []) if _ATTRIBUTES in names else []
        if len(size) >= 3:
            sizes[Path(place).relative_to(path).as_posix()] = size[::-1]
        finest = "s0" in inner
        inner[:] = [n for n in inner if not size and not (finest and _COARSER.fullmatch(n))]
    if not sizes:
        raise VolumeError(
            f"{path}: holds no dataset of three axes or more",
            "give the folder of one",
            code="shape",
        )
    name, own = _viewed(query, list(sizes)) or (query.array_named(sizes), {})
    for part in (Path(name), *Path(name).parents):
        own = _attributes(path / part) | own
    try:
        store = {"driver": "file", "path": f"{(path / name).absolute()}/"}
        array = Tensor({"driver": "n5", "kvstore": store}, path / name)
    except ImportError as error:
        raise DeviceError(
            f'{path}: is an N5, which needs TensorStore; pip install "volspec[zarr]"',
            code="unsupported",
        ) from error
    except ValueError as error:
        raise VolumeError(
            f"{path / name}: its {_ATTRIBUTES} cannot be read ({one_line(error)[:120]})",
            "copy it again, or write it with gzip, blosc, zstd or without compression",
            code="damaged",
        ) from error
    stated = [str(axis).lower()[:1] for axis in own.get("axes", ())]
    letters = named_axes(query, array.shape, stated, "xyzct")
    return array, *_lattice(own, letters)


def _viewed(query: Query, names: list[str]) -> tuple[str, dict[str, Any]] | None:
    """Return the dataset of a setup and time of BigDataViewer's, and its project's voxels."""
    found = {match.groups(): name for name in names if (match := _SETUP.fullmatch(name))}
    if not found or "dataset" in query.options:
        return None
    setups, times = (sorted({key[k] for key in found}, key=int) for k in (0, 1))
    project = project_of(query.path)
    called = [project.names.get(int(setup), "") for setup in setups] if project else []
    time = times[query.index("time", len(times), "time steps")]
    setup = setups[query.index("channel", len(setups), "channels (setups)", called)]
    size, unit = project.sizes.get(int(setup), ([], "")) if project else ([], "")
    own = {"resolution": size, "unit": unit} if size else {}
    return found.get((setup, time), next(iter(found.values()))), own


def _lattice(own: dict[str, Any], letters: list[str]) -> tuple[Axes, NDArray[np.float64], bool]:
    """Return the axes with units, the map from index to place, and False if none is stated."""
    pixel = own.get("pixelResolution")
    pixel = pixel if isinstance(pixel, dict) else {"dimensions": pixel}
    try:
        step = np.array(own.get("resolution") or pixel["dimensions"], float)
        factors = np.array(own.get("downsamplingFactors") or [1] * len(step), float)
        factors = factors if factors.ndim == 1 else factors[0]
        units = own.get("units") or [own.get("unit") or pixel.get("unit")] * len(step)
        at = [letters.index(name) for name in "xyz"] if len(step) == 3 else range(len(letters))
        matrix = np.eye(len(letters) + 1)
        matrix[at, at], matrix[at, -1] = step * factors, step * (factors - 1) / 2
        axes: Axes = [{"name": name} for name in letters]
        for place, unit in zip(at, units, strict=True):
            axes[place]["unit"] = unit
        return axes, matrix, bool((step > 0).all())
    except (TypeError, ValueError, KeyError, IndexError):
        return [{"name": name} for name in letters], np.eye(len(letters) + 1), False


def named_axes(query: Query, shape: Sequence[int], names: Sequence[str], usual: str) -> list[str]:
    """Return a letter for each axis of an array: those of ``axes=``, those stated, or three."""
    count = len(shape)
    if "axes" in query.options:
        names = query.options["axes"]
    elif count == 3 and sorted(names) != [*"xyz"] and not {*"tc"} & {*names}:
        names = [name for name in usual if name in "xyz"]
    if len(names) != count or len({*names}) != count or not {*"xyz"} <= {*names} <= {*"tczyx"}:
        example = "".join(name for name in usual if name in "xyztc"[: max(count, 3)])
        raise VolumeError(
            f"{query.path}: is an array of {count} axes ({' × '.join(map(str, shape))}), and does "
            "not say which of them are x, y, z, channels and time",
            f"name them, as in {query.example(axes=example)}",
            code="shape",
            given=query.options.get("axes"),
        )
    return [*names]
