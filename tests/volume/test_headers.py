"""Headers of files: those that differ from the voxels, that ITK misreads, and wide integers."""

import gzip
import struct
import warnings
import zlib
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import pyvista
import SimpleITK as sitk

from tests.support.errors import raises, warns
from tests.support.volumes import (
    META,
    NRRD,
    RAW,
    VALUES,
    load_silently,
    nifti,
    write_nrrd,
    write_vti,
)
from volspec._files import captured_output
from volspec.errors import VolspecWarning, VolumeError
from volspec.volume import load_volume

LOCAL = f"{META}ElementDataFile = LOCAL\n"
BIG = VALUES.astype(">i2").tobytes()
WORDS = b" ".join(b"%d" % value for value in VALUES.ravel()) + b"\n"
META_VARIANTS = [
    ("BinaryDataByteOrderMSB = T", BIG),
    ("BinaryDataByteOrderMSB = 1", BIG),
    ("BinaryDataByteOrderMSB = yes", RAW),
    ("binarydatabyteordermsb = True", RAW),
    ("ElementByteOrderMSB = True", BIG),
    ("ElementByteOrderMSB = True\nBinaryDataByteOrderMSB = False", RAW),
    ("BinaryDataByteOrderMSB = True\nElementByteOrderMSB = False", RAW),
    ("ElementToIntensityFunctionSlope = 2\nElementToIntensityFunctionOffset = 5", RAW),
    (f"CompressedData = T\nCompressedDataSize = {len(zlib.compress(RAW))}", zlib.compress(RAW)),
    (f"CompressedData = 1\nCompressedDataSize = {len(gzip.compress(RAW))}", gzip.compress(RAW)),
    ("CompressedData = yes", RAW),
    ("BinaryData = F", WORDS),
    ("BinaryData = 0", WORDS),
    ("BinaryData = true", RAW),
    ("BinaryData: True\nBinaryDataByteOrderMSB := True", BIG),
    ("\n \nBinaryDataByteOrderMSB = False\nBinaryDataByteOrderMSB = True", BIG),
    ("datafile = elsewhere.raw\n\xa0BinaryDataByteOrderMSB = True", RAW),
    ("ElementNBits = 8", RAW),
    ("HeaderSize = 6", b"abcdef" + RAW),
]
NRRD_VARIANTS = [
    ("endian: BIG\nencoding: RAW", BIG),
    ("endian: little\nencoding: raw\nbyteskip: 4", b"abcd" + RAW),
    ("endian: little\nencoding: raw\nbyte skip: 4", b"abcd" + RAW),
    ("endian: little\nencoding: raw\nbyte skip: +4", b"abcd" + RAW),
    ("endian: little\nencoding: raw\nbyte skip: -1", b"abcd" + RAW),
    ("endian: little\nencoding: raw\nlineskip: 1", b"ab\n" + RAW),
    ("endian: little\nencoding: raw\nline skip: 1", b"ab\n" + RAW),
    ("endian: little\nencoding: raw\nendian:=big", RAW),
    ("endian: little\nencoding: raw\nencoding:=gzip", RAW),
    ("# endian: big\nendian: little\nencoding: raw", RAW),
    ("endian: little\nencoding: gz", gzip.compress(RAW)),
    ("endian: little\nencoding: gzip\nlineskip: 1", b"ab\n" + gzip.compress(RAW)),
    ("endian: little\nencoding: gzip\nbyteskip: 4", gzip.compress(b"abcd" + RAW)),
    ("ENDIAN: little\nEncoding: raw", RAW),
    ("endian: little\nencoding: hex", RAW.hex().encode()),
    ("endian: little\r\nencoding: raw\r", RAW),
]
# Offset of a field, its format, its values.
# Slopes and intercepts that nifti1.h gives a meaning, and those that say nothing; the first voxel
# is never before byte 352.
NIFTI_VARIANTS: list[tuple[int, str, tuple[float, ...], Callable[[np.ndarray], np.ndarray]]] = [
    *((108, "<f", (start,), np.copy) for start in (0, 348, 352.9, np.nan, np.inf, -5, 100)),
    *((112, "<2f", pair, np.copy) for pair in ((np.nan, 0), (0, 3), (np.inf, 0), (1, 0))),
    (112, "<2f", (1, 3), lambda values: values + 3.0),
    (112, "<2f", (2, 0), lambda values: values * 2.0),
    (70, "<2h", (512, 16), lambda values: values.view(np.uint16)),
    (72, "<h", (8,), np.copy),
]


