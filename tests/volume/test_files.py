"""Volumes from files: values and geometry, and one clear line for a file that cannot be read."""

import gzip
import io
from collections.abc import Callable
from pathlib import Path

import h5py
import mrcfile
import numpy as np
import PIL.Image
import pytest
import pyvista
import SimpleITK as sitk
import tifffile
import zarr

from tests.support.errors import raises, warns
from tests.support.volumes import META, NRRD, RAW, VALUES, WORLD, load_silently, nifti, write_nrrd
from volspec.errors import VolumeError
from volspec.volume import Metadata, Volume, load_volume
from volspec.volume.files.query import Query, Stored
from volspec.volume.load import read_here
from volspec.volume.metadata import ONE_SLICE
from volspec.volume.summary import summarise


@pytest.fixture
def files(tmp_path: Path) -> Path:
    """One volume of 4 x 3 x 2 voxels in every format."""
    write_nrrd(tmp_path / "v.nrrd")
    (tmp_path / "v.raw").write_bytes(RAW)
    (tmp_path / "v.mhd").write_text(
        f"{META}ElementSpacing = 2 1 3\nTransformMatrix = 0 1 0 -1 0 0 0 0 1\nOffset = 5 6 7\n"
        "ElementDataFile = v.raw\n"
    )
    (tmp_path / "v.nii").write_bytes(nifti(VALUES, np.diag([-1.0, -1, 1, 1]) @ WORLD))
    Volume(VALUES, world_from_index=WORLD).to_pyvista().save(tmp_path / "v.vti")
    (tmp_path / "brain.nii.gz").write_bytes(b"")
    return tmp_path


@pytest.mark.parametrize("name", ["v.nrrd", "v.mhd", "v.nii", "v.vti"])
def test_values_spacing_and_orientation_are_kept(files, name):
    volume = load_volume(files / name)
    assert volume.values.dtype == np.int16 and np.array_equal(volume.values, VALUES)
    assert np.allclose(volume.spacing_mm, (2, 1, 3)) and np.allclose(volume.world_from_index, WORLD)
    assert load_volume(f"{files / name}?spacing=1,1,2").spacing_mm == (1, 1, 2)


ONE, FEW = VALUES[0], VALUES[:1]


def by_itk(values: np.ndarray) -> Callable[[Path], None]:
    """A writer of voxels of 2 × 1 (× 3) mm."""
    image = sitk.GetImageFromArray(values)
    image.SetSpacing([2.0, 1.0, 3.0][: values.ndim])
    return lambda path: sitk.WriteImage(image, str(path))


# Files of one slice, and the depth of their voxels; that of a picture is a pixel's shorter side.
SLICES: dict[str, tuple[Callable[[Path], object], float]] = {
    "v.npy": (lambda path: np.save(path, ONE), 1),
    "deep.npy": (lambda path: np.save(path, FEW), 1),
    "v.npz": (lambda path: np.savez(path, one=ONE), 1),
    "v.raw?shape=4x3&dtype=int16": (ONE.tofile, 1),
    "v.png": (lambda path: PIL.Image.fromarray(ONE.astype(np.uint16)).save(path), 1),
    "v.tif": (lambda path: tifffile.imwrite(path, ONE), 1),
    **{f"v.{kind}": (by_itk(ONE), 1) for kind in ("nrrd", "mha", "nii")},
    **{f"deep.{kind}": (by_itk(FEW), 3) for kind in ("nrrd", "mha", "nii.gz", "vtk")},
    "v.h5": (lambda path: h5py.File(path, "w").create_dataset("v", data=ONE).file.close(), 1),
    "v.mrc": (lambda path: mrcfile.write(path, ONE, voxel_size=1e7), 1),
    "v.zarr": (lambda path: zarr.save(str(path), ONE), 1),
}


@pytest.mark.filterwarnings("ignore")
@pytest.mark.parametrize("name", SLICES)
def test_a_file_of_one_slice_is_a_volume_of_two_alike(name, tmp_path):
    write, depth_mm = SLICES[name]
    write(tmp_path / name.partition("?")[0])
    volume = load_volume(tmp_path / name)
    assert all(np.array_equal(each, ONE.astype(each.dtype)) for each in volume.values)
    front, back = volume.world_from_index[2, 3] + np.array([0, volume.world_from_index[2, 2]])
    assert (volume.values.shape[0], back, -front) == pytest.approx((2, depth_mm / 2, depth_mm / 2))
    assert ONE_SLICE in volume.metadata.assumed
    again = load_volume(f"{tmp_path}/{name}{'&' if '?' in name else '?'}spacing=1,1,5")
    assert again.spacing_mm == (1, 1, 5) and again.world_from_index[2, 3] == -2.5
    assert again.metadata.assumed == (ONE_SLICE,)


