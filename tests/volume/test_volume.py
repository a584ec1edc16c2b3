"""Volumes from arrays: types, geometry, named axes, refusals, and down-sampling."""

from __future__ import annotations

import pickle
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
import pyvista
from dask.array import from_array

from tests.support.errors import raises, refuses, warns
from volspec.errors import VolspecWarning, VolumeError
from volspec.volume import Volume, load_volume
from volspec.volume.labels import Label
from volspec.volume.summary import summarise, value_form, value_text


def test_a_pickled_volume_is_the_same():
    values = np.arange(24, dtype=np.uint8).reshape(2, 3, 4)
    pet = Volume(values, spacing_mm=(2, 2, 2), name="PET", missing=3)
    volume = Volume(values, labels={1: Label("bone")}, fields=(pet,))
    again = pickle.loads(pickle.dumps(volume))
    for one, other in ((volume, again), (pet, again.fields[0])):
        assert (one.name, one.missing, one.labels) == (other.name, other.missing, other.labels)
        assert np.array_equal(one.values, other.values)
        assert np.array_equal(one.world_from_index, other.world_from_index)


@pytest.mark.parametrize(
    ("given", "native"),
    [
        *[(name, name) for name in ("u1", "u2", "i2", "f4")],
        *[("i1", "i2"), ("?", "u1"), ("f2", "f4"), ("f8", "f4"), (">i2", "i2"), (">f4", "f4")],
    ],
)
def test_types_that_kernels_read_stay_and_others_are_widened(given, native):
    assert Volume(np.ones((2, 2, 2), given)).values.dtype == np.dtype(native)


@pytest.mark.parametrize(
    ("given", "low", "high", "native"),
    [
        (given, low, high, native)
        for given in ("i4", "u4", "i8", "u8", ">i8")
        for low, high, native in [
            *[(0, 255, "u1"), (0, 256, "u2"), (0, 65535, "u2"), (0, 65536, "f4")],
            *[(-1, 200, "i2"), (-32768, 32767, "i2"), (-1, 32768, "f4")],
        ]
        if low >= 0 or "i" in given
    ],
)
def test_wide_integers_take_the_least_type(given, low, high, native):
    values = np.full((2, 2, 2), high, given)
    values[0, 0, 0] = low
    volume = Volume(values)
    assert volume.values.dtype == np.dtype(native) and volume.range == (low, high)
    assert np.array_equal(volume.values, values)


def test_an_array_that_needs_no_conversion_is_shared_and_read_only_here():
    given = np.arange(27, dtype=np.float32).reshape(3, 3, 3)
    volume = Volume(given)
    assert np.shares_memory(given, volume.values) and given.flags.writeable
    assert not volume.values.flags.writeable
    volume.to_pyvista().point_data["values"][:] = 99  # VTK knows no read-only arrays
    assert volume.values.max() == given.max() == 26


@pytest.mark.parametrize("kind", ["?", "u1", "i2", "i8", "f4", "f8"])
@pytest.mark.parametrize("give", [np.ma.asarray, list, lambda m: from_array(m, chunks=2)])
def test_masked_voxels_are_missing(kind, give):
    mask = np.arange(24).reshape(2, 3, 4) < 5
    masked = np.ma.masked_array(np.where(mask, 0, 1).astype(kind), mask)
    with warns("5 of 24 voxels"):
        volume = Volume(give(masked))
    assert volume.range == (1, 1) and np.array_equal(volume.values == volume.missing, mask)
    assert Volume(np.ma.masked_array(np.ones((2, 2, 2), "u1"))).values.dtype == np.uint8
    refuses(lambda: Volume(np.ma.masked_all((2, 2, 2))), "range ", VolumeError)


def test_nan_and_infinities_are_missing_voxels():
    values = np.linspace(2, 9, 27, dtype=np.float32).reshape(3, 3, 3)
    values[0, 0, 1], values[0, 1, 1], values[1, 1, 1] = np.nan, -np.inf, np.inf
    with warns("3", "27", file=__file__):
        volume = Volume(values)
    assert volume.range == (2, 9) and np.count_nonzero(volume.values == volume.missing) == 3
    wider, half = volume.with_spacing((1, 2, 3)), volume.downsampled(2)  # without a warning
    assert (wider.range, wider.missing) == (volume.range, volume.missing)
    assert half.missing is None and half.range[0] >= 2  # no block lacks half of its voxels
    back = volume.to_pyvista().point_data["values"]
    assert np.count_nonzero(np.isnan(back)) == 3 and Volume(np.ones((2, 2, 2))).missing is None


