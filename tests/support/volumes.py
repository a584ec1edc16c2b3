"""Small volumes and the files that hold them."""

import gzip
import struct
import warnings
from pathlib import Path
from typing import Any

import numpy as np

from volspec.volume import Volume, load_volume

VALUES = np.arange(24, dtype=np.int16).reshape(2, 3, 4) * 100 - 700
# x runs along +y with 2 mm, y along −x with 1 mm, z along +z with 3 mm.
WORLD = np.array([[0, -1, 0, 5], [2, 0, 0, 6], [0, 0, 3, 7], [0, 0, 0, 1]], float)
NRRD = (
    "NRRD0004\ntype: short\ndimension: 3\nspace: left-posterior-superior\nsizes: 4 3 2\n"
    "space directions: (0,2,0) (-1,0,0) (0,0,3)\nspace origin: (5,6,7)\n"
    "kinds: domain domain domain\nendian: little\nencoding: raw\n\n"
)
META = "ObjectType = Image\nNDims = 3\nDimSize = 4 3 2\nElementType = MET_SHORT\n"


RAW = VALUES.tobytes()


def write_nrrd(path: Path, packed: bool = False, surplus: bytes = b"") -> Path:
    """Write `VALUES` to an NRRD file."""
    data = RAW + surplus
    header = NRRD.replace("raw", "gzip") if packed else NRRD
    path.write_bytes(header.encode() + (gzip.compress(data) if packed else data))
    return path


def write_vti(path: Path, grid: Any, mode: str, packed: bool = True, encode: bool = False) -> bytes:
    """Write ``.vti`` by VTK itself, in a mode that pyvista does not offer; return the bytes."""
    from vtkmodules.vtkIOXML import vtkXMLImageDataWriter

    writer = vtkXMLImageDataWriter()
    writer.SetInputData(grid)
    writer.SetFileName(str(path))
    writer.SetDataMode(getattr(writer, mode))
    writer.SetEncodeAppendedData(encode)
    if not packed:
        writer.SetCompressorTypeToNone()
    writer.Write()
    return path.read_bytes()


def nifti(values: np.ndarray, ras_from_index: np.ndarray, code: int = 4, order: str = "<") -> bytes:
    """A NIfTI-1 file with an sform; its world is RAS, ITK's is LPS. ``code`` is its type's."""
    header = bytearray(352)
    for form, offset, numbers in (
        ("i", 0, [348]),
        ("8h", 40, [3, *values.shape[::-1], 1, 1, 1, 1]),
        ("2h", 70, [code, 8 * values.itemsize]),
        ("8f", 76, [1, 2, 1, 3, 1, 1, 1, 1]),
        ("2f", 108, [352, 1]),
        ("2h", 252, [0, 1]),
        ("12f", 280, ras_from_index[:3].ravel()),
    ):
        struct.pack_into(order + form, header, offset, *numbers)
    header[344:348] = b"n+1\0"
    return bytes(header) + values.astype(values.dtype.newbyteorder(order)).tobytes()


def load_silently(path: Path | str) -> Volume:
    """Load a volume, with warnings as errors."""
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        return load_volume(path)
