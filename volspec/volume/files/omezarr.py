"""OME-Zarr (versions 0.4 and 0.5) and plain Zarr arrays: folders, zip files and URLs; N5 folders.

    folder -> multiscales: axes, levels, scale -> [omezarr] -> Stack, Reading

The zarr library opens Zarr's metadata, `volspec.volume.files.n5` those of N5.

References
----------
[1] Moore et al. (2023), "OME-Zarr: a cloud-optimized bioimaging file format", Histochem Cell Biol
    160, 223-251. doi:10.1007/s00418-023-02209-1; ngff.openmicroscopy.org/0.5
[2] OME-NGFF RFC-5, coordinate systems and transformations: ``affine`` is a matrix of a row for each
    axis, with a column for each and one of offsets; ``rotation`` has no offsets.
"""

from __future__ import annotations

import json
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from volspec.errors import VolumeError, one_line
from volspec.volume.channels import Channel
from volspec.volume.files.label_tables import labels_in_zarr
from volspec.volume.files.lattice import affine, mm_per_unit, spacing_text
from volspec.volume.files.n5 import Axes, is_n5, named_axes, open_n5
from volspec.volume.files.query import Choice, ChoicesListed, OneSlice, Query, Reading
from volspec.volume.files.tensors import fast_array, import_zarr
from volspec.volume.labels import Labels
from volspec.volume.levels.pyramid import BLOCK, DEFAULT_BYTES, Level, Stack, cast_dtype
from volspec.volume.levels.sample import BINS, VoxelSample, step_along
from volspec.volume.metadata import NO_SPACING, NO_UNIT, Metadata

ZIP_SUFFIXES = (".zarr.zip", ".ozx")
_MARKS = (".zgroup", ".zattrs", ".zarray", "zarr.json")
# More bytes of voxels than this are a mistake: 1 PiB.
_MAX_BYTES = 2**50
_SPACE = ("z", "y", "x")
_OPTIONS = {"c": ("channel", "channels"), "t": ("time", "time steps")}
# Depth to which groups are searched for arrays.
_DEEPEST = 4
# Elements of a matrix (N + 1, N + 1) that a transformation gives, by its type.
_SHAPES: dict[str, Callable[[int], tuple[Any, Any]]] = {
    "scale": lambda count: (range(count), range(count)),
    "translation": lambda _: (slice(-1), -1),
    "affine": lambda _: (slice(-1), slice(None)),
    "rotation": lambda _: (slice(-1), slice(-1)),
}
DAMAGE = (KeyError, TypeError, ValueError, IndexError, OSError, RuntimeError, AttributeError)


