"""Volumes from files: what is kept, and one clear line for what cannot be read."""

from __future__ import annotations

import struct
import warnings
from pathlib import Path

import numpy as np
import pytest

from volspec.errors import VolspecWarning, VolumeError
from volspec.volume import Volume, load_volume
from volspec.volume.summary import summarise

VALUES = np.arange(24, dtype=np.int16).reshape(2, 3, 4) * 100 - 700
# x runs along +y with 2 mm, y along −x with 1 mm, z along +z with 3 mm.
WORLD = np.array([[0, -1, 0, 5], [2, 0, 0, 6], [0, 0, 3, 7], [0, 0, 0, 1]], float)
NRRD = (
    "NRRD0004\ntype: short\ndimension: 3\nspace: left-posterior-superior\nsizes: 4 3 2\n"
    "space directions: (0,2,0) (-1,0,0) (0,0,3)\nspace origin: (5,6,7)\n"
    "kinds: domain domain domain\nendian: little\nencoding: raw\n\n"
)


def nifti(values: np.ndarray, ras_from_index: np.ndarray) -> bytes:
    """A NIfTI-1 file with an sform; its world is RAS, ITK's is LPS."""
    header = bytearray(352)
    struct.pack_into("<i", header, 0, 348)
    struct.pack_into("<8h", header, 40, 3, *values.shape[::-1], 1, 1, 1, 1)
    struct.pack_into("<2h", header, 70, 4, 16)
    struct.pack_into("<8f", header, 76, 1, 2, 1, 3, 1, 1, 1, 1)
    struct.pack_into("<2f", header, 108, 352, 1)
    struct.pack_into("<2h", header, 252, 0, 1)
    struct.pack_into("<12f", header, 280, *ras_from_index[:3].ravel())
    header[344:348] = b"n+1\0"
    return bytes(header) + values.tobytes()


@pytest.fixture
def files(tmp_path: Path) -> Path:
    """The same 4 x 3 x 2 volume in every format."""
    raw = VALUES.tobytes()
    (tmp_path / "v.nrrd").write_bytes(NRRD.encode() + raw)
    (tmp_path / "v.raw").write_bytes(raw)
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
    with pytest.warns(VolspecWarning, match="holds 48 bytes.*takes 24"):
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


def npy(dtype: str, length: str) -> bytes:
    """A header of ``numpy.save`` alone."""
    head = f"{{'descr': '{dtype}', 'fortran_order': True, 'shape': ({length}, 2, 6), }}\n"
    return b"\x93NUMPY\x01\x00" + len(head).to_bytes(2, "little") + head.encode()


BAD_FILES = {
    "missing.nrrd": (None, "no such file"),
    "empty.nrrd": (b"", "is empty"),
    "junk.nrrd": (b"hello" * 99, "cannot be read"),
    "junk.nii.gz": (b"hello" * 99, "cannot be read"),
    "junk.mhd": (b"hello" * 99, "line 1 of its header, .* is not written as Name = value"),
    "junk.vti": (b"hello" * 99, "not readable"),
    "junk.npy": (b"hello" * 99, "not a readable .npy"),
    "empty.npy": (npy("|S0", "5" * 40), r"values of type \|S0 are not real numbers"),
    "subarray.npy": (npy("<0f8", "2"), "values of type .* are not real numbers"),
    "notes.txt": (b"hello", "unknown format; known are NRRD"),
    "short.nrrd": (NRRD.encode() + VALUES.tobytes()[:30], "30 bytes .* asks for 48"),
    "flat.nrrd": (
        b"NRRD0004\ntype: short\ndimension: 2\nsizes: 4 6\nendian: little\nencoding: raw\n\n"
        + VALUES.tobytes(),
        "2-D",
    ),
    "zero.nrrd": (
        b"NRRD0004\ntype: short\ndimension: 3\nsizes: 4 3 2\nspacings: 1 0 1\n"
        b"endian: little\nencoding: raw\n\n" + VALUES.tobytes(),
        "spacing",
    ),
}


