"""What a volume's header promises, against what the file holds.

ITK and VTK read some damaged files without complaint: missing voxels become zeros or whatever
memory held, surplus bytes are dropped, a negative spacing mirrors an axis.
"""

from __future__ import annotations

import gzip
import math
import os
import struct
import warnings
import zlib
from pathlib import Path

import numpy as np

from volspec.errors import VolspecWarning, VolumeError

_AGAIN = "truncated, copy or download it again"
# Bits of a legacy VTK type; vtkIdType is stored as int.
_VTK_BITS = {
    **dict.fromkeys(("bit",), 1),
    **dict.fromkeys(("char", "signed_char", "unsigned_char"), 8),
    **dict.fromkeys(("short", "unsigned_short"), 16),
    **dict.fromkeys(("int", "unsigned_int", "vtkidtype", "float"), 32),
    **dict.fromkeys(("long", "unsigned_long", "vtktypeint64", "vtktypeuint64", "double"), 64),
}


def check_itk_header(path: Path) -> None:
    """Refuse what ITK reads without complaint: spacings it mirrors, NIfTI data it lacks.

    Raises
    ------
    VolumeError
    """
    if path.name.lower().endswith((".nii", ".nii.gz")):
        _check_nifti_length(path)
        return
    fields, _ = _read_fields(path)
    spacing = fields.get("spacings") or fields.get("elementspacing") or ""
    try:
        numbers = [float(word) for word in spacing.split()]
    except ValueError:
        return  # ITK says what is wrong with it
    if not all(0 < number < np.inf for number in numbers):
        raise VolumeError(
            f"{path}: spacing {spacing}; each of x, y, z must be positive, correct the header"
        )


def warn_if_longer(path: Path, nbytes: int) -> None:
    """Warn where an NRRD or MetaImage file holds more than the ``nbytes`` of its voxels."""
    if path.name.lower().endswith((".nii", ".nii.gz")):
        return
    held = _held_bytes(path, nbytes)
    if held is not None and held > nbytes:
        # To the caller of load_volume, past the reader.
        warnings.warn(
            f"{path}: {held} bytes of voxels, its header describes {nbytes} and the rest is not "
            "read; are its size and type right?",
            VolspecWarning,
            stacklevel=4,
        )


def _read_fields(path: Path) -> tuple[dict[str, str], int]:
    """An NRRD's or MetaImage's fields, names in lower case, and where the header ends."""
    separator = "=" if path.suffix.lower() in (".mhd", ".mha") else ":"
    fields = {}
    with path.open("rb") as file:
        if separator == ":" and not file.readline(80).startswith(b"NRRD"):
            return {}, 0
        while line := file.readline(1 << 16).decode("latin-1").strip():
            key, found, value = line.partition(separator)
            if found:
                fields[key.strip().lower()] = value.strip()
            elif separator == "=":
                break
            if key.strip().lower() == "elementdatafile":  # by definition the last
                break
        return fields, file.tell()


def _held_bytes(path: Path, nbytes: int) -> int | None:
    """Bytes of voxels beside or behind a header; None where only the reader can tell."""
    fields, start = _read_fields(path)
    encoding = fields.get("encoding", "raw").lower()
    if fields.get("compresseddata", "").lower() == "true" or (
        fields.get("binarydata", "").lower() == "false"
    ):
        return None
    name = fields.get("data file", fields.get("datafile", fields.get("elementdatafile", "LOCAL")))
    data = path
    if name.upper() != "LOCAL":
        data, start = path.parent / name, 0
    try:
        skip = int(fields.get("byte skip", fields.get("headersize", "0")))
    except ValueError:
        return None
    # A list of files, data at a file's end, or lines before it.
    if not data.is_file() or skip < 0 or fields.get("line skip", "0") != "0":
        return None
    if encoding == "raw":
        return data.stat().st_size - start - skip
    if encoding not in ("gz", "gzip") or skip:
        return None
    with data.open("rb") as file:
        file.seek(-4, os.SEEK_END)
        if file.read() == struct.pack("<I", nbytes % 2**32):  # gzip ends with the length
            return nbytes
        file.seek(start)
        try:
            with gzip.GzipFile(fileobj=file) as unpacked:
                return sum(len(chunk) for chunk in iter(lambda: unpacked.read(1 << 22), b""))
        except (OSError, EOFError, zlib.error):
            return None


def _check_nifti_length(path: Path) -> None:
    gzipped = path.name.lower().endswith(".gz")
    try:
        with gzip.open(path) if gzipped else path.open("rb") as file:
            head = file.read(352)
            held = len(head)
            while chunk := file.read(1 << 22):
                held += len(chunk)
    except (OSError, EOFError, zlib.error) as error:
        raise VolumeError(f"{path}: cannot be read ({error}); is the file complete?") from error
    order = "<" if head[:4] == struct.pack("<i", 348) else ">"
    if len(head) < 352 or head[:4] != struct.pack(order + "i", 348):
        return  # NIfTI-2, or none at all: ITK decides
    dims = struct.unpack_from(order + "8h", head, 40)
    count = int(np.prod([max(n, 1) for n in dims[1 : 1 + max(dims[0], 0)]], dtype=np.int64))
    (bits,) = struct.unpack_from(order + "h", head, 72)
    (start,) = struct.unpack_from(order + "f", head, 108)
    if head[344:347] == b"n+1" and held < start + count * bits // 8:
        raise VolumeError(
            f"{path}: holds {held} bytes, its header asks for {int(start) + count * bits // 8}; "
            f"{_AGAIN}"
        )


def check_vtk_length(path: Path) -> None:
    """Refuse a truncated ``.vti`` or binary ``.vtk``, whose missing voxels VTK makes up.

    Raises
    ------
    VolumeError
    """
    size = path.stat().st_size
    with path.open("rb") as file:
        if path.suffix.lower() == ".vti":
            file.seek(max(size - 1024, 0))
            if b"</VTKFile>" not in file.read():
                raise VolumeError(
                    f"{path}: not readable as VTK image data, </VTKFile> is missing; {_AGAIN}"
                )
            return
        if [file.readline(256) for _ in range(3)][2].strip().upper() != b"BINARY":
            return  # in ASCII VTK itself finds what is missing
        tuples = "0"
        while line := file.readline(4096):
            match line.decode("latin-1").lower().split():
                case ["point_data" | "cell_data", tuples]:
                    continue
                case ["scalars", _, kind, *components]:
                    file.readline(4096)  # the lookup table's name
                    counts = [*(components or ["1"]), tuples]
                case [_, per_tuple, count, kind]:  # an array of a FIELD
                    counts = [per_tuple, count]
                case _:  # other words, or data of arrays that are never cast
                    continue
            if kind in _VTK_BITS and all(n.isdecimal() for n in counts):
                bits = _VTK_BITS[kind] * math.prod(map(int, counts))
                file.seek(-(-bits // 8), os.SEEK_CUR)
            if file.tell() > size:
                raise VolumeError(
                    f"{path}: holds {size} bytes, its header asks for {file.tell()} or more; "
                    f"{_AGAIN}"
                )