@dataclass(frozen=True, slots=True)
class _Picture:
    """Levels of a picture, finest first, with the names of their axes and the group's metadata."""

    query: Query
    group: Any  # of zarr, from which further arrays are read
    names: list[str]
    levels: list[Level]
    units: list[str]  # along x, y, z; empty if no scale is stated
    ome: dict[str, Any]
    attrs: dict[str, Any]  # what `volspec convert` adds; empty if another program wrote it

    @property
    def is_in_parts(self) -> bool:
        """True if it is larger than memory, and one channel and time are selected."""
        if self.levels[0].nbytes <= (self.query.memory_bytes or DEFAULT_BYTES):
            return False
        sides = zip(self.names, self.levels[0].array.shape, strict=True)
        axes = [name for name, count in sides if name not in _SPACE and count > 1]
        return all(_OPTIONS.get(name, ("", ""))[0] in self.query.options for name in axes)

    @property
    def sizes(self) -> tuple[str, ...]:
        """Sizes of the levels, such as ``2048 × 2048 × 80``."""
        return tuple(" × ".join(map(str, level.shape[::-1])) for level in self.levels)

    @property
    def labels(self) -> Labels | None:
        """Labels in the metadata; None if it is no picture of labels."""
        image_label = self.ome.get("image-label")
        return None if image_label is None else labels_in_zarr(image_label)

    @property
    def metadata(self) -> Metadata:
        """Statements on the source by `volspec convert`; else what is assumed of the lengths."""
        attrs = self.attrs.get("metadata")
        if isinstance(attrs, dict):
            modality, unit = (str(attrs.get(key, "")) for key in ("modality", "unit"))
            assumed = tuple(map(str, attrs.get("assumed", ())))
            return Metadata(modality, unit, bool(attrs.get("is_patient")), assumed)
        if not self.units:
            return Metadata(assumed=(NO_SPACING,))
        return Metadata(assumed=() if all(map(mm_per_unit, self.units)) else (NO_UNIT,))

    def select(self) -> tuple[tuple[int, ...], Channel | None]:
        """Return the selected index along each axis, 0 along those of space, and the channel."""
        try:
            channels = [Channel.of_omero(channel) for channel in self.ome["omero"]["channels"]]
        except DAMAGE:
            channels = []
        titles = [channel.name for channel in channels]
        index = selected_index(self.query, self.names, self.levels[0].array.shape, titles)
        number = index[self.names.index("c")] if "c" in self.names else 0
        return index, next(iter(channels[number:]), None)

    def choose_level(self, notes: list[str]) -> Level:
        """Return the level that the query selects, else the finest that memory holds."""
        query, count = self.query, len(self.levels)
        if "level" in query.options:
            return self.levels[query.index("level", count, "levels", self.sizes)]
        max_bytes = query.memory_bytes or DEFAULT_BYTES
        number = next((k for k in range(count) if self.levels[k].nbytes <= max_bytes), count - 1)
        if query.choices is not None and count > 1 and not self.is_in_parts:
            values = tuple(map(str, range(count)))
            query.choices.append(Choice("level", values, self.sizes, str(number)))
        if number:
            notes.append(
                f"{query.path}: level 0 takes {self.levels[0].nbytes / 1e9:.3g} GB, level {number} "
                f"is read; choose another as {query.example(level='0')}"
            )
        return self.levels[number]

    def unit_notes(self, level: Level) -> list[str]:
        """Return a note if the unit of the scale is unknown, and no spacing is given."""
        unknown = [unit for unit in self.units if mm_per_unit(unit) is None]
        if not unknown or self.query.spacing_mm is not None:
            return []
        scale = spacing_text(*np.linalg.norm(level.world_from_index[:3, :3], axis=0))
        return [
            f"{self.query.path}: the unit of its scale is {unknown[0] or 'none'}, millimetres are "
            f"assumed; if that is wrong, give them as in {self.query.example(spacing=scale)}"
        ]


def is_zarr(folder: Path) -> bool:
    """Return True if a folder is a Zarr group or array, or one of N5."""
    return any((folder / mark).is_file() for mark in _MARKS) or is_n5(folder)


def read_ome_zarr(query: Query) -> Reading:
    """Read a level of a picture, with the channel and time that the query selects."""
    query.allow("level", "channel", "time", "dataset", "axes")
    picture = _open_picture(query)
    notes: list[str] = []
    level = picture.choose_level(notes)
    notes += picture.unit_notes(level)
    index, channel = picture.select()
    remedy, half = "copy the store again", level.nbytes // 2
    # A chunk is left out only of a picture whose coarser levels are whole.
    if "level" not in query.options and level is not picture.levels[-1]:
        memory = f"{half >> 20}MiB" if half >> 20 else f"{half}B"
        remedy += f", or leave the chunk out of pictures: {query.example(memory=memory)}"
    values = read_level(query, replace(level, at=index), remedy)
    details = picture.labels, channel, picture.metadata
    return Reading(values, None, level.world_from_index, notes, *details)


def selected_index(
    query: Query, names: Sequence[str], shape: Sequence[int], titles: Sequence[str] = ()
) -> tuple[int, ...]:
    """Return the index that the query selects along each axis, 0 along those of space."""
    index = []
    for name, count in zip(names, shape, strict=True):
        key, noun = _OPTIONS.get(name, ("", ""))
        if not key and name not in _SPACE and count > 1:
            raise VolumeError(
                f"{query.path}: has {count} values along an axis {name!r}; a volume has x, y, z, "
                "save one of them",
                code="shape",
            )
        index.append(query.index(key, count, noun, titles if name == "c" else ()) if key else 0)
    return tuple(index)


def read_level(query: Query, level: Level, remedy: str) -> NDArray[Any]:
    """Read a level as a whole, unless only choices are asked for."""
    query.end_choices()
    z, y, x = level.shape
    query.reserve((z, y, x), level.dtype.itemsize)
    # A chunk is decompressed whole, even if only a part is needed.
    chunk = np.minimum(level.array.chunks or 1, level.array.shape).tolist()
    if math.prod(chunk) > z * y * x:
        query.reserve(chunk, level.dtype.itemsize)
    try:
        return level.read(((0, z), (0, y), (0, x)))
    except DAMAGE as error:
        raise VolumeError(
            f"{query.path}: a chunk cannot be read ({one_line(error)[:200]})",
            remedy,
            code="damaged",
        ) from error


