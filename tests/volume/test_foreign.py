"""Arrays with named axes, and collections of arrays, where a volume is wanted.

Stand-ins offer what is used of xarray and Zarr; both were tried (2026.9 and 3.1).
"""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
import pyvista

from volspec.errors import VolumeError
from volspec.volume import Volume


class DataArray:
    """What is used of xarray's."""

    def __init__(self, values: np.ndarray, dims: str, **coords: Any) -> None:
        self.values, self.dims, self.coords = values, tuple(dims), coords
        self.dtype = values.dtype

    def transpose(self, *dims: str) -> DataArray:
        order = [self.dims.index(dim) for dim in dims]
        return DataArray(self.values.transpose(order), "".join(dims), **self.coords)

    def __array__(self, dtype: Any = None, copy: bool | None = None) -> np.ndarray:
        return self.values


VALUES = np.arange(24, dtype=np.float32).reshape(2, 3, 4)


@pytest.mark.parametrize("take", [Volume, Volume.of])
@pytest.mark.parametrize(
    ("dims", "order"), [("zyx", (0, 1, 2)), ("xyz", (2, 1, 0)), ("YXZ", (2, 0, 1))]
)
def test_axes_called_x_y_z_may_come_in_any_order(take: Any, dims: str, order: Any) -> None:
    volume = take(DataArray(VALUES, dims))
    assert np.array_equal(volume.values, VALUES.transpose(order))
    assert volume.spacing_mm == (1, 1, 1)


def test_axes_of_other_names_stay_in_their_order() -> None:
    volume = Volume.of(DataArray(VALUES, "lij", l=[0.0, 2.5]))
    assert volume.shape_xyz == (4, 3, 2) and volume.spacing_mm == (1, 1, 2.5)


def test_coordinates_place_the_volume_unless_it_is_told() -> None:
    """Rising or falling, whole numbers or not quite even float32."""
    given = DataArray(
        VALUES, "zyx", z=[7, 9], y=[3.0, 2.5, 2.0], x=np.float32([0.1, 0.2, 0.3, 0.4])
    )
    volume = Volume(given)
    index, world = [[0, 0, 0, 1], [3, 2, 1, 1]], [[0.1, 3, 7], [0.4, 2, 9]]
    assert np.allclose((np.array(index) @ volume.world_from_index.T)[:, :3], world)
    assert np.allclose(volume.spacing_mm, (0.1, 0.5, 2))
    assert Volume(given, spacing_mm=(1, 2, 3)).world_from_index[:3, 3].tolist() == [0, 0, 0]
    assert Volume(given, world_from_index=np.diag([4.0, 5, 6, 1])).spacing_mm == (4, 5, 6)


@pytest.mark.parametrize(
    "at", [[0, 1, 3], [1, 1, 1], ["a", "b", "c"], [0, np.nan, 2], [0, 1, np.inf]]
)
def test_uneven_coordinates_are_refused(at: Any) -> None:
    given = DataArray(VALUES, "zyx", y=np.array(at))
    with pytest.raises(VolumeError, match=r"scan: .* along 'y' are not evenly .*drop_vars\('y'\)"):
        Volume(given, name="scan")


def test_one_slice_and_four_axes_are_refused_by_their_shape() -> None:
    with pytest.raises(VolumeError, match=r"shape \(1, 3, 4\); .* was a single slice given"):
        Volume(DataArray(VALUES[:1], "zyx", z=[5]))
    with pytest.raises(VolumeError, match=r"shape \(1, 2, 3, 4\); .*one channel or time step"):
        Volume(DataArray(VALUES[None], "tzyx", t=[5]))


def test_collections_name_what_they_hold() -> None:
    """A Zarr group, an xarray Dataset, a dictionary."""
    with pytest.raises(VolumeError, match="scan: is a dict of 'ct', 'labels'; give one array of"):
        Volume({"ct": VALUES, "labels": VALUES}, name="scan")
    with pytest.raises(VolumeError, match="is a dict of nothing"):
        Volume.of({})


def test_pyvistas_grids_and_blocks_are_sent_to_the_right_door() -> None:
    grid = pyvista.ImageData(dimensions=(3, 3, 3))
    with pytest.raises(VolumeError, match=r"pyvista ImageData; Volume.from_pyvista takes an Im"):
        Volume(grid)
    with pytest.raises(VolumeError, match=r"MultiBlock; .* ImageData, such as one of its 2 bl"):
        Volume.of(pyvista.MultiBlock([grid, grid]))
