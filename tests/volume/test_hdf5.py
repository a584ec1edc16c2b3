"""HDF5 files: datasets, time steps, spacing, and what is refused."""

import json
from pathlib import Path

import h5py
import numpy as np
import pytest

from tests.support.errors import raises
from tests.support.volumes import load_silently
from tests.volume.test_zarr import write_n5
from volspec.errors import VolumeError
from volspec.volume import load_volume, volume_choices
from volspec.volume.metadata import NO_SPACING, NO_UNIT

VALUES = np.arange(4 * 5 * 6, dtype=np.uint16).reshape(4, 5, 6)


@pytest.fixture
def file(tmp_path: Path) -> Path:
    """Return a file with a volume, a series of two, and what is no volume."""
    path = tmp_path / "v.h5"
    with h5py.File(path, "w") as made:
        made.create_dataset("t0/cells", data=VALUES, chunks=(2, 5, 6), compression="lzf")
        made["t0/cells"].attrs["element_size_um"] = (2000.0, 500.0, 250.0)
        made["series"] = np.stack([VALUES, VALUES + 1])
        made["table"] = np.zeros((3, 3))
        made["names"] = [b"a", b"b"]
    return path


def test_a_dataset_its_spacing_and_a_time_step(file):
    volume = load_volume(f"{file}?dataset=t0/cells")
    assert np.array_equal(volume.values, VALUES) and volume.spacing_mm == (0.25, 0.5, 2.0)
    assert volume.metadata.assumed == ()
    assert load_volume(f"{file}?dataset=/t0/cells&spacing=1,2,3").spacing_mm == (1.0, 2.0, 3.0)
    assert np.array_equal(load_volume(f"{file}?dataset=series&time=1").values, VALUES + 1)


def test_the_only_dataset_needs_no_name(tmp_path):
    with h5py.File(tmp_path / "v.hdf5", "w") as made:
        made["a"] = VALUES.astype(">f4")
    assert np.array_equal(load_volume(tmp_path / "v.hdf5").values, VALUES)


def test_choices(file):
    (choice,) = volume_choices(file)
    assert (choice.key, choice.values, choice.chosen) == ("dataset", ("series", "t0/cells"), None)
    assert [each.key for each in volume_choices(f"{file}?dataset=series")] == ["dataset", "time"]


def damage(file: Path, kind: str) -> None:
    """Give a dataset an impossible spacing, cut the file off, or leave no volume in it."""
    if kind == "cut":
        file.write_bytes(file.read_bytes()[:900])
        return
    with h5py.File(file, "r+" if kind == "spacing" else "w") as made:
        if kind == "spacing":
            made["t0/cells"].attrs["element_size_um"] = (1.0, -1.0, 1.0)
        else:
            made["table"] = np.zeros((3, 3))


@pytest.mark.parametrize(
    ("kind", "options", "code"),
    [
        ("", "", "missing"),
        ("", "?dataset=series", "missing"),
        ("", "?dataset=table", "unknown"),
        ("", "?dataset=t0", "unknown"),
        ("", "?a=1", "unknown"),
        ("spacing", "?dataset=t0/cells", "range"),
        ("cut", "?dataset=series&time=0", "damaged"),
        ("table", "", "range"),
    ],
)
def test_what_is_no_volume_is_refused(kind, options, code, file):
    if kind:
        damage(file, kind)
    with raises(VolumeError, code):
        load_volume(f"{file}{options}")


@pytest.mark.parametrize("axes", ["xyz", "zyxc", "czyx", "tzyxc", "xyzct"])
def test_axes_are_those_that_ilastik_states(tmp_path, axes):
    """The second channel is one more than the first; there is one time step."""
    whole = np.stack([VALUES, VALUES + 1])[None]
    dropped = tuple(0 if letter not in axes else slice(None) for letter in "tczyx")
    order = [letter for letter in "tczyx" if letter in axes]
    with h5py.File(tmp_path / "v.h5", "w") as made:
        made["data"] = whole[dropped].transpose([order.index(each) for each in axes])
        made["data"].attrs["axistags"] = json.dumps({"axes": [{"key": each} for each in axes]})
    fields = load_volume(tmp_path / "v.h5").by_role.values()
    assert len(fields) == 1 + ("c" in axes)
    assert all(np.array_equal(each.values, VALUES + k) for k, each in enumerate(fields))


def test_links_into_other_files_are_followed(tmp_path):
    with h5py.File(tmp_path / "part.h5", "w") as made:
        made["d"] = VALUES
    with h5py.File(tmp_path / "master.h5", "w") as made:
        made["entry/data"] = h5py.ExternalLink("part.h5", "/d")
        made["entry/again"] = h5py.SoftLink("/")
    assert np.array_equal(load_volume(tmp_path / "master.h5").values, VALUES)


