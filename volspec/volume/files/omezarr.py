"""OME-Zarr (versions 0.4 and 0.5) and plain Zarr arrays: folders, zip files and URLs; N5 folders.

    folder -> multiscales: axes, levels, scale -> [omezarr] -> Reading

The zarr library opens Zarr's metadata, `volspec.volume.files.n5` those of N5.

References
----------
[1] Moore et al. (2023), "OME-Zarr: a cloud-optimized bioimaging file format", Histochem Cell Biol
    160, 223-251. doi:10.1007/s00418-023-02209-1; ngff.openmicroscopy.org/0.5
[2] OME-NGFF RFC-5, coordinate systems and transformations: ``affine`` is a matrix of a row for each
    axis, with a column for each and one of offsets; ``rotation`` has no offsets.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from volspec.errors import DeviceError, VolumeError, one_line
from volspec.volume import pyramid
from volspec.volume.channels import Channel
from volspec.volume.files.label_tables import labels_in_zarr
from volspec.volume.files.lattice import affine, mm_per_unit, spacing_text
from volspec.volume.files.n5 import is_n5, named_axes, open_n5
from volspec.volume.files.query import Choice, ChoicesListed, Query, Reading
from volspec.volume.files.tensors import fast_array
from volspec.volume.labels import Labels
from volspec.volume.metadata import NO_SPACING, NO_UNIT, Metadata
from volspec.volume.pyramid import BLOCK, DEFAULT_BYTES
from volspec.volume.sample import BINS, Sample, step_along

ZIP_SUFFIXES = (".zarr.zip", ".ozx")
_MARKS = (".zgroup", ".zattrs", ".zarray", "zarr.json")
# More bytes of voxels than this are a mistake: 1 PiB.
_MOST_BYTES = 2**50
_SPACE = ("z", "y", "x")
_OPTIONS = {"c": ("channel", "channels"), "t": ("time", "time steps")}
# Depth to which groups are searched for arrays.
_DEEPEST = 4
# Elements of a matrix (N + 1, N + 1) that a transformation gives, by its type.
_SHAPES: dict[str, Callable[[NDArray[np.float64]], tuple[Any, Any]]] = {
    "scale": lambda one: (range(len(one) - 1), range(len(one) - 1)),
    "translation": lambda one: (slice(-1), -1),
    "affine": lambda one: (slice(-1), slice(None)),
    "rotation": lambda one: (slice(-1), slice(-1)),
}
_DAMAGE = (KeyError, TypeError, ValueError, IndexError, OSError, RuntimeError, AttributeError)


@dataclass(frozen=True, slots=True)
class Level:
    """One resolution of a picture."""

    array: Any  # from fast_array
    matrix: NDArray[np.float64]  # (N + 1, N + 1) from index to place, in the axes' units
    is_spaced: bool  # the matrix is stated, not assumed


def is_zarr(folder: Path) -> bool:
    """Return True if a folder is a Zarr group or array, or one of N5."""
    return any((folder / mark).is_file() for mark in _MARKS) or is_n5(folder)


def ome_zarr_stack(query: Query) -> pyramid.Stack | None:
    """Return the levels of a picture that is larger than memory; else None.

    So are those of several channels, unless one is selected. Raises VolumeError if the levels are
    not resolutions of one picture.
    """
    if "level" in query.options or query.choices is not None:
        return None
    group, axes, levels = _opened(query)
    names = _names(axes)
    if not set(_SPACE) <= set(names) or not _is_in_parts(levels, names, query):
        return None
    if any(_nbytes(level, names) > _MOST_BYTES for level in levels):
        raise VolumeError(
            f"{query.path}: its metadata declare {_level_names(levels, names)[0]} voxels; is it "
            "damaged?",
            code="damaged",
        )
    at = []
    for name, count in zip(names, levels[0].array.shape, strict=True):
        key, what = _OPTIONS.get(name, ("", ""))
        at.append(0 if name in _SPACE else query.index(key, count, what))
    places = tuple(names.index(name) for name in _SPACE)
    stated = _own_metadata(group)
    remarks = list[str]()
    found: list[pyramid.Level] = []
    for number, level in enumerate(levels):
        _check_extent(level, levels, number, axes, names, query)
        world = _world(level, axes, group, query, [] if found else remarks)
        array, chunk = level.array, level.array.chunks
        ranges = _ranges(group, stated, number, array)
        if ranges is None and "ranges" in stated:
            lost = (
                f"{query.path}: the ranges of its blocks (volspec/ranges) cannot be used, so that "
                "casts read more; convert it again"
            )
            remarks += [] if lost in remarks else [lost]
        # Files of a conversion are small: of a server, they are asked for as a whole.
        by_block = ranges is not None and array.shards is not None and not query.is_remote
        if array.shards is not None and (by_block or stated.get("complete")):
            chunk = array.shards
        found.append(
            pyramid.Level(
                array,
                (places[0], places[1], places[2]),
                tuple(at),
                world,
                tuple(chunk[place] for place in places),
                ranges,
                by_block,
            )
        )
    number = at[names.index("c")] if "c" in names else 0
    channel = next(iter(_channels(group)[number:]), None)
    sample = _sample(group, stated, found[0])
    if sample is None and "sample" in stated:
        remarks.append(
            f"{query.path}: the sample of its voxels (volspec/sample) cannot be used, so that "
            "camera and colours follow from a coarse level; convert it again"
        )
    metadata = _metadata(group, axes, levels[0])
    return pyramid.Stack(found, channel, _labels(group), remarks, sample, metadata)


def _own_metadata(group: Any) -> dict[str, Any]:
    """Return what `volspec convert` adds to the metadata; empty if another program wrote it."""
    stated = group.attrs.get("volspec")
    return stated if isinstance(stated, dict) else {}


def _metadata(group: Any, axes: list[dict[str, Any]], level: Level) -> Metadata:
    """Return what `volspec convert` wrote of the source; else what is assumed of the lengths."""
    stated = _own_metadata(group).get("metadata")
    if isinstance(stated, dict):
        modality, unit = (str(stated.get(key, "")) for key in ("modality", "unit"))
        assumed = tuple(map(str, stated.get("assumed", ())))
        return Metadata(modality, unit, bool(stated.get("is_patient")), assumed)
    if not level.is_spaced:
        return Metadata(assumed=(NO_SPACING,))
    units = [str(axis.get("unit", "")) for axis in axes if str(axis["name"]).lower() in _SPACE]
    return Metadata(assumed=() if all(map(mm_per_unit, units)) else (NO_UNIT,))


def _is_in_parts(levels: list[Level], names: list[str], query: Query) -> bool:
    """Return True if a picture is larger than memory, and one channel and time are selected."""
    sides = zip(names, levels[0].array.shape, strict=True)
    others = [name for name, count in sides if name not in _SPACE and count > 1]
    selected = all(_OPTIONS.get(name, ("", ""))[0] in query.options for name in others)
    return selected and _nbytes(levels[0], names) > _most_bytes(query)


def _most_bytes(query: Query) -> int:
    return DEFAULT_BYTES if query.memory_bytes is None else query.memory_bytes


def _ranges(group: Any, stated: dict[str, Any], number: int, voxels: Any) -> NDArray[Any] | None:
    """Return the ranges of a level's blocks that `volspec convert` wrote; None if there are none.

    So it is if they are damaged, or not of these voxels.
    """
    try:
        paths = stated["ranges"]
        if stated["block"] != BLOCK:
            return None
        found = np.asarray(fast_array(group[paths[number]], complete=True)[...])
    except _DAMAGE:
        return None
    blocks = tuple(-(-n // BLOCK) for n in voxels.shape)
    low_high = found.shape == (2, *blocks) and found.dtype == pyramid.cast_dtype(voxels.dtype)
    return found if low_high and (found[0] <= found[1]).all() else None


def _sample(group: Any, stated: dict[str, Any], finest: pyramid.Level) -> Sample | None:
    """Return what `volspec convert` wrote of all voxels; None if it did not, or it is damaged."""
    try:
        low, high = map(float, stated["range"])
        counts = np.array(stated["histogram"], float)
        voxels = np.asarray(fast_array(group[stated["sample"]], complete=True)[...])
    except _DAMAGE:
        return None
    sides = tuple(-(-n // step_along(n)) for n in finest.shape)
    if not (low <= high and counts.shape == (BINS,) and (counts >= 0).all()):
        return None
    return Sample((low, high), counts, voxels) if voxels.shape == sides else None


def _check_extent(
    level: Level,
    levels: list[Level],
    number: int,
    axes: list[dict[str, Any]],
    names: list[str],
    query: Query,
) -> None:
    """Refuse a level that does not cover the same part of the world as the finest."""
    finest = levels[0]
    for axis, name in enumerate(names):
        if name not in _SPACE:
            continue
        ends, widths = [], []
        for each in (level, finest):
            row, offset = each.matrix[axis, :-1], each.matrix[axis, -1]
            corners = np.zeros(len(row)), np.array(each.array.shape)
            ends.append([float(row @ (corner - 0.5) + offset) for corner in corners])
            widths.append(np.abs(row).sum())
        apart = max(abs(a - b) for a, b in zip(*ends, strict=True))
        if apart > 1.01 * max(widths):
            (a, b), (c, d) = ends
            unit = axes[axis].get("unit") or "units"
            raise VolumeError(
                f"{query.path}: level {number} lies from {a:g} to {b:g} {unit} along {name}, level "
                f"0 from {c:g} to {d:g}; its levels are not resolutions of one picture",
                f"correct its metadata, or read one level: {query.example(level=str(number))}",
                code="conflict",
            )


def _opened(query: Query) -> tuple[Any, list[dict[str, Any]], list[Level]]:
    """Return the group or array, the axes and the levels of a picture."""
    path = query.path
    if not query.is_remote and is_n5(path):
        array, axes, matrix, is_spaced = open_n5(query)
        return SimpleNamespace(attrs={}), axes, [Level(array, matrix, is_spaced)]
    try:
        import zarr
        from zarr.storage import ZipStore
    except ImportError as error:
        raise DeviceError(
            f'{path}: is an OME-Zarr, which needs zarr; pip install "volspec[zarr]"',
            code="unsupported",
        ) from error
    try:
        zipped = path.name.lower().endswith(ZIP_SUFFIXES) and not query.is_remote
        group = zarr.open(ZipStore(path, mode="r") if zipped else str(path), mode="r")
        if isinstance(group, zarr.Group) and ("dataset" in query.options or not _pictures(group)):
            group = group[_array_in(group, query)]
        if isinstance(group, zarr.Array):
            axes, levels = _plain(group, query)
        else:
            axes, levels = _multiscale(group, query)
        _names(axes)
    except (VolumeError, ChoicesListed):
        raise
    except KeyError as error:
        raise VolumeError(
            f"{path}: its OME-Zarr metadata have no {error.args[0]!r}; is it complete?",
            code="damaged",
        ) from error
    except Exception as error:  # whatever the library raises
        remedy = "is the address right?" if query.is_remote else "is it complete?"
        raise VolumeError(
            f"{path}: its OME-Zarr metadata cannot be read ({one_line(error)[:120]}); {remedy}",
            code="damaged",
        ) from error
    return group, axes, levels


def _names(axes: list[dict[str, Any]]) -> list[str]:
    return [str(axis["name"]).lower() for axis in axes]


def read_ome_zarr(query: Query) -> Reading:
    """Read a level of a picture, with the channel and time that the query selects."""
    query.allow("level", "channel", "time", "dataset", "axes")
    remarks: list[str] = []
    group, axes, levels = _opened(query)
    names = _names(axes)
    level = levels[_level(levels, names, query, remarks)]
    world = _world(level, axes, group, query, remarks)
    channels = _channels(group)
    values, number = _values(level, names, query, channels)
    channel = next(iter(channels[number:]), None)
    stated = _labels(group), channel, _metadata(group, axes, level)
    return Reading(values, None, world, remarks, *stated)


def _labels(group: Any) -> Labels | None:
    """Return the labels in the metadata; None if it is no picture of labels."""
    stated = dict(group.attrs)
    image_label = stated.get("ome", stated).get("image-label")
    return None if image_label is None else labels_in_zarr(image_label)


def _pictures(group: Any) -> Any:
    """Return the pictures of a group in its metadata; none if it has none."""
    attributes = dict(group.attrs)
    return attributes.get("ome", attributes).get("multiscales")


def _array_in(group: Any, query: Query) -> str:
    """Return the array that ``dataset=`` selects in a group without a picture of its own."""
    found: dict[str, tuple[int, ...]] = {}

    def search(inner: Any, place: str, depth: int) -> None:
        for name, node in inner.members():
            if hasattr(node, "shape"):
                if node.ndim >= 3 and node.dtype.kind in "buif":
                    found[place + name] = node.shape
            elif _pictures(node):
                raise VolumeError(
                    f"{query.path}: is a Zarr folder of pictures (multiscales)",
                    f"give one of them, such as {query.path}/{place}{name}",
                    code="unsupported",
                )
            elif depth:
                search(node, f"{place}{name}/", depth - 1)

    if not query.is_remote:  # of a URL, folders are not listed
        search(group, "", _DEEPEST)
    if not found:
        raise VolumeError(
            f"{query.path}: is a Zarr folder without an OME-Zarr picture (multiscales) or an array "
            "of three axes",
            "give the folder of one",
            code="unsupported",
        )
    return query.array_named(found)


def _plain(array: Any, query: Query) -> tuple[list[dict[str, Any]], list[Level]]:
    """Return the axes of an array without a picture's metadata, and it as the only level."""
    stated = getattr(array.metadata, "dimension_names", None)
    names = [str(name).lower()[:1] for name in stated or array.attrs.get("_ARRAY_DIMENSIONS", ())]
    names = named_axes(query, array.shape, names, "tczyx")
    level = Level(fast_array(array), np.eye(array.ndim + 1), False)
    return [{"name": name} for name in names], [level]