def test_raw_bytes_are_read_as_the_name_says(files):
    volume = load_volume(f"{files}/v.raw?shape=4x3x2&dtype=int16&spacing=2,1,3")
    assert np.array_equal(volume.values, VALUES) and volume.spacing_mm == (2, 1, 3)
    (files / "big.raw").write_bytes(b"head" + VALUES.astype(">i2").tobytes())
    big = load_volume(f"{files}/big.raw?shape=4x3x2&dtype=int16&order=big&offset=4")
    assert np.array_equal(big.values, VALUES) and big.values.dtype.isnative


def test_raw_files_longer_than_their_layout_are_warned_about(files):
    with warns("48", "24"):
        load_volume(f"{files}/v.raw?shape=4x3x2&dtype=uint8")


def test_npy_is_read(tmp_path):
    np.save(tmp_path / "v.npy", VALUES.astype(np.float64))
    volume = load_volume(f"{tmp_path}/v.npy?spacing=1,1,2")
    assert volume.spacing_mm == (1, 1, 2)
    assert volume.values.dtype == np.float32 and np.array_equal(volume.values, VALUES)


def test_cells_of_pyvista_lie_between_its_points():
    grid = pyvista.ImageData(dimensions=(5, 4, 3), spacing=(2, 2, 2))
    grid.cell_data["density"] = VALUES.ravel()
    cells = Volume.from_pyvista(grid)
    assert cells.shape_xyz == (4, 3, 2) and np.allclose(cells.world_from_index[:3, 3], 1)


def npy(head: bytes) -> bytes:
    """A file of ``numpy.save`` without values."""
    return b"\x93NUMPY\x01\x00" + len(head).to_bytes(2, "little") + head


def array(dtype: str, shape: str, order: bool = False) -> bytes:
    return npy(f"{{'descr': '{dtype}', 'fortran_order': {order}, 'shape': ({shape}), }}\n".encode())


def saved(values: np.ndarray) -> bytes:
    file = io.BytesIO()
    np.save(file, values)
    return file.getvalue()


def spaced_nrrd(spacing: str) -> bytes:
    head = f"NRRD0004\ntype: short\ndimension: 3\nsizes: 4 3 2\nspacings: {spacing}\n"
    return f"{head}endian: little\nencoding: raw\n\n".encode() + RAW


def saved_in_one(**arrays: np.ndarray) -> bytes:
    file = io.BytesIO()
    np.savez_compressed(file, **arrays)
    return file.getvalue()


