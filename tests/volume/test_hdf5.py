"""HDF5 files: datasets, time steps, spacing, and what is refused."""

from pathlib import Path

import h5py
import numpy as np
import pytest

from tests.support.errors import raises
from volspec.errors import VolumeError
from volspec.volume import load_volume, volume_choices

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
        ("table", "", "shape"),
    ],
)
def test_what_is_no_volume_is_refused(kind, options, code, file):
    if kind:
        damage(file, kind)
    with raises(VolumeError, code):
        load_volume(f"{file}{options}")
