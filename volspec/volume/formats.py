"""Formats of volumes: their names, endings, first bytes and readers, each in one place.

    file -> [formats] -> reader

What a file begins with decides; its ending decides between formats that begin alike.
"""

from __future__ import annotations

import gzip
import zlib
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

from volspec.volume.files import neuro
from volspec.volume.files.dicom import read_series
from volspec.volume.files.dicom_headers import SUFFIXES as DICOM_SUFFIXES
from volspec.volume.files.dicom_headers import is_dicom
from volspec.volume.files.hdf5 import hdf5_stack, read_hdf5
from volspec.volume.files.itk import read_itk
from volspec.volume.files.mrc import MAGIC as MRC_MAGIC
from volspec.volume.files.mrc import SUFFIXES as MRC_SUFFIXES
from volspec.volume.files.mrc import read_mrc
from volspec.volume.files.omezarr import ZIP_SUFFIXES, ome_zarr_stack, read_ome_zarr
from volspec.volume.files.query import Query, Reading
from volspec.volume.files.raw import read_npy, read_npz, read_raw
from volspec.volume.files.tiff import SUFFIXES as TIFF_SUFFIXES
from volspec.volume.files.tiff import pictures_stack, read_stack, read_tiff, tiff_stack
from volspec.volume.files.vtk import read_vtk
from volspec.volume.pyramid import Stack

Reader = Callable[[Query], Reading]
Magic = tuple[int, bytes]
# Bytes of a file that are looked at, unpacked if they are packed by gzip.
_LOOKED_AT = 1024


@dataclass(frozen=True, slots=True)
class Format:
    """A format: what it is called, how its files are recognised, and what reads them."""

    name: str
    suffixes: tuple[str, ...]
    read: Reader
    library: str = ""  # module that reads it, in a child process; empty if NumPy alone does
    magic: tuple[Magic, ...] = ()  # (offset, bytes), one of which its files hold
    stack: Callable[[Query], Stack | None] | None = None  # levels of one larger than memory
    whole: bool = True  # a file is a volume, not the slice of one

    def begins(self, head: bytes) -> bool:
        """Return True if a file's first bytes are of this format."""
        return any(head.startswith(text, at) for at, text in self.magic)


_HDF5 = (0, b"\x89HDF\r\n\x1a\n")
_NIFTI = ((344, b"n+1\0"), (344, b"ni1\0"), (4, b"n+2\0"), (4, b"ni2\0"))
FORMATS = (
    Format("NRRD", (".nrrd", ".nhdr"), read_itk, "SimpleITK", ((0, b"NRRD"),)),
    Format("MetaImage", (".mha", ".mhd"), read_itk, "SimpleITK"),
    Format("NIfTI", (".nii", ".nii.gz"), neuro.read_neuro, "nibabel", _NIFTI),
    Format("NIfTI and Analyze pairs", neuro.PAIRS, neuro.read_neuro, "nibabel"),
    Format("FreeSurfer", (".mgh", ".mgz"), neuro.read_neuro, "nibabel"),
    Format("AFNI", (".head", ".brik", ".brik.gz"), neuro.read_neuro, "nibabel"),
    Format("PAR/REC", (".par", ".rec"), neuro.read_neuro, "nibabel"),
    Format("MINC", (".mnc",), neuro.read_neuro, "nibabel", (_HDF5, (0, b"CDF\1"))),
    Format("DICOM", DICOM_SUFFIXES, read_series, "SimpleITK", ((128, b"DICM"),), None, False),
    Format(
        *("TIFF", TIFF_SUFFIXES, read_tiff, "tifffile"),
        ((0, b"II*\0"), (0, b"MM\0*"), (0, b"II+\0"), (0, b"MM\0+")),
        tiff_stack,
        whole=False,
    ),
    Format(
        "HDF5",
        (".h5", ".hdf5", ".he5", ".hdf", ".nxs", ".emd"),
        read_hdf5,
        "h5py",
        (_HDF5,),
        hdf5_stack,
    ),
    Format("OME-Zarr", ZIP_SUFFIXES, read_ome_zarr, "zarr", (), ome_zarr_stack),
    Format("MRC", MRC_SUFFIXES, read_mrc, "mrcfile", (MRC_MAGIC,)),
    Format("VTI", (".vti",), read_vtk, "pyvista"),
    Format("VTR", (".vtr",), read_vtk, "pyvista"),
    Format("VTK", (".vtk",), read_vtk, "pyvista", ((0, b"# vtk DataFile"),)),
    Format(".npy", (".npy",), read_npy, "", ((0, b"\x93NUMPY"),)),
    Format(".npz", (".npz",), read_npz),
    Format("raw bytes", (".raw",), read_raw, whole=False),
)
# Readers of folders, which no file has.
SLICES = Format("slices", (), read_stack, "tifffile", (), pictures_stack)
BY_READER = {each.read: each for each in (*FORMATS, SLICES)}
WHOLE_SUFFIXES = tuple(s for each in FORMATS if each.whole for s in each.suffixes)
"""Endings of files that each are a whole volume, unlike the slices of a series."""
VOLUME_SUFFIXES = tuple(s for each in FORMATS for s in each.suffixes)
KNOWN = ", ".join(each.name for each in FORMATS)


def format_of(path: Path) -> Format | None:
    """Return a file's format; None if it is none that is known."""
    lower, head = path.name.lower(), head_of(path)
    by_name = [each for each in FORMATS if lower.endswith(each.suffixes)]
    by_content = [each for each in FORMATS if each.begins(head)]
    both = [each for each in by_name if each in by_content]
    if by_name and by_name[0].name == "raw bytes":
        return by_name[0]
    if not (by_content or by_name) and is_dicom(path):  # without its preamble
        return BY_READER[read_series]
    return next(iter((*both, *by_content, *by_name)), None)


def head_of(path: Path) -> bytes:
    """Return a file's first bytes, unpacked if they are packed by gzip."""
    with path.open("rb") as file:
        head = file.read(_LOOKED_AT)
    if head.startswith(b"\x1f\x8b"):
        with suppress(OSError, EOFError, zlib.error), gzip.open(path) as packed:
            return packed.read(_LOOKED_AT)
    return head
