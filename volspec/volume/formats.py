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

from volspec._extras import EXTRAS
from volspec.volume.files import neuro
from volspec.volume.files.dicom import read_series
from volspec.volume.files.dicom_headers import DICOM_SUFFIXES, is_dicom
from volspec.volume.files.gipl import MAGIC as GIPL_MAGIC
from volspec.volume.files.gipl import read_gipl
from volspec.volume.files.hdf5 import hdf5_stack, project_stack, read_hdf5, read_project
from volspec.volume.files.imaris import imaris_stack, read_imaris
from volspec.volume.files.metaimage import read_metaimage
from volspec.volume.files.micro import read_micro
from volspec.volume.files.mif import MAGIC as MIF_MAGIC
from volspec.volume.files.mif import read_mif
from volspec.volume.files.mrc import MAGIC as MRC_MAGIC
from volspec.volume.files.mrc import SUFFIXES as MRC_SUFFIXES
from volspec.volume.files.mrc import read_mrc
from volspec.volume.files.nrrd import read_nrrd
from volspec.volume.files.omezarr import ZIP_SUFFIXES, ome_zarr_stack, read_ome_zarr
from volspec.volume.files.pages import PICTURES
from volspec.volume.files.presence import GZIP
from volspec.volume.files.query import Query, Reading
from volspec.volume.files.raw import read_npy, read_npz, read_raw
from volspec.volume.files.slices import pictures_stack, read_stack
from volspec.volume.files.tiff import SUFFIXES as TIFF_SUFFIXES
from volspec.volume.files.tiff import read_tiff, tiff_stack
from volspec.volume.files.vtk import read_vtk
from volspec.volume.levels.pyramid import Stack

Reader = Callable[[Query], Reading]
Magic = tuple[int, bytes]
# Bytes of a file that are looked at.
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
    unpacks: bool = False  # its reader unpacks files that are packed by gzip
    note: str = ""  # what is read of it, for docs/reference/formats.md

    @property
    def extra(self) -> str:
        """Extra of the package that installs the library; empty if it comes with the package."""
        return next((name for name, modules in EXTRAS.items() if self.library in modules), "")

    def begins(self, head: bytes) -> bool:
        """Return True if a file's first bytes are of this format."""
        return any(head.startswith(text, offset) for offset, text in self.magic)


