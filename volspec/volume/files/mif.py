"""MRtrix images, ``.mif``, ``.mif.gz`` and ``.mih``: text header; voxels by `Layout`.

    path -> [mif] -> Layout, world_from_index, metadata

References
----------
[1] MRtrix3, "Images and other data": ``layout`` has each axis' sign and place in the order of
    storage; ``transform`` leads from millimetres along the axes to scanner coordinates (RAS).
"""

from __future__ import annotations

import math
import re
import zlib
from pathlib import Path

import numpy as np

from volspec.errors import VolumeError, one_line
from volspec.volume.files.lattice import LPS_FROM_RAS, affine
from volspec.volume.files.layout import Layout, choose_axes, damage_error, data_files
from volspec.volume.files.presence import is_packed, open_unpacked
from volspec.volume.files.query import Query, Reading, Stored
from volspec.volume.metadata import NO_SPACING, Metadata

MAGIC = 0, b"mrtrix image"
_DTYPE = re.compile(r"(bit|u?int(?:8|16|32|64)|float(?:16|32|64))(le|be)?", re.IGNORECASE)
_MAX_HEADER = 1 << 24


def read_mif(query: Query) -> Reading:
    """Read a 3-D image, or one volume of it (``time=``, a fifth axis ``channel=``)."""
    path = query.path
    query.allow("time", "channel")
    try:
        header = _header(path)
        size = [int(text) for text in header["dim"][0].split(",")]
        strides = [text.strip() for text in header["layout"][0].split(",")]
        places = [int(text.lstrip("+-")) for text in strides]  # fastest first
        spacing = np.array(header["vox"][0].split(",")[:3], float)
        if sorted(places) != [*range(len(size))] or min(size) < 1 or len(spacing) < 3:
            raise ValueError(f"layout {strides} of size {size}")
        rows = [row.split(",") for row in header.get("transform", ())[:3]]
        matrix = np.array([*rows, [0, 0, 0, 1]], float).reshape(4, 4) if rows else np.eye(4)
        shift, slope = map(float, header.get("scaling", ["0,1"])[0].split(","))
        kind = _DTYPE.fullmatch(header["datatype"][0])
        name, _, offset = header["file"][0].rpartition(" ")
        first = int(offset)
    except (KeyError, ValueError, IndexError, OSError, EOFError, zlib.error) as error:
        raise damage_error(path, f"its header cannot be read ({one_line(error)[:120]})") from error
    if kind is None or len(header["file"]) > 1:
        raise VolumeError(
            f"{path}: holds {header['datatype'][0]} in {len(header['file'])} files",
            "make one file of real numbers: mrconvert -datatype float32",
            code="unsupported",
        )
    shape = tuple(size[places.index(place)] for place in range(len(size)))
    index = choose_axes(query, shape, dict(zip(places[3:], ("time", "channel"), strict=False)))
    backward = {place for place, stride in zip(places, strides, strict=True) if stride[0] == "-"}
    index = {place: shape[place] - 1 - k if place in backward else k for place, k in index.items()}
    files = (path,) if name in ("", ".") else data_files(path, [name])
    encoding = "gzip" if is_packed(files[0]) else "raw"
    is_bits, is_big = kind[1].lower() == "bit", (kind[2] or "").lower() == "be"
    dtype = np.dtype("u1" if is_bits else kind[1].lower()).newbyteorder(">" if is_big else "<")
    stored = (-(-math.prod(shape) // 8),) if is_bits else shape
    scaling = (1.0, 0.0) if is_bits else (slope, shift)
    layout = Layout(path, files, dtype, stored, encoding, skip=first, scaling=scaling)
    notes: list[str] = []
    values = layout.read({} if is_bits else index, query, notes)
    slowest = sorted(places[:3], reverse=True)
    if is_bits or slowest != places[2::-1] or backward & {*slowest}:
        values = values.read() if isinstance(values, Stored) else values
        if is_bits:
            query.reserve(shape, 1)
            bits = np.unpackbits(values, count=math.prod(shape)).reshape(shape[::-1])
            values = bits[tuple(index.get(k, slice(None)) for k in reversed(range(len(shape))))]
        values = values[tuple(slice(None, None, -1 if k in backward else 1) for k in slowest)]
        values = values.transpose([slowest.index(place) for place in places[2::-1]])
    is_stated = np.isfinite(spacing) & (spacing > 0)
    world = matrix @ affine(np.diag(np.where(is_stated, spacing, 1.0)), (0, 0, 0))
    assumed = () if is_stated.all() else (NO_SPACING,)
    metadata = Metadata(is_patient=bool(rows), assumed=assumed)
    world = LPS_FROM_RAS @ world if rows else world
    return Reading(values, None, world, notes, metadata=metadata)


def _header(path: Path) -> dict[str, list[str]]:
    """Return the lines of a header by their keys, of which some occur several times."""
    fields: dict[str, list[str]] = {}
    with open_unpacked(path) as file:
        while (line := file.readline(4096).decode("utf-8", "replace").strip()) != "END":
            key, colon, value = line.partition(":")
            if file.tell() > _MAX_HEADER or not (colon or line == "mrtrix image"):
                raise ValueError("no END")
            fields.setdefault(key.strip().lower(), []).append(value.strip())
    return fields