@pytest.mark.parametrize("kind", ["virtual", "external", "soft"])
def test_missing_sources_and_targets_are_named(tmp_path, kind):
    """HDF5 fills the voxels of missing sources with zeros."""
    part = tmp_path / "part.h5"
    with h5py.File(part, "w") as made:
        made["d"] = VALUES
    layout = h5py.VirtualLayout(VALUES.shape, VALUES.dtype)
    layout[:] = h5py.VirtualSource("part.h5", "d", VALUES.shape)
    with h5py.File(tmp_path / "v.h5", "w") as made:
        if kind == "virtual":
            made.create_virtual_dataset("a", layout)
        else:
            made["a"] = (
                h5py.ExternalLink("part.h5", "d") if kind == "external" else h5py.SoftLink("d")
            )
    if kind != "soft":
        assert np.array_equal(load_volume(tmp_path / "v.h5").values, VALUES)
    part.unlink()
    with raises(VolumeError, "not-found") as caught:
        load_volume(tmp_path / "v.h5")
    assert ("leads to d," if kind == "soft" else "part.h5") in str(caught.value)


@pytest.mark.parametrize("text", [str, str.encode])
def test_nexus_has_the_spacing_of_its_coordinates(tmp_path, text):
    with h5py.File(tmp_path / "scan.nxs", "w") as made:
        made["entry/data"] = VALUES
        made["entry"].attrs["axes"] = [text(name) for name in "zyx"]
        for name, count, step in zip("zyx", VALUES.shape, (2.0, 0.7, 0.5), strict=True):
            made[f"entry/{name}"] = np.arange(count) * step
            made[f"entry/{name}"].attrs["units"] = text("um")
    assert load_volume(tmp_path / "scan.nxs").spacing_mm == pytest.approx((5e-4, 7e-4, 2e-3))


@pytest.mark.parametrize("stated", ["", "uint16", "int16"])
def test_bigdataviewer_s_int16_is_uint16_unless_it_is_stated(tmp_path, stated):
    large = (VALUES.astype(np.uint32) * 500).astype(np.uint16)
    with h5py.File(tmp_path / "v.h5", "w") as made:
        for time in range(2):
            for level in range(2):
                part = (large - time)[:: level + 1, :: level + 1, :: level + 1]
                made[f"t{time:05}/s00/{level}/cells"] = part.view(np.int16)
        made["s00/resolutions"] = np.ones((2, 3))
        if stated:
            made["s00"].attrs["dataType"] = stated
    values = load_volume(f"{tmp_path / 'v.h5'}?time=1").values
    assert np.array_equal(values, (large - 1).view(stated or "uint16"))


def write_project(path: Path, form: str, data: str, unit: str = "um") -> Path:
    setups = "".join(
        f"<ViewSetup><id>{k}</id><name>GFP {k}</name><voxelSize><unit>{unit}</unit>"
        "<size>0.5 0.7 2</size></voxelSize></ViewSetup>"
        for k in (0, 1)
    )
    loader = f"<ImageLoader><{form}>{data}</{form}></ImageLoader>"
    path.write_text(f"<a><SequenceDescription>{loader}{setups}</SequenceDescription></a>")
    return path


@pytest.mark.filterwarnings("ignore:.*unit of its scale")
@pytest.mark.parametrize("form", ["hdf5", "n5"])
@pytest.mark.parametrize(("unit", "mm", "assumed"), [("um", 1e-3, ()), ("", 1.0, (NO_UNIT,))])
def test_a_bigdataviewer_project_states_voxels_and_names(tmp_path, form, unit, mm, assumed):
    """Its file gives the same as its data, next to which it is."""
    data = tmp_path / f"v.{form}"
    for k in (0, 1):
        if form == "n5":
            write_n5(data / f"setup{k}/timepoint0/s0", VALUES + k)
        else:
            with h5py.File(data, "a") as made:
                made[f"t00000/s{k:02}/0/cells"] = VALUES + k
    assert load_silently(data).metadata.assumed == (NO_SPACING,)
    for path in (data, write_project(tmp_path / "project.xml", form, data.name, unit)):
        volume = load_volume(path)
        (other,) = volume.fields
        assert np.array_equal(other.values, VALUES + 1) and other.name == "GFP 1"
        assert volume.spacing_mm == pytest.approx((0.5 * mm, 0.7 * mm, 2 * mm))
        assert volume.metadata.assumed == assumed


@pytest.mark.parametrize(("text", "code"), [("<a/>", "unsupported"), ("", "not-found")])
def test_projects_without_data_are_refused(tmp_path, text, code):
    path = write_project(tmp_path / "v.xml", "n5", "gone.n5")
    path.write_text(text or path.read_text())
    with raises(VolumeError, code):
        load_volume(path)


@pytest.mark.parametrize("stated", ["2.0 0.7 0.5", [0.7, 0.5], [2, 0.7, -1.0], [2, 0.7, np.nan]])
def test_sizes_that_are_none_are_named_with_a_spacing_that_works(tmp_path, stated):
    with h5py.File(tmp_path / "v.h5", "w") as made:
        made["data"] = VALUES
        made["data"].attrs["element_size_um"] = stated
    with raises(VolumeError, "range") as caught:
        load_volume(tmp_path / "v.h5")
    assert "element_size_um" in str(caught.value)
    assert load_volume(f"{tmp_path / 'v.h5'}?spacing=1,2,3").spacing_mm == (1, 2, 3)
