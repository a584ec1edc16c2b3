"""GIPL images of the Guys Image Processing Lab, ``.gipl`` and ``.gipl.gz``, as ITK writes them."""

from __future__ import annotations

import gzip
import struct
import zlib

import numpy as np

from volspec.errors import VolumeError, one_line
from volspec.volume.files.lattice import affine
from volspec.volume.files.query import Query, Reading
from volspec.volume.metadata import NO_UNIT, Metadata

MAGIC = (252, struct.pack(">I", 719555000)), (252, struct.pack(">I", 4026526128))
_DTYPES = dict(
    zip(
        (1, 7, 8, 15, 16, 31, 32, 64, 65),
        ("u1", "i1", "u1", ">i2", ">u2", ">u4", ">i4", ">f4", ">f8"),
        strict=True,
    )
)
_HEADER = 256


def read_gipl(query: Query) -> Reading:
    """Read an image, or one of its time steps."""
    path = query.path
    query.allow("time")
    try:
        with path.open("rb") as file:
            packed = file.read(2) == b"\x1f\x8b"
        with gzip.open(path) if packed else path.open("rb") as file:
            head = file.read(_HEADER)
            *size, steps, kind = struct.unpack_from(">5H", head)
            spacing, origin = (
                struct.unpack_from(">3f", head, 10),
                struct.unpack_from(">3d", head, 204),
            )
            dtype = np.dtype(_DTYPES[kind])
            time = query.index("time", max(steps, 1), "time steps")
            query.end_choices()
            query.reserve(size, dtype.itemsize)
            nbytes = int(np.prod(size)) * dtype.itemsize
            file.seek(_HEADER + time * nbytes)
            data = file.read(nbytes)
    except (KeyError, struct.error, OSError, EOFError, zlib.error) as error:
        raise VolumeError(
            f"{path}: is no GIPL image of numbers ({one_line(error)[:120]}); is it complete?",
            code="damaged",
        ) from error
    query.require_held(len(data), size, nbytes)
    values = np.frombuffer(data, dtype).reshape(size[::-1])
    world = affine(np.diag(np.abs(spacing)), origin)
    return Reading(values, world_from_index=world, metadata=Metadata(assumed=(NO_UNIT,)))
