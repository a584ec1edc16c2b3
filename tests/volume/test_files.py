"""Volumes from files: values and geometry, and one clear line for a file that cannot be read."""

from __future__ import annotations

import warnings
from pathlib import Path

import numpy as np
import pytest
import SimpleITK as sitk

from tests.support.errors import raises, warns
from tests.support.volumes import NRRD, RAW, VALUES, WORLD, nifti, write_nrrd
from volspec.errors import VolumeError
from volspec.volume import Volume, load_volume, phantom
from volspec.volume.summary import summarise


@pytest.fixture
def files(tmp_path: Path) -> Path:
    """One volume of 4 x 3 x 2 voxels in every format."""
    write_nrrd(tmp_path / "v.nrrd")
    (tmp_path / "v.raw").write_bytes(RAW)
    (tmp_path / "v.mhd").write_text(
        "ObjectType = Image\nNDims = 3\nDimSize = 4 3 2\nElementType = MET_SHORT\n"
        "ElementSpacing = 2 1 3\nTransformMatrix = 0 1 0 -1 0 0 0 0 1\nOffset = 5 6 7\n"
        "ElementDataFile = v.raw\n"
    )
    (tmp_path / "v.nii").write_bytes(nifti(VALUES, np.diag([-1.0, -1, 1, 1]) @ WORLD))
    Volume(VALUES, world_from_index=WORLD).to_pyvista().save(tmp_path / "v.vti")
    return tmp_path


@pytest.mark.parametrize("name", ["v.nrrd", "v.mhd", "v.nii", "v.vti"])
def test_values_spacing_and_orientation_are_kept(files: Path, name: str) -> None:
    volume = load_volume(files / name)
    assert volume.values.dtype == np.int16 and np.array_equal(volume.values, VALUES)
    assert np.allclose(volume.spacing_mm, (2, 1, 3))
    assert np.allclose(volume.world_from_index, WORLD)


def test_raw_bytes_are_read_as_the_name_says(files: Path) -> None:
    volume = load_volume(f"{files}/v.raw?shape=4x3x2&dtype=int16&spacing=2,1,3")
    assert np.array_equal(volume.values, VALUES) and volume.spacing_mm == (2, 1, 3)
    (files / "big.raw").write_bytes(b"head" + VALUES.astype(">i2").tobytes())
    big = load_volume(f"{files}/big.raw?shape=4x3x2&dtype=int16&order=big&offset=4")
    assert np.array_equal(big.values, VALUES) and big.values.dtype.isnative


def test_raw_files_longer_than_their_layout_are_warned_about(files: Path) -> None:
    with warns("48", "24"):
        load_volume(f"{files}/v.raw?shape=4x3x2&dtype=uint8")


def test_npy_is_read(tmp_path: Path) -> None:
    np.save(tmp_path / "v.npy", VALUES.astype(np.float64))
    volume = load_volume(tmp_path / "v.npy")
    assert volume.values.dtype == np.float32 and np.array_equal(volume.values, VALUES)


def test_pyvista_round_trip_keeps_cells_and_points() -> None:
    import pyvista

    volume = Volume(VALUES, world_from_index=WORLD)
    again = Volume.from_pyvista(volume.to_pyvista())
    assert np.allclose(again.world_from_index, WORLD) and np.array_equal(again.values, VALUES)
    grid = pyvista.ImageData(dimensions=(5, 4, 3), spacing=(2, 2, 2))
    grid.cell_data["density"] = VALUES.ravel()
    cells = Volume.from_pyvista(grid)
    assert cells.shape_xyz == (4, 3, 2) and np.allclose(cells.world_from_index[:3, 3], 1)


def npy(head: bytes) -> bytes:
    """A file of ``numpy.save`` without values."""
    return b"\x93NUMPY\x01\x00" + len(head).to_bytes(2, "little") + head


def array(dtype: str, shape: str, order: bool = False) -> bytes:
    return npy(f"{{'descr': '{dtype}', 'fortran_order': {order}, 'shape': ({shape}), }}\n".encode())