def loaded_as_itk_does(path: Path) -> None:
    """Voxels that are read as a file's bytes, and not by ITK, are those that ITK would give."""
    with captured_output([]):
        expected = sitk.GetArrayFromImage(sitk.ReadImage(str(path)))
    assert expected.shape == VALUES.shape
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", VolspecWarning)
        assert np.array_equal(load_volume(path).values, expected, equal_nan=True)


META_PLACES = [
    *("ElementDataFile: ../v.raw", "ElementDataFile = ../v.raw", " ElementDataFile =: /v.raw"),
    *("datafile = LOCAL\nElementDataFile = ../v.raw", "ElementDataFile = LIST\na\n../v.raw"),
    *("ElementDataFile = LIST 2D\n/v.raw", "ElementDataFile = /etc/hostname"),
    *("ElementDataFile = %s%n.raw 1 2 1", "ElementDataFile = v%d%d.raw 1 2 1"),
]
NRRD_PLACES = [
    *("data file: ../v.raw", "datafile: /v.raw", "Data File: C:v.raw", "data file: %s.raw 1 2 1"),
    *("data file: LIST\na.raw\n../v.raw", "content: a list\ndata file: LIST 2\n../v.raw"),
]
# VTK leaves what a missing piece would hold as memory was.
ONE_PIECE = (
    '<VTKFile type="ImageData" version="1.0" byte_order="LittleEndian">'
    '<ImageData WholeExtent="0 3 0 3 0 3" Origin="0 0 0" Spacing="1 1 1">'
    '<Piece Extent="0 1 0 1 0 1"><PointData Scalars="a">'
    '<DataArray type="UInt8" Name="a" format="ascii">1 2 1 2 1 2 1 2</DataArray>'
    "</PointData></Piece></ImageData>"
)
# VTK's parser recurses until the process ends.
DEEP = '<VTKFile type="ImageData">' + "<a>" * 200_000 + "</a>"
NO_VTI = ["<DataArray/>", "<a></a></a>", "<AppendedData>no mark", ONE_PIECE, DEEP]
COUNTS = ["0", "-1", "4290967296", "1e99", "nan"]
SIZES = {"0 3 2": "range", "-4 3 2": "range", "4 3": "damaged"}


def of_place(field: str) -> str:
    """The code for voxels elsewhere."""
    return "syntax" if "%" in field else "unsupported"


def sized(header: str, sizes: str) -> bytes:
    return header.replace("4 3 2", sizes).encode() + RAW


def nifti_with(offset: int, form: str, *numbers: float) -> bytes:
    data = bytearray(nifti(VALUES, np.eye(4)))
    struct.pack_into(form, data, offset, *numbers)
    return bytes(data)


REFUSED: list[tuple[str, str | bytes, str]] = [
    # MetaIO takes the next line, here the voxels' place, for its value.
    ("v.mha", f"{META}hello\nElementDataFile = ../voxels.raw\n", "syntax"),
    # Voxels lie in the header's folder.
    *(("v.mha", f"{META}{field}\n", of_place(field)) for field in META_PLACES),
    *(("v.nhdr", NRRD.replace("raw", f"raw\n{field}"), of_place(field)) for field in NRRD_PLACES),
    # Before ITK counts them.
    *(("v.mha", META.replace("NDims = 3", f"NDims = {count}"), "shape") for count in COUNTS),
    *(("v.nrrd", NRRD.replace("dimension: 3", f"dimension: {count}"), "shape") for count in COUNTS),
    *(("v.mha", sized(LOCAL, n), SIZES[n]) for n in SIZES),
    *(("v.nrrd", sized(NRRD, n), SIZES[n]) for n in SIZES),
    # ITK takes it for Analyze, and makes voxels up.
    ("v.nii", nifti_with(344, "<i", 0), "damaged"),
    ("v.nii", nifti_with(0, "<i", 540), "damaged"),
    ("v.nii", nifti_with(70, "<h", 1536), "unsupported"),
    *(("v.vti", f"{text}</VTKFile>", "damaged") for text in NO_VTI),
]


@pytest.mark.parametrize(
    ("name", "content", "code"), REFUSED, ids=[f"{k}-{row[0]}" for k, row in enumerate(REFUSED)]
)
def test_headers_that_cannot_be_read_are_refused(tmp_path, name, content, code):
    (tmp_path / name).write_bytes(content.encode() if isinstance(content, str) else content)
    with raises(VolumeError, code) as caught:
        load_volume(tmp_path / name)
    assert name in str(caught.value)


