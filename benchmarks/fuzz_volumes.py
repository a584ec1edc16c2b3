"""Readers of volumes under fuzzing: whole, through their child process; their headers, by coverage.

    valid files -> [fuzz_volumes] -> fuzz_targets

Only the memory of a library in the child can be seen from here: its peak is read after every input,
and the text of the child's answer counts as the place that an input reached.
"""

from __future__ import annotations

import locale
import os
import re
import struct
import tempfile
from collections.abc import Callable, Iterable, Mapping
from contextlib import suppress
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.fuzz_target import Target
from volspec.errors import VolspecError
from volspec.volume import load_volume, reader_process
from volspec.volume.files.query import Query, Stored
from volspec.volume.files.vtk import check_vtk
from volspec.volume.load import read_here

_VALUES = (np.arange(4 * 5 * 6) % 251).astype(np.uint8).reshape(4, 5, 6)
_SHORTS = _VALUES.astype(np.int16) * 100 - 9000
_FLOATS = np.where(_VALUES == 7, np.nan, _VALUES / 9).astype(np.float32)
# Number of words after the file's name in a message that identify the place.
_WORDS, _PLACE = re.compile(r"[A-Za-z_]{3,}"), 6


def _load(path: Path) -> None:
    try:
        load_volume(path)
    except VolspecError as error:
        said = str(error).rpartition("/")[2]
        error.place = tuple(_WORDS.findall(said)[:_PLACE])
        raise


def _load_raw(path: Path) -> None:
    """Load 60 voxels with a query: the file's text up to a newline."""
    query, _, voxels = path.read_bytes().partition(b"\n")
    path.with_name("voxels.raw").write_bytes(voxels.ljust(120, b"\1"))
    load_volume(f"{path.with_name('voxels.raw')}?{query.decode('utf-8', 'surrogateescape')}")


def _here(path: Path) -> None:
    """Read a file in this process, so that its reader's coverage is seen."""
    query = Query(path)
    values = read_here(query).values
    if isinstance(values, Stored):
        query.reserve(values.shape, np.dtype(values.dtype).itemsize)  # as the program does
        values.read()


class _Children:
    """Memory of the reading processes."""

    def __init__(self) -> None:
        self._before: dict[int, int] = {}

    def peak(self) -> int:
        """Return the child's peak bytes for the last input; 0 if it is new or has ended."""
        most = 0
        for process in reader_process._idle_processes(os.getpid()):
            pid = process._process.pid
            with suppress(OSError):
                status = Path(f"/proc/{pid}/status").read_text()
                high, now = (
                    int(re.search(rf"{name}:\s+(\d+)", status)[1]) << 10
                    for name in ("VmHWM", "VmRSS")
                )
                most = max(most, high - self._before.get(pid, high))
                Path(f"/proc/{pid}/clear_refs").write_text("5")  # forget this peak
                self._before[pid] = now
        return most

    def declared(self, data: bytes) -> int:
        """Return the bytes of the last input, and of the voxels that its header declares."""
        idle = reader_process._idle_processes(os.getpid())
        return len(data) + max((each.declared_bytes for each in idle), default=0)


def _itk(name: str, *arrays: np.ndarray, packed: bool = False) -> Callable[[], Iterable[bytes]]:
    def seeds() -> Iterable[bytes]:
        import SimpleITK as sitk

        with tempfile.TemporaryDirectory() as folder:
            for values in arrays:
                path = Path(folder, name)
                sitk.WriteImage(sitk.GetImageFromArray(values), str(path), packed)
                yield path.read_bytes()

    return seeds


def _vti() -> Iterable[bytes]:
    import pyvista
    from vtkmodules.vtkIOXML import vtkXMLImageDataWriter

    grid = pyvista.ImageData(dimensions=(6, 5, 4))
    grid.point_data["values"] = _SHORTS.ravel()
    with tempfile.TemporaryDirectory() as folder:
        for mode in ("Ascii", "Binary", "Appended"):
            for packed in (False, True):
                writer = vtkXMLImageDataWriter()
                writer.SetInputData(grid)
                writer.SetFileName(str(Path(folder, "v.vti")))
                writer.SetDataMode(getattr(writer, mode))
                writer.SetEncodeAppendedData(packed)
                if not packed:
                    writer.SetCompressorTypeToNone()
                writer.Write()
                yield Path(folder, "v.vti").read_bytes()


