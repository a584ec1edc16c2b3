"""DICOM series: which slices are one volume, where they lie, and what is refused."""

import locale
import re
import struct
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import SimpleITK as sitk

from tests.support.errors import advised_address, raises, warns
from tests.support.volumes import load_silently
from volspec.errors import VolspecWarning, VolumeError
from volspec.volume import load_series, load_volume, volume_choices

VALUES = (np.arange(4 * 3 * 5, dtype=np.int16).reshape(4, 3, 5) * 7).astype(np.int16)
SPACING = (0.5, 0.75)
STEP = 2.5


@pytest.fixture(autouse=True)
def _characters_stay() -> Iterator[None]:
    """GDCM writes in the C locale and stays there: what Python opens next would be ASCII."""
    before = locale.setlocale(locale.LC_CTYPE)
    yield
    locale.setlocale(locale.LC_CTYPE, before)


def write_slice(path: Path, values: np.ndarray, **tags: str) -> None:
    """One DICOM file; tags by their number, as ``x0020_0013="4"``."""
    image = sitk.GetImageFromArray(values, isVector=values.ndim == 3)
    image.SetSpacing(SPACING)
    for tag, text in tags.items():
        image.SetMetaData(tag[1:].replace("_", "|"), text)
    writer = sitk.ImageFileWriter()
    writer.SetImageIO("GDCMImageIO")
    writer.KeepOriginalImageUIDOn()
    writer.SetUseCompression("compressed" in tags)
    writer.SetFileName(str(path))
    writer.Execute(image)


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


def test_reading_leaves_the_locale_alone(tmp_path):
    write_series(tmp_path)
    locale.setlocale(locale.LC_CTYPE, "C.UTF-8")
    load_volume(tmp_path)
    assert locale.setlocale(locale.LC_CTYPE) == "C.UTF-8"


@pytest.mark.parametrize("header", [True, False])
def test_slices_are_known_by_their_first_bytes(tmp_path, header):
    for file in write_series(tmp_path).iterdir():
        whole = file.read_bytes()
        end = 144 + int.from_bytes(whole[140:144], "little")  # of the header, group 0002
        file.with_name(f"IM{file.stem}").write_bytes(whole if header else whole[end:])
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
    """PET has one each. They are changed in the file: ITK's writer would divide by them."""
    for k, values in enumerate(VALUES):
        path = tmp_path / f"{k}.dcm"
        write_slice(path, values, **plane(k, k), x0028_1052="0", x0028_1053="1")
        if k:
            intercept, slope = b"\x28\0\x52\x10\2\0\0\0", b"\x28\0\x53\x10\2\0\0\0"
            data = path.read_bytes().replace(intercept + b"0 ", intercept + b"-7")
            path.write_bytes(data.replace(slope + b"1 ", slope + (b".5" if k > 1 else b"2 ")))
    values = load_silently(tmp_path).values
    assert values.dtype == np.float32 and np.array_equal(values[0], VALUES[0])
    assert np.array_equal(values[1], VALUES[1] * 2 - 7)
    assert np.array_equal(values[2:], VALUES[2:] * 0.5 - 7)


def test_compressed_slices_are_read(tmp_path):
    values = np.indices((3, 32, 64), np.int16)[::2].sum(axis=0, dtype=np.int16)
    write_places(tmp_path, 0, 1, 2, values=values, compressed="")
    assert (tmp_path / "0.dcm").stat().st_size < values[0].nbytes
    assert np.array_equal(load_silently(tmp_path).values, values)


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
        path = tmp_path / f"{9 - k}.dcm"
        write_slice(path, values, **plane(0, k), x0018_0088="4")
        # ITK's writer always writes a place, under another tag it is none; and its own distance.
        data = path.read_bytes().replace(b"\x20\0\x32\0", b"\x20\0\x33\0")
        path.write_bytes(re.sub(rb"(\x18\0\x88\0\x02\0\0\0)..", rb"\g<1>4 ", data))
    with warns("4", "?spacing="):
        volume = load_volume(tmp_path)
    assert np.array_equal(volume.values, VALUES) and volume.spacing_mm == (*SPACING, 4)


def write_film(folder: Path) -> None:
    image = sitk.GetImageFromArray((VALUES // 2).astype(np.uint8))
    image.SetSpacing((1, 2, 3))
    sitk.WriteImage(image, str(folder / "film.dcm"))


def test_a_file_of_many_frames_is_a_volume(tmp_path):
    write_film(tmp_path)
    with warns("4", "?spacing="):
        assert np.array_equal(load_volume(tmp_path).values, VALUES // 2)
    assert load_volume(f"{tmp_path}/film.dcm?spacing=1,1,4").spacing_mm == (1, 1, 4)


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
    (lambda folder: write_class(folder, "map", PALETTE), "/map", "not-found", "palette"),
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


def element(group: int, number: int, kind: str, value: bytes | str | int) -> bytes:
    """One element of a DICOM data set, explicit and little-endian."""
    if isinstance(value, int):
        value = value.to_bytes(2, "little")
    data = value.encode() if isinstance(value, str) else value
    data += (b"\0" if kind == "UI" else b" ") * (len(data) % 2)
    size = len(data).to_bytes(2, "little")
    if kind == "OW":
        size = b"\0\0" + len(data).to_bytes(4, "little")
    return struct.pack("<HH", group, number) + kind.encode() + size + data


def test_a_dose_is_in_grays_and_its_frames_lie_at_their_offsets(tmp_path):
    """ITK's writer knows no doses."""
    frames, rows, columns = VALUES.shape
    elements = (
        element(2, 2, "UI", "1.2.840.10008.5.1.4.1.1.481.2"),
        *(element(2, 3, "UI", "1.2.3"), element(2, 16, "UI", "1.2.840.10008.1.2.1")),
        element(8, 0x16, "UI", "1.2.840.10008.5.1.4.1.1.481.2"),
        *(element(8, 0x18, "UI", "1.2.3"), element(8, 0x60, "CS", "RTDOSE")),
        *(element(0x20, 0xD, "UI", "1.2"), element(0x20, 0xE, "UI", "1.2.9")),
        element(0x20, 0x32, "DS", "0\\0\\0"),
        element(0x20, 0x37, "DS", "1\\0\\0\\0\\1\\0"),
        *(element(0x28, 2, "US", 1), element(0x28, 4, "CS", "MONOCHROME2")),
        element(0x28, 8, "IS", str(frames)),
        *(element(0x28, 0x10, "US", rows), element(0x28, 0x11, "US", columns)),
        element(0x28, 0x30, "DS", "2\\2"),
        *(element(0x28, 0x100, "US", 16), element(0x28, 0x101, "US", 16)),
        *(element(0x28, 0x102, "US", 15), element(0x28, 0x103, "US", 0)),
        element(0x3004, 0xC, "DS", "0\\4\\8\\12"),
        element(0x3004, 0xE, "DS", "0.001"),
        element(0x7FE0, 0x10, "OW", VALUES.astype("<u2").tobytes()),
    )
    (tmp_path / "dose.dcm").write_bytes(b"\0" * 128 + b"DICM" + b"".join(elements))
    with pytest.warns(VolspecWarning):
        volume = load_volume(tmp_path / "dose.dcm")
    assert volume.values == pytest.approx(VALUES * 0.001) and volume.spacing_mm == (2, 2, 4)