def ome_zarr_stack(query: Query) -> Stack | None:
    """Return the levels of a picture that is larger than memory; else None.

    So are those of several channels, unless one is selected. Raises VolumeError if the levels are
    not resolutions of one picture.
    """
    if "level" in query.options or query.choices is not None:
        return None
    picture = _open_picture(query)
    if not picture.is_in_parts:
        return None
    if any(level.nbytes > _MAX_BYTES for level in picture.levels):
        raise VolumeError(
            f"{query.path}: its metadata declare {picture.sizes[0]} voxels; is it damaged?",
            code="damaged",
        )
    index, channel = picture.select()
    notes = picture.unit_notes(picture.levels[0])
    levels: list[Level] = []
    for number, level in enumerate(picture.levels):
        _check_extent(picture, number)
        ranges, shards = _ranges(picture, number), level.array.shards
        # Files of a conversion are small: of a server, they are asked for as a whole.
        by_block = ranges is not None and shards is not None and not query.is_remote
        if shards is not None and (by_block or picture.attrs.get("complete")):
            z, y, x = (shards[axis] for axis in level.axes)
            level = replace(level, chunk=(z, y, x))
        levels.append(replace(level, at=index, ranges=ranges, by_block=by_block))
    sample = _sample(picture, levels[0])
    without = "the {} (volspec/{}) cannot be used, so that {}; convert it again"
    if "ranges" in picture.attrs and any(level.ranges is None for level in levels):
        problem = without.format("ranges of its blocks", "ranges", "casts read more")
        notes.append(f"{query.path}: {problem}")
    if "sample" in picture.attrs and sample is None:
        worse = "camera and colours follow from a coarse level"
        problem = without.format("sample of its voxels", "sample", worse)
        notes.append(f"{query.path}: {problem}")
    return Stack(levels, channel, picture.labels, notes, sample, picture.metadata)


