"""DICOM series: which slices are one volume, where they lie, and what is refused."""

import os
import struct
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from pydicom import Dataset, dcmread, uid
from pydicom.data import get_testdata_file
from pydicom.datadict import dictionary_VR

from tests.support.errors import advised_address, raises, warns
from tests.support.volumes import load_silently
from volspec.errors import VolumeError
from volspec.volume import load_series, load_volume, volume_choices
from volspec.volume.files.dicom import read_series
from volspec.volume.files.dicom_frames import read_values
from volspec.volume.files.dicom_headers import headers
from volspec.volume.files.query import Query
from volspec.volume.labels import Label

VALUES = (np.arange(4 * 3 * 5, dtype=np.int16).reshape(4, 3, 5) * 7).astype(np.int16)
SPACING = (0.5, 0.75)
STEP = 2.5


def header(values: np.ndarray, **attributes: Any) -> Dataset:
    """Return a data set with pixels; attributes by their keyword, or number as ``x0020_0013``."""
    made = Dataset()
    made.file_meta = Dataset()
    made.file_meta.TransferSyntaxUID = uid.ExplicitVRLittleEndian
    made.SOPClassUID, made.SOPInstanceUID = uid.CTImageStorage, uid.generate_uid()
    made.Rows, made.Columns = values.shape[-2:]
    made.BitsAllocated = made.BitsStored = 8 * values.itemsize
    made.HighBit = made.BitsStored - 1
    made.PixelRepresentation = int(values.dtype.kind == "i")
    made.SamplesPerPixel, made.PhotometricInterpretation = 1, "MONOCHROME2"
    made.PixelSpacing = list(SPACING[::-1])
    made.add_new("PixelData", "OW", values.tobytes() + b"\0" * (values.nbytes % 2))
    for name, value in attributes.items():
        if value is None:
            delattr(made, name)
        elif name.startswith("x"):
            tag = int(name[1:].replace("_", ""), 16)
            made.add_new(tag, dictionary_VR(tag), value)
        else:
            setattr(made, name, value)
    return made


def write_slice(path: Path, values: np.ndarray, **attributes: Any) -> None:
    """Write one DICOM file, with attributes as in `header`."""
    made = header(values, **attributes)
    if values.ndim == 3:
        made.Rows, made.Columns, made.SamplesPerPixel = values.shape
        made.PhotometricInterpretation, made.PlanarConfiguration = "RGB", 0
    made.save_as(path, enforce_file_format=True)


def plane(
    z: float, number: int, series: int = 3, across: float = 0.0, name: str = "Head"
) -> dict[str, str]:
    """Tags of an axial slice's position: the patient's x and y along its rows and columns."""
    return {
        "x0008_0060": "CT",
        "x0008_103e": name,
        "x0020_000e": f"1.2.{series}",
        "x0020_0011": str(series),
        "x0020_0013": str(number),
        "x0020_0032": f"-10\\{across - 20}\\{z}",
        "x0020_0037": "1\\0\\0\\0\\1\\0",
    }


def write_series(folder: Path, values: np.ndarray = VALUES, **more: Any) -> Path:
    """Write a series with files, numbers and positions in three different orders."""
    folder.mkdir(parents=True, exist_ok=True)
    for k, slice_ in enumerate(values):
        name = f"{k * 7 % 11}{more.get('series', 3)}.dcm"
        write_slice(folder / name, slice_, **plane(k * STEP, len(values) - k, **more))
    return folder


def write_places(folder: Path, *places: float, values: np.ndarray = VALUES, **tags: str) -> Path:
    for k, (z, each) in enumerate(zip(places, values, strict=False)):
        write_slice(folder / f"{k}.dcm", each, **plane(z, k), **tags)
    return folder


def write_part(folder: Path, name: str, end: int, of: str = "03.dcm") -> Path:
    (folder / name).write_bytes((folder / of).read_bytes()[:end])
    return folder


def test_slices_are_put_where_they_lie_in_the_patient(tmp_path):
    folder = write_series(tmp_path / "head")
    for named in (folder, folder / "03.dcm"):
        volume = load_silently(named)
        assert volume.values.dtype == np.int16 and np.array_equal(volume.values, VALUES)
        assert volume.spacing_mm == (*SPACING, STEP) and volume.name == str(named)
        assert volume.world_from_index[:3, 3].tolist() == [-10, -20, 0]