JUNK = b"hello" * 99
INT16 = "v.raw?shape=4x3x2&dtype=int16"
# Name and options; the file's bytes, if it is not one of `files`; the error's code; what its text
# has, the name if left out.
REFUSED: list[tuple[str, bytes | None, str] | tuple[str, bytes | None, str, str]] = [
    ("missing.nrrd", None, "not-found"),
    ("empty.nrrd", b"", "damaged"),
    *((f"junk.{suffix}", JUNK, "damaged") for suffix in ("nrrd", "nii.gz", "vti", "npy")),
    ("junk.mhd", JUNK, "syntax"),
    ("empty.npy", array("|S0", "5" * 40 + ", 2, 6", order=True), "type"),
    ("subarray.npy", array("<0f8", "2, 2, 6", order=True), "type"),
    ("endless.npy", array("<f4", "99999999, 99999, 9"), "damaged"),
    ("negative.npy", array("<f4", "-4, 3, 2"), "damaged"),
    ("objects.npy", array("|O", "4, 3, 2"), "type"),
    ("open.npy", npy(b"{'descr': '<f4', 'fortran_order': False, 'shape': (((((((("), "damaged"),
    ("deep.npy", npy(b"{'descr': '" + b"(" * 900), "damaged"),
    ("digits.npy", npy(b"9" * 900), "damaged"),
    ("bytes.npy", npy(b"\xff\xfe\x00 'descr'"), "damaged"),
    ("4d.npy", saved(np.ones((5, 3, 3, 3))), "shape", "a[0]"),
    ("4d.npy?time=0", saved(np.ones((5, 3, 3, 3))), "shape", "a[0]"),
    ("0d.npy", saved(np.ones(())), "shape", "stack"),
    ("grey.npy", saved(np.full((3, 3, 3), 5.0)), "range"),
    ("nan.npy", saved(np.full((3, 3, 3), np.nan)), "range"),
    ("notes.txt", b"hello", "unknown", "FILE.raw?shape="),
    # A bundled volume's name: the file comes first.
    ("engine", b"", "damaged"),
    ("short.nrrd", NRRD.encode() + RAW[:30], "damaged"),
    # ITK mirrors a negative axis and takes NaN for 1.
    *(("s.nrrd", spaced_nrrd(spacing), "range") for spacing in ("-1 1 1", "1 0 1", "1 1 nan")),
    *(
        ("s.mhd", f"{META}ElementSpacing = {one}\nElementDataFile = v.raw\n".encode(), "range")
        for one in ("-1 1 1", "1 0 1", "1 1 nan")
    ),
    ("v.raw", None, "missing"),
    ("v.raw?shape=4x3x2", None, "missing"),
    ("v.raw?shape=4&dtype=uint8", None, "shape", "v.raw?"),
    ("v.raw?shape=4x3x20&dtype=int16", None, "damaged"),
    ("v.raw?shape=4x3x2&dtype=nonsense", None, "syntax"),
    ("v.raw?shape=4x3x2&dtype=uint99", None, "syntax", "uint16"),
    ("v.raw?shape=axb&dtype=uint8", None, "syntax"),
    ("v.raw?shape=4x3x2&colour=red", None, "unknown"),
    (f"{INT16}&order=odd", None, "unknown"),
    (f"{INT16}&spacing=1,-1,1", None, "range", "v.raw?"),
    (f"{INT16}&spacing=1,0,1", None, "range"),
    ("v.stl", b"bytes", "unsupported", "mesh"),
    ("v.mgz", b"bytes", "damaged"),
    # What is there instead of the file, whatever its name.
    ("v.nii.gz", b"version https://git-lfs.github.com/spec/v1\noid sha256:7", "damaged", "git lfs"),
    ("v.dcm", b"/annex/objects/MD5E-s1--2.nii.gz\n", "damaged", "git annex get"),
    ("v.tif", b"\n<!DOCTYPE html><html>", "damaged", "web page"),
    ("v.vti", b'\xef\xbb\xbf<?xml version="1.0"?>\n<html xmlns="">', "damaged", "web page"),
    ("v.nrrd", b'{"message": "Not Found"}', "damaged", "web page"),
    ("v.mha", gzip.compress(META.encode()), "unsupported", "gunzip -c v.mha > unpacked-v.mha"),
    ("v.nii.gz", gzip.compress(gzip.compress(bytes(600))), "damaged", "twice"),
    ("v.img", b"bytes", "not-found", "v.hdr"),
    ("am.nrrd", spaced_nrrd("1 1"), "damaged", "spacings are 2, its axes 3"),
    ("v.npz", b"bytes", "damaged"),
    ("v.npz", saved_in_one(a=VALUES)[:-60], "damaged"),
    ("v.npz", saved_in_one(a=np.ones(3)), "shape", "stack"),
    ("v.npz", saved_in_one(a=VALUES, b=VALUES), "missing", "dataset=a"),
    ("v.nc", b"\x89HDF\r\n\x1a\n", "unsupported", "xarray"),
    ("v.gif", b"bytes", "unsupported", "PNG"),
    ("v.tar.gz", b"bytes", "unsupported", "unpack"),
    # The nearest name or option is given.
    ("v.nrd", None, "not-found", "'v.nrrd'"),
    ("brian.nrrd", None, "not-found", "'brain.nii.gz'"),
    ("z.nrrd", None, "not-found"),
    ("z?.nrrd", None, "not-found", "z?.nrrd"),
    ("v.nrrd?label=t.txt", None, "unknown", "'labels'"),
    ("v.nii?tme=0", None, "unknown", "'time'"),
    ("v.vti?dims=3", None, "unknown", "spacing, labels"),
    ("4d.npy?spacings=1,1,2", saved(VALUES), "unknown", "'spacing'"),
    # A folder of volumes.
    ("", None, "missing", "5 volumes"),
]


@pytest.mark.parametrize("row", REFUSED, ids=lambda row: row[0] or "folder")
def test_what_cannot_be_read_is_refused_in_one_line(files, capfd, monkeypatch, row):
    address, content, code, *words = row
    name = address.partition("?")[0]
    monkeypatch.chdir(files)
    if content is not None:
        Path(name).write_bytes(content)
    with raises(VolumeError, code) as caught:
        load_volume(address or files)
    assert (words or [name])[0] in str(caught.value)
    assert capfd.readouterr().err == "", "a reader printed to stderr"