def _vtk() -> Iterable[bytes]:
    import pyvista

    grid = pyvista.ImageData(dimensions=(6, 5, 4))
    grid.point_data["values"] = _SHORTS.ravel()
    with tempfile.TemporaryDirectory() as folder:
        for binary in (False, True):
            grid.save(Path(folder, "v.vtk"), binary=binary)
            yield Path(folder, "v.vtk").read_bytes()


def _npy() -> Iterable[bytes]:
    with tempfile.TemporaryDirectory() as folder:
        for values in (_VALUES, np.asfortranarray(_SHORTS), _FLOATS.astype(np.float64)):
            np.save(Path(folder, "v.npy"), values)
            yield Path(folder, "v.npy").read_bytes()


def _tiff() -> Iterable[bytes]:
    from PIL import Image
    from tifffile import imwrite

    stack = _SHORTS.astype(np.uint16)
    sizes = {"PhysicalSizeX": 0.5, "PhysicalSizeY": 0.5, "PhysicalSizeZ": 2}
    with tempfile.TemporaryDirectory() as folder:
        plain, ome = Path(folder, "v.tif"), Path(folder, "v.ome.tif")
        for options in ({}, {"compression": "zlib"}, {"compression": "lzma"}, {"imagej": True}):
            imwrite(plain, stack, **options)
            yield plain.read_bytes()
        imwrite(ome, stack, metadata={"axes": "ZYX", **sizes}, compression="zlib")
        yield ome.read_bytes()
        first, *others = [Image.fromarray(page) for page in _VALUES]
        first.save(plain, save_all=True, append_images=others, compression="tiff_lzw")
        yield plain.read_bytes()


def _mrc() -> Iterable[bytes]:
    import mrcfile

    with tempfile.TemporaryDirectory() as folder:
        for values in (_SHORTS, np.nan_to_num(_FLOATS)):
            with mrcfile.new(Path(folder, "v.mrc"), values, overwrite=True) as file:
                file.voxel_size = 5.0
            yield Path(folder, "v.mrc").read_bytes()


def _hdf5() -> Iterable[bytes]:
    import h5py

    with tempfile.TemporaryDirectory() as folder:
        for packed in (None, "gzip"):
            with h5py.File(Path(folder, "v.h5"), "w") as file:
                data = file.create_dataset("a/data", data=_SHORTS, compression=packed)
                data.attrs["element_size_um"] = [2.0, 0.5, 0.5]
            yield Path(folder, "v.h5").read_bytes()


def _mif() -> Iterable[bytes]:
    head = (
        "mrtrix image\ndim: 6,5,4\nvox: 1,1,2\nlayout: -0,+1,+2\ndatatype: Int16LE\n"
        "transform: 1,0,0,5\ntransform: 0,1,0,6\ntransform: 0,0,1,7\nscaling: 1,2\n"
        "file: . 256\nEND\n"
    )
    yield head.encode().ljust(256, b"\0") + _SHORTS.tobytes()


def _gipl() -> Iterable[bytes]:
    header = bytearray(256)
    struct.pack_into(">4H", header, 0, 6, 5, 4, 1)
    struct.pack_into(">H4f", header, 8, 15, 1, 1, 2, 1)
    struct.pack_into(">I", header, 252, 719555000)
    yield bytes(header) + _SHORTS.astype(">i2").tobytes()


def _mgh() -> Iterable[bytes]:
    import nibabel

    with tempfile.TemporaryDirectory() as folder:
        for name in ("v.mgh", "v.mgz"):
            nibabel.save(nibabel.MGHImage(_SHORTS.T, np.eye(4)), Path(folder, name))
            yield Path(folder, name).read_bytes()