@pytest.mark.parametrize("has_header", [True, False])
def test_slices_are_known_by_their_first_bytes(tmp_path, has_header):
    for file in write_series(tmp_path).iterdir():
        whole = file.read_bytes()
        end = 144 + int.from_bytes(whole[140:144], "little")  # of the header, group 0002
        file.with_name(f"IM{file.stem}").write_bytes(whole if has_header else whole[end:])
        file.unlink()
    for path in (tmp_path, tmp_path / "IM03"):
        assert np.array_equal(load_silently(path).values, VALUES)


def test_an_oblique_series_keeps_its_directions(tmp_path):
    """Sagittal: columns along the patient's y, rows downwards, slices along -x."""
    for k, values in enumerate(VALUES):
        place = {"x0020_0032": f"{-k * STEP}\\1\\2", "x0020_0037": "0\\1\\0\\0\\0\\-1"}
        write_slice(tmp_path / f"{k}.dcm", values, **{**plane(0, k), **place})
    volume = load_silently(tmp_path)
    expected = [[0, 0, -STEP, 0], [SPACING[0], 0, 0, 1], [0, -SPACING[1], 0, 2], [0, 0, 0, 1]]
    assert np.allclose(volume.world_from_index, expected) and np.array_equal(volume.values, VALUES)


def test_a_tilted_gantry_s_slices_stay_where_they_were_taken(tmp_path):
    """A reader that gives all stacks right angles puts the last slice 3 mm too far up."""
    for k, values in enumerate(VALUES):
        write_slice(tmp_path / f"{k}.dcm", values, **plane(k * STEP, k, across=1.0 * k))
    volume = load_silently(tmp_path)
    assert volume.corners_mm[4].tolist() == [-10, -17, 3 * STEP]
    assert np.array_equal(volume.values, VALUES)


def test_rescale_slope_and_intercept_are_applied_slice_by_slice(tmp_path):
    """PET has one each."""
    rescales = ((1, 0), (2, -7), (0.5, -7), (0.5, -7))
    for k, (slope, intercept) in enumerate(rescales):
        tags = plane(k, k) | {"x0008_0060": "PT", "x0054_1001": "BQML"}
        tags |= {"x0028_1053": str(slope), "x0028_1052": str(intercept)}
        write_slice(tmp_path / f"{k}.dcm", VALUES[k], **tags)
    volume = load_silently(tmp_path)
    expected = [values * a + b for values, (a, b) in zip(VALUES, rescales, strict=True)]
    assert volume.values.dtype == np.float32 and np.array_equal(volume.values, expected)
    assert volume.metadata.unit == "Bq/ml"


@pytest.mark.parametrize("file", ["RLE", "jp2klossless", "jpeg_ls_lossless", "bigendian"])
def test_compressed_slices_are_read(file):
    """pydicom's own files: one picture, stored in many ways."""
    plain, other = (
        read_values(headers([Path(get_testdata_file(f"MR_small{name}.dcm"))])[0])
        for name in ("", f"_{file}")
    )
    assert np.ptp(plain) > 0 and np.array_equal(plain, other)


@pytest.mark.parametrize(
    ("stored", "attributes", "expected"),
    [
        (VALUES - 1024, {"PhotometricInterpretation": "MONOCHROME1"}, VALUES - 1024),
        ((VALUES - 99) & 0xFFF | 0x5000, {"BitsStored": 12, "HighBit": 11}, VALUES - 99),
        ((VALUES - 99) << 4, {"BitsStored": 12}, VALUES - 99),
        (VALUES.astype(np.uint8), {}, VALUES.astype(np.uint8)),
        (VALUES, {"file_meta.TransferSyntaxUID": uid.ImplicitVRLittleEndian}, VALUES),
        (VALUES, {"file_meta.TransferSyntaxUID": uid.DeflatedExplicitVRLittleEndian}, VALUES),
        (VALUES.astype(np.float32), {"keyword": "FloatPixelData"}, VALUES),
        (VALUES.astype(np.float64), {"keyword": "DoubleFloatPixelData"}, VALUES),
    ],
)
def test_stored_values_are_read_as_they_are(tmp_path, stored, attributes, expected):
    """Nothing is inverted; bits beyond the stored ones, as of overlays, are no part of a value."""
    for k, values in enumerate(stored):
        made = header(values, **plane(k, k))
        for name, value in attributes.items():
            if name == "keyword":
                pixels = made.pop("PixelData").value
                made.add_new(value, dictionary_VR(value), pixels)
            else:
                target = made.file_meta if "." in name else made
                setattr(target, name.rpartition(".")[2], value)
        made.save_as(tmp_path / f"{k}.dcm", enforce_file_format=True)
    assert np.array_equal(load_silently(tmp_path).values, expected)


