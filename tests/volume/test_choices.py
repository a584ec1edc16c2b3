"""Choices of an address: series, level, channel, time step, the layout of raw bytes."""

import gzip
from pathlib import Path

import numpy as np
import pytest
import SimpleITK as sitk
from tifffile import imwrite

from tests.support.errors import advised_address, raises
from tests.support.volumes import RAW, VALUES, load_silently, write_nrrd
from tests.volume.test_zarr import CHANNEL, SPACE, TIME, edit_ome, write
from volspec.errors import VolumeError
from volspec.volume import Choice, load_volume, volume_choices

STEPS = np.stack([VALUES, VALUES + 1, VALUES * 2])


def itk_file(path: Path, key: str) -> Path:
    """Write three time steps, or three components per voxel."""
    values = STEPS if key == "time" else np.moveaxis(STEPS, 0, -1)
    image = sitk.GetImageFromArray(values, isVector=key == "channel")
    sitk.WriteImage(image, str(path), useCompression=path.suffix == ".mha")
    return path


@pytest.mark.parametrize("key", ["time", "channel"])
@pytest.mark.parametrize("name", ["v.nii", "v.nii.gz", "v.nrrd", "v.mhd", "v.mha"])
def test_a_time_step_or_component_is_chosen(tmp_path, name, key):
    path = itk_file(tmp_path / name, key)
    if key == "channel":
        every = load_silently(str(path)).by_name.values()
        assert all(np.array_equal(f.values, v) for f, v in zip(every, STEPS, strict=True))
    for index, values in enumerate(STEPS):
        volume = load_silently(f"{path}?{key}={index}")
        assert np.array_equal(volume.values, values) and volume.values.dtype == np.int16
    (choice,) = volume_choices(path)
    every, default = ((), None) if key == "time" else (("all",), "all")
    assert (choice.key, choice.values, choice.chosen) == (key, (*every, "0", "1", "2"), default)
    assert volume_choices(f"{path}?{key}=2")[0].chosen == "2"


@pytest.mark.parametrize(
    ("name", "key", "query", "code"),
    [
        ("v.nii", "time", "", "missing"),
        ("v.nrrd", "time", "?time=3", "range"),
        ("v.mha", "channel", "?channel=abc", "range"),
        ("v.nii.gz", "channel", "?channel=", "range"),
        ("cut.nii", "time", "?time=2", "damaged"),
        ("cut.nii.gz", "time", "?time=2", "damaged"),
    ],
)
def test_choices_that_a_file_does_not_have_are_refused(tmp_path, name, key, query, code):
    path = itk_file(tmp_path / name, key)
    if name == "cut.nii":
        path.write_bytes(path.read_bytes()[:-8])
    elif name == "cut.nii.gz":
        path.write_bytes(gzip.compress(gzip.decompress(path.read_bytes())[:-8]))
        assert np.array_equal(load_silently(f"{path}?time=1").values, STEPS[1])
    with raises(VolumeError, code) as caught:
        load_volume(f"{path}{query}")
    if code == "range":
        assert "0 to 2" in caught.value.remedy and caught.value.given == query.partition("=")[2]


def test_the_advised_address_opens_the_volume(tmp_path):
    """The example in each message adds what is missing and keeps the rest."""
    stacks = np.stack([STEPS, STEPS + 7]).astype(np.uint16)
    notes = {"axes": "TZCYX", "spacing": 1.0, "unit": "mm"}
    imwrite(tmp_path / "a b.tif", stacks, imagej=True, resolution=(1, 1), metadata=notes)
    (tmp_path / "v_4x3x2_int16.raw").write_bytes(RAW)
    (tmp_path / "v-4x3x2.raw").write_bytes(RAW)
    itk_file(tmp_path / "v.nii", "time")
    for name in ("v.nii", "a b.tif?channel=1", "a b.tif"):
        with raises(VolumeError, "missing") as caught:
            load_volume(f"{tmp_path}/{name}")
        volume = load_silently(advised_address(caught.value))
        assert volume.name == f"{tmp_path}/{name.partition('?')[0]}"
    for name in ("v_4x3x2_int16.raw", "v-4x3x2.raw"):
        with raises(VolumeError, "missing") as caught:
            load_volume(f"{tmp_path}/{name}?offset=0")
        assert load_silently(advised_address(caught.value)).shape_xyz == (4, 3, 2)


def test_components_on_the_slowest_axis_of_an_nrrd_are_chosen(tmp_path):
    header = (
        "NRRD0004\ntype: short\ndimension: 4\nsizes: 4 3 2 3\nspacings: 1 1 1 nan\n"
        "kinds: domain domain domain list\nendian: little\nencoding: raw\n\n"
    )
    (tmp_path / "v.nrrd").write_bytes(header.encode() + STEPS.tobytes())
    assert np.array_equal(load_silently(f"{tmp_path}/v.nrrd?channel=2").values, STEPS[2])


def test_scaled_steps_of_nifti_have_names_in_seconds(tmp_path):
    path = itk_file(tmp_path / "v.nii", "time")
    data = bytearray(path.read_bytes())
    data[92:96] = np.float32(2.5).tobytes()  # pixdim[4]
    data[112:120] = np.array([0.5, -3], np.float32).tobytes()  # slope and intercept
    path.write_bytes(data)
    assert volume_choices(path)[0].names == ("0 s", "2.5 s", "5 s")
    volume = load_silently(f"{path}?time=1")
    assert np.array_equal(volume.values, STEPS[1] * 0.5 - 3) and volume.values.dtype == np.float32


def test_volumes_of_one_value_leave_no_choice(tmp_path):
    np.save(tmp_path / "v.npy", VALUES)
    for path in (write_nrrd(tmp_path / "v.nrrd"), tmp_path / "v.npy"):
        assert volume_choices(path) == ()


def test_raw_bytes_without_a_layout_are_a_choice(tmp_path):
    (tmp_path / "v.raw").write_bytes(RAW)
    assert volume_choices(tmp_path / "v.raw") == (Choice("shape", (), ()),)
    assert volume_choices(f"{tmp_path}/v.raw?shape=4x3x2&dtype=int16") == ()


def test_an_ome_zarr_lists_levels_channels_and_times(tmp_path):
    many = np.stack([STEPS, STEPS]).astype(np.uint16)
    path = write(tmp_path / "v.zarr", many, [TIME, CHANNEL, *SPACE])
    edit_ome(path, omero={"channels": [{"label": name} for name in ("DAPI", "GFP", "Cy5")]})
    level, time, channel = volume_choices(f"{path}?channel=1")
    assert (level.key, level.names, level.chosen) == ("level", ("4 × 3 × 2", "2 × 2 × 1"), "0")
    assert (time.key, time.values, time.chosen) == ("time", ("0", "1"), None)
    assert (channel.names, channel.chosen) == (("all", "DAPI", "GFP", "Cy5"), "1")
