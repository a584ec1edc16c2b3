"""MRC maps: axes, cells in Å, stacks, and headers that state no size of a voxel."""

import mrcfile
import numpy as np
import pytest

from tests.support.errors import raises, warns
from tests.support.fixtures import slow
from tests.support.volumes import load_silently
from volspec.errors import VolumeError
from volspec.volume import load_volume

VALUES = np.arange(4 * 5 * 6, dtype=np.float32).reshape(4, 5, 6)


def write(path, values=VALUES, voxel=(2.0, 3.0, 4.0), **fields):
    with mrcfile.new(path, values) as file:
        file.voxel_size = voxel
        for name, value in fields.items():
            file.header[name] = value
    return path


@pytest.mark.parametrize(
    ("name", "dtype"),
    [("v.mrc", "f4"), ("v.rec", "i2"), slow("v.map", "i1"), slow("v.st", "u2"), slow("v", "f2")],
)
def test_a_map_is_in_angstroms_from_its_origin(tmp_path, name, dtype):
    path = write(tmp_path / name, VALUES.astype(dtype), origin=(10.0, 20.0, 30.0))
    volume = load_silently(path)
    assert np.array_equal(volume.values, VALUES)
    assert volume.spacing_mm == pytest.approx((2e-7, 3e-7, 4e-7))
    np.testing.assert_allclose(volume.world_from_index[:3, 3], [1e-6, 2e-6, 3e-6], rtol=1e-6)


def test_columns_rows_and_sections_lead_where_the_header_says(tmp_path):
    """Sections along x, rows along z, columns along y, from start 1, 2, 3 of these."""
    starts = {"nxstart": 1, "nystart": 2, "nzstart": 3}
    path = write(tmp_path / "v.map", mapc=2, mapr=3, maps=1, **starts)
    mrcfile.validate(path, print_file=None)
    world = load_silently(path).world_from_index * 1e7
    with mrcfile.open(path) as file:
        x, y, z = np.array(file.header.cella.tolist()) / (6, 5, 4)
    expected = [[0, 0, x, 3 * x], [y, 0, 0, y], [0, z, 0, 2 * z]]
    np.testing.assert_allclose(world[:3], expected, rtol=1e-5)


def test_a_stack_of_volumes_has_steps(tmp_path):
    with mrcfile.new(tmp_path / "v.mrc") as file:
        file.set_data(np.stack([VALUES, VALUES + 1]))
        file.voxel_size = 1.0
    assert np.array_equal(load_silently(f"{tmp_path / 'v.mrc'}?time=1").values, VALUES + 1)


def test_a_size_that_is_not_stated_is_told(tmp_path):
    path = write(tmp_path / "v.mrc", voxel=0.0)
    with warns("no size of a voxel", "1 mm"):
        assert load_volume(path).spacing_mm == (1, 1, 1)
    assert load_silently(f"{path}?spacing=1e-7,1e-7,1e-7").spacing_mm == (1e-7, 1e-7, 1e-7)


@pytest.mark.parametrize("cut", [600, 1100])
def test_a_cut_map_is_refused(tmp_path, cut):
    path = write(tmp_path / "v.mrc")
    path.write_bytes(path.read_bytes()[:cut])
    with raises(VolumeError, "damaged"):
        load_volume(path)