@cache
def _dicom() -> dict[str, bytes]:
    import SimpleITK as sitk

    files = {}
    before = locale.setlocale(locale.LC_CTYPE)
    with tempfile.TemporaryDirectory() as folder:
        for k, values in enumerate(_SHORTS):
            image = sitk.GetImageFromArray(values)
            tags = {"0020|000e": "1.2.3", "0020|0032": f"0\\0\\{k}", "0020|0013": str(k)}
            for tag, text in ({"0008|0060": "CT", "0020|0037": "1\\0\\0\\0\\1\\0"} | tags).items():
                image.SetMetaData(tag, text)
            writer = sitk.ImageFileWriter()
            writer.SetImageIO("GDCMImageIO")
            writer.KeepOriginalImageUIDOn()
            writer.SetFileName(str(Path(folder, "s.dcm")))
            writer.Execute(image)
            files[f"s{k}.dcm"] = Path(folder, "s.dcm").read_bytes()
    locale.setlocale(locale.LC_CTYPE, before)  # GDCM's writer leaves the C locale
    return files


@cache
def _zarr(version: int) -> dict[str, bytes]:
    import zarr

    with tempfile.TemporaryDirectory() as folder:
        group = zarr.open_group(folder, mode="w", zarr_format=version)
        array = group.create_array("0", shape=_SHORTS.shape, dtype="int16", chunks=(2, 5, 6))
        array[...] = _SHORTS
        axes = [{"name": n, "type": "space", "unit": "micrometer"} for n in "zyx"]
        scale = [{"type": "scale", "scale": [2, 0.5, 0.5]}]
        levels = [{"path": "0", "coordinateTransformations": scale}]
        picture = {"version": "0.5", "multiscales": [{"axes": axes, "datasets": levels}]}
        group.attrs.update(picture if version == 2 else {"ome": picture})
        return {
            path.relative_to(folder).as_posix(): path.read_bytes()
            for path in Path(folder).rglob("*")
            if path.is_file()
        }


def _png() -> Iterable[bytes]:
    from PIL import Image

    with tempfile.TemporaryDirectory() as folder:
        for values in (_VALUES[0], _SHORTS[0].astype(np.uint16)):
            Image.fromarray(values).save(Path(folder, "s.png"))
            yield Path(folder, "s.png").read_bytes()


def _bmp() -> Iterable[bytes]:
    from PIL import Image

    with tempfile.TemporaryDirectory() as folder:
        for name in ("s.bmp", "s.jpg"):
            Image.fromarray(_VALUES[0]).save(Path(folder, name))
            yield Path(folder, name).read_bytes()


_NRRD = (b"sizes: ", b"type: ", b"encoding: ", b"gzip", b"bzip2", b"hex", b"ascii", b"data file: ")
_META = (
    *(b"ElementDataFile = ", b"LIST", b"%s%n", b"../", b"DimSize = ", b"CompressedData = True\n"),
    *(b"HeaderSize = -1\n", b"ElementNumberOfChannels = ", b"NDims = ", b"BinaryData = False\n"),
)
_VTI = (b"<DataArray ", b"</DataArray>", b'WholeExtent="', b'Extent="', b'format="binary"', b"<a>")
_VTK = (b"DIMENSIONS ", b"POINT_DATA ", b"SCALARS a int\n", b"FIELD f 1\n", b"DATASET POLYDATA\n")
_MIF = (b"dim: ", b"layout: ", b"datatype: ", b"file: ", b"transform: ", b"END\n", b"scaling: ")
_ZARR = (b'"shape":', b'"chunks":', b'"codecs":', b'"blosc"', b'"zstd"', b'"data_type":', b"null")