def two_series(folder: Path) -> None:
    write_series(folder, series=3, name="Head 2.5")
    write_series(folder, VALUES[:3] + 1, series=12, name="Soft")


def test_of_several_series_one_is_chosen(tmp_path):
    two_series(tmp_path)
    for name in ("?series=12", "?series=1.2.12", "/012.dcm"):
        assert np.array_equal(load_silently(f"{tmp_path}{name}").values, VALUES[:3] + 1)


def structures() -> bytes:
    """Begin of an RTSTRUCT file without a preamble and without its class, implicit types."""
    tags = ((0x60, b"RTSTRUCT"), (0x70, b"volspec "))
    return b"".join(struct.pack("<2HI", 8, tag, len(text)) + text for tag, text in tags) * 20


def with_strangers(folder: Path) -> None:
    write_series(folder)
    for name in ("a.dcm", "b.dcm"):
        (folder / name).write_bytes(b"hello" * 99)


def with_scouts(folder: Path, count: int = 1) -> None:
    """Write a series and sagittal slices."""
    write_series(folder)
    for k in range(count):
        tags = plane(k, 9) | {"x0020_0037": "0\\1\\0\\0\\0\\-1"}
        write_slice(folder / f"scout{k}.dcm", VALUES[0], **tags)


@pytest.mark.parametrize(
    ("make", "count", "name"),
    [
        (with_strangers, "2 of 6", "a.dcm"),
        (with_scouts, "1 of 5", "scout0.dcm"),
        (lambda folder: write_part(write_series(folder), "part.dcm", 200), "1 of 5", "part.dcm"),
    ],
)
def test_files_that_are_no_slices_are_left_out_with_one_warning(tmp_path, make, count, name):
    make(tmp_path)
    for path in (tmp_path, tmp_path / "03.dcm"):
        with warns(count, name):
            assert np.array_equal(load_volume(path).values, VALUES)


PALETTE, CONTENTS = b"1.2.840.10008.5.1.4.39.1", b"1.2.840.10008.1.3.10"


def write_class(folder: Path, name: str, uid: bytes) -> None:
    """Write the begin of a DICOM file of a class."""
    head = bytes(128) + b"DICM" + b"\2\0\2\0UI" + len(uid).to_bytes(2, "little")
    (folder / name).write_bytes(head + uid)


def write_report(folder: Path) -> None:
    """Write a slice's file as one of a class without pictures."""
    whole = (folder / "03.dcm").read_bytes()
    at = whole.index(bytes.fromhex("02000200") + b"UI")
    uid = b"1.2.840.10008.5.1.4.1.1.88.11\0"
    (folder / "SR1").write_bytes(whole[: at + 6] + len(uid).to_bytes(2, "little") + uid)


def write_bare(folder: Path) -> None:
    """Old programs write structure sets as a bare data set, here of implicit types."""
    uid = b"1.2.840.10008.5.1.4.1.1.481.3\0"
    charset = b"\x08\x00\x05\x00\x0a\x00\x00\x00ISO_IR 100"
    bare = charset + b"\x08\x00\x16\x00" + len(uid).to_bytes(4, "little") + uid
    (folder / "structures.dcm").write_bytes(bare)


def copy_files(folder: Path) -> None:
    for file in list(folder.iterdir()):
        (folder / f"copy of {file.name}").write_bytes(file.read_bytes())


@pytest.mark.parametrize(
    "write",
    [
        lambda folder: (folder / "notes.txt").write_text("by hand"),
        lambda folder: (folder / ".hidden.dcm").write_text("of the system"),
        lambda folder: (folder.parent / "viewer.exe").write_bytes(b"as on a CD"),
        lambda folder: write_class(folder.parent, "DICOMDIR", CONTENTS),
        # Objects without pixels.
        lambda folder: (folder / "rt.dcm").write_bytes(structures()),
        write_report,
        write_bare,
        copy_files,
    ],
    ids=["notes", "hidden", "program", "contents", "structures", "report", "bare", "copies"],
)
def test_files_of_other_kinds_are_left_out(tmp_path, write):
    """A folder without slices is those below it."""
    folder = write_series(tmp_path / "patient" / "series")
    write(folder)
    for path in (tmp_path, folder, folder / "03.dcm", f"{folder}?series=3"):
        assert np.array_equal(load_silently(path).values, VALUES)