def test_values_over_decades_are_logarithms_and_texts_the_file_s(tmp_path):
    """Also beyond float32; what is not above 0 is missing."""
    values = 10.0 ** np.linspace(-60, 60, 4 * 5 * 6).reshape(4, 5, 6)
    values[0, 0, :3] = 0, -1, np.nan
    np.save(tmp_path / "v.npy", values)
    with warns("3 of 120 voxels"):
        volume = load_volume(f"{tmp_path}/v.npy?scale=log&unit=HU")
    assert np.allclose(volume.values.flat[3:], np.log10(values.flat[3:]), atol=1e-5)
    assert volume.missing is not None and (volume.values.flat[:3] == volume.missing).all()
    assert not volume.metadata.in_hounsfield
    assert np.allclose(volume.stated(volume.range), [values[0, 0, 3], 1e60], rtol=1e-4)
    told = summarise(volume)
    assert told.range == pytest.approx((values[0, 0, 3], 1e60), rel=1e-4) and told.missing == 3
    assert told.mean == pytest.approx(np.nanmean(values, where=values > 0), rel=1e-4)
    assert (value_form(volume) % 2.5, value_text(volume, 2.5)) == ("10^2.5", "316.23")
    for query, code in (("scale=lag", "unknown"), ("scale=log&memory=100", "unsupported")):
        with raises(VolumeError, code):
            load_volume(f"{tmp_path}/v.npy?{query}")


def test_integers_that_float32_cannot_hold_are_warned_about():
    Volume(np.full((2, 2, 2), 2**24, np.int64))
    with warns("int64", "2^24"):
        Volume(np.full((2, 2, 2), 2**24 + 1, np.int64))


def test_doubles_that_float32_rounds_are_warned_about():
    ramp = np.linspace(0, 1, 27).reshape(3, 3, 3)
    for values in (ramp, np.full((2, 2, 2), 0.1), ramp.round() + 1e6):
        Volume(values)  # whole numbers below 2^24 stay what they are
    with warns("1000000", "1000001", "0.029"):
        Volume(ramp + 1e6)
    with warns("float64"):
        Volume(ramp * 1e-60)  # below float32's least number
    ramp[0, 0, 0] = np.nan
    with pytest.warns(VolspecWarning) as caught:
        Volume(ramp + 1e6)
    assert ["1 of 27" in str(w.message) for w in caught] == [True, False]


def blocks_of(values: np.ndarray, small: np.ndarray) -> list[tuple[Any, np.ndarray]]:
    """Down-sampled values, each with its block of 3³; ends may be shorter."""
    corners = (3 * np.array(list(np.ndindex(small.shape)))).tolist()
    parts = [tuple(slice(at, at + 3) for at in corner) for corner in corners]
    return [(value, values[part]) for value, part in zip(small.flat, parts, strict=True)]


def test_down_sampling_takes_the_mean_of_blocks_and_of_what_is_left_at_the_ends():
    values = np.random.default_rng(1).integers(-900, 900, (5, 6, 7)).astype(np.int16)
    small = Volume(values).downsampled(3)
    assert small.values.dtype == np.int16 and small.shape_xyz == (3, 2, 2)
    for value, block in blocks_of(values, small.values):
        assert value == round(float(block.mean()))
    assert Volume(values).downsampled(1).values.tolist() == values.tolist()
    halves = Volume(values.astype(np.float32) / 4).downsampled(2)
    assert halves.values.dtype == np.float32
    assert halves.values[0, 0, 0] == values[:2, :2, :2].mean() / 4


def test_down_sampled_voxels_lie_at_their_blocks_centres():
    """A field linear in the world is itself again where blocks are whole."""
    world = np.array([[0, -1, 0, 5], [2, 0, 0, 6], [0, 0, 3, 7], [0, 0, 0, 1]], float)

    def places(volume: Volume) -> np.ndarray:
        z, y, x = np.indices(volume.values.shape)
        index = np.stack([x, y, z, np.ones_like(x)])
        return np.einsum("ab,b...->a...", volume.world_from_index, index)[:3]

    volume = Volume(np.zeros((4, 8, 12), np.float32), world_from_index=world)
    field = np.tensordot([1, 2, 3], places(volume), 1).astype(np.float32)
    small = Volume(field, world_from_index=world).downsampled(2)
    assert small.spacing_mm == (4, 2, 6)
    assert np.allclose(small.values, np.tensordot([1, 2, 3], places(small), 1))


def test_down_sampled_labels_are_the_most_frequent():
    labels = np.random.default_rng(2).integers(0, 5, (5, 6, 7)).astype(np.uint8) * 50
    small = Volume(labels).downsampled(3, labels=True)
    assert small.values.dtype == np.uint8
    for value, block in blocks_of(labels, small.values):
        found, counts = np.unique(block, return_counts=True)
        assert value == found[counts.argmax()]


def test_a_volume_is_not_down_sampled_to_one_voxel():
    assert Volume(np.zeros((5, 9, 9))).downsampled(4).shape_xyz == (3, 3, 2)