def _multiscale(group: Any, query: Query) -> tuple[list[dict[str, Any]], list[Level]]:
    """Return the axes and the levels, finest first, of a group's first picture."""
    picture = _pictures(group)[0]
    # Version 0.3 states only the axes' names.
    axes = [axis if isinstance(axis, dict) else {"name": axis} for axis in picture["axes"]]
    whole = picture.get("coordinateTransformations", [])
    levels: list[Level] = []
    complete = bool(_own_metadata(group).get("complete"))
    for each in picture["datasets"]:
        steps = [*each.get("coordinateTransformations", []), *whole]
        array = fast_array(_array_of(group, each["path"]), complete=complete)
        if len(array.shape) != len(axes):
            raise ValueError(f"{len(axes)} axes of an array of {len(array.shape)}")
        levels.append(Level(array, _matrix(steps, len(axes), query), bool(steps)))
    if not levels:
        raise ValueError("no datasets")
    sizes = [math.prod(level.array.shape) for level in levels]
    if "level" not in query.options and sizes != sorted(sizes, reverse=True):
        raise VolumeError(
            f"{query.path}: its levels are not in order, from the finest to the coarsest",
            f"correct its metadata, or read one level: {query.example(level='0')}",
            code="conflict",
        )
    return axes, levels


def _array_of(group: Any, path: str) -> Any:
    try:
        return group[path]
    except KeyError as error:
        raise ValueError(f"they name an array {path!r}, which is not there") from error


