"""DICOM series: which slices are one volume, where they lie, and what is refused."""

import os
import struct
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from pydicom import Dataset, uid
from pydicom.data import get_testdata_file

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


def item(**attributes: Any) -> Dataset:
    """Return an item of a sequence."""
    made = Dataset()
    for keyword, value in attributes.items():
        setattr(made, keyword, value)
    return made


def group(name: str, **attributes: Any) -> dict[str, list[Dataset]]:
    """Return a sequence of one item, a functional group for instance."""
    return {f"{name}Sequence": [item(**attributes)]}


def write_slice(
    path: Path, values: np.ndarray, pixels: str = "PixelData", **attributes: Any
) -> None:
    """Write one DICOM file, with attributes by their keywords; None empties one."""
    made = item(file_meta=Dataset())
    made.file_meta.TransferSyntaxUID = attributes.pop("syntax", uid.ExplicitVRLittleEndian)
    made.SOPClassUID, made.SOPInstanceUID = uid.CTImageStorage, uid.generate_uid()
    made.Rows, made.Columns = values.shape[-2:]
    made.BitsAllocated = made.BitsStored = 8 * values.itemsize
    made.HighBit = made.BitsStored - 1
    made.PixelRepresentation = int(values.dtype.kind == "i")
    made.SamplesPerPixel, made.PhotometricInterpretation = 1, "MONOCHROME2"
    made.PixelSpacing = list(SPACING[::-1])
    setattr(made, pixels, values.tobytes() + b"\0" * (values.nbytes % 2))
    for name, value in attributes.items():
        setattr(made, name, value)
    made[pixels].is_undefined_length = made.file_meta.TransferSyntaxUID.is_encapsulated
    made.save_as(path, enforce_file_format=True)


def plane(z: float, number: int, series: int = 3) -> dict[str, Any]:
    """Tags of an axial slice's position: the patient's x and y along its rows and columns."""
    return {
        "Modality": "CT",
        "SeriesDescription": "Head",
        "SeriesInstanceUID": f"1.2.{series}",
        "SeriesNumber": series,
        "InstanceNumber": number,
        "ImagePositionPatient": [-10, -20, z],
        "ImageOrientationPatient": [1, 0, 0, 0, 1, 0],
    }


TURNED = {"ImageOrientationPatient": [0, 1, 0, 0, 0, -1]}


def write_series(folder: Path, values: Any = VALUES, series: int = 3, **tags: Any) -> Path:
    """Write a series with files, numbers and positions in three different orders."""
    folder.mkdir(parents=True, exist_ok=True)
    for k, slice_ in enumerate(values):
        stated = plane(k * STEP, len(values) - k, series) | tags
        write_slice(folder / f"{k * 7 % 11}{series}.dcm", slice_, **stated)
    return folder


def write_places(
    folder: Path, *places: float, values: Any = VALUES, each: Any = ({},) * 8, **tags: Any
) -> Path:
    """Write slices at places along z, with ``tags`` and those that ``each`` has."""
    for k, (z, slice_, own) in enumerate(zip(places, values, each, strict=False)):
        write_slice(folder / f"{k}.dcm", slice_, **plane(z, k) | tags | own)
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
    places = [{"ImagePositionPatient": [-k * STEP, 1, 2]} for k in range(4)]
    volume = load_silently(write_places(tmp_path, *range(4), each=places, **TURNED))
    expected = [[0, 0, -STEP, 0], [SPACING[0], 0, 0, 1], [0, -SPACING[1], 0, 2], [0, 0, 0, 1]]
    assert np.allclose(volume.world_from_index, expected) and np.array_equal(volume.values, VALUES)


def test_a_tilted_gantry_s_slices_stay_where_they_were_taken(tmp_path):
    """A reader that gives all stacks right angles puts the last slice 3 mm too far up."""
    places = [{"ImagePositionPatient": [-10, k - 20, k * STEP]} for k in range(4)]
    volume = load_silently(write_places(tmp_path, *range(4), each=places))
    assert volume.corners_mm[4].tolist() == [-10, -17, 3 * STEP]
    assert np.array_equal(volume.values, VALUES)


