"""MRtrix images, ``.mif``, ``.mif.gz`` and ``.mih``, read without a library.

    text header -> layout, transform -> [mif] -> Reading

References
----------
[1] MRtrix3, "Images and other data": ``layout`` has each axis' sign and place in the order of
    storage; ``transform`` leads from millimetres along the axes to scanner coordinates (RAS).
"""

from __future__ import annotations

import gzip
import math
import re
import zlib
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from volspec.errors import VolumeError, one_line
from volspec.volume.files.lattice import affine
from volspec.volume.files.query import Query, Reading
from volspec.volume.metadata import NO_SPACING, Metadata

MAGIC = 0, b"mrtrix image"
_DTYPE = re.compile(r"(bit|u?int(?:8|16|32|64)|float(?:16|32|64))(le|be)?", re.IGNORECASE)
_MOST_HEADER = 1 << 24
_LPS_FROM_RAS = np.diag([-1.0, -1.0, 1.0, 1.0])


def read_mif(query: Query) -> Reading:
    """Read a 3-D image, or one volume of it (``time=``, a fifth axis ``channel=``)."""
    path = query.path
    query.allow("time", "channel")
    try:
        header = _header(path)
        size = [int(text) for text in header["dim"][0].split(",")]
        strides = [text.strip() for text in header["layout"][0].split(",")]
        order = sorted(range(len(size)), key=lambda axis: int(strides[axis].lstrip("+-")))
        spacing = np.array([float(text) for text in header["vox"][0].split(",")[:3]])
        place, _, offset = header["file"][0].strip().rpartition(" ")
        rows = [[float(n) for n in row.split(",")] for row in header.get("transform", ())[:3]]
        matrix = np.array([*rows, [0, 0, 0, 1]], float).reshape(4, 4) if rows else np.eye(4)
        shift, scale = map(float, header.get("scaling", ["0,1"])[0].split(","))
        kind = _DTYPE.fullmatch(header["datatype"][0].strip())
        first, data = int(offset), path if place in ("", ".") else path.parent / place
        if len(strides) != len(size) or min(size) < 1:
            raise ValueError(f"layout {strides} of size {size}")
    except (KeyError, ValueError, IndexError, OSError, EOFError, zlib.error) as error:
        raise VolumeError(
            f"{path}: its header cannot be read ({one_line(error)[:120]}); is it complete?",
            code="damaged",
        ) from error
    if kind is None or not 3 <= len(size) <= 5 or len(header["file"]) > 1:
        raise VolumeError(
            f"{path}: holds {len(size)} axes of {header['datatype'][0]} in {len(header['file'])} "
            "files",
            "make one of real numbers and up to five axes: mrconvert -datatype float32",
            code="unsupported",
        )
    axes = (("time", "volumes"), ("channel", "channels"))[: len(size) - 3]
    at = [query.index(key, n, what) for (key, what), n in zip(axes, size[3:], strict=True)]
    query.end_choices()
    is_bits = kind[1].lower() == "bit"
    dtype = np.dtype("u1" if is_bits else kind[1].lower())
    dtype = dtype.newbyteorder(">" if (kind[2] or "le").lower() == "be" else "<")
    query.reserve(size, dtype.itemsize)
    nbytes = -(-math.prod(size) // 8) if is_bits else math.prod(size) * dtype.itemsize
    values: Any = _stored(query, data, first, nbytes)
    values = np.unpackbits(values, count=math.prod(size)) if is_bits else values.view(dtype)
    values = values.reshape([size[axis] for axis in reversed(order)])
    values = values.transpose([len(size) - 1 - order.index(axis) for axis in range(len(size))])
    values = values[tuple(slice(None, None, -1 if s[0] == "-" else 1) for s in strides)]
    values = values[(..., *at)].T
    if (shift, scale) != (0, 1):
        values = values.astype(np.float32) * np.float32(scale) + np.float32(shift)
    valid = np.isfinite(spacing) & (spacing > 0)
    world = matrix @ affine(np.diag(np.where(valid, spacing, 1.0)), (0, 0, 0))
    assumed = () if valid.all() else (NO_SPACING,)
    metadata = Metadata(is_patient=bool(rows), assumed=assumed)
    return Reading(values, None, _LPS_FROM_RAS @ world if rows else world, metadata=metadata)


def _opened(path: Path) -> Any:
    with path.open("rb") as file:
        packed = file.read(2) == b"\x1f\x8b"
    return gzip.open(path) if packed else path.open("rb")


def _header(path: Path) -> dict[str, list[str]]:
    """Return the lines of a header by their keys, of which some occur several times."""
    found: dict[str, list[str]] = {}
    with _opened(path) as file:
        while (line := file.readline(4096).decode("utf-8", "replace").strip()) != "END":
            key, colon, value = line.partition(":")
            if file.tell() > _MOST_HEADER or not (colon or line == "mrtrix image"):
                raise ValueError("no END")
            found.setdefault(key.strip().lower(), []).append(value.strip())
    return found


def _stored(query: Query, path: Path, first: int, nbytes: int) -> NDArray[np.uint8]:
    """Return the bytes of all voxels."""
    if not path.is_file():
        raise VolumeError(
            f"{query.path}: its voxels are in {path}, which is not there",
            f"copy it into {path.parent}",
            code="not-found",
        )
    try:
        with _opened(path) as file:
            file.seek(first)
            held = np.frombuffer(file.read(nbytes), np.uint8)
    except (OSError, EOFError, zlib.error) as error:
        raise VolumeError(
            f"{path}: cannot be read ({one_line(error)[:120]}); copy it again", code="damaged"
        ) from error
    query.require_held(len(held), (nbytes,), nbytes)
    return held
