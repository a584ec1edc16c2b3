"""MetaImage files (.mha, .mhd): header, axes and units; voxels by `Layout`.

    path -> [metaimage] -> Layout, world_from_index, metadata

References
----------
[1] MetaIO documentation, MetaImage: ElementSpacing, TransformMatrix (an axis in each row), Offset
    in ITK's LPS frame, DistanceUnits, AnatomicalOrientation.
"""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from volspec.errors import VolumeError, quote
from volspec.volume.files.lattice import affine, mm_per_unit
from volspec.volume.files.layout import (
    Layout,
    choose_axes,
    counts,
    damage_error,
    dimensions,
    named_files,
)
from volspec.volume.files.query import Query, Reading
from volspec.volume.metadata import NO_SPACING, NO_UNIT, Metadata

_MAX_LINES, _MAX_LENGTH = 10_000, 1 << 16
# MetaIO also accepts a colon, and without either reads the value from the next line.
_LINE = re.compile(r"([^=:\r]+)[=:]([^\r]*)")
# Those of C on 32-bit machines: LONG has 4 bytes.
_CODES = "CHAR=i1 UCHAR=u1 SHORT=i2 USHORT=u2 INT=i4 UINT=u4 LONG=i4 ULONG=u4 LONG_LONG=i8"
_TYPES = dict(word.split("=") for word in f"{_CODES} ULONG_LONG=u8 FLOAT=f4 DOUBLE=f8".split())


def read_metaimage(query: Query) -> Reading:
    """Read a 3-D image, or one time step and one component of it."""
    path = query.path
    query.allow("time", "channel")
    fields, listed, end = _header(path)
    axes = dimensions(path, fields.get("NDims", "3"))
    size = counts(path, fields.get("DimSize", "").split())
    if len(size) != axes:
        raise damage_error(path, f"its DimSize has {len(size)} numbers, its NDims is {axes}")
    world, metadata = _world_from_index(query, fields, axes)
    channels = counts(path, [fields.get("ElementNumberOfChannels", "1")])
    shape = channels + size if channels[0] > 1 else size
    first = len(shape) - axes
    roles = {0: "channel"} if first else {}
    roles |= dict.fromkeys(range(first + 3, len(shape)), "time")
    layout = _layout(path, fields, listed, shape, end)
    picked = choose_axes(query, shape, roles)
    notes: list[str] = []
    values = layout.read(picked, query, notes)
    return Reading(values, world_from_index=world, notes=notes, metadata=metadata)


def _header(path: Path) -> tuple[dict[str, str], tuple[str, ...], int]:
    """Return the fields of a header, the files that follow it, and the first byte after it."""
    fields: dict[str, str] = {}
    with path.open("rb") as file:
        for number in range(_MAX_LINES):
            if not (read := file.readline(_MAX_LENGTH)):
                break
            if not (line := read.strip().decode("latin-1")):
                continue
            if (match := _LINE.fullmatch(line)) is None:
                raise VolumeError(
                    f"{path}: line {number + 1} of its header, {quote(line)}, is not "
                    "written as Name = value; correct or delete it",
                    code="syntax",
                )
            fields[match[1].rstrip(" \t")] = value = match[2].lstrip("=: \t")
            if match[1].rstrip(" \t") == "ElementDataFile":
                end = file.tell()
                lines = file.read().splitlines() if value.upper().startswith("LIST") else []
                names = (line.strip().decode("latin-1") for line in lines)
                return fields, tuple(filter(None, names)), end
    return fields, (), 0


def _is_true(word: str) -> bool:
    """Return True for a word that MetaIO reads as true, judging by its first letter alone."""
    return word[:1] in ("T", "t", "1")