def _matrix(steps: Sequence[dict[str, Any]], count: int, query: Query) -> NDArray[np.float64]:
    """Combine transformations into a map from index to place, (N + 1, N + 1).

    >>> _matrix([{"type": "scale", "scale": [2]}, {"type": "translation", "translation": [3]},
    ... {"type": "scale", "scale": [10]}], 1, Query(Path())).tolist()
    [[20.0, 30.0], [0.0, 1.0]]
    """
    whole = np.eye(count + 1)
    for step in steps:
        kind, one = step["type"], np.eye(count + 1)
        if kind == "sequence":
            one = _matrix(step["transformations"], count, query)
        elif kind in _SHAPES and kind in step:
            numbers = np.array(step[kind], float)
            rows, columns = _SHAPES[kind](one)
            if numbers.shape != one[rows, columns].shape:
                raise ValueError(f"a {kind} of {numbers.size} numbers for {count} axes")
            if kind == "scale" and not (numbers > 0).all():
                raise ValueError(f"a scale of {numbers.tolist()}, which is not positive")
            one[rows, columns] = numbers
        elif kind != "identity" and query.spacing_mm is None:
            raise VolumeError(
                f"{query.path}: has a transformation of type {kind:.40}; supported are those with "
                f"numbers in the metadata: {', '.join(_SHAPES)}, sequence",
                f"give the spacing in mm instead, as in {query.example(spacing='1,1,1')}",
                code="unsupported",
            )
        whole = one @ whole
    return whole