def test_rescale_slope_and_intercept_are_applied_slice_by_slice(tmp_path):
    """PET has one each."""
    rescales = ((1, 0), (2, -7), (0.5, -7), (0.5, -7))
    each = [{"RescaleSlope": a, "RescaleIntercept": b} for a, b in rescales]
    write_places(tmp_path, *range(4), each=each, Modality="PT", Units="BQML")
    volume = load_silently(tmp_path)
    expected = [values * a + b for values, (a, b) in zip(VALUES, rescales, strict=True)]
    assert volume.values.dtype == np.float32 and np.array_equal(volume.values, expected)
    assert volume.metadata.unit == "Bq/ml"


# Of 400 stored values from -90 on.
LUT_DATA = (np.arange(9, 409) * 3).astype("<u2").tobytes()
LUT = group("ModalityLUT", LUTDescriptor=[400, -90, 16], ModalityLUTType="HU", LUTData=LUT_DATA)


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
        (VALUES, {"syntax": uid.ImplicitVRLittleEndian}, VALUES),
        (VALUES, {"syntax": uid.DeflatedExplicitVRLittleEndian}, VALUES),
        (VALUES - 99, LUT | {"syntax": uid.ImplicitVRLittleEndian}, np.clip(VALUES, 9, 408) * 3),
        (VALUES - 99, LUT | {"syntax": uid.ExplicitVRLittleEndian}, np.clip(VALUES, 9, 408) * 3),
        (VALUES.astype(np.float32), {"pixels": "FloatPixelData"}, VALUES),
        (VALUES.astype(np.float64), {"pixels": "DoubleFloatPixelData"}, VALUES),
    ],
)
def test_stored_values_are_read_as_they_are(tmp_path, stored, attributes, expected):
    """Nothing is inverted; bits beyond the stored ones, as of overlays, are no part of a value."""
    write_places(tmp_path, 0, 1, 2, 3, values=stored, **attributes)
    assert np.array_equal(load_silently(tmp_path).values, expected)


def two_series(folder: Path) -> None:
    write_series(folder, series=3, SeriesDescription="Head 2.5")
    write_series(folder, VALUES[:3] + 1, series=12, SeriesDescription="Soft")


def test_of_several_series_one_is_chosen(tmp_path):
    two_series(tmp_path)
    for name in ("?series=12", "?series=1.2.12", "/012.dcm"):
        assert np.array_equal(load_silently(f"{tmp_path}{name}").values, VALUES[:3] + 1)


def bare(*elements: tuple[int, bytes]) -> bytes:
    """Elements of group 8 without a preamble, of implicit types, as old programs write them."""
    return b"".join(struct.pack("<2HI", 8, tag, len(text)) + text for tag, text in elements)


# Without its class.
STRUCTURES = bare((0x60, b"RTSTRUCT"), (0x70, b"volspec ")) * 20


def with_strangers(folder: Path) -> None:
    write_series(folder)
    for name in ("a.dcm", "b.dcm"):
        (folder / name).write_bytes(b"hello" * 99)


def with_scouts(folder: Path, count: int = 1) -> None:
    """Write a series and sagittal slices."""
    write_series(folder)
    for k in range(count):
        write_slice(folder / f"scout{k}.dcm", VALUES[0], **plane(k, 9) | TURNED)


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


def begin(uid: bytes) -> bytes:
    """Return the begin of a DICOM file of a class."""
    return bytes(128) + b"DICM" + b"\2\0\2\0UI" + len(uid).to_bytes(2, "little") + uid


PALETTE, CONTENTS = begin(b"1.2.840.10008.5.1.4.39.1"), begin(b"1.2.840.10008.1.3.10")
OTHERS = {
    "notes.txt": b"by hand",
    ".hidden.dcm": b"of the system",
    "../viewer.exe": b"as on a CD",
    "../DICOMDIR": CONTENTS,
    # Objects without pixels.
    "rt.dcm": STRUCTURES,
    "SR1": begin(b"1.2.840.10008.5.1.4.1.1.88.11\0"),
    "structures.dcm": bare((5, b"ISO_IR 100"), (0x16, b"1.2.840.10008.5.1.4.1.1.481.3\0")),
    "copy of 03.dcm": None,
}