def localizer(folder: Path) -> None:
    """Slices of one series that cross each other."""
    for k, turn in enumerate(("1\\0\\0\\0\\1\\0", "0\\1\\0\\0\\0\\-1", "1\\0\\0\\0\\0\\-1")):
        write_slice(folder / f"l{k}.dcm", VALUES[k], **(plane(0, k, 9) | {"x0020_0037": turn}))


def test_series_that_do_not_stack_are_not_offered(tmp_path):
    localizer(write_series(tmp_path))
    assert volume_choices(tmp_path) == ()
    with warns("2 series", "'Head'"):
        assert np.array_equal(load_volume(tmp_path).values, VALUES)
    write_series(tmp_path, series=4)
    assert volume_choices(tmp_path)[0].values == ("3", "4")


def with_a_gap(folder: Path) -> None:
    write_series(folder, LONG)
    next(p for p in folder.iterdir() if "\\7.5 " in p.read_bytes().decode("latin-1")).unlink()


def test_missing_slices_do_not_matter_if_a_spacing_is_given(tmp_path):
    with_a_gap(tmp_path)
    taken = load_silently(f"{tmp_path}?spacing=1,1,2")
    assert taken.spacing_mm == (1, 1, 2) and taken.shape_xyz == (5, 3, 7)


def test_slices_off_their_places_are_warned_about(tmp_path):
    write_places(tmp_path, 0, 2.5, 5.4, 7.5)
    with warns("0.4", "2.5", file=__file__):
        assert load_volume(tmp_path).spacing_mm[2] == 2.5


def of_two_times(folder: Path) -> Path:
    values = np.stack([VALUES, VALUES + 1], axis=1).reshape(8, *VALUES.shape[1:])
    return write_places(folder, *(0, 0, 1, 1, 2, 2, 3, 3), values=values)


def test_of_several_times_at_every_place_one_is_chosen(tmp_path):
    of_two_times(tmp_path)
    assert np.array_equal(load_silently(f"{tmp_path}?time=1").values, VALUES + 1)
    assert np.array_equal([step.values for step in load_series(tmp_path)], [VALUES, VALUES + 1])


def test_slices_without_places_follow_their_numbers(tmp_path):
    for k, values in enumerate(VALUES):
        tags = plane(0, k) | {"x0018_0088": "4"}
        del tags["x0020_0032"]
        write_slice(tmp_path / f"{9 - k}.dcm", values, **tags)
    with warns("4", "?spacing="):
        volume = load_volume(tmp_path)
    assert np.array_equal(volume.values, VALUES) and volume.spacing_mm == (*SPACING, 4)
    assert volume.metadata.assumed == ("slices 4 mm apart",) and not volume.metadata.is_patient
    assert load_volume(f"{tmp_path}?spacing=1,1,4").metadata.assumed == ()


