"""Headers of files: those that differ from the voxels, that ITK misreads, and wide integers."""

from __future__ import annotations

import gzip
import struct
import warnings
import zlib
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import pyvista

from tests.support.errors import raises
from tests.support.volumes import META, NRRD, VALUES, load_silently, nifti
from volspec.errors import VolspecWarning, VolumeError
from volspec.volume import load_volume


@pytest.mark.parametrize("suffix", [".nii", ".nii.gz"])
def test_truncated_nifti_is_refused(tmp_path: Path, suffix: str) -> None:
    """ITK fills what is missing without a word."""
    whole = nifti(VALUES, np.eye(4))
    path = tmp_path / f"v{suffix}"
    path.write_bytes(whole if suffix == ".nii" else gzip.compress(whole))
    assert load_volume(path).shape_xyz == (4, 3, 2)
    cut = whole[:-9]
    path.write_bytes(cut if suffix == ".nii" else gzip.compress(cut))
    with raises(VolumeError, "damaged"):
        load_volume(path)
    path.write_bytes((whole if suffix == ".nii" else gzip.compress(whole))[:-12])
    with raises(VolumeError, "damaged"):
        load_volume(path)


@pytest.mark.parametrize("suffix", [".nii", ".nii.gz"])
def test_truncated_nifti_whose_values_are_rescaled_is_refused(tmp_path: Path, suffix: str) -> None:
    data = bytearray(nifti(VALUES, np.eye(4)))
    struct.pack_into("<2f", data, 112, 2.0, 5.0)
    path = tmp_path / f"v{suffix}"
    path.write_bytes(bytes(data) if suffix == ".nii" else gzip.compress(data))
    assert np.array_equal(load_volume(path).values, VALUES * 2.0 + 5)
    path.write_bytes(bytes(data[:-9]) if suffix == ".nii" else gzip.compress(data[:-9]))
    with raises(VolumeError, "damaged"):
        load_volume(path)


@pytest.mark.parametrize(
    ("offset", "form", "number", "code"),
    [
        (344, "<i", 0, "damaged"),  # ITK takes it for Analyze, and makes voxels up
        (0, "<i", 540, "damaged"),
        (70, "<h", 1536, "unsupported"),
    ],
)
def test_a_nifti_header_of_another_kind_is_refused(
    tmp_path: Path, offset: int, form: str, number: int, code: str
) -> None:
    data = bytearray(nifti(VALUES, np.eye(4)))
    struct.pack_into(form, data, offset, number)
    (tmp_path / "v.nii").write_bytes(data)
    with raises(VolumeError, code):
        load_volume(tmp_path / "v.nii")


RAW = VALUES.tobytes()
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
NIFTI_VARIANTS = [
    *((108, "<f", (start,)) for start in (0, 348, 352.9, np.nan, np.inf, -5, 100)),
    *((112, "<2f", pair) for pair in ((np.nan, 0), (1, 3), (0, 3), (np.inf, 0), (2, 0), (1, 0))),
    (70, "<2h", (512, 16)),
    (72, "<h", (8,)),
]


def loaded_as_itk_does(path: Path) -> None:
    """Voxels that are read as a file's bytes, and not by ITK, are those that ITK would give."""
    import SimpleITK as sitk

    from volspec._files import captured_output

    with captured_output([]):
        expected = sitk.GetArrayFromImage(sitk.ReadImage(str(path)))
    assert expected.shape == VALUES.shape
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", VolspecWarning)
        assert np.array_equal(load_volume(path).values, expected, equal_nan=True)


def test_a_metaimage_line_that_is_no_field_is_refused(tmp_path: Path) -> None:
    """MetaIO takes the next line, here the voxels' place, for its value."""
    (tmp_path / "v.mha").write_text(f"{META}hello\nElementDataFile = ../voxels.raw\n")
    with raises(VolumeError, "syntax"):
        load_volume(tmp_path / "v.mha")


@pytest.mark.parametrize(
    "field",
    [
        *("ElementDataFile: ../v.raw", "ElementDataFile = ../v.raw", " ElementDataFile =: /v.raw"),
        *("datafile = LOCAL\nElementDataFile = ../v.raw", "ElementDataFile = LIST\na\n../v.raw"),
        *("ElementDataFile = LIST 2D\n/v.raw", "ElementDataFile = /etc/hostname"),
        *("ElementDataFile = %s%n.raw 1 2 1", "ElementDataFile = v%d%d.raw 1 2 1"),
    ],
)
def test_metaimage_voxels_lie_in_the_header_s_folder(tmp_path: Path, field: str) -> None:
    (tmp_path / "v.mha").write_text(f"{META}{field}\n")
    with raises(VolumeError, "syntax" if "%" in field else "unsupported"):
        load_volume(tmp_path / "v.mha")