@pytest.mark.parametrize("name", OTHERS)
def test_files_of_other_kinds_are_left_out(tmp_path, name):
    """A folder without slices is those below it."""
    folder = write_series(tmp_path / "patient" / "series")
    (folder / name).write_bytes(OTHERS[name] or (folder / "03.dcm").read_bytes())
    for path in (tmp_path, folder, folder / "03.dcm", f"{folder}?series=3"):
        assert np.array_equal(load_silently(path).values, VALUES)


def localizer(folder: Path) -> None:
    """Slices of one series that cross each other."""
    for k, turn in enumerate(([1, 0, 0, 0, 1, 0], [0, 1, 0, 0, 0, -1], [1, 0, 0, 0, 0, -1])):
        tags = plane(0, k, 9) | {"ImageOrientationPatient": turn}
        write_slice(folder / f"l{k}.dcm", VALUES[k], **tags)


def test_series_that_do_not_stack_are_not_offered(tmp_path):
    localizer(write_series(tmp_path))
    assert volume_choices(tmp_path) == ()
    with warns("2 series", "'Head'"):
        assert np.array_equal(load_volume(tmp_path).values, VALUES)
    write_series(tmp_path, series=4)
    assert volume_choices(tmp_path)[0].values == ("3", "4")


def with_a_gap(folder: Path) -> None:
    write_series(folder, LONG)
    (folder / "103.dcm").unlink()


def test_missing_slices_do_not_matter_if_a_spacing_is_given(tmp_path):
    with_a_gap(tmp_path)
    taken = load_silently(f"{tmp_path}?spacing=1,1,2")
    assert taken.spacing_mm == (1, 1, 2) and taken.shape_xyz == (5, 3, 7)


def test_slices_off_their_places_are_warned_about(tmp_path):
    write_places(tmp_path, 0, 2.5, 5.4, 7.5)
    with warns("0.4", "2.5", file=__file__):
        assert load_volume(tmp_path).spacing_mm[2] == 2.5


def test_slices_of_several_stacks_are_refused_unless_a_spacing_is_given(tmp_path):
    """Every other slice lies 9 mm to the side."""
    path = write_frames(tmp_path / "a.dcm", VALUES, [[9 * (k % 2), 0, k] for k in range(4)])
    with raises(VolumeError, "conflict"):
        load_volume(path)
    assert load_silently(f"{path}?spacing=1,1,2").spacing_mm == pytest.approx((1, 1, 2))


def test_a_single_slice_is_as_deep_as_it_is_thick(tmp_path):
    volume = load_silently(write_places(tmp_path, 7.0, SliceThickness=3))
    assert [np.array_equal(each, VALUES[0]) for each in volume.values] == [True, True]
    assert volume.spacing_mm == (*SPACING, 3) and volume.world_from_index[2, 3] == 5.5


@pytest.mark.parametrize(
    ("tags", "word"),
    [
        ({"ImageOrientationPatient": [1, 0, 0, 1, 0, 0]}, "axial"),
        ({"PatientID": "A", "PatientName": "Kim"}, "0.dcm and 2.dcm"),
    ],
)
def test_odd_tags_are_remarked_on(tmp_path, tags, word):
    """One of the two names is written in two ways."""
    names = [{}, tags, {"PatientName": "kim^^"} if "PatientName" in tags else {}]
    write_places(tmp_path, 0, 1, 2, each=names, **tags | {"PatientName": "Lee"})
    with warns(word):
        assert np.array_equal(load_volume(tmp_path).values, VALUES[:3])


def of_two_times(folder: Path) -> Path:
    values = np.stack([VALUES, VALUES + 1], axis=1).reshape(8, *VALUES.shape[1:])
    return write_places(folder, *(0, 0, 1, 1, 2, 2, 3, 3), values=values)