@pytest.mark.parametrize(("fields", "data"), META_VARIANTS, ids=[each for each, _ in META_VARIANTS])
def test_metaimage_headers_are_read_as_by_itk(tmp_path, fields, data):
    path = tmp_path / "v.mha"
    path.write_bytes(f"{META}{fields}\nElementDataFile = LOCAL\n".encode("latin-1") + data)
    loaded_as_itk_does(path)


@pytest.mark.parametrize(("fields", "data"), NRRD_VARIANTS, ids=[each for each, _ in NRRD_VARIANTS])
def test_nrrd_headers_are_read_as_by_itk(tmp_path, fields, data):
    path = tmp_path / "v.nrrd"
    head = "NRRD0004\ntype: short\ndimension: 3\nsizes: 4 3 2\n"
    path.write_bytes(f"{head}{fields}\n\n".encode() + data)
    loaded_as_itk_does(path)


@pytest.mark.parametrize("suffix", [".nii", ".nii.gz"])
@pytest.mark.parametrize(("offset", "form", "numbers", "expected"), NIFTI_VARIANTS)
def test_nifti_headers_are_read_as_defined(tmp_path, suffix, offset, form, numbers, expected):
    data, path = nifti_with(offset, form, *numbers), tmp_path / f"v{suffix}"
    path.write_bytes(data if suffix == ".nii" else gzip.compress(data))
    assert np.array_equal(load_silently(path).values, expected(VALUES))


def grid(**arrays: np.ndarray) -> pyvista.ImageData:
    made = pyvista.ImageData(dimensions=(6, 5, 40))
    for name, array in arrays.items():
        made.point_data[name] = array
    return made


RAMP = (np.arange(1200) * 10 + 7).astype(np.int16)
VECTORS = np.arange(3600.0).reshape(1200, 3)
WHOLE, LONGER = b"0 5 0 4 0 39", b"0 5 0 4 0 99"
Cuts = tuple[bytes, list[bytes], np.ndarray]


def cut_nifti(_: Path, packed: bool, rescaled: bool) -> Cuts:
    """ITK fills what is missing without a word."""
    data = nifti_with(112, "<2f", 2.0, 5.0) if rescaled else nifti(VALUES, np.eye(4))
    pack = gzip.compress if packed else bytes
    values = VALUES * 2.0 + 5 if rescaled else VALUES
    return pack(data), [pack(data[:-9]), pack(data)[:-12]], values


def cut_legacy(path: Path, ascii: bool, **more: np.ndarray) -> Cuts:
    """VTK gives what is missing any value. The last 40 bytes may be its closing words."""
    grid(**({"a": RAMP} | more)).save(path, binary=not ascii)
    whole = path.read_bytes()
    cuts = [whole[:-cut] for cut in (40, 200, 1300, 2300)[ascii:]]
    return whole, cuts, RAMP


def cut_vti(path: Path, mode: str, packed: bool, encode: bool = False) -> Cuts:
    """VTK reads past the file's end, and fills an edited extent with what memory held."""
    whole = write_vti(path, grid(a=RAMP), mode, packed, encode)
    cuts = [whole.replace(WHOLE, LONGER), *(whole[:-cut] for cut in (30, 400, 1200))]
    if mode == "Binary" and packed:
        start = whole.index(b"RangeMax")
        cuts.append(whole[: start + 200] + whole[start + 400 :])
    return whole, cuts, RAMP


CUT: dict[str, tuple[str, Callable[[Path], Cuts]]] = {
    "nii": ("v.nii", lambda path: cut_nifti(path, False, False)),
    "nii.gz": ("v.nii.gz", lambda path: cut_nifti(path, True, False)),
    "rescaled nii": ("v.nii", lambda path: cut_nifti(path, False, True)),
    "rescaled nii.gz": ("v.nii.gz", lambda path: cut_nifti(path, True, True)),
    "vtk": ("v.vtk", lambda path: cut_legacy(path, False)),
    "vtk of two": ("v.vtk", lambda path: cut_legacy(path, False, b=RAMP.astype(np.float64))),
    "vtk of vectors": ("v.vtk", lambda path: cut_legacy(path, False, v=VECTORS)),
    "vtk of labels": ("v.vtk", lambda path: cut_legacy(path, False, a=RAMP.astype(np.int64))),
    "vtk in digits": ("v.vtk", lambda path: cut_legacy(path, True)),
    "vti in digits": ("v.vti", lambda path: cut_vti(path, "Ascii", False)),
    "vti": ("v.vti", lambda path: cut_vti(path, "Binary", False)),
    "packed vti": ("v.vti", lambda path: cut_vti(path, "Binary", True)),
    "vti at its end": ("v.vti", lambda path: cut_vti(path, "Appended", False)),
    "packed vti at its end": ("v.vti", lambda path: cut_vti(path, "Appended", True)),
    "encoded vti": ("v.vti", lambda path: cut_vti(path, "Appended", False, True)),
    "packed encoded vti": ("v.vti", lambda path: cut_vti(path, "Appended", True, True)),
}


