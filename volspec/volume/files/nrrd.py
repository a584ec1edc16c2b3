"""NRRD files: header, axes, units and segments; voxels by `Layout`.

    path -> [nrrd] -> Layout, world_from_index, metadata

References
----------
[1] Definition of NRRD file format, teem.sourceforge.net/nrrd/format.html: types, encodings, axes,
    spaces; samples of an axis with mins and maxs but without ``centerings`` are cells, as in Teem.
[2] 3D Slicer, Segmentations: ``SegmentN_Name``, ``_LabelValue``, ``_Layer``, ``_Color``.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from volspec.errors import VolumeError, quote
from volspec.volume.channels import ALL
from volspec.volume.files.label_tables import labels_in_nrrd
from volspec.volume.files.lattice import affine, mm_per_unit
from volspec.volume.files.layout import (
    Layout,
    choose_axes,
    counts,
    damage_error,
    dimensions,
    named_files,
)
from volspec.volume.files.query import Query, Reading, Stored
from volspec.volume.labels import Labels
from volspec.volume.metadata import NO_SPACING, NO_UNIT, Metadata

# Greatest number of a header's lines, and their greatest length.
_MAX_LINES, _MAX_LENGTH = 10_000, 1 << 16
_CODES = "char=i1 uchar=u1 short=i2 ushort=u2 int=i4 uint=u4 longlong=i8 ulonglong=u8 float=f4"
_SIZED = "int8=i1 uint8=u1 int16=i2 uint16=u2 int32=i4 uint32=u4 int64=i8 uint64=u8 double=f8"
_TYPES = dict(word.split("=") for word in f"{_CODES} {_SIZED}".split())
_NAMES = "raw=raw gz=gzip gzip=gzip bz2=bzip2 bzip2=bzip2 hex=hex txt=text text=text ascii=text"
_ENCODINGS = dict(word.split("=") for word in _NAMES.split())
# Signs that turn the spaces of patients to left, posterior, superior.
_PATIENT = {
    **dict.fromkeys(("ras", "rightanteriorsuperior"), (-1.0, -1.0, 1.0)),
    **dict.fromkeys(("las", "leftanteriorsuperior"), (1.0, -1.0, 1.0)),
    **dict.fromkeys(("lps", "leftposteriorsuperior"), (1.0, 1.0, 1.0)),
}
# Custom keys in which Slicer states what its sequences, whose first axis is time, are indexed by.
_INDEX = "axis 0 index"
_VECTOR, _QUOTED = re.compile(r"none|\([^)]*\)"), re.compile(r'"([^"]*)"')


@dataclass(frozen=True, slots=True)
class _Header:
    """Fields in lower case without spaces, such as ``byteskip``, and custom keys with values."""

    path: Path
    named: dict[str, str]
    pairs: dict[str, str]
    listed: tuple[str, ...]  # data files
    end: int  # first byte after the header

    @classmethod
    def read(cls, path: Path) -> _Header:
        """Read a header: UTF-8, as Slicer and pynrrd write it, or else Latin-1."""
        named: dict[str, str] = {}
        pairs: dict[str, str] = {}
        listed: list[str] = []
        with path.open("rb") as file:
            if not file.readline(80).startswith(b"NRRD"):
                raise damage_error(path, "does not begin as an NRRD header")
            for _ in range(_MAX_LINES):
                line = _text(file.readline(_MAX_LENGTH)).strip()
                if not line:
                    break
                key, separator, value = line.partition(":")
                if named.get("datafile", "")[:4].upper() == "LIST":
                    listed.append(line)
                elif separator and value.startswith("="):
                    pairs[key] = value[1:]
                elif separator and not line.startswith("#"):
                    named[key.strip().lower().replace(" ", "")] = value.strip()
            named["datafile"] = named.get("datafile", "")
            return cls(path, named, pairs, tuple(listed), file.tell())

    def words(self, name: str, count: int) -> list[str]:
        """Return one word for each axis; empty if the field is missing."""
        words = self.named.get(name, "").split()
        if words and len(words) != count:
            raise damage_error(self.path, f"its {name} are {len(words)}, its axes {count}")
        return words

    def numbers(self, name: str, count: int) -> NDArray[np.float64] | None:
        """Return one number for each axis; None if the field is missing."""
        words = self.words(name, count)
        try:
            return np.array([float(word) for word in words]) if words else None
        except ValueError as error:
            raise damage_error(self.path, f"its {name} are {quote(self.named[name])}") from error

    def units(self, name: str, count: int) -> NDArray[np.float64]:
        """Return the millimetres in the unit of each axis; NaN if it is none of length."""
        units = [mm_per_unit(unit) for unit in _QUOTED.findall(self.named.get(name, ""))]
        return np.array(units if len(units) == count else [None] * count, np.float64)

    def directions(self, count: int) -> list[NDArray[np.float64] | None]:
        """Return the vector (3,) to the next sample along each axis; None if it has none."""
        vectors: list[NDArray[np.float64] | None] = []
        for text in _VECTOR.findall(self.named.get("spacedirections", "").lower()):
            vector = self.vector(text) if text != "none" else None
            vectors.append(vector if vector is not None and vector.any() else None)
        if vectors and len(vectors) != count:
            raise damage_error(
                self.path, f"its space directions are {len(vectors)}, its axes {count}"
            )
        return vectors

    def vector(self, text: str) -> NDArray[np.float64] | None:
        """Return the first three numbers of a vector (x,y,z), without those of time."""
        try:
            numbers = np.array([float(word) for word in text.strip("() ").split(",")])
        except ValueError as error:
            raise damage_error(self.path, f"its vector is {quote(text)}") from error
        if len(numbers) < 2:
            raise VolumeError(f"{self.path}: its space is {len(numbers)}-D, not 3-D", code="shape")
        return None if np.isnan(numbers).all() else np.append(numbers, 0.0)[:3]


def _text(line: bytes) -> str:
    try:
        return line.decode()
    except UnicodeDecodeError:
        return line.decode("latin-1")


def read_nrrd(query: Query) -> Reading:
    """Read a 3-D image, or one time step and one component of it."""
    query.allow("time", "channel")
    header = _Header.read(query.path)
    axes = dimensions(query.path, header.named.get("dimension", "").replace(" ", ""))
    shape = counts(query.path, header.named.get("sizes", "").split())
    if len(shape) != axes:
        raise damage_error(query.path, f"its sizes are {len(shape)}, its axes {axes}")
    layout = _layout(header, shape)
    roles = _roles(header, axes)
    space = [axis for axis in range(axes) if axis not in roles]
    world, metadata = None, Metadata()
    if len(space) in (2, 3):
        world, metadata = _world_from_index(header, shape, space, query)
    notes: list[str] = []
    values: Stored | NDArray[Any]
    labels: Labels | None
    if list(roles.values()) == ["channel"] and labels_in_nrrd(header.pairs, 0) and _all(query):
        values, labels = _merge_segments(layout, next(iter(roles)), header, query, notes)
    else:
        picked = choose_axes(query, shape, roles)
        values = layout.read(picked, query, notes)
        layer = next((picked[axis] for axis, role in roles.items() if role == "channel"), 0)
        labels = labels_in_nrrd(header.pairs, layer)
    return Reading(values, None, world, notes, labels, metadata=metadata)


def _all(query: Query) -> bool:
    """Return True if all channels are read, not one of them or the list of choices."""
    return query.choices is None and query.options.get("channel", ALL) == ALL


def _merge_segments(
    layout: Layout, axis: int, header: _Header, query: Query, notes: list[str]
) -> tuple[NDArray[Any], Labels]:
    """Return the segments of several layers, which may overlap, as one volume of labels.

    They keep their numbers, or are numbered in order if two layers use the same.
    """
    layers = [labels_in_nrrd(header.pairs, k) or {} for k in range(layout.shape[axis])]
    keys = [(layer, number) for layer, labels in enumerate(layers) for number in labels]
    own_numbers = {number for _, number in keys}
    fits = len(own_numbers) == len(keys) and max(own_numbers) < 1 << 16
    numbers = {key: key[1] if fits else place for place, key in enumerate(keys, start=1)}
    values, overlap = np.zeros((1, 1, 1), np.uint16), 0
    for layer, labels in enumerate(layers):
        read = layout.read({axis: layer}, query, notes if not layer else [])
        voxels = read.read() if isinstance(read, Stored) else read
        codes = np.zeros(voxels.shape, np.uint16)
        for number in labels:
            codes[voxels == number] = numbers[layer, number]
        overlap += int(np.count_nonzero((values > 0) & (codes > 0)))
        values = np.where(codes > 0, codes, values)
    if overlap:
        notes.append(
            f"{query.path}: segments overlap in {overlap} voxels, which show the one in the later "
            f"layer; {query.example(channel='0')} is the first layer"
        )
    return values, {numbers[k, n]: layers[k][n] for k, n in keys}


def _roles(header: _Header, axes: int) -> dict[int, str]:
    """Return the axes that are not of space, and the option that chooses along each."""
    kinds = header.named.get("kinds", "").lower().split()
    kinds = kinds if len(kinds) == axes else ["???"] * axes
    spacings, directions = header.numbers("spacings", axes), header.directions(axes)
    space: list[int] = []
    for axis, kind in enumerate(kinds):
        if directions:
            is_space = directions[axis] is not None
        elif kind in ("none", "???"):
            is_space = spacings is None or axes < 4 or not np.isnan(spacings[axis])
        else:
            is_space = kind in ("domain", "space")
        if is_space and len(space) < 3:
            space.append(axis)
    is_sequence = kinds[0] == "list" and any(key.startswith(_INDEX) for key in header.pairs)
    roles = {}
    for axis, kind in enumerate(kinds):
        unknown = kind in ("domain", "space", "none", "???")
        is_time = kind == "time" or (unknown and axis > max(space, default=0))
        if axis not in space:
            roles[axis] = "time" if is_time or (is_sequence and axis == 0) else "channel"
    return roles


def _layout(header: _Header, shape: tuple[int, ...]) -> Layout:
    """Return the place and type of the voxels."""
    path, named = header.path, header.named
    words = re.sub(r"_t$|^signed ", "", named.get("type", "").lower().strip())
    code = _TYPES.get(re.sub(r"unsigned ", "u", words).removesuffix(" int").replace(" ", ""))
    encoding = _ENCODINGS.get(named.get("encoding", "raw").lower())
    if code is None or encoding is None:
        problem = f"type {quote(named.get('type', ''))}"
        if code is not None:
            problem = f"encoding {quote(named['encoding'])}"
        raise VolumeError(
            f"{path}: its {problem} is none of NRRD's for numbers; correct the header",
            code="unsupported",
        )
    try:
        skip, lines = (int(named.get(name, "0")) for name in ("byteskip", "lineskip"))
    except ValueError as error:
        raise damage_error(path, "its byte or line skip is no whole number") from error
    where = named["datafile"]
    files = named_files(path, where, header.listed) if where else (path,)
    packed = encoding in ("gzip", "bzip2")
    at_end = skip < 0 and not packed
    seek = 0 if where else header.end
    order = ">" if named.get("endian", "").lower() == "big" else "<"
    return Layout(
        *(path, files, np.dtype(order + code), shape, encoding),
        seek=-1 if at_end else seek,
        lines=0 if at_end else max(lines, 0),
        skip=max(skip, 0),
    )


def _world_from_index(
    header: _Header, shape: tuple[int, ...], space: list[int], query: Query
) -> tuple[NDArray[np.float64], Metadata]:
    """Return the map to millimetres of the three axes of space, and what is known of it."""
    axes, path = len(shape), header.path
    directions = header.directions(axes)
    origin = header.named.get("spaceorigin", "")
    start = header.vector(origin) if origin else None
    frame = re.sub(r"[-\s]|time$", "", header.named.get("space", "").lower()).removesuffix("time")
    signs = _PATIENT.get(frame)
    assumed: tuple[str, ...] = ()
    if directions:
        columns = np.stack([d for a in space if (d := directions[a]) is not None], axis=1)
        units = header.units("spaceunits", 3)
        if len(space) == 2 and np.isnan(units).all():
            units = np.resize(header.units("spaceunits", 2), 3)
        mm = np.nan_to_num(units, nan=1.0)
        columns, start = columns * mm[:, None], (np.zeros(3) if start is None else start) * mm
        columns = np.pad(columns, ((0, 0), (0, 3 - len(space))))
    else:
        spacing, first, assumed = _spacing(header, shape)
        bad = [not (np.isfinite(spacing[axis]) and spacing[axis]) for axis in space]
        if "spacings" in header.named:  # those of mins and maxs may lead backwards
            bad = [not 0 < spacing[axis] < np.inf for axis in space]
        if any(bad) and query.spacing_mm is None:
            words = " ".join(f"{length:g}" for length in spacing)
            raise VolumeError(
                f"{path}: spacing {words}; each of x, y, z must be positive",
                f"correct the header, or give it as {query.example(spacing='1,1,1')}",
                code="range",
            )
        spacing[[axis for axis, wrong in zip(space, bad, strict=True) if wrong]] = 1.0
        units = header.units("units", axes)[space]
        mm = np.nan_to_num(units, nan=1.0)
        columns, offset = np.zeros((3, 3)), np.zeros(3)
        np.fill_diagonal(columns[: len(space)], spacing[space] * mm)
        offset[: len(space)] = first[space] * mm
        start = offset if start is None else start * np.resize(mm, 3)
    if not assumed and np.isnan(units).any():
        assumed = (NO_UNIT,)
    world = affine(columns, np.where(np.isnan(start), 0.0, start))
    if signs is not None:
        world = np.diag([*signs, 1.0]) @ world
    return world, Metadata(is_patient=signs is not None, assumed=assumed)


def _spacing(
    header: _Header, shape: tuple[int, ...]
) -> tuple[NDArray[np.float64], NDArray[np.float64], tuple[str, ...]]:
    """Return the spacing and the first sample along each axis, and what is assumed of them."""
    axes = len(shape)
    spacings = header.numbers("spacings", axes)
    low, high = (header.numbers(f"axis{end}", axes) for end in ("mins", "maxs"))
    centred = header.words("centerings", axes) or header.words("centers", axes)
    node = np.array([word.lower() == "node" for word in centred])
    node = node if node.size else np.zeros(axes, bool)
    assumed: tuple[str, ...] = () if spacings is not None else (NO_SPACING,)
    spacing = np.ones(axes) if spacings is None else spacings
    if low is not None and high is not None and spacings is None:
        spacing = (high - low) / (np.array(shape) - node)
        assumed = ()
    first = np.zeros(axes) if low is None else low + np.where(node, 0.0, spacing / 2)
    return spacing, first, assumed