def test_of_several_times_at_every_place_one_is_chosen(tmp_path):
    of_two_times(tmp_path)
    assert np.array_equal(load_silently(f"{tmp_path}?time=1").values, VALUES + 1)
    assert np.array_equal([step.values for step in load_series(tmp_path)], [VALUES, VALUES + 1])


def test_slices_without_places_follow_their_numbers(tmp_path):
    for k, values in enumerate(VALUES):
        tags = plane(0, k) | {"SpacingBetweenSlices": 4}
        del tags["ImagePositionPatient"]
        write_slice(tmp_path / f"{9 - k}.dcm", values, **tags)
    with warns("4", "?spacing="):
        volume = load_volume(tmp_path)
    assert np.array_equal(volume.values, VALUES) and volume.spacing_mm == (*SPACING, 4)
    assert volume.metadata.assumed == ("slices 4 mm apart",) and not volume.metadata.is_patient
    assert load_volume(f"{tmp_path}?spacing=1,1,4").metadata.assumed == ()


def write_film(folder: Path) -> None:
    write_slice(folder / "film.dcm", (VALUES // 2).astype(np.uint8), NumberOfFrames=4)


def test_a_file_of_many_frames_is_a_volume(tmp_path):
    write_film(tmp_path)
    with warns("4", "?spacing="):
        assert np.array_equal(load_volume(tmp_path).values, VALUES // 2)
    assert load_volume(f"{tmp_path}/film.dcm?spacing=1,1,4").spacing_mm == (1, 1, 4)


SAGITTAL = group("PlaneOrientation", **TURNED)


def write_frames(
    path: Path, values: np.ndarray, places: list[Any], groups: Any = (), **more: Any
) -> Path:
    """Write a file of many frames at places in the patient, or along z; ``groups`` are others."""
    own = groups or [{}] * len(places)
    places = [[0, 0, each] if isinstance(each, int) else each for each in places]
    frames = [
        item(**group("PlanePosition", ImagePositionPatient=place), **each)
        for place, each in zip(places, own, strict=True)
    ]
    shared = group("PlaneOrientation", ImageOrientationPatient=[1, 0, 0, 0, 1, 0])
    shared |= group("PixelMeasures", PixelSpacing=list(SPACING[::-1]), SliceThickness=1)
    many = {"NumberOfFrames": len(places), "PixelSpacing": None, "Modality": "CT"}
    many |= group("SharedFunctionalGroups", **shared)
    many["PerFrameFunctionalGroupsSequence"] = frames
    write_slice(path, values, **many, **more)
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
    [
        ("FrameContent", "TemporalPositionIndex"),
        ("MREcho", "EffectiveEchoTime"),
        ("TemporalPosition", "TemporalPositionTimeOffset"),
        ("CardiacSynchronization", "NominalCardiacTriggerDelayTime"),
        ("CardiacSynchronization", "NominalPercentageOfCardiacPhase"),
    ],
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
        ({"RescaleIntercept": -9, "RescaleSlope": 1, "Modality": "MR"}, ""),
        ({}, ""),
    ],
)
def test_only_a_rescaled_ct_is_in_hounsfield_units(tmp_path, attributes, unit):
    stated = load_silently(write_places(tmp_path, 0, 1, **attributes)).metadata
    assert stated.unit == unit and stated.modality == attributes.get("Modality", "CT")


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
    liver = item(SegmentNumber=1, SegmentLabel="liver", RecommendedDisplayCIELabValue=red)
    more["SegmentSequence"] = [liver, item(SegmentNumber=2, SegmentLabel="spleen")]
    numbers = [group("SegmentIdentification", ReferencedSegmentNumber=n) for n in (1, 1, 2, 2)]
    if kind == "LABELMAP":
        numbers, places = [], [0, 4, 2, 6]
    reading = read_series(Query(write_frames(tmp_path / "a", stored, places, numbers, **more)))
    assert reading.values[:, 0].tolist() == [[1, 2, 0], [0, 0, 0], [1, 0, 0], [0, 0, 0]]
    assert reading.world_from_index[:3, 2].tolist() == [0, 0, 2]
    assert all(word in text for word, text in zip(remarks, reading.notes, strict=True))
    assert (reading.labels[1].name, reading.labels[2]) == ("liver", Label("spleen"))
    assert reading.labels[1].colour == pytest.approx((1, 0, 0), abs=0.01)


def of_two_patients(folder: Path, keyword: str = "PatientID") -> None:
    write_places(folder, 0, 1, each=[{keyword: "A"}, {keyword: "B"}])


def test_a_file_that_changes_while_it_is_read_is_refused(tmp_path):
    write_places(tmp_path, 0)
    (one,) = headers([tmp_path / "0.dcm"])
    os.utime(tmp_path / "0.dcm", (0, 0))
    with raises(VolumeError, "state"):
        read_values(one)


def test_descriptions_are_read_in_their_character_set(tmp_path):
    for series, name in ((3, "Schädel nüchtern"), (4, "Kontrast")):
        tags = {"SpecificCharacterSet": "ISO_IR 100", "SeriesDescription": name}
        write_series(tmp_path, series=series, **tags)
    assert "'Schädel nüchtern'" in volume_choices(tmp_path)[0].names[0]


COLOURED = np.zeros((2, 3, 4, 5), np.uint8)
RGB = {"SamplesPerPixel": 3, "PhotometricInterpretation": "RGB", "PlanarConfiguration": 1}
MPEG = {"syntax": uid.MPEG2MPML, "PixelData": b"\xfe\xff\x00\xe0\0\0\0\0\xfe\xff\xdd\xe0\0\0\0\0"}
LONG = np.concatenate([VALUES, VALUES + 1])
REFUSED: list[tuple[Callable[[Path], object], str, str, str]] = [
    (lambda folder: None, "", "not-found", ""),
    (lambda folder: write_places(folder, 0, 1, values=COLOURED, **RGB), "", "shape", ""),
    (lambda folder: write_places(folder, 1, 1), "", "duplicate", ""),
    (lambda folder: (folder / "a.dcm").write_bytes(b"hello" * 99), "", "damaged", "a.dcm"),
    (two_series, "", "missing", "?series=3"),
    (two_series, "?series=7", "unknown", "'Head 2.5'"),
    (lambda f: (f / "a.dcm").write_bytes(STRUCTURES), "/a.dcm", "not-found", "RTSTRUCT"),
    (with_strangers, "/a.dcm", "damaged", "a.dcm"),
    (lambda f: (f / "map").write_bytes(PALETTE), "/map", "not-found", "Palette"),
    (lambda f: (f / "DICOMDIR").write_bytes(CONTENTS), "/DICOMDIR", "not-found", "DICOMDIR"),
    (lambda folder: write_part(write_series(folder), "a.dcm", 200), "/a.dcm", "damaged", "a.dcm"),
    (lambda folder: write_part(write_series(folder), "73.dcm", -1), "", "missing", "73.dcm"),
    # A slice between others.
    (lambda folder: write_part(write_series(folder, LONG), "33.dcm", 200), "", "missing", "1 of 8"),
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
    (lambda folder: of_two_patients(folder, "PatientName"), "", "conflict", "1.dcm"),
    (lambda f: write_places(f, 0, 0, ImageType=["", "", "MOSAIC"]), "", "unsupported", "dcm2niix"),
    (lambda folder: write_places(folder, 0, 1, **MPEG), "", "unsupported", "MPEG2"),
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
    write_series(tmp_path / "b", series=7, SeriesDescription="Chest")
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
    write_slice(tmp_path / "dose.dcm", VALUES, **stated)
    volume = load_silently(tmp_path / "dose.dcm")
    assert volume.values == pytest.approx(VALUES * 0.001) and volume.metadata.unit == "Gy"
    assert volume.spacing_mm == (*SPACING, 4)
    assert volume.world_from_index[:3, 3].tolist() == [1, 2, 3]