def _nbytes(level: Level, names: list[str]) -> int:
    """Return the bytes of a volume of a level."""
    sides = [n for n, name in zip(level.array.shape, names, strict=True) if name in _SPACE]
    return math.prod(sides) * int(level.array.dtype.itemsize)


def _level(levels: list[Level], names: list[str], query: Query, remarks: list[str]) -> int:
    """Return the level that the query selects, else the finest that memory holds."""
    if "level" in query.options:
        return query.index("level", len(levels), "levels", _level_names(levels, names))
    sizes = [_nbytes(level, names) for level in levels]
    chosen = next((k for k, n in enumerate(sizes) if n <= _most_bytes(query)), len(levels) - 1)
    if query.choices is not None and len(levels) > 1 and not _is_in_parts(levels, names, query):
        values = tuple(map(str, range(len(levels))))
        query.choices.append(Choice("level", values, _level_names(levels, names), str(chosen)))
    if chosen:
        remarks.append(
            f"{query.path}: level 0 takes {sizes[0] / 1e9:.3g} GB, level {chosen} is read; choose "
            f"another as {query.example(level='0')}"
        )
    return chosen


def _world(
    level: Level,
    axes: list[dict[str, Any]],
    group: Any,
    query: Query,
    remarks: list[str],
) -> NDArray[np.float64]:
    places = {str(axis["name"]).lower(): k for k, axis in enumerate(axes)}
    if missing := [name for name in _SPACE if name not in places]:
        raise VolumeError(
            f"{query.path}: has no axis {missing[0]} (its axes are {', '.join(places)}); a volume "
            "has x, y and z",
            code="shape",
        )
    at = [places[name] for name in reversed(_SPACE)]
    units = [str(axes[place].get("unit") or "none") for place in at]
    unknown = [unit for unit in units if mm_per_unit(unit) is None]
    unit_mm = np.array([(level.is_spaced and mm_per_unit(unit)) or 1.0 for unit in units])
    world = affine(level.matrix[np.ix_(at, at)] * unit_mm[:, None], level.matrix[at, -1] * unit_mm)
    if unknown and query.spacing_mm is None and level.is_spaced:
        scale = np.linalg.norm(world[:3, :3], axis=0)
        remarks.append(
            f"{query.path}: the unit of its scale is {unknown[0]}, millimetres are assumed; "
            f"if that is wrong, give them as in {query.example(spacing=spacing_text(*scale))}"
        )
    # OME-Zarr has no directions: `volspec convert` writes its own.
    try:
        directions = _own_metadata(group)["world_from_picture"]
        return np.array(directions, float).reshape(4, 4) @ world
    except (KeyError, TypeError, ValueError):
        return world