@pytest.mark.parametrize("kind", CUT)
def test_truncated_files_are_refused(tmp_path, kind):
    name, make = CUT[kind]
    path = tmp_path / name
    whole, cuts, values = make(path)
    for content in (whole, whole + b"\n") if name == "v.vtk" else (whole,):
        path.write_bytes(content)
        assert np.array_equal(load_volume(path).values.ravel(), values.ravel())
    for content in cuts:
        path.write_bytes(content)
        with raises(VolumeError, "damaged"):
            load_volume(path)


@pytest.mark.parametrize("mode", ["Ascii", "Binary", "Appended"])
def test_a_vti_file_of_digits_with_other_arrays_is_read(tmp_path, mode):
    """Vectors come with elements of their own, field data with text that is no voxels."""
    image = grid(labels=(RAMP % 7).astype(np.uint8), vectors=VECTORS)
    image.field_data["note"] = np.arange(5000.0)
    image.set_active_scalars("labels")
    path = tmp_path / "v.vti"
    assert (b"InformationKey" in write_vti(path, image, mode)) == (mode != "Appended")
    assert np.array_equal(load_volume(path).values.ravel(), RAMP % 7)


def detached(path: Path, head: str, data: bytes) -> None:
    path.write_text(head)
    (path.parent / "voxels.raw").write_bytes(data)


DETACHED = NRRD.replace("encoding: raw", "encoding: raw\ndata file: voxels.raw")
AWAY = "ElementDataFile = voxels.raw\n"
OFFSET = f"{META}HeaderSize = 5\n{AWAY}"
LONG_FILES: dict[str, tuple[str, Callable[[Path, bytes], object]]] = {
    "nrrd": ("v.nrrd", lambda path, more: write_nrrd(path, surplus=more)),
    "gzip": ("v.nrrd", lambda path, more: write_nrrd(path, packed=True, surplus=more)),
    "nhdr": ("v.nhdr", lambda path, more: detached(path, DETACHED, RAW + more)),
    "mhd": ("v.mhd", lambda path, more: detached(path, META + AWAY, RAW + more)),
    "offset": ("v.mhd", lambda path, more: detached(path, OFFSET, b"12345" + RAW + more)),
    "mha": ("v.mha", lambda path, more: path.write_bytes(LOCAL.encode() + RAW + more)),
}


@pytest.mark.parametrize("kind", LONG_FILES)
def test_files_longer_than_their_header_says_are_warned_about(tmp_path, kind):
    name, write = LONG_FILES[kind]
    write(tmp_path / name, b"")
    assert np.array_equal(load_volume(tmp_path / name).values, VALUES)
    write(tmp_path / name, b"more")
    with warns("52", "48", file=__file__):
        assert np.array_equal(load_volume(tmp_path / name).values, VALUES)


def test_a_gzip_file_in_two_members_is_not_longer(tmp_path):
    """Only the last member's length is stored at the end."""
    header = NRRD.replace("encoding: raw", "encoding: gzip").encode()
    (tmp_path / "v.nrrd").write_bytes(header + gzip.compress(RAW[:40]) + gzip.compress(RAW[40:]))
    assert np.array_equal(load_volume(tmp_path / "v.nrrd").values, VALUES)


@pytest.mark.parametrize(("most", "narrow"), [(29, np.uint8), (29000, np.uint16)])
def test_labels_of_wide_integers_stay_whole(tmp_path, most, narrow):
    labels = (np.arange(24, dtype=np.int64).reshape(2, 3, 4) * most) // 23
    image = pyvista.ImageData(dimensions=(4, 3, 2))
    image.point_data["labels"] = labels.ravel()
    image.save(tmp_path / "points.vti")
    image = pyvista.ImageData(dimensions=(5, 4, 3))
    image.cell_data["labels"] = labels.ravel().astype(np.int32)
    image.save(tmp_path / "cells.vti")
    (tmp_path / "v.nii").write_bytes(nifti(labels, np.eye(4), code=1024))
    header = NRRD.replace("type: short", "type: int64").encode()
    (tmp_path / "v.nrrd").write_bytes(header + labels.tobytes())
    for name in ("points.vti", "cells.vti", "v.nii", "v.nrrd"):
        values = load_volume(tmp_path / name).values
        assert values.dtype == narrow and np.array_equal(values, labels), name
