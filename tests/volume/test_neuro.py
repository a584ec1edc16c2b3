"""Formats that nibabel reads, as nibabel and the standards have them."""

import gzip
import struct
import warnings
from pathlib import Path

import nibabel
import numpy as np
import pytest

from tests.support.errors import raises, warns
from tests.support.fixtures import slow_each
from tests.support.volumes import load_silently
from volspec.errors import VolumeError
from volspec.volume import load_volume

VALUES = np.arange(2 * 3 * 4, dtype=np.int16).reshape(4, 3, 2) * 7
WORLD = np.array([[0, -0.5, 0, 5], [0.7, 0, 0, -6], [0, 0, 2, 7], [0, 0, 0, 1.0]])
LPS = np.diag([-1.0, -1, 1, 1])
OWN = Path(nibabel.__file__).parent / "tests" / "data"
USUAL = ("scaled+tlrc.HEAD", "phantom_varscale.PAR", "tiny.mnc")
FURTHER = (
    *("example4d+orig.BRIK.gz", "phantom_EPI_asc_CLEAR_2_1.REC", "small.mnc", "minc2_4d.mnc"),
    *("minc1_4d.mnc", "test.mgz", "example_nifti2.nii.gz", "reoriented_anat_moved.nii"),
)


@pytest.mark.parametrize("name", [*USUAL, *slow_each(*FURTHER)])
@pytest.mark.filterwarnings("ignore::UserWarning")  # nibabel's, of its own files
def test_nibabel_s_files_are_read_as_nibabel_says(name):
    image = nibabel.load(OWN / name)
    values = np.asarray(image.dataobj)
    if values.ndim == 4 and name.endswith(".mnc"):
        values = np.moveaxis(values, 0, 3)
    several = values.ndim == 4 and values.shape[3] > 1
    volume = load_volume(f"{OWN / name}?time=0" if several else OWN / name)
    first = values.reshape(*values.shape[:3], -1)[..., 0]
    np.testing.assert_allclose(volume.values, first.T, rtol=1e-6)
    np.testing.assert_allclose(volume.world_from_index, LPS @ image.affine, atol=1e-4)


@pytest.mark.parametrize(
    ("kind", "name"),
    [
        (nibabel.Nifti1Image, "v.nii.gz"),
        (nibabel.Nifti2Image, "v.nii"),
        (nibabel.Nifti1Pair, "v.img"),
        (nibabel.Nifti2Pair, "v.hdr"),
        (nibabel.MGHImage, "v.mgz"),
        (nibabel.MGHImage, "v.mgh"),
    ],
)
def test_every_kind_has_the_same_voxels_in_the_same_place(tmp_path, kind, name):
    kind(VALUES, WORLD).to_filename(tmp_path / name)
    volume = load_silently(tmp_path / name)
    assert np.array_equal(volume.values, VALUES.T)
    np.testing.assert_allclose(volume.world_from_index, LPS @ WORLD, atol=1e-5)


def test_a_file_is_unpacked_if_it_is_packed_whatever_its_name_says(tmp_path):
    nibabel.Nifti1Image(VALUES, WORLD).to_filename(tmp_path / "v.nii")
    data = (tmp_path / "v.nii").read_bytes()
    (tmp_path / "v.nii.gz").write_bytes(data)
    (tmp_path / "v.nii").write_bytes(gzip.compress(data))
    for name in ("v.nii", "v.nii.gz"):
        assert np.array_equal(load_silently(tmp_path / name).values, VALUES.T)


def test_analyze_states_a_spacing_but_no_orientation(tmp_path):
    image = nibabel.AnalyzeImage(VALUES, np.diag([0.5, 0.7, 2, 1]))
    image.to_filename(tmp_path / "v.img")
    world = load_silently(tmp_path / "v.hdr").world_from_index
    np.testing.assert_allclose(world, np.diag([0.5, 0.7, 2, 1]), atol=1e-6)


def nifti(
    folder: Path, sform: np.ndarray | None, qform: np.ndarray | None, **fields: object
) -> str:
    """Write an image with codes of 2 and 1, and header fields as given."""
    image = nibabel.Nifti1Image(VALUES, np.eye(4))
    image.set_sform(sform, 2 if sform is not None else 0)
    image.set_qform(qform, 1 if qform is not None else 0)
    for name, value in fields.items():
        image.header[name] = value
    image.to_filename(folder / "v.nii")
    return str(folder / "v.nii")


def with_nan(path: str) -> str:
    """Put NaN into the sform, which nibabel does not write."""
    with open(path, "r+b") as file:
        file.seek(280)
        file.write(np.float32(np.nan).tobytes())
    return path


