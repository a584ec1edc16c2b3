"""Bytes without a header, and NumPy's own files.

load_volume -> [raw] -> Volume
"""

from __future__ import annotations

import numpy as np

from volspec.errors import VolumeError
from volspec.volume.files.query import Query, tell
from volspec.volume.model import Volume

_EXAMPLE = "shape=256x256x110&dtype=uint8&spacing=1,1,1"


def read_npy(query: Query) -> Volume:
    """Read what ``numpy.save`` wrote.

    Raises
    ------
    VolumeError
    """
    path = query.path
    try:
        values = np.load(path, allow_pickle=False)
    except (ValueError, EOFError, OSError) as error:
        raise VolumeError(
            f"{path}: not a readable .npy file of numbers; is it complete, and saved by numpy.save?"
        ) from error
    return Volume(values, name=str(path))


def read_raw(query: Query) -> Volume:
    """Read bytes as the query lays them out.

    Raises
    ------
    VolumeError
        If the layout is incomplete, or the file shorter.
    """
    path, options = query.path, query.options
    query.allow("shape", "dtype", "spacing", "offset", "order")
    if missing := [key for key in ("shape", "dtype") if key not in options]:
        raise VolumeError(
            f"{path}: raw bytes need their layout, {missing[0]} is missing; write "
            f"{path.name}?{_EXAMPLE}"
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
    except (ValueError, TypeError) as error:
        raise VolumeError(
            f"{path}: {key}={options[key]} cannot be read; write it as in {path.name}?{_EXAMPLE}"
        ) from error
    if options.get("order", "little") not in ("little", "big"):
        raise VolumeError(f"{path}: order={options['order']}; give little or big")
    if options.get("order") == "big":
        dtype = dtype.newbyteorder(">")
    if len(shape) != 3 or min(shape) < 1:
        raise VolumeError(f"{path}: shape {options['shape']} is not XxYxZ with positive counts")
    expected = int(np.prod(shape, dtype=np.int64)) * dtype.itemsize
    held = path.stat().st_size - offset
    if offset < 0 or held < expected:
        raise VolumeError(
            f"{path}: holds {max(held, 0)} bytes after the offset, but shape {options['shape']} "
            f"of {dtype} needs {expected}; truncated, or is the shape wrong?"
        )
    flat = np.fromfile(path, dtype, count=int(np.prod(shape)), offset=offset)
    spacing = query.spacing_mm or (1.0, 1.0, 1.0)
    volume = Volume(flat.reshape(shape[::-1]), spacing_mm=spacing, name=str(path))
    if held > expected:
        tell(
            [
                f"{path}: holds {held} bytes, shape {options['shape']} of {dtype} takes {expected} "
                "of them; are shape, dtype and offset right?"
            ]
        )
    return volume