@pytest.mark.parametrize(
    "field",
    [
        *(
            "data file: ../v.raw",
            "datafile: /v.raw",
            "Data File: C:v.raw",
            "data file: %s.raw 1 2 1",
        ),
        *("data file: LIST\na.raw\n../v.raw", "content: a list\ndata file: LIST 2\n../v.raw"),
    ],
)
def test_nrrd_voxels_lie_in_the_header_s_folder(tmp_path: Path, field: str) -> None:
    head = NRRD.replace("encoding: raw", "encoding: raw\n" + field)
    (tmp_path / "v.nhdr").write_text(head)
    with raises(VolumeError, "syntax" if "%" in field else "unsupported"):
        load_volume(tmp_path / "v.nhdr")


@pytest.mark.parametrize("count", ["0", "-1", "4290967296", "1e99", "nan"])
def test_dimensions_that_cannot_be_are_refused_before_itk_counts_them(
    tmp_path: Path, count: str
) -> None:
    (tmp_path / "v.mha").write_text(META.replace("NDims = 3", f"NDims = {count}"))
    (tmp_path / "v.nrrd").write_text(NRRD.replace("dimension: 3", f"dimension: {count}"))
    for name in ("v.mha", "v.nrrd"):
        with raises(VolumeError, "shape"):
            load_volume(tmp_path / name)


@pytest.mark.parametrize(("fields", "data"), META_VARIANTS, ids=[each for each, _ in META_VARIANTS])
def test_metaimage_headers_are_taken_as_itk_takes_them(
    tmp_path: Path, fields: str, data: bytes
) -> None:
    path = tmp_path / "v.mha"
    path.write_bytes(f"{META}{fields}\nElementDataFile = LOCAL\n".encode("latin-1") + data)
    loaded_as_itk_does(path)


@pytest.mark.parametrize(("fields", "data"), NRRD_VARIANTS, ids=[each for each, _ in NRRD_VARIANTS])
def test_nrrd_headers_are_taken_as_itk_takes_them(tmp_path: Path, fields: str, data: bytes) -> None:
    path = tmp_path / "v.nrrd"
    head = "NRRD0004\ntype: short\ndimension: 3\nsizes: 4 3 2\n"
    path.write_bytes(f"{head}{fields}\n\n".encode() + data)
    loaded_as_itk_does(path)


@pytest.mark.parametrize("suffix", [".nii", ".nii.gz"])
@pytest.mark.parametrize(("offset", "form", "numbers"), NIFTI_VARIANTS)
def test_nifti_headers_are_taken_as_itk_takes_them(
    tmp_path: Path, suffix: str, offset: int, form: str, numbers: tuple[float, ...]
) -> None:
    data = bytearray(nifti(VALUES, np.eye(4)))
    struct.pack_into(form, data, offset, *numbers)
    path = tmp_path / f"v{suffix}"
    path.write_bytes(bytes(data) if suffix == ".nii" else gzip.compress(data))
    loaded_as_itk_does(path)


def grid(**arrays: np.ndarray) -> pyvista.ImageData:
    made = pyvista.ImageData(dimensions=(6, 5, 40))
    for name, array in arrays.items():
        made.point_data[name] = array
    return made


RAMP = (np.arange(1200) * 10 + 7).astype(np.int16)
GRIDS: dict[str, Callable[[], pyvista.ImageData]] = {
    "scalars": lambda: grid(a=RAMP),
    "a second array": lambda: grid(a=RAMP, b=RAMP.astype(np.float64)),
    "vectors, too": lambda: grid(a=RAMP, v=np.ones((1200, 3))),
    "labels": lambda: grid(a=RAMP.astype(np.int64)),
}


@pytest.mark.parametrize("name", GRIDS)
def test_a_truncated_legacy_vtk_file_is_refused(tmp_path: Path, name: str) -> None:
    """VTK gives what is missing any value. The last 40 bytes may be its closing words."""
    path = tmp_path / "v.vtk"
    GRIDS[name]().save(path)
    whole = path.read_bytes()
    assert np.array_equal(load_silently(path).values.ravel(), RAMP)
    path.write_bytes(whole + b"\n")
    assert np.array_equal(load_silently(path).values.ravel(), RAMP)
    for cut in (40, 200, 1300, 2300):
        path.write_bytes(whole[:-cut])
        with raises(VolumeError, "damaged"):
            load_volume(path)


def test_a_truncated_ascii_vtk_file_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "v.vtk"
    grid(a=RAMP).save(path, binary=False)
    assert np.array_equal(load_silently(path).values.ravel(), RAMP)
    path.write_bytes(path.read_bytes()[:-200])
    with raises(VolumeError, "damaged"):
        load_volume(path)


