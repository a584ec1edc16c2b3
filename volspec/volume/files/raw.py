"""Raw bytes without a header, and NumPy's .npy and .npz files.

load_volume -> [raw] -> Reading
"""

from __future__ import annotations

import math
import re
import zipfile
import zlib
from dataclasses import replace
from pathlib import Path
from typing import IO, Any

import numpy as np

from volspec.errors import VolumeError, nearest
from volspec.volume.files.query import Choice, Query, Reading, Stored
from volspec.volume.metadata import NO_SPACING, Metadata

_NPY_HEADERS = {
    (1, 0): np.lib.format.read_array_header_1_0,
    (2, 0): np.lib.format.read_array_header_2_0,
}
_DTYPES = (
    *("uint8", "int8", "uint16", "int16", "uint32", "int32", "uint64", "int64"),
    *("float16", "float32", "float64", "bool"),
)
# Size and type in the name of a file, such as ``head_256x256x110_int16.raw``.
_SIZE_IN_NAME = re.compile(r"(?<!\d)(\d+)[x×](\d+)[x×](\d+)(?!\d)")
_DTYPE_IN_NAME = re.compile(r"(?<![a-z])(?:u?int(?:8|16|32|64)|float(?:16|32|64))(?!\d)")
_NO_SPACING = Metadata(assumed=(NO_SPACING,))
_DTYPE_BY_BYTES = {1: "uint8", 2: "uint16", 4: "float32", 8: "float64"}


Header = tuple[tuple[int, ...], bool, np.dtype[Any]]


def _npy_header(file: IO[bytes], path: Path) -> Header:
    """Return an array's shape, whether its first index changes fastest, and its type."""
    try:
        read_header = _NPY_HEADERS[np.lib.format.read_magic(file)]
        header: Header = read_header(file)
    # The header is a Python literal, whose parser may raise any error if it is damaged.
    except Exception as error:
        raise VolumeError(
            f"{path}: not a readable .npy file of numbers; is it complete, and saved by "
            "numpy.save?",
            code="damaged",
        ) from error
    return header


def read_npy(query: Query) -> Reading:
    """Read a file written by ``numpy.save``."""
    path = query.path
    with path.open("rb") as file:
        shape, columns_first, dtype = _npy_header(file, path)
        if dtype.kind not in "buif":  # other kinds may have an item size of 0
            raise VolumeError(
                f"{path}: values of type {dtype!s:.60} are not real numbers; save an array of "
                "these",
                code="type",
            )
        if len(shape) not in (2, 3):
            size = " x ".join(map(str, shape)) or "one number"
            remedy = "save all slices in one array: numpy.save('v.npy', numpy.stack(slices))"
            if len(shape) > 3:
                remedy = "save one volume of it, such as numpy.save('t0.npy', a[0])"
            raise VolumeError(
                f"{path}: is {len(shape)}-D ({size}); a volume has three axes (Z, Y, X): {remedy}",
                code="shape",
            )
        query.allow()
        query.end_choices()
        actual = path.stat().st_size - file.tell()
        query.require_held(actual, shape, math.prod(shape) * dtype.itemsize)
        if columns_first:
            query.reserve(shape, dtype.itemsize)
            flat = np.fromfile(file, dtype, math.prod(shape))
            return Reading(flat.reshape(shape[::-1]).T, metadata=_NO_SPACING)
        stored = Stored(str(path), shape, dtype.str, file.tell())
        return Reading(stored, metadata=_NO_SPACING)


def read_npz(query: Query) -> Reading:
    """Read an array of three axes of a file written by ``numpy.savez``."""
    path = query.path
    query.allow("dataset")
    try:
        with zipfile.ZipFile(path) as packed:
            headers: dict[str, Header] = {}
            for name in packed.namelist():
                with packed.open(name) as file:
                    headers[name.removesuffix(".npy")] = _npy_header(file, path)
        by_name = {
            name: (shape, dtype)
            for name, (shape, _, dtype) in headers.items()
            if len(shape) in (2, 3) and dtype.kind in "buif"
        }
        deep = {name: header for name, header in by_name.items() if len(header[0]) == 3}
        if not (by_name := deep or by_name):
            raise VolumeError(
                f"{path}: holds no array of numbers with three axes (Z, Y, X), only "
                f"{', '.join(headers) or 'none'}",
                "save one: numpy.savez('v.npz', volume=numpy.stack(slices))",
                code="shape",
            )
        name = query.array_named({name: shape for name, (shape, _) in by_name.items()})
        query.end_choices()
        shape, dtype = by_name[name]
        query.reserve(shape, dtype.itemsize)
        with np.load(path) as arrays:
            return Reading(arrays[name], metadata=_NO_SPACING)
    except (OSError, EOFError, ValueError, zipfile.BadZipFile, zlib.error) as error:
        if isinstance(error, VolumeError):
            raise
        raise VolumeError(
            f"{path}: not a readable .npz file of numbers; is it complete, and of numpy.savez?",
            code="damaged",
        ) from error