@pytest.mark.parametrize(
    ("name", "content"),
    [
        ("links", None),
        ("pointers", b"version https://git-lfs.github.com/spec/v1\noid sha256:7"),
    ],
)
def test_slices_that_are_not_there_are_named_with_the_way_to_them(tmp_path, name, content):
    for k in range(4):
        if content:
            (tmp_path / f"s{k}.dcm").write_bytes(content)
        else:
            PIL.Image.fromarray(np.full((3, 4), k, np.uint8)).save(tmp_path / f"s{k}.png")
    if content is None:
        (tmp_path / "s2.png").unlink()
        (tmp_path / "s2.png").symlink_to(".git/annex/objects/s2")
    with raises(VolumeError) as caught:
        load_volume(tmp_path)
    assert ("git lfs pull" if content else "git annex get") in caught.value.remedy


def test_a_header_whose_voxels_are_a_pointer_names_the_way_to_them(tmp_path):
    (tmp_path / "v.mhd").write_text(f"{META}ElementDataFile = v.raw\n")
    (tmp_path / "v.raw").symlink_to("annex/v.raw")
    with raises(VolumeError, "not-found") as caught:
        load_volume(tmp_path / "v.mhd")
    assert "git annex get" in caught.value.remedy


def test_what_is_larger_than_memory_is_read_in_parts_or_the_way_is_named(tmp_path):
    head = NRRD.replace("4 3 2", "4000 2500 2000").encode()
    (tmp_path / "v.nrrd").write_bytes(head.replace(b"raw", b"gzip") + gzip.compress(RAW))
    with raises(VolumeError, "size") as caught:
        load_volume(tmp_path / "v.nrrd")
    assert "volspec convert" in caught.value.remedy
    with (tmp_path / "v.nrrd").open("wb") as file:
        file.write(head)
        file.truncate(len(head) + 4000 * 2500 * 2000 * 2)
    assert isinstance(read_here(Query.of(f"{tmp_path}/v.nrrd")).values, Stored)


def test_summary_counts_every_voxel():
    summary = summarise(Volume(VALUES, None, WORLD, metadata=Metadata(is_patient=True)))
    assert sum(count for _, _, count in summary.histogram) == 24
    assert summary.extent_mm == (6, 2, 3) and summary.range == (-700, 1600)
    assert summary.directions == "PRS" and summary.table().row_count > 8


def test_a_question_mark_may_be_a_part_of_the_name(tmp_path):
    np.save(tmp_path / "what?spacing=2.npy", VALUES)
    assert load_volume(tmp_path / "what?spacing=2.npy").values.shape == VALUES.shape


def test_paths_that_are_none_and_files_that_may_not_be_read_are_refused(files, monkeypatch):
    """Permissions are simulated: root may read everything."""
    with raises(VolumeError, "missing"):  # an empty name is not the present folder
        load_volume("")
    monkeypatch.setattr("os.access", lambda path, mode: False)
    for path in (files, files / "v.nrrd"):
        with raises(VolumeError, "unreadable") as caught:
            load_volume(path)
        assert "chmod" in caught.value.remedy


def test_a_summary_has_directions_as_letters_and_short_lengths_in_micrometres():
    assert summarise(Volume(VALUES)).directions == ""
    fine = summarise(Volume(VALUES, spacing_mm=(0.0002, 0.0002, 0.001)))
    cells = [list(column.cells) for column in fine.table().columns]
    assert cells[1][cells[0].index("spacing")] == "0.2 × 0.2 × 1 µm"


def test_an_array_of_several_is_named(tmp_path):
    (tmp_path / "v.npz").write_bytes(
        saved_in_one(**{"a+b": VALUES, "c": VALUES + 1, "d": VALUES[0]})
    )
    assert np.array_equal(load_silently(f"{tmp_path / 'v.npz'}?dataset=a+b").values, VALUES)


def test_a_link_to_nothing_is_told(tmp_path):
    (tmp_path / "v.nii").symlink_to(tmp_path / "nowhere.nii")
    with raises(VolumeError, "not-found") as caught:
        load_volume(tmp_path / "v.nii")
    assert "nowhere.nii" in str(caught.value)


def test_a_file_is_what_it_begins_with(tmp_path):
    """Not what it is called."""
    whole = {"v.tif": NRRD.encode() + RAW, "v.nrrd": saved(VALUES), "map": nifti(VALUES, np.eye(4))}
    for name, data in whole.items():
        (tmp_path / name).write_bytes(data)
        assert np.array_equal(load_silently(tmp_path / name).values, VALUES)