BAD_FILES = {
    "missing.nrrd": (None, "not-found"),
    "empty.nrrd": (b"", "damaged"),
    "junk.nrrd": (b"hello" * 99, "damaged"),
    "junk.nii.gz": (b"hello" * 99, "damaged"),
    "junk.mhd": (b"hello" * 99, "syntax"),
    "junk.vti": (b"hello" * 99, "damaged"),
    "junk.npy": (b"hello" * 99, "damaged"),
    "empty.npy": (array("|S0", "5" * 40 + ", 2, 6", order=True), "type"),
    "subarray.npy": (array("<0f8", "2, 2, 6", order=True), "type"),
    "endless.npy": (array("<f4", "99999999, 99999, 9"), "damaged"),
    "negative.npy": (array("<f4", "-4, 3, 2"), None),
    "objects.npy": (array("|O", "4, 3, 2"), "type"),
    "open.npy": (npy(b"{'descr': '<f4', 'fortran_order': False, 'shape': (((((((("), "damaged"),
    "deep.npy": (npy(b"{'descr': '" + b"(" * 900), "damaged"),
    "digits.npy": (npy(b"9" * 900), "damaged"),
    "bytes.npy": (npy(b"\xff\xfe\x00 'descr'"), "damaged"),
    "notes.txt": (b"hello", "unknown"),
    "short.nrrd": (NRRD.encode() + RAW[:30], "damaged"),
    "flat.nrrd": (
        b"NRRD0004\ntype: short\ndimension: 2\nsizes: 4 6\nendian: little\nencoding: raw\n\n" + RAW,
        "shape",
    ),
}


@pytest.mark.parametrize("name", BAD_FILES)
def test_unreadable_files_are_named_in_one_line(
    tmp_path: Path, capfd: pytest.CaptureFixture[str], name: str
) -> None:
    content, code = BAD_FILES[name]
    if content is not None:
        (tmp_path / name).write_bytes(content)
    with raises(VolumeError, code) as caught:
        load_volume(tmp_path / name)
    assert name in str(caught.value)
    assert capfd.readouterr().err == "", "a reader printed to stderr"


@pytest.mark.parametrize(
    ("query", "code"),
    [
        ("", "missing"),
        ("?shape=4x3x2", "missing"),
        ("?shape=4x3&dtype=uint8", "shape"),
        ("?shape=4x3x20&dtype=int16", "damaged"),
        ("?shape=4x3x2&dtype=nonsense", "syntax"),
        ("?shape=axb&dtype=uint8", "syntax"),
        ("?shape=4x3x2&dtype=int16&order=odd", "unknown"),
        ("?shape=4x3x2&dtype=int16&spacing=1,-1,1", "range"),
        ("?shape=4x3x2&dtype=int16&spacing=1,0,1", "range"),
        ("?shape=4x3x2&colour=red", "unknown"),
        ("?shape=4x3x2&dtype=uint99", "syntax"),
    ],
)
def test_raw_layouts_that_do_not_fit_are_refused(files: Path, query: str, code: str) -> None:
    with raises(VolumeError, code) as caught:
        load_volume(f"{files}/v.raw{query}")
    if "uint99" in query:
        assert "uint16" in caught.value.remedy
    if "shape=4x3&" in query or "-1" in query:
        assert "v.raw?" in caught.value.remedy


def test_constant_volumes_are_refused(tmp_path: Path) -> None:
    np.save(tmp_path / "grey.npy", np.full((3, 3, 3), 5.0))
    with raises(VolumeError, "range"):
        load_volume(tmp_path / "grey.npy")


@pytest.mark.parametrize("spacing", ["-1 1 1", "1 0 1", "1 1 nan"])
def test_spacings_that_are_not_positive_are_refused(files: Path, spacing: str) -> None:
    """ITK mirrors a negative axis and takes NaN for 1."""
    head = f"NRRD0004\ntype: short\ndimension: 3\nsizes: 4 3 2\nspacings: {spacing}\n"
    text = head + "endian: little\nencoding: raw\n\n"
    (files / "s.nrrd").write_bytes(text.encode() + RAW)
    mhd = (files / "v.mhd").read_text().replace("= 2 1 3", f"= {spacing}")
    (files / "s.mhd").write_text(mhd)
    for name in ("s.nrrd", "s.mhd"):
        with raises(VolumeError, "range"):
            load_volume(files / name)


def test_summary_counts_every_voxel() -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        summary = summarise(Volume(VALUES, world_from_index=WORLD))
    assert sum(count for _, _, count in summary.histogram) == 24
    assert summary.extent_mm == (6, 2, 3) and summary.range == (-700, 1600)
    assert summary.table().row_count > 8


@pytest.mark.parametrize(("path", "code"), [(3, "type"), ("", "missing")])
def test_what_is_no_path_is_refused(path: object, code: str) -> None:
    """An empty name is not the folder that one is in."""
    with raises(VolumeError, code):
        load_volume(path)