@pytest.mark.parametrize("compressed", [False, True])
@pytest.mark.parametrize("appended", [False, True])
def test_a_truncated_vti_file_is_refused(tmp_path: Path, compressed: bool, appended: bool) -> None:
    """VTK reads uncompressed appended data past the file's end without an error."""
    from vtkmodules.vtkIOXML import vtkXMLImageDataWriter

    path = tmp_path / "v.vti"
    image = grid(a=RAMP)
    writer = vtkXMLImageDataWriter()
    writer.SetInputData(image)
    writer.SetFileName(str(path))
    writer.SetEncodeAppendedData(False)
    writer.SetDataMode(writer.Appended if appended else writer.Binary)
    if not compressed:
        writer.SetCompressorTypeToNone()
    writer.Write()
    whole = path.read_bytes()
    assert np.array_equal(load_silently(path).values.ravel(), RAMP)
    for cut in (30, 400, 1200):
        path.write_bytes(whole[:-cut])
        with raises(VolumeError, "damaged"):
            load_volume(path)


@pytest.mark.parametrize("encode", [False, True])
@pytest.mark.parametrize("packed", [False, True])
@pytest.mark.parametrize("mode", ["Ascii", "Binary", "Appended"])
def test_a_vti_file_whose_array_is_short_is_refused(
    tmp_path: Path, mode: str, packed: bool, encode: bool
) -> None:
    """A whole file in which an extent was edited: VTK fills the rest with what memory held."""
    from vtkmodules.vtkIOXML import vtkXMLImageDataWriter

    path = tmp_path / "v.vti"
    writer = vtkXMLImageDataWriter()
    writer.SetInputData(grid(a=RAMP))
    writer.SetFileName(str(path))
    writer.SetDataMode(getattr(writer, mode))
    writer.SetEncodeAppendedData(encode)
    if not packed:
        writer.SetCompressorTypeToNone()
    writer.Write()
    assert np.array_equal(load_silently(path).values.ravel(), RAMP)
    path.write_bytes(path.read_bytes().replace(b"0 5 0 4 0 39", b"0 5 0 4 0 99"))
    with raises(VolumeError, "damaged"):
        load_volume(path)


@pytest.mark.parametrize("mode", ["Ascii", "Binary", "Appended"])
def test_a_vti_file_of_digits_with_other_arrays_is_read(tmp_path: Path, mode: str) -> None:
    """Vectors come with elements of their own, field data with text that is no voxels."""
    from vtkmodules.vtkIOXML import vtkXMLImageDataWriter

    image = grid(labels=(RAMP % 7).astype(np.uint8), vectors=np.ones((1200, 3)))
    image.field_data["note"] = np.arange(5000.0)
    image.set_active_scalars("labels")
    path = tmp_path / "v.vti"
    writer = vtkXMLImageDataWriter()
    writer.SetInputData(image)
    writer.SetFileName(str(path))
    writer.SetDataMode(getattr(writer, mode))
    writer.Write()
    assert (b"InformationKey" in path.read_bytes()) == (mode != "Appended")
    assert np.array_equal(load_silently(path).values.ravel(), RAMP % 7)
    path.write_bytes(path.read_bytes().replace(b"0 5 0 4 0 39", b"0 5 0 4 0 49"))
    with raises(VolumeError, "damaged"):
        load_volume(path)


@pytest.mark.parametrize("text", ["<DataArray/>", "<a></a></a>", "<AppendedData>no mark"])
def test_a_vti_file_that_is_none_is_refused(tmp_path: Path, text: str) -> None:
    path = tmp_path / "v.vti"
    path.write_text(f"{text}</VTKFile>")
    with raises(VolumeError, "damaged"):
        load_volume(path)


def test_a_vti_file_without_all_of_its_pieces_is_refused(tmp_path: Path) -> None:
    """VTK leaves in the rest what memory held."""
    path = tmp_path / "v.vti"
    path.write_text(
        '<VTKFile type="ImageData" version="1.0" byte_order="LittleEndian">'
        '<ImageData WholeExtent="0 3 0 3 0 3" Origin="0 0 0" Spacing="1 1 1">'
        '<Piece Extent="0 1 0 1 0 1"><PointData Scalars="a">'
        '<DataArray type="UInt8" Name="a" format="ascii">1 2 1 2 1 2 1 2</DataArray>'
        "</PointData></Piece></ImageData></VTKFile>"
    )
    with raises(VolumeError, "damaged"):
        load_volume(path)


def test_a_vti_file_nested_deeply_is_refused(tmp_path: Path) -> None:
    """VTK's parser recurses until the process ends."""
    path = tmp_path / "v.vti"
    path.write_bytes(b'<VTKFile type="ImageData">' + b"<a>" * 200_000 + b"</a></VTKFile>")
    with raises(VolumeError, "damaged"):
        load_volume(path)