def write_film(folder: Path) -> None:
    values = (VALUES // 2).astype(np.uint8)
    header(values, NumberOfFrames=4).save_as(folder / "film.dcm", enforce_file_format=True)


def test_a_file_of_many_frames_is_a_volume(tmp_path):
    write_film(tmp_path)
    with warns("4", "?spacing="):
        assert np.array_equal(load_volume(tmp_path).values, VALUES // 2)
    assert load_volume(f"{tmp_path}/film.dcm?spacing=1,1,4").spacing_mm == (1, 1, 4)


def group(name: str, **attributes: Any) -> dict[str, list[Dataset]]:
    """Return a sequence of one item, a functional group for instance."""
    made = Dataset()
    for keyword, value in attributes.items():
        setattr(made, keyword, value)
    return {f"{name}Sequence": [made]}


SAGITTAL = group("PlaneOrientation", ImageOrientationPatient=[0, 1, 0, 0, 0, -1])


def write_frames(
    path: Path, values: np.ndarray, places: list[Any], groups: Any = (), **more: Any
) -> Path:
    """Write a file of many frames at places in the patient, or along z; ``groups`` are others."""
    own = groups or [{}] * len(places)
    at = [[0, 0, each] if isinstance(each, int) else each for each in places]
    frames = [
        group("PlanePosition", ImagePositionPatient=p) | g for p, g in zip(at, own, strict=True)
    ]
    shared = group("PlaneOrientation", ImageOrientationPatient=[1, 0, 0, 0, 1, 0])
    shared |= group("PixelMeasures", PixelSpacing=list(SPACING[::-1]), SliceThickness=1)
    many = {"NumberOfFrames": len(places), "PixelSpacing": None, "Modality": "CT"}
    many |= group("SharedFunctionalGroups", **shared)
    many["PerFrameFunctionalGroupsSequence"] = [group("", **each)["Sequence"][0] for each in frames]
    header(values, **many, **more).save_as(path, enforce_file_format=True)
    return path


def test_frames_lie_where_each_of_them_says(tmp_path):
    """Frames of any order have values of their own; those of a tilted gantry are sheared."""
    tilted = [[0, 0.6 * k, 2 * k] for k in (2, 0, 3, 1)]
    name = "PixelValueTransformation"
    rescales = [group(name, RescaleSlope=2, RescaleIntercept=-k) for k in range(4)]
    volume = load_silently(write_frames(tmp_path / "a.dcm", VALUES, tilted, rescales))
    assert volume.world_from_index[:3, 2] == pytest.approx((0, 0.6, 2))
    expected = VALUES * 2 - np.arange(4)[:, None, None]
    assert np.array_equal(volume.values, expected[[1, 3, 0, 2]])
    assert (volume.metadata.unit, volume.metadata.is_patient) == ("HU", True)


@pytest.mark.parametrize(
    ("name", "keyword"),
    [("FrameContent", "TemporalPositionIndex"), ("MREcho", "EffectiveEchoTime")],
)
def test_of_frames_at_one_place_one_is_chosen(tmp_path, name, keyword):
    groups = [group(name, **{keyword: 1 + k // 2}) for k in (2, 0, 3, 1)]
    path = write_frames(tmp_path / "a.dcm", VALUES, [0, 0, 2, 2], groups)
    assert np.array_equal(load_silently(f"{path}?time=0").values, VALUES[[1, 3]])
    assert np.array_equal(load_silently(f"{path}?time=1").values, VALUES[[0, 2]])


def test_files_of_one_frame_each_lie_where_it_says(tmp_path):
    for k, values in enumerate(VALUES):
        write_frames(tmp_path / f"{9 - k}.dcm", values, [2 * k], SeriesInstanceUID="1.2")
    volume = load_silently(tmp_path)
    assert volume.spacing_mm == (*SPACING, 2) and np.array_equal(volume.values, VALUES)


@pytest.mark.parametrize(
    ("attributes", "example"), [({}, "=1,1,2"), ({"ImagerPixelSpacing": [0.7, 0.5]}, "=0.5,0.7,2")]
)
def test_pixels_of_unknown_size_are_remarked_on(tmp_path, attributes, example):
    write_places(tmp_path, 0, 2, SliceThickness=2, PixelSpacing=None, **attributes)
    with warns(example):
        volume = load_volume(tmp_path)
    assert volume.spacing_mm == (1, 1, 2) and volume.metadata.assumed == ("pixels 1 mm apart",)
    assert load_silently(f"{tmp_path}?spacing{example}").metadata.assumed == ()


@pytest.mark.parametrize(
    ("attributes", "unit"),
    [
        ({"RescaleIntercept": -1024, "RescaleSlope": 1}, "HU"),
        ({"RescaleIntercept": -1024, "RescaleSlope": 1, "RescaleType": "US"}, ""),
        ({"RescaleIntercept": -9, "RescaleSlope": 1, "ImageType": ["A", "B", "LOCALIZER"]}, ""),
        ({"RescaleIntercept": -9, "RescaleSlope": 1, "x0008_0060": "MR"}, ""),
        ({}, ""),
    ],
)
def test_only_a_rescaled_ct_is_in_hounsfield_units(tmp_path, attributes, unit):
    for k in range(2):
        write_slice(tmp_path / f"{k}.dcm", VALUES[k], **plane(k, k) | attributes)
    stated = load_silently(tmp_path).metadata
    assert stated.unit == unit and stated.modality == attributes.get("x0008_0060", "CT")


@pytest.mark.parametrize(
    ("kind", "frames", "remarks"),
    [
        # A slice without a frame is empty; of two segments the last is read.
        ("BINARY", [[1, 1, 0], [1, 0, 0], [0, 1, 0], [0, 0, 0]], ("1 voxels",)),
        ("FRACTIONAL", [[99, 50, 49], [50, 0, 0], [0, 50, 9], [0, 0, 0]], ("1 voxels", "half")),
        ("LABELMAP", [[1, 2, 0], [1, 0, 0], [0, 0, 0], [0, 0, 0]], ()),
    ],
)
def test_segments_are_labels(tmp_path, kind, frames, remarks):
    stored, places = np.array(frames, np.uint8)[:, None], [0, 4, 0, 6]
    more: dict[str, Any] = {"SegmentationType": kind, "MaximumFractionalValue": 100}
    if kind == "BINARY":
        more |= {"BitsAllocated": 1, "BitsStored": 1, "HighBit": 0}
        more["PixelData"] = np.packbits(stored, bitorder="little").tobytes()
    red = [35579, 53664, 50858]  # sRGB (1, 0, 0), as L*a*b* under D50
    liver = group("", SegmentNumber=1, SegmentLabel="liver", RecommendedDisplayCIELabValue=red)
    spleen = group("", SegmentNumber=2, SegmentLabel="spleen")
    more["SegmentSequence"] = [each["Sequence"][0] for each in (liver, spleen)]
    numbers = [group("SegmentIdentification", ReferencedSegmentNumber=n) for n in (1, 1, 2, 2)]
    if kind == "LABELMAP":
        numbers, places = [], [0, 4, 2, 6]
    reading = read_series(Query(write_frames(tmp_path / "a", stored, places, numbers, **more)))
    assert reading.values[:, 0].tolist() == [[1, 2, 0], [0, 0, 0], [1, 0, 0], [0, 0, 0]]
    assert reading.world_from_index[:3, 2].tolist() == [0, 0, 2]
    assert all(word in text for word, text in zip(remarks, reading.remarks, strict=True))
    assert (reading.labels[1].name, reading.labels[2]) == ("liver", Label("spleen"))
    assert reading.labels[1].colour == pytest.approx((1, 0, 0), abs=0.01)


def of_two_patients(folder: Path) -> None:
    for k, name in enumerate("AB"):
        write_slice(folder / f"{k}.dcm", VALUES[k], **plane(k, k), PatientID=name)


def unknown_compression(folder: Path) -> None:
    for k in range(2):
        made = header(VALUES[k], **plane(k, k))
        made.file_meta.TransferSyntaxUID = uid.MPEG2MPML
        made["PixelData"].is_undefined_length = True
        made.PixelData = b"\xfe\xff\x00\xe0\0\0\0\0\xfe\xff\xdd\xe0\0\0\0\0"
        made.save_as(folder / f"{k}.dcm", enforce_file_format=True)


def test_a_file_that_changes_while_it_is_read_is_refused(tmp_path):
    write_places(tmp_path, 0)
    (one,) = headers([tmp_path / "0.dcm"])
    os.utime(tmp_path / "0.dcm", (0, 0))
    with raises(VolumeError, "state"):
        read_values(one)


def test_descriptions_are_read_in_their_character_set(tmp_path):
    for series, name in ((3, "Schädel nüchtern"), (4, "Kontrast")):
        write_series(tmp_path, series=series, name=name)
    for path in tmp_path.iterdir():
        made = dcmread(path)
        made.SpecificCharacterSet = "ISO_IR 100"
        made.save_as(path)
    assert "'Schädel nüchtern'" in volume_choices(tmp_path)[0].names[0]


COLOURED = np.zeros((2, 4, 5, 3), np.uint8)
LONG = np.concatenate([VALUES, VALUES + 1])
REFUSED: list[tuple[Callable[[Path], object], str, str, str]] = [
    (lambda folder: None, "", "not-found", ""),
    (lambda folder: write_places(folder, 0), "", "shape", ""),
    (lambda folder: write_places(folder, 0, 1, values=COLOURED), "", "shape", ""),
    (lambda folder: write_places(folder, 1, 1), "", "duplicate", ""),
    (lambda folder: (folder / "a.dcm").write_bytes(b"hello" * 99), "", "damaged", "a.dcm"),
    (two_series, "", "missing", "?series=3"),
    (two_series, "?series=7", "unknown", "'Head 2.5'"),
    (lambda f: (f / "a.dcm").write_bytes(structures()), "/a.dcm", "not-found", "RTSTRUCT"),
    (with_strangers, "/a.dcm", "damaged", "a.dcm"),
    (lambda folder: write_class(folder, "map", PALETTE), "/map", "not-found", "Palette"),
    (lambda f: write_class(f, "DICOMDIR", CONTENTS), "/DICOMDIR", "not-found", "DICOMDIR"),
    (lambda folder: write_part(write_series(folder), "a.dcm", 200), "/a.dcm", "damaged", "a.dcm"),
    (lambda folder: write_part(write_series(folder), "73.dcm", -1), "", "missing", "73.dcm"),
    # A slice between others.
    (lambda folder: write_part(write_series(folder, LONG), "33.dcm", 200), "", "missing", "1 of 8"),
    (lambda f: write_part(write_places(f, 0), "a.dcm", 200, "0.dcm"), "", "shape", "1 of 2"),
    (lambda folder: localizer(write_series(folder)), "?series=9", "shape", "3 slices"),
    (lambda folder: localizer(write_places(folder, 0)), "", "shape", ""),
    (with_a_gap, "", "missing", ""),
    (of_two_times, "", "missing", "?time="),
    (lambda folder: (of_two_times(folder) / "5.dcm").unlink(), "", "duplicate", ""),
    (lambda folder: with_scouts(folder, 2), "", "conflict", ""),
    (write_film, "/film.dcm?time=1", "conflict", "time=1"),
    (lambda f: write_frames(f / "a", LONG, [0, 2, 4, 6, 20, 22, 24, 26]), "/a", "missing", ""),
    (
        lambda f: write_frames(f / "a", VALUES, [0, 2, 4, 6], [{}, {}, SAGITTAL, SAGITTAL]),
        *("/a", "conflict", "dcm2niix"),
    ),
    (of_two_patients, "", "conflict", "1.dcm"),
    (lambda f: write_places(f, 0, 0, ImageType=["", "", "MOSAIC"]), "", "unsupported", "dcm2niix"),
    (unknown_compression, "", "unsupported", "MPEG2"),
    (lambda folder: write_places(folder, 0, 1, Rows=30), "", "damaged", "0.dcm"),
    (write_series, "?slices=3", "unknown", "slices"),
    (write_series, "?spacing=1,2", "syntax", "1,2"),
    (write_series, "?spacing=1,1,-1", "range", "1,1,-1"),
    (write_series, "?spacing=1,1,1&spacing=2,2,2", "duplicate", "spacing"),
    (write_series, "?time=1", "conflict", "time=1"),
]


@pytest.mark.parametrize(("make", "name", "code", "word"), REFUSED)
def test_folders_that_are_no_volume_are_refused_in_one_line(
    tmp_path, capfd, make, name, code, word
):
    make(tmp_path)
    with raises(VolumeError, code) as caught:
        load_volume(f"{tmp_path}{name}")
    assert word in str(caught.value)
    if "?series=" in word or "?time=" in word:
        load_silently(advised_address(caught.value))
    assert capfd.readouterr().err == "", "a reader printed to stderr"


def test_series_of_a_folder_are_listed_by_number_and_description(tmp_path):
    write_series(tmp_path / "a")
    write_series(tmp_path / "b", series=7, name="Chest")
    (choice,) = volume_choices(tmp_path)
    assert choice.key == "series" and choice.values == ("3", "7")
    assert choice.names[1] == "CT 'Chest' (4 slices of 5x3)"
    for value in choice.values:
        assert load_volume(f"{tmp_path}?series={value}").shape_xyz
    assert volume_choices(tmp_path / "a") == ()


def test_a_dose_is_in_grays_and_its_frames_lie_at_their_offsets(tmp_path):
    stated = {"Modality": "RTDOSE", "DoseUnits": "GY", "DoseGridScaling": 0.001}
    stated |= {"ImagePositionPatient": [1, 2, 3], "ImageOrientationPatient": [1, 0, 0, 0, 1, 0]}
    stated |= {"GridFrameOffsetVector": [0, 4, 8, 12], "NumberOfFrames": 4}
    header(VALUES, **stated).save_as(tmp_path / "dose.dcm", enforce_file_format=True)
    volume = load_silently(tmp_path / "dose.dcm")
    assert volume.values == pytest.approx(VALUES * 0.001) and volume.metadata.unit == "Gy"
    assert volume.spacing_mm == (*SPACING, 4) and volume.world_from_index[:3, 3].tolist() == [
        1,
        2,
        3,
    ]