def volumes() -> Mapping[str, Target]:
    """Return the readers of volumes by name."""
    children = _Children()

    def whole(
        seeds: Callable[[], Iterable[bytes]], file: str, tokens: tuple[bytes, ...] = (), **more: Any
    ) -> Target:
        return Target(
            *(_load, seeds, file),
            tokens=tokens,
            declared=children.declared,
            peak=children.peak,
            **more,
        )

    def header(
        read: Callable[[Path], object],
        seeds: Callable[[], Iterable[bytes]],
        file: str,
        tokens: tuple[bytes, ...] = (),
    ) -> Target:
        return Target(read, seeds, file, tokens=tokens)

    nrrd, mha = _itk("v.nrrd", _SHORTS, _FLOATS), _itk("v.mha", _SHORTS, _FLOATS)
    packed_nrrd, packed_mha = (_itk(f"v.{e}", _SHORTS, packed=True) for e in ("nrrd", "mha"))
    nifti, packed_nifti = _itk("v.nii", _SHORTS, _FLOATS), _itk("v.nii.gz", _SHORTS, _FLOATS)
    texts = b"shape=5x4x3&dtype=int16", b"shape=4x3x5&dtype=uint8&order=big&offset=3&spacing=1,2,3"
    companions = {"v.raw": _SHORTS.tobytes()}

    def slices() -> Mapping[str, bytes]:
        return {name: data for name, data in _dicom().items() if name != "s0.dcm"}

    def pictures() -> Mapping[str, bytes]:
        first, *_ = _png()
        return {"s1.png": first, "s2.png": first}

    def photographs() -> Mapping[str, bytes]:
        *_, last = _bmp()
        return {"s1.jpg": last, "s2.jpg": last}

    def store(version: int, name: str) -> tuple[Callable[[], Iterable[bytes]], str]:
        return lambda: [_zarr(version)[name]], f"z.zarr/{name}"

    def parts(version: int) -> Callable[[], Mapping[str, bytes]]:
        return lambda: {f"z.zarr/{name}": data for name, data in _zarr(version).items()}

    return {
        "nrrd": whole(lambda: [*nrrd(), *packed_nrrd()], "v.nrrd", _NRRD),
        "nhdr": whole(_itk("v.nhdr", _SHORTS), "v.nhdr", _NRRD, companions=lambda: companions),
        "mha": whole(lambda: [*mha(), *packed_mha()], "v.mha", _META),
        "mhd": whole(_itk("v.mhd", _SHORTS), "v.mhd", _META, companions=lambda: companions),
        "nii": whole(nifti, "v.nii"),
        "nii.gz": whole(packed_nifti, "v.nii.gz"),
        "vti": whole(_vti, "v.vti", _VTI),
        "vtk": whole(_vtk, "v.vtk", _VTK),
        "npy": Target(_load, _npy, "v.npy", tokens=(b"'descr'", b"'shape': (", b"'|O'", b"((")),
        "raw": Target(_load_raw, lambda: texts, "query", tokens=(b"&dtype=", b"x", b"&time=1")),
        "tiff": whole(_tiff, "v.tif", (b"II*\0", b"MM\0*", b"<OME", b"ImageJ=")),
        "dicom": whole(lambda: [_dicom()["s0.dcm"]], "s0.dcm", companions=slices, opens="."),
        "png": whole(_png, "s0.png", (b"IHDR", b"IDAT"), companions=pictures, opens="."),
        "zarr-2": whole(*store(2, "0/.zarray"), _ZARR, companions=parts(2), opens="z.zarr"),
        "zarr-3": whole(*store(3, "0/zarr.json"), _ZARR, companions=parts(3), opens="z.zarr"),
        "zarr-group": whole(*store(3, "zarr.json"), _ZARR, companions=parts(3), opens="z.zarr"),
        "zarr-chunk": whole(*store(3, "0/c/0/0/0"), (), companions=parts(3), opens="z.zarr"),
        "mrc": whole(_mrc, "v.mrc"),
        "hdf5": whole(_hdf5, "v.h5"),
        "mif": whole(_mif, "v.mif", _MIF),
        "gipl": whole(_gipl, "v.gipl"),
        "mgh": whole(_mgh, "v.mgh"),
        "jpeg": whole(_bmp, "s0.jpg", (), companions=photographs, opens="."),
        "nrrd-header": header(_here, lambda: [*nrrd(), *packed_nrrd()], "v.nrrd", _NRRD),
        "meta-header": header(_here, lambda: [*mha(), *packed_mha()], "v.mha", _META),
        "nifti-header": header(_here, nifti, "v.nii"),
        "dicom-here": header(_here, lambda: [*_dicom().values()], "s0.dcm"),
        "mif-header": header(_here, _mif, "v.mif", _MIF),
        "vti-header": header(lambda path: check_vtk(Query(path)), _vti, "v.vti", _VTI),
        "vtk-header": header(lambda path: check_vtk(Query(path)), _vtk, "v.vtk", _VTK),
    }