def test_a_vti_file_with_damaged_data_is_refused_in_one_line(tmp_path: Path) -> None:
    path = tmp_path / "v.vti"
    grid(a=RAMP).save(path)
    whole = path.read_bytes()
    start = whole.index(b"RangeMax")
    path.write_bytes(whole[: start + 200] + whole[start + 400 :])
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        with raises(VolumeError, "damaged"):
            load_volume(path)


def write_nrrd(path: Path, surplus: bytes) -> None:
    path.write_bytes(NRRD.encode() + VALUES.tobytes() + surplus)


def write_gzipped_nrrd(path: Path, surplus: bytes) -> None:
    header = NRRD.replace("encoding: raw", "encoding: gzip").encode()
    path.write_bytes(header + gzip.compress(VALUES.tobytes() + surplus))


def write_detached_nrrd(path: Path, surplus: bytes) -> None:
    path.write_text(NRRD.replace("encoding: raw", "encoding: raw\ndata file: voxels.bin"))
    (path.parent / "voxels.bin").write_bytes(VALUES.tobytes() + surplus)


def write_mhd(path: Path, surplus: bytes) -> None:
    path.write_text(f"{META}ElementDataFile = voxels.raw\n")
    (path.parent / "voxels.raw").write_bytes(VALUES.tobytes() + surplus)


def write_mhd_with_offset(path: Path, surplus: bytes) -> None:
    path.write_text(f"{META}HeaderSize = 5\nElementDataFile = voxels.raw\n")
    (path.parent / "voxels.raw").write_bytes(b"12345" + VALUES.tobytes() + surplus)


def write_mha(path: Path, surplus: bytes) -> None:
    path.write_bytes(f"{META}ElementDataFile = LOCAL\n".encode() + VALUES.tobytes() + surplus)


@pytest.mark.parametrize(
    ("name", "write"),
    [
        ("v.nrrd", write_nrrd),
        ("v.nrrd", write_gzipped_nrrd),
        ("v.nhdr", write_detached_nrrd),
        ("v.mhd", write_mhd),
        ("v.mhd", write_mhd_with_offset),
        ("v.mha", write_mha),
    ],
)
def test_files_longer_than_their_header_says_are_warned_about(
    tmp_path: Path, name: str, write: Callable[[Path, bytes], None]
) -> None:
    path = tmp_path / name
    write(path, b"")
    assert np.array_equal(load_silently(path).values, VALUES)
    write(path, b"more")
    with pytest.warns(VolspecWarning, match=r"52 bytes of voxels.* describes 48") as caught:
        assert np.array_equal(load_volume(path).values, VALUES)
    assert len(caught) == 1 and caught[0].filename == __file__


def test_a_gzip_file_in_two_members_is_not_longer(tmp_path: Path) -> None:
    """Only the last member's length is stored at the end."""
    header = NRRD.replace("encoding: raw", "encoding: gzip").encode()
    raw = VALUES.tobytes()
    (tmp_path / "v.nrrd").write_bytes(header + gzip.compress(raw[:40]) + gzip.compress(raw[40:]))
    assert np.array_equal(load_silently(tmp_path / "v.nrrd").values, VALUES)


def wide_nifti(values: np.ndarray) -> bytes:
    data = bytearray(nifti(values, np.eye(4)))
    struct.pack_into("<2h", data, 70, 1024, 64)
    return bytes(data)


@pytest.mark.parametrize(("most", "narrow"), [(29, np.uint8), (29000, np.uint16)])
def test_label_files_of_wide_integers_stay_whole_numbers(
    tmp_path: Path, most: int, narrow: type
) -> None:
    labels = (np.arange(24, dtype=np.int64).reshape(2, 3, 4) * most) // 23
    image = pyvista.ImageData(dimensions=(4, 3, 2))
    image.point_data["labels"] = labels.ravel()
    image.save(tmp_path / "points.vti")
    image = pyvista.ImageData(dimensions=(5, 4, 3))
    image.cell_data["labels"] = labels.ravel().astype(np.int32)
    image.save(tmp_path / "cells.vti")
    (tmp_path / "v.nii").write_bytes(wide_nifti(labels))
    header = NRRD.replace("type: short", "type: int64").encode()
    (tmp_path / "v.nrrd").write_bytes(header + labels.tobytes())
    for name in ("points.vti", "cells.vti", "v.nii", "v.nrrd"):
        values = load_silently(tmp_path / name).values
        assert values.dtype == narrow and np.array_equal(values, labels), name


def test_pyvista_s_frog_is_read_as_labels() -> None:
    from pyvista import examples

    path = Path(examples.dir_path) / "frog_tissues.vti"
    if not path.exists():
        pytest.skip("this pyvista ships no frog")
    frog = load_volume(path)
    assert frog.shape_xyz == (500, 470, 136) and frog.values.dtype == np.uint8
    assert frog.range == (0, 29) and frog.spacing_mm == (1, 1, 1.5)