def _level_names(levels: list[Level], names: list[str]) -> tuple[str, ...]:
    """Return the sizes of levels, such as ``2048 × 2048 × 80``."""
    sizes = [dict(zip(names, level.array.shape, strict=True)) for level in levels]
    return tuple(" × ".join(str(size.get(axis, 1)) for axis in "xyz") for size in sizes)


def _channels(group: Any) -> list[Channel]:
    """Return the channels in the ``omero`` metadata; empty if there are none."""
    attributes = dict(group.attrs)
    try:
        channels = attributes.get("ome", attributes)["omero"]["channels"]
        return [Channel.of_omero(channel) for channel in channels]
    except _DAMAGE:
        return []


def _values(
    level: Level, names: list[str], query: Query, channels: list[Channel]
) -> tuple[NDArray[Any], int]:
    """Read the selected channel and time as (Z, Y, X); also return the channel's number."""
    named, number = [channel.name for channel in channels], 0
    index: list[int | slice] = []
    for name, count in zip(names, level.array.shape, strict=True):
        if name in _SPACE:
            index.append(slice(None))
            continue
        key, what = _OPTIONS.get(name, ("", ""))
        if not key and count > 1:
            raise VolumeError(
                f"{query.path}: has {count} values along an axis {name!r}; a volume has x, y, z, "
                "save one of them",
                code="shape",
            )
        at = query.index(key, count, what, named if name == "c" else ())
        number = at if name == "c" else number
        index.append(at)
    query.end_choices()
    read = [n for n, at in zip(level.array.shape, index, strict=True) if isinstance(at, slice)]
    query.reserve(read, level.array.dtype.itemsize)
    # A chunk is decompressed whole, even if only a part is needed.
    chunk = [min(pair) for pair in zip(level.array.chunks, level.array.shape, strict=True)]
    if math.prod(chunk) > math.prod(read):
        query.reserve(chunk, level.array.dtype.itemsize)
    try:
        values = np.asarray(level.array[tuple(index)])
    except _DAMAGE as error:
        half = math.prod(read) * level.array.dtype.itemsize // 2**21
        some = query.example(memory=f"{max(half, 1)}MiB")
        raise VolumeError(
            f"{query.path}: a chunk cannot be read ({one_line(error)[:200]})",
            f"copy the store again, or leave the chunk out of pictures: {some}",
            code="damaged",
        ) from error
    order = [name for name in names if name in _SPACE]
    return values.transpose([order.index(name) for name in _SPACE]), number