def test_a_question_mark_may_be_a_part_of_the_name(tmp_path: Path) -> None:
    path = tmp_path / "what?spacing=2.npy"
    np.save(path, VALUES)
    assert load_volume(path).values.shape == VALUES.shape


@pytest.mark.parametrize(
    ("name", "word"),
    [
        *[("v.stl", "mesh"), ("v.mgz", "mri_convert"), ("v.nc", "xarray"), ("v.czi", "OME-TIFF")],
        *[("v.png", "folder"), ("v.JPG", "folder"), ("v.zip", "unpack"), ("v.tar.gz", "unpack")],
    ],
)
def test_files_of_other_formats_get_advice(tmp_path: Path, name: str, word: str) -> None:
    (tmp_path / name).write_bytes(b"bytes")
    with raises(VolumeError, "unsupported") as caught:
        load_volume(tmp_path / name)
    assert word in str(caught.value)


def test_a_folder_of_volumes_lists_one(files: Path) -> None:
    with raises(VolumeError, "missing") as caught:
        load_volume(files)
    assert "4 volumes" in str(caught.value) and str(files / "v.mhd") in caught.value.remedy


@pytest.mark.parametrize(
    ("name", "near"), [("v.nrd", "'v.nrrd'"), ("brian.nrrd", "'brain.nii.gz'"), ("z.nrrd", "")]
)
def test_a_missing_file_s_near_name_is_given(files: Path, name: str, near: str) -> None:
    (files / "brain.nii.gz").write_bytes(b"")
    with raises(VolumeError, "not-found") as caught:
        load_volume(files / name)
    assert near in caught.value.remedy and ("did you mean" in caught.value.remedy) == bool(near)


def test_a_file_that_may_not_be_read_is_not_called_damaged(
    files: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Permissions are simulated: root may read everything."""
    monkeypatch.setattr("os.access", lambda path, mode: False)
    for path in (files, files / "v.nrrd"):
        with raises(VolumeError, "unreadable") as caught:
            load_volume(path)
        assert "chmod" in caught.value.remedy


@pytest.mark.parametrize(
    ("shape", "word"), [((5, 3, 3, 3), "a[0]"), ((5, 3), "stack"), ((), "stack")]
)
def test_an_npy_of_other_dimensions_gets_advice(
    tmp_path: Path, shape: tuple[int, ...], word: str
) -> None:
    np.save(tmp_path / "v.npy", np.ones(shape))
    for query in ("", "?time=0"):
        with raises(VolumeError, "shape") as caught:
            load_volume(f"{tmp_path}/v.npy{query}")
        assert word in caught.value.remedy


def test_values_that_are_all_nan_get_advice(tmp_path: Path) -> None:
    np.save(tmp_path / "v.npy", np.full((3, 3, 3), np.nan))
    with raises(VolumeError, "range") as caught:
        load_volume(tmp_path / "v.npy")
    assert caught.value.remedy


@pytest.mark.parametrize(
    ("option", "meant"), [("label=t.txt", "'labels'"), ("tme=0", "'time'"), ("dims=3", "labels")]
)
def test_an_unknown_option_s_near_one_is_given(files: Path, option: str, meant: str) -> None:
    with raises(VolumeError, "unknown") as caught:
        load_volume(f"{files}/v.nrrd?{option}")
    assert meant in caught.value.remedy and "spacing, labels" in caught.value.remedy


def test_a_summary_has_directions_as_letters_and_short_lengths_in_micrometres() -> None:
    assert summarise(Volume(VALUES, world_from_index=WORLD)).directions == "PRS"
    assert summarise(Volume(VALUES)).directions == ""
    fine = summarise(Volume(VALUES, spacing_mm=(0.0002, 0.0002, 0.001)))
    cells = [list(column.cells) for column in fine.table().columns]
    assert cells[1][cells[0].index("spacing")] == "0.2 × 0.2 × 1 µm"


@pytest.mark.parametrize("name", ["v.npy", "v.nrrd", "v.nii", "v.vti"])
def test_every_format_takes_a_spacing(tmp_path: Path, name: str) -> None:
    path, ball = tmp_path / name, phantom.ball(6)
    if name.endswith(".npy"):
        np.save(path, ball.values)
    elif name.endswith(".vti"):
        ball.to_pyvista().save(path)
    else:
        sitk.WriteImage(sitk.GetImageFromArray(ball.values), path)
    assert load_volume(f"{path}?spacing=1,1,2").spacing_mm == (1, 1, 2)
    with raises(VolumeError, "unknown"):
        load_volume(f"{path}?spacings=1,1,2")