class DataArray:
    """Fake with the attributes of xarray's that are used; xarray 2026.9 was tested as well."""

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
def test_axes_called_x_y_z_may_come_in_any_order(take, dims, order):
    volume = take(DataArray(VALUES, dims))
    assert np.array_equal(volume.values, VALUES.transpose(order)) and volume.spacing_mm == (1, 1, 1)


def test_axes_of_other_names_stay_in_their_order():
    volume = Volume.of(DataArray(VALUES, "lij", l=[0.0, 2.5]))
    assert volume.shape_xyz == (4, 3, 2) and volume.spacing_mm == (1, 1, 2.5)


def test_coordinates_give_the_geometry_by_default():
    """Rising or falling, whole numbers or not quite even float32."""
    x = np.float32([0.1, 0.2, 0.3, 0.4])
    given = DataArray(VALUES, "zyx", z=[7, 9], y=[3.0, 2.5, 2.0], x=x)
    volume = Volume(given)
    index, world = [[0, 0, 0, 1], [3, 2, 1, 1]], [[0.1, 3, 7], [0.4, 2, 9]]
    assert np.allclose((np.array(index) @ volume.world_from_index.T)[:, :3], world)
    assert np.allclose(volume.spacing_mm, (0.1, 0.5, 2))
    assert Volume(given, spacing_mm=(1, 2, 3)).world_from_index[:3, 3].tolist() == [0, 0, 0]
    assert Volume(given, world_from_index=np.diag([4.0, 5, 6, 1])).spacing_mm == (4, 5, 6)


GRID = pyvista.ImageData(dimensions=(3, 3, 3))
CUBE = np.zeros((2, 2, 2))
SPACINGS: tuple[Any, ...] = ((1, 1), "abc", ((1, 2), 3, 4), {}, (1j, 1, 1))
WORLDS: tuple[Any, ...] = ("abc", [[1, 2], [3]], np.eye(3), np.full((4, 4), np.inf))
FACTORS: tuple[Any, ...] = (0, -2, 1.5, "2", None)
UNEVEN: Any = ([0, 1, 3], [1, 1, 1], ["a", "b", "c"], [0, np.nan, 2], [0, 1, np.inf])
Row = tuple[Callable[[], object], str] | tuple[Callable[[], object], str, str]
REFUSED: list[Row] = [
    (lambda: Volume(CUBE, world_from_index=np.ones((4, 4))), "range"),
    *(
        (lambda mm=mm: Volume(CUBE, (mm, mm, 2 * mm), np.diag([mm, mm, mm, 1])), "conflict")
        for mm in (1.0, 1e-9)
    ),
    *(
        (lambda s=s: Volume(CUBE, spacing_mm=s, name="scan"), "type", "scan: spacing_mm")
        for s in SPACINGS
    ),
    *((lambda s=s: Volume(CUBE).with_spacing(s), "type", "volume: spacing_mm") for s in SPACINGS),
    *((lambda world=world: Volume(CUBE, world_from_index=world), "shape") for world in WORLDS),
    *(
        (lambda make=make, values=values: make(values), "shape" if values == 5 else "type")
        for make in (Volume, Volume.of)
        for values in ([[1, 2], [3]], "abc", None, 5)
    ),
    *(
        (lambda shape=shape: Volume(np.zeros(shape)), "shape")
        for shape in ((3, 3), (3, 3, 3, 2), (0, 3, 3), (1, 3, 3))
    ),
    (lambda: Volume(np.zeros((3, 3, 3), complex)), "type"),
    (lambda: Volume(np.full((3, 3, 3), np.nan)), "range"),
    (lambda: Volume(np.full((3, 3, 3), 1e300)), "range"),  # beyond float32
    *((lambda by=by: Volume(np.zeros((4, 4, 4))).downsampled(by), "range") for by in FACTORS),
    (lambda: Volume(np.zeros((5, 9, 9))).downsampled(5), "range"),
    *((lambda y=y: Volume(DataArray(VALUES, "zyx", y=np.array(y))), "range") for y in UNEVEN),
    (lambda: Volume(DataArray(VALUES[:1], "zyx", z=[5])), "shape"),
    (lambda: Volume(DataArray(VALUES[None], "tzyx", t=[5])), "shape"),
    # A Zarr group, an xarray Dataset, a dictionary.
    (lambda: Volume({"ct": VALUES, "labels": VALUES}), "type"),
    (lambda: Volume.of({}), "type"),
    (lambda: Volume(GRID), "type"),
    (lambda: Volume.of(pyvista.MultiBlock([GRID, GRID])), "type"),
]


@pytest.mark.parametrize("row", REFUSED, ids=range(len(REFUSED)))
def test_what_is_no_volume_is_refused(row):
    make, *code_and_field = row
    with raises(VolumeError, *code_and_field):
        make()