# No library, but in a child process all the same, with limits of time and memory.
_OURS = "zlib"
HDF5 = (0, b"\x89HDF\r\n\x1a\n")
_NIFTI = ((344, b"n+1\0"), (344, b"ni1\0"), (4, b"n+2\0"), (4, b"ni2\0"))
DICOM = Format(
    *("DICOM", DICOM_SUFFIXES, read_series, "pydicom.pixels", ((128, b"DICM"),)),
    whole=False,
    note="series, enhanced files, segmentations, doses; a patient's axes, HU",
)
OME_ZARR = Format(
    *("OME-Zarr", (".zarr", *ZIP_SUFFIXES), read_ome_zarr, "zarr"),
    stack=ome_zarr_stack,
    note="0.4, 0.5, folders, zip files, URLs; also plain arrays of Zarr 2 and 3",
)
RAW = Format("raw bytes", (".raw",), read_raw, whole=False, note="shape, dtype, spacing asked")
SLICES = Format(
    *("slices", (), read_stack, "tifffile"),
    stack=pictures_stack,
    note="folders of TIFF, PNG, BMP, JPEG or JPEG 2000; channels and times in names",
)
"""Folders of pictures; no file has this format."""
FORMATS = (
    Format(
        *("NRRD", (".nrrd", ".nhdr"), read_nrrd, _OURS, ((0, b"NRRD"),)),
        note="all encodings, units, times, channels, segments; a patient's axes in such a space",
    ),
    Format(
        *("MetaImage", (".mha", ".mhd"), read_metaimage, _OURS),
        note="units; a patient's axes with AnatomicalOrientation",
    ),
    Format(
        *("NIfTI", (".nii", ".nii.gz"), neuro.read_neuro, "nibabel", _NIFTI),
        unpacks=True,
        note="1 and 2; times, components, labels; a patient's axes with a code",
    ),
    Format(
        *("NIfTI and Analyze pairs", neuro.PAIRS, neuro.read_neuro, "nibabel"),
        unpacks=True,
        note="header and voxels in two files",
    ),
    Format(
        *("FreeSurfer", (".mgh", ".mgz"), neuro.read_neuro, "nibabel"),
        unpacks=True,
        note="a patient's axes",
    ),
    Format(
        *("AFNI", (".head", ".brik", ".brik.gz"), neuro.read_neuro, "nibabel"),
        unpacks=True,
        note="a patient's axes",
    ),
    Format("PAR/REC", (".par", ".rec"), neuro.read_neuro, "nibabel", note="a patient's axes"),
    DICOM,
    Format(
        *("TIFF", TIFF_SUFFIXES, read_tiff, "tifffile"),
        ((0, b"II*\0"), (0, b"MM\0*"), (0, b"II+\0"), (0, b"MM\0+")),
        tiff_stack,
        whole=False,
        note="ImageJ, OME-TIFF, BigTIFF: units, channels, times, several stacks",
    ),
    Format(
        *("pictures", tuple(s for k in PICTURES if k != "TIFF" for s in PICTURES[k]), read_stack),
        "tifffile",
        whole=False,
        note="PNG, BMP, JPEG or JPEG 2000: one slice",
    ),
    Format(
        *(
            "HDF5",
            (".h5", ".hdf5", ".he5", ".hdf", ".nxs", ".emd"),
            read_hdf5,
            "h5py",
            (HDF5,),
        ),
        hdf5_stack,
        note="axes and sizes of ilastik, NeXus, BigDataViewer, element_size_um",
    ),
    Format(
        *("MINC", (".mnc",), neuro.read_neuro, "nibabel", (HDF5, (0, b"CDF\1"))),
        note="1 and 2; a patient's axes",
    ),
    Format(
        *("BigDataViewer", (".xml",), read_project, "h5py", (), project_stack),
        whole=False,
        note="its HDF5 or N5, with units and setups",
    ),
    OME_ZARR,
    Format(
        *("N5", (".n5",), read_ome_zarr, "zarr"),
        stack=ome_zarr_stack,
        note="folders; the finest of several levels",
    ),
    Format("MRC", MRC_SUFFIXES, read_mrc, "mrcfile", (MRC_MAGIC,), note="also CCP4; ångströms"),
    Format(
        *("MRtrix", (".mif", ".mif.gz", ".mih"), read_mif, _OURS, (MIF_MAGIC,)),
        unpacks=True,
        note="a patient's axes",
    ),
    Format(
        *("GIPL", (".gipl", ".gipl.gz"), read_gipl, _OURS, GIPL_MAGIC),
        unpacks=True,
        note="spacing and origin",
    ),
    Format(
        *("Imaris", (".ims",), read_imaris, "h5py", (HDF5,), imaris_stack),
        note="places, channels, times, levels",
    ),
    Format("CZI", (".czi",), read_micro, "pylibCZIrw", note="scenes, mosaics"),
    Format("LIF", (".lif",), read_micro, "liffile", note="its pictures"),
    Format("ND2", (".nd2",), read_micro, "nd2", note="channels, times, positions"),
    Format("OIF", (".oib", ".oif"), read_micro, "oiffile", note="channels, times"),
    Format("VTI", (".vti", ".pvti"), read_vtk, "pyvista", note="points or cells, vectors, pieces"),
    Format("VTR", (".vtr", ".pvtr"), read_vtk, "pyvista", note="of even spacing"),
    Format("VTM", (".vtm", ".vtmb"), read_vtk, "pyvista", note="a block of several"),
    Format("VTKHDF", (".vtkhdf",), read_vtk, "pyvista", (HDF5,), note="image data"),
    Format("VTK", (".vtk",), read_vtk, "pyvista", ((0, b"# vtk DataFile"),), note="legacy files"),
    Format(".npy", (".npy",), read_npy, "", ((0, b"\x93NUMPY"),), note="of three axes"),
    Format(".npz", (".npz",), read_npz, note="one of its arrays"),
    RAW,
)
WHOLE_SUFFIXES = tuple(s for kind in FORMATS if kind.whole for s in kind.suffixes)
"""Endings of files that each are a whole volume, unlike the slices of a series."""
SLICE_SUFFIXES = (*DICOM_SUFFIXES, *(s for endings in PICTURES.values() for s in endings))
"""Endings of files of which each may be a slice."""
VOLUME_SUFFIXES = tuple(s for kind in FORMATS for s in kind.suffixes)
KNOWN = ", ".join(kind.name for kind in FORMATS if kind is not RAW)


def format_of(path: Path, head: bytes) -> Format | None:
    """Return the format of a file with some first bytes ; None if it is unknown."""
    unpacked = _peek_gzip(path) if head.startswith(GZIP) else head
    by_name = [kind for kind in FORMATS if path.name.lower().endswith(kind.suffixes)]
    by_content = [kind for kind in FORMATS if kind.begins(unpacked if kind.unpacks else head)]
    if RAW in by_name:  # whatever its bytes happen to look like
        return RAW
    if not (by_content or by_name) and is_dicom(path):  # without its preamble
        return DICOM
    both = [kind for kind in by_name if kind in by_content]
    return next(iter((*both, *by_content, *by_name)), None)


def _peek_gzip(path: Path) -> bytes:
    """Return the first bytes in a file that is packed by gzip; none if it is damaged."""
    with suppress(OSError, EOFError, zlib.error), gzip.open(path) as file:
        return file.read(_LOOKED_AT)
    return b""