SHEARED = np.array([[0.5, 0, 0, 1], [0, 0.5, 0.6, 2], [0, 0, 2, 3], [0, 0, 0, 1.0]])


def test_the_sform_alone_is_the_map_if_there_is_one(tmp_path):
    """Nifti1.h, method 3: neither pixdim nor the qform is used; shear is part of it."""
    path = nifti(tmp_path, SHEARED, None, pixdim=[1, 1, 1, 9, 1, 1, 1, 1])
    np.testing.assert_allclose(load_silently(path).world_from_index, LPS @ SHEARED, atol=1e-6)
    path = nifti(tmp_path, WORLD, np.diag([-1.0, 1, 1, 1]) @ WORLD)
    with warns("sform (code 2)", "qform (code 1)"):
        world = load_volume(path).world_from_index
    np.testing.assert_allclose(world, LPS @ WORLD, atol=1e-6)
    world = load_silently(nifti(tmp_path, None, WORLD)).world_from_index
    np.testing.assert_allclose(world, LPS @ WORLD, atol=1e-6)
    with warns("sform holds NaN", "qform"):
        world = load_volume(with_nan(nifti(tmp_path, WORLD, WORLD))).world_from_index
    np.testing.assert_allclose(world, LPS @ WORLD, atol=1e-6)


def test_a_sform_of_nan_is_refused_with_a_spacing_that_works(tmp_path):
    path = with_nan(nifti(tmp_path, WORLD, None))
    with raises(VolumeError, "damaged") as caught:
        load_volume(path)
    assert "sform" in str(caught.value) and f"{path}?spacing=1,1,1" in str(caught.value)
    assert load_silently(f"{path}?spacing=1,2,3").spacing_mm == (1, 2, 3)


@pytest.mark.parametrize(
    ("sform", "codes", "fields"),
    [
        # A map that is none does not keep the other from being taken.
        (WORLD, (2, 1), {"quatern_b": 2.0}),
        (np.zeros((4, 4)), (2, 1), {}),
        # Of a qform, pixdim has no sign, and qfac is 1 unless it is -1.
        (None, (0, 1), {"pixdim": [0, 0.7, 0.5, -2.0, 1, 1, 1, 1]}),
        (WORLD, (2, 0), {"xyzt_units": 7}),
    ],
)
def test_a_map_that_is_one_is_taken(tmp_path, sform, codes, fields):
    path = Path(nifti(tmp_path, WORLD, WORLD, **fields))
    header = bytearray(path.read_bytes())
    struct.pack_into("<2h", header, 252, *codes[::-1])
    if sform is not None:
        struct.pack_into("<12f", header, 280, *sform[:3].ravel())
    path.write_bytes(header)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        world = load_volume(path).world_from_index
    np.testing.assert_allclose(world, LPS @ WORLD, atol=1e-5)


@pytest.mark.parametrize(("units", "scale"), [(1, 1000.0), (2, 1.0), (3, 1e-3), (0, 1.0)])
def test_lengths_are_in_the_unit_that_the_header_states(tmp_path, units, scale):
    spacing = load_silently(nifti(tmp_path, WORLD, None, xyzt_units=units)).spacing_mm
    np.testing.assert_allclose(spacing, np.array([0.7, 0.5, 2.0]) * scale, rtol=1e-6)


def test_colours_are_channels_and_complex_numbers_are_named(tmp_path):
    colours = np.zeros(VALUES.shape, [("R", "u1"), ("G", "u1"), ("B", "u1")])
    for k, name in enumerate("RGB"):
        colours[name] = VALUES + k
    nibabel.Nifti1Image(colours, WORLD).to_filename(tmp_path / "v.nii.gz")
    volume = load_silently(tmp_path / "v.nii.gz")
    assert [each.range for each in volume.by_role.values()] == [(0, 161), (1, 162), (2, 163)]
    nibabel.Nifti1Image(VALUES.astype(np.complex64), WORLD).to_filename(tmp_path / "c.nii")
    with raises(VolumeError, "unsupported") as caught:
        load_volume(tmp_path / "c.nii")
    assert "complex" in str(caught.value)


@pytest.mark.parametrize(("header", "voxels"), [("v.hdr", "v.img"), ("T1.PAR", "T1.REC")])
def test_a_missing_file_of_voxels_is_named(tmp_path, header, voxels):
    if header == "v.hdr":
        nibabel.Nifti1Pair(VALUES, WORLD).to_filename(tmp_path / header)
        (tmp_path / voxels).unlink()
    else:
        (tmp_path / header).write_bytes((OWN / header).read_bytes())
    with raises(VolumeError, "not-found") as caught, warnings.catch_warnings():
        warnings.simplefilter("ignore")
        load_volume(tmp_path / header)
    assert voxels in str(caught.value)