def _example(query: Query) -> str:
    """Return an address with a layout for messages, the file's own if its name has one."""
    name = query.path.name.lower()
    size, dtype = _SIZE_IN_NAME.search(name), _DTYPE_IN_NAME.search(name)
    nbytes = query.path.stat().st_size
    if size:
        shape = "x".join(size.groups())
        voxel_bytes = nbytes // max(math.prod(map(int, size.groups())), 1)
        kind = dtype[0] if dtype else _DTYPE_BY_BYTES.get(voxel_bytes, "uint8")
    else:
        kind = dtype[0] if dtype else query.options.get("dtype", "uint8")
        shape = _likely_shape(nbytes // np.dtype(kind).itemsize if kind in _DTYPES else nbytes)
    options = {"shape": shape, "dtype": kind, "spacing": "1,1,1"}
    return query.example(**(options | query.options))


def _likely_shape(voxels: int) -> str:
    """Return a shape with as many voxels, of square slices if that is possible.

    >>> _likely_shape(256 * 256 * 110), _likely_shape(60**3), _likely_shape(7 * 11)
    ('256x256x110', '60x60x60', '77x1x1')
    """
    cube = round(voxels ** (1 / 3))
    for side in (512, 256, cube, 128, 64):
        slices, remainder = divmod(voxels, max(side, 1) ** 2)
        if not remainder and side / 8 <= slices <= 4 * side:
            return f"{side}x{side}x{slices}"
    return f"{voxels}x1x1"


def read_raw(query: Query) -> Reading:
    """Read bytes in the layout that the query gives."""
    path, options = query.path, query.options
    query.allow("shape", "dtype", "spacing", "offset", "order")
    if missing := [key for key in ("shape", "dtype") if key not in options]:
        if query.choices is not None:
            query.choices.append(Choice("shape", (), ()))
        query.end_choices()
        raise VolumeError(
            f"{path}: raw bytes need a layout, {missing[0]} is missing",
            f"write {_example(query)} with the file's own numbers (order=big if big-endian)",
            code="missing",
        )
    try:
        key = "shape"
        shape = tuple(int(n) for n in options["shape"].lower().split("x"))
        key = "dtype"
        dtype = np.dtype(options["dtype"])
        if dtype.kind not in "buif":
            raise TypeError
        key = "offset"
        offset = int(options.get("offset", "0"))
    except (ValueError, TypeError, SyntaxError, RecursionError) as error:  # the last two from dtype
        remedy = f"write it as in {_example(replace(query, options={}))}"
        if key == "dtype":
            remedy = f"{nearest(options[key], _DTYPES, count=1)}give one of {', '.join(_DTYPES)}"
        raise VolumeError(
            f"{path}: {key}={options[key]} cannot be read",
            remedy,
            code="syntax",
            given=options[key],
        ) from error
    if options.get("order", "little") not in ("little", "big"):
        raise VolumeError(
            f"{path}: order={options['order']}; give little or big",
            code="unknown",
            given=options["order"],
        )
    if options.get("order") == "big":
        dtype = dtype.newbyteorder(">")
    if offset < 0:
        raise VolumeError(
            f"{path}: offset={offset}; give the bytes before the voxels, 0 or more",
            code="range",
            given=offset,
        )
    if len(shape) not in (2, 3) or min(shape) < 1:
        raise VolumeError(
            f"{path}: shape={options['shape']} is not three positive counts; give those along x, "
            f"y and z, as in {_example(replace(query, options={}))}",
            code="shape",
            given=options["shape"],
        )
    expected = math.prod(shape) * dtype.itemsize
    actual = path.stat().st_size - offset
    if actual < expected:
        width, height = shape[:2]
        slices, remainder = divmod(max(actual, 0), width * height * dtype.itemsize)
        remedy = "compare shape, dtype and offset with the file's source, or copy the file again"
        if slices and not remainder:
            address = query.example(shape=f"{width}x{height}x{slices}")
            remedy = f"it has {slices} whole slices: write {address}, or copy the file again"
        raise VolumeError(
            f"{path}: holds {max(actual, 0)} bytes after the offset, but shape {options['shape']} "
            f"of {dtype} needs {expected}",
            remedy,
            code="damaged",
        )
    query.end_choices()
    notes = []
    if actual > expected:
        notes.append(
            f"{path}: holds {actual} bytes, shape {options['shape']} of {dtype} takes {expected} "
            "of them; are shape, dtype and offset right?"
        )
    stored = Stored(str(path), shape[::-1], dtype.str, offset)
    return Reading(stored, notes=notes, metadata=_NO_SPACING)