def _layout(
    path: Path, fields: dict[str, str], listed: tuple[str, ...], shape: tuple[int, ...], end: int
) -> Layout:
    """Return the place and type of the voxels."""
    name = fields.get("ElementType", "")
    code = _TYPES.get(name.removeprefix("MET_").removesuffix("_ARRAY"))
    if code is None:
        raise VolumeError(
            f"{path}: its ElementType is {quote(name)}, none of MetaImage's for numbers; correct "
            "the header",
            code="unsupported",
        )
    order = fields.get("BinaryDataByteOrderMSB", fields.get("ElementByteOrderMSB", ""))
    packed = _is_true(fields.get("CompressedData", ""))
    encoding = "zlib" if packed else "raw"
    if not _is_true(fields.get("BinaryData", "True")):
        encoding = "text"
    try:
        seek = int(fields.get("HeaderSize", "0"))
    except ValueError as error:
        raise damage_error(path, f"its HeaderSize is {quote(fields['HeaderSize'])}") from error
    where = fields.get("ElementDataFile", "")
    if not where:
        raise damage_error(path, "its header does not say where the voxels are (ElementDataFile)")
    files: tuple[Path, ...] = (path,)
    if where.upper() == "LOCAL":
        seek = seek or end
    else:
        files = named_files(path, where, listed, ("1", str(shape[-1]), "1"))
    if packed and seek < 0:
        seek = 0 if files != (path,) else end
    dtype = np.dtype((">" if _is_true(order) else "<") + code)
    return Layout(path, files, dtype, shape, encoding, seek=max(seek, -1))


def _world_from_index(
    query: Query, fields: dict[str, str], axes: int
) -> tuple[NDArray[np.float64], Metadata]:
    """Return the map to millimetres in LPS, and what is known of it."""
    path = query.path
    spacing = _numbers(path, fields, ("ElementSpacing", "ElementSize"), axes)
    if spacing is not None and not all(0 < length < np.inf for length in spacing):
        words = fields.get("ElementSpacing", fields.get("ElementSize"))
        if query.spacing_mm is None:
            raise VolumeError(
                f"{path}: spacing {words}; each of x, y, z must be positive",
                f"correct the header, or give it as {query.example(spacing='1,1,1')}",
                code="range",
            )
        spacing = None
    origin = _numbers(path, fields, ("Offset", "Position", "Origin"), axes)
    names = ("TransformMatrix", "Rotation", "Orientation")
    matrix = _numbers(path, fields, names, axes**2)
    directions = np.eye(3) if matrix is None else matrix.reshape(axes, axes)[:3, :3].T
    # Rounded to a few decimals, their lengths are not 1.
    lengths = np.linalg.norm(directions, axis=0)
    directions = directions / np.where(lengths > 0, lengths, 1.0)
    unit_mm = mm_per_unit(fields.get("DistanceUnits"))
    assumed: tuple[str, ...] = () if unit_mm else (NO_UNIT,)
    mm = unit_mm or 1.0
    if spacing is None:
        spacing, assumed = np.ones(axes), (NO_SPACING,)
    start = np.zeros(axes) if origin is None else origin
    columns, first, of = np.zeros((3, 3)), np.zeros(3), min(axes, 3)
    columns[:of, :of], first[:of] = directions[:of, :of] * spacing[:3] * mm, start[:3] * mm
    world = affine(columns, first)
    if not np.isfinite(world).all():
        raise damage_error(path, "its directions or its origin hold no numbers")
    letters = fields.get("AnatomicalOrientation", "").strip("? ")
    return world, Metadata(is_patient=letters != "", assumed=assumed)


def _numbers(
    path: Path, fields: dict[str, str], names: tuple[str, ...], count: int
) -> NDArray[np.float64] | None:
    """Return the numbers of the first of several fields that is there; None if none is."""
    name = next((key for key in names if key in fields), None)
    if name is None:
        return None
    try:
        numbers = np.array([float(word) for word in fields[name].split()])
    except ValueError:
        numbers = np.empty(0)
    if len(numbers) < count:
        raise damage_error(path, f"its {name} is {quote(fields[name])}, not {count} numbers")
    return numbers[:count]