def _ranges(picture: _Picture, number: int) -> NDArray[Any] | None:
    """Return the ranges of a level's blocks that `volspec convert` wrote; None if there are none.

    So it is if they are damaged, or not of these voxels.
    """
    voxels = picture.levels[number].array
    try:
        paths = picture.attrs["ranges"]
        if picture.attrs["block"] != BLOCK:
            return None
        ranges = np.asarray(fast_array(picture.group[paths[number]], complete=True)[...])
    except DAMAGE:
        return None
    blocks = tuple(-(-n // BLOCK) for n in voxels.shape)
    low_high = ranges.shape == (2, *blocks) and ranges.dtype == cast_dtype(voxels.dtype)
    return ranges if low_high and (ranges[0] <= ranges[1]).all() else None


def _sample(picture: _Picture, finest: Level) -> VoxelSample | None:
    """Return what `volspec convert` wrote of all voxels; None if it did not, or it is damaged."""
    attrs = picture.attrs
    try:
        low, high = map(float, attrs["range"])
        counts = np.array(attrs["histogram"], float)
        voxels = np.asarray(fast_array(picture.group[attrs["sample"]], complete=True)[...])
    except DAMAGE:
        return None
    sides = tuple(-(-n // step_along(n)) for n in finest.shape)
    if not (low <= high and counts.shape == (BINS,) and (counts >= 0).all()):
        return None
    return VoxelSample((low, high), counts, voxels) if voxels.shape == sides else None


def _check_extent(picture: _Picture, number: int) -> None:
    """Refuse a level that does not cover the same part of the world as the finest."""
    ends, widths = [], []
    for level in (picture.levels[number], picture.levels[0]):
        columns, origin = level.world_from_index[:3, :3], level.world_from_index[:3, 3]
        corners = np.subtract([(0, 0, 0), level.shape[::-1]], 0.5)
        ends.append((corners @ columns.T + origin).T)
        widths.append(np.abs(columns).sum(axis=1))
    distances = np.abs(ends[0] - ends[1]).max(axis=1)
    for axis in np.flatnonzero(distances > 1.01 * np.maximum(*widths)):
        (a, b), (c, d) = ends[0][axis], ends[1][axis]
        raise VolumeError(
            f"{picture.query.path}: level {number} lies from {a:g} to {b:g} mm along "
            f"{'xyz'[axis]}, level 0 from {c:g} to {d:g}; its levels are not resolutions of one "
            "picture",
            f"correct its metadata, or read one level: {picture.query.example(level=str(number))}",
            code="conflict",
        )


def _open_picture(query: Query) -> _Picture:
    """Return a picture, or an array as one."""
    path = query.path
    if not query.is_remote and is_n5(path):
        array, axes, matrix, is_spaced = open_n5(query)
        return _picture(query, None, axes, [(array, matrix)], is_spaced)
    zarr = import_zarr(path)
    try:
        zipped = path.name.lower().endswith(ZIP_SUFFIXES) and not query.is_remote
        group = zarr.open(zarr.storage.ZipStore(path, mode="r") if zipped else str(path), mode="r")
        if isinstance(group, zarr.Group) and ("dataset" in query.options or not _pictures(group)):
            group = group[_array_in(group, query)]
        if not isinstance(group, zarr.Array):
            return _multiscale(group, query)
        dimensions = getattr(group.metadata, "dimension_names", None)
        names = [str(n).lower()[:1] for n in dimensions or group.attrs.get("_ARRAY_DIMENSIONS", ())]
        axes = [{"name": name} for name in named_axes(query, group.shape, names, "tczyx")]
        return _picture(query, group, axes, [(fast_array(group), np.eye(group.ndim + 1))], False)
    except (VolumeError, ChoicesListed):
        raise
    except Exception as error:  # whatever the library raises
        problem = f"cannot be read ({one_line(error)[:120]})"
        if isinstance(error, KeyError):
            problem = f"have no {error.args[0]!r}"
        if isinstance(error, json.JSONDecodeError):
            problem = f"are not valid JSON (line {error.lineno}, column {error.colno})"
        remedy = "is the address right?" if query.is_remote else "is it complete?"
        raise VolumeError(
            f"{path}: its OME-Zarr metadata {problem}; {remedy}", code="damaged"
        ) from error


def _metadata(group: Any) -> dict[str, Any]:
    """Return the attributes of a group, which version 0.5 has under ``ome``."""
    attributes = dict(group.attrs)
    metadata: dict[str, Any] = attributes.get("ome", attributes)
    return metadata


def _pictures(group: Any) -> Any:
    """Return the pictures of a group in its metadata; none if it has none."""
    return _metadata(group).get("multiscales")


def _picture(
    query: Query, group: Any, axes: Axes, arrays: Sequence[tuple[Any, Any]], is_spaced: bool
) -> _Picture:
    """Return arrays as the levels of a picture, with their maps from index to axes' units."""
    names = [str(axis["name"]).lower() for axis in axes]
    if "z" not in names and "y" in names:  # a picture: one slice of unknown depth
        names, axes = ["z", *names], [axes[names.index("y")], *axes]
        arrays = [(OneSlice(array), np.pad(matrix, ((1, 0), (1, 0)))) for array, matrix in arrays]
    if missing := [name for name in _SPACE if name not in names]:
        raise VolumeError(
            f"{query.path}: has no axis {missing[0]} (its axes are {', '.join(names)}); a volume "
            "has x, y and z",
            code="shape",
        )
    attrs = {} if group is None else group.attrs.get("volspec")
    attrs = attrs if isinstance(attrs, dict) else {}
    # OME-Zarr has no directions: `volspec convert` writes its own.
    try:
        directions = np.array(attrs["world_from_picture"], float).reshape(4, 4)
    except (KeyError, TypeError, ValueError):
        directions = np.eye(4)
    k, j, i = places = tuple(names.index(name) for name in _SPACE)
    order = [i, j, k]
    units = [str(axes[place].get("unit") or "") for place in order] if is_spaced else []
    unit_mm = np.array([mm_per_unit(unit) or 1.0 for unit in units] or [1.0] * 3)
    levels = []
    for array, matrix in arrays:
        world = affine(matrix[np.ix_(order, order)] * unit_mm[:, None], matrix[order, -1] * unit_mm)
        z, y, x = (array.chunks[place] for place in places)
        levels.append(Level(array, (k, j, i), (0,) * len(names), directions @ world, (z, y, x)))
    ome = {} if group is None else _metadata(group)
    return _Picture(query, group, names, levels, units, ome, attrs)


def _array_in(group: Any, query: Query) -> str:
    """Return the array that ``dataset=`` selects in a group without a picture of its own."""
    shapes: dict[str, tuple[int, ...]] = {}

    def search(inner: Any, place: str, depth: int) -> None:
        for name, node in inner.members():
            if hasattr(node, "shape"):
                if node.ndim >= 2 and node.dtype.kind in "buif":
                    shapes[place + name] = node.shape
            elif _pictures(node):
                raise VolumeError(
                    f"{query.path}: is a Zarr folder of pictures (multiscales); give one of them, "
                    f"such as {query.path}/{place}{name}",
                    code="unsupported",
                )
            elif depth:
                search(node, f"{place}{name}/", depth - 1)

    if not query.is_remote:  # of a URL, folders are not listed
        search(group, "", _DEEPEST)
    if not shapes:
        raise VolumeError(
            f"{query.path}: is a Zarr folder without an OME-Zarr picture (multiscales) or an array "
            "of three axes; give the folder of one",
            code="unsupported",
        )
    deep = {name: shape for name, shape in shapes.items() if len(shape) > 2}
    return query.array_named(deep or shapes)


def _multiscale(group: Any, query: Query) -> _Picture:
    """Return the first picture of a group."""
    multiscale = _pictures(group)[0]
    # Version 0.3 states only the axes' names.
    axes = [axis if isinstance(axis, dict) else {"name": axis} for axis in multiscale["axes"]]
    common = multiscale.get("coordinateTransformations", [])
    attrs = group.attrs.get("volspec")
    complete = isinstance(attrs, dict) and bool(attrs.get("complete"))
    arrays, steps = [], []
    for entry in multiscale["datasets"]:
        steps = [*entry.get("coordinateTransformations", []), *common]
        try:
            array = fast_array(group[entry["path"]], complete=complete)
        except KeyError as error:
            raise ValueError(f"they name an array {entry['path']!r}, which is not there") from error
        if len(array.shape) != len(axes):
            raise ValueError(f"{len(axes)} axes of an array of {len(array.shape)}")
        arrays.append((array, _matrix(steps, len(axes), query)))
    if not arrays:
        raise ValueError("no datasets")
    sizes = [math.prod(array.shape) for array, _ in arrays]
    if "level" not in query.options and sizes != sorted(sizes, reverse=True):
        raise VolumeError(
            f"{query.path}: its levels are not in order, from the finest to the coarsest",
            f"correct its metadata, or read one level: {query.example(level='0')}",
            code="conflict",
        )
    return _picture(query, group, axes, arrays, bool(steps))


def _matrix(steps: Sequence[dict[str, Any]], count: int, query: Query) -> NDArray[np.float64]:
    """Combine transformations into a map from index to place, (N + 1, N + 1).

    >>> _matrix([{"type": "scale", "scale": [2]}, {"type": "translation", "translation": [3]},
    ... {"type": "scale", "scale": [10]}], 1, Query(Path())).tolist()
    [[20.0, 30.0], [0.0, 1.0]]
    """
    matrix = np.eye(count + 1)
    for step in steps:
        kind, one, by_path = step["type"], np.eye(count + 1), "path" in step
        if kind == "sequence":
            one = _matrix(step["transformations"], count, query)
        elif kind in _SHAPES and kind in step:
            place = _SHAPES[kind](count)
            numbers = _numbers(step[kind], one[place].shape, kind)
            if numbers is None and query.spacing_mm is None:
                needed = f"{count} positive numbers" if kind == "scale" else "numbers for its axes"
                raise VolumeError(
                    f"{query.path}: its {kind} in the OME-Zarr metadata is {step[kind]!r:.60}, not "
                    f"{needed}",
                    f"correct it, or give the spacing as in {query.example(spacing='1,1,1')}",
                    code="damaged",
                )
            one[place] = one[place] if numbers is None else numbers
        elif kind != "identity" and query.spacing_mm is None:
            raise VolumeError(
                f"{query.path}: has a transformation of type {kind:.40}{' by path' * by_path}; "
                f"supported are those with numbers in the metadata: {', '.join(_SHAPES)}, sequence",
                f"give the spacing in mm instead, as in {query.example(spacing='1,1,1')}",
                code="unsupported",
            )
        matrix = one @ matrix
    return matrix


def _numbers(value: Any, shape: tuple[int, ...], kind: str) -> NDArray[np.float64] | None:
    """Return the numbers of a transformation; None if they are none, too few, or no scale."""
    try:
        numbers = np.array(value, float)
    except (TypeError, ValueError):
        return None
    is_valid = np.isfinite(numbers).all() and (kind != "scale" or (numbers > 0).all())
    return numbers if numbers.shape == shape and is_valid else None