@pytest.mark.parametrize("name", BAD_FILES)
def test_unreadable_files_are_named_in_one_line(
    tmp_path: Path, capfd: pytest.CaptureFixture[str], name: str
) -> None:
    content, message = BAD_FILES[name]
    if content is not None:
        (tmp_path / name).write_bytes(content)
    with pytest.raises(VolumeError, match=message) as caught:
        load_volume(tmp_path / name)
    assert name in str(caught.value) and "\n" not in str(caught.value)
    assert capfd.readouterr().err == "", "a reader printed to stderr"


@pytest.mark.parametrize(
    ("query", "message"),
    [
        ("", "shape is missing"),
        ("?shape=4x3x2", "dtype is missing"),
        ("?shape=4x3&dtype=uint8", "not XxYxZ"),
        ("?shape=4x3x20&dtype=int16", "needs 480"),
        ("?shape=4x3x2&dtype=nonsense", "dtype=nonsense cannot be read"),
        ("?shape=axb&dtype=uint8", "shape=axb cannot be read"),
        ("?shape=4x3x2&dtype=int16&order=odd", "order=odd"),
        ("?shape=4x3x2&dtype=int16&spacing=1,-1,1", "must be positive"),
        ("?shape=4x3x2&dtype=int16&spacing=1,0,1", "must be positive"),
        ("?shape=4x3x2&colour=red", "unknown option 'colour'"),
    ],
)
def test_raw_layouts_that_do_not_fit_are_refused(files: Path, query: str, message: str) -> None:
    with pytest.raises(VolumeError, match=message):
        load_volume(f"{files}/v.raw{query}")


def test_constant_and_wrongly_shaped_arrays_are_refused(tmp_path: Path) -> None:
    np.save(tmp_path / "grey.npy", np.full((3, 3, 3), 5.0))
    with pytest.raises(VolumeError, match="every voxel is 5"):
        load_volume(tmp_path / "grey.npy")
    for values, message in [
        (np.zeros((3, 3)), "3-D"),
        (np.zeros((3, 3, 3, 2)), "3-D"),
        (np.zeros((0, 3, 3)), "two voxels"),
        (np.zeros((1, 3, 3)), "single slice"),
        (np.zeros((3, 3, 3), complex), "not real numbers"),
        (np.full((3, 3, 3), np.nan), "none of the 27 voxels is a finite"),
    ]:
        with pytest.raises(VolumeError, match=message):
            Volume(values)


@pytest.mark.parametrize("spacing", ["-1 1 1", "1 0 1", "1 1 nan"])
def test_spacings_that_are_not_positive_are_refused(files: Path, spacing: str) -> None:
    """ITK mirrors a negative axis and takes NaN for 1."""
    head = f"NRRD0004\ntype: short\ndimension: 3\nsizes: 4 3 2\nspacings: {spacing}\n"
    text = head + "endian: little\nencoding: raw\n\n"
    (files / "s.nrrd").write_bytes(text.encode() + VALUES.tobytes())
    mhd = (files / "v.mhd").read_text().replace("= 2 1 3", f"= {spacing}")
    (files / "s.mhd").write_text(mhd)
    for name in ("s.nrrd", "s.mhd"):
        with pytest.raises(VolumeError, match=f"spacing {spacing}; each of x, y, z"):
            load_volume(files / name)


def test_summary_counts_every_voxel() -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        summary = summarise(Volume(VALUES, world_from_index=WORLD))
    assert sum(count for _, _, count in summary.histogram) == 24
    assert summary.extent_mm == (6, 2, 3) and summary.range == (-700, 1600)
    assert summary.table().row_count > 8


def test_what_is_no_path_is_refused() -> None:
    with pytest.raises(VolumeError, match="volume: 3 is no path; give text"):
        load_volume(3)


def test_an_empty_name_is_not_the_folder_that_one_is_in() -> None:
    with pytest.raises(VolumeError, match="the name is empty; give a file or a folder"):
        load_volume("")


def test_a_question_mark_may_be_a_part_of_the_name(tmp_path: Path) -> None:
    path = tmp_path / "what?spacing=2.npy"
    np.save(path, VALUES)
    assert load_volume(path).values.shape == VALUES.shape
