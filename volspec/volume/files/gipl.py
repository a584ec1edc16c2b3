"""GIPL images of the Guys Image Processing Lab, ``.gipl`` and ``.gipl.gz``, as ITK writes them."""

from __future__ import annotations

import struct
import zlib

import numpy as np

from volspec.errors import one_line
from volspec.volume.files.lattice import affine
from volspec.volume.files.layout import Layout, choose_axes, damage_error
from volspec.volume.files.presence import is_packed, open_unpacked
from volspec.volume.files.query import Query, Reading
from volspec.volume.metadata import NO_UNIT, Metadata

MAGIC = (252, struct.pack(">I", 719555000)), (252, struct.pack(">I", 4026526128))
_CODES = "1=u1 7=i1 8=u1 15=i2 16=u2 31=u4 32=i4 64=f4 65=f8"
_DTYPES = dict(word.split("=") for word in _CODES.split())
_HEADER = 256


def read_gipl(query: Query) -> Reading:
    """Read an image, or one of its time steps."""
    path = query.path
    query.allow("time")
    try:
        encoding = "gzip" if is_packed(path) else "raw"
        with open_unpacked(path) as file:
            head = file.read(_HEADER)
        *size, steps, kind = struct.unpack_from(">5H", head)
        spacing, origin = struct.unpack_from(">3f", head, 10), struct.unpack_from(">3d", head, 204)
        dtype = np.dtype(">" + _DTYPES[str(kind)])
    except (KeyError, struct.error, OSError, EOFError, zlib.error) as error:
        raise damage_error(
            path, f"is no GIPL image of numbers ({one_line(error)[:120]})"
        ) from error
    shape = (*size, max(steps, 1))
    layout = Layout(path, (path,), dtype, shape, encoding, skip=_HEADER)
    notes: list[str] = []
    values = layout.read(choose_axes(query, shape, {3: "time"}), query, notes)
    world = affine(np.diag(np.abs(spacing)), origin)
    return Reading(values, None, world, notes, metadata=Metadata(assumed=(NO_UNIT,)))
