"""Bricks: bounds that no sample leaves, and what they make of tables and levels."""

import tracemalloc

import numpy as np
import pytest

from volspec.raycast.launch.bricks import (
    BRICK,
    FURTHEST,
    brick_ranges,
    chessboard_distance,
    opacity_spread,
    straddled_bricks,
    visible_bricks,
)


@pytest.mark.parametrize("dtype", ["u1", "u2", "i2", "f4"])
@pytest.mark.parametrize("shape", [(2, 2, 2), (8, 9, 7), (16, 17, 33), (25, 8, 40), (9, 64, 2)])
def test_ranges_are_those_of_one_voxel_more_than_a_brick_has(shape, dtype):
    values = np.random.default_rng(3).integers(0, 200, shape).astype(dtype)
    low, high = brick_ranges(values)
    assert low.dtype == high.dtype == values.dtype
    assert low.flags.c_contiguous and high.flags.c_contiguous
    assert low.shape == tuple(-(-n // BRICK) for n in shape)
    for brick in np.ndindex(low.shape):
        part = values[tuple(slice(b * BRICK, b * BRICK + BRICK + 1) for b in brick)]
        assert (low[brick], high[brick]) == (part.min(), part.max())


def test_ranges_need_little_memory(engine):
    """Two results and a slice at a time: 2.4 % of 7 MB measured."""
    tracemalloc.start()
    brick_ranges(engine.values)
    _, most = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert most < 0.15 * engine.values.nbytes


@pytest.fixture(scope="module")
def ranges() -> tuple[np.ndarray, np.ndarray]:
    rng = np.random.default_rng(4)
    low = rng.uniform(-0.2, 1.1, (4, 5, 6))
    return low, low + rng.uniform(0, 0.4, low.shape) * rng.integers(0, 2, low.shape)


TABLE = np.array([0, 0, 0.2, 0.1, 0, 0, 0.9, 0, 0, 0, 0.3])


@pytest.mark.parametrize("entries", [2, 11, 257, 65536])
def test_visibility_and_spread_are_those_of_every_entry_a_value_can_read(ranges, entries):
    low, high = ranges
    opacity = np.interp(np.linspace(0, 10, entries), np.arange(11), TABLE).astype(np.float32)
    visible = visible_bricks(low, high, (0, 1), opacity)
    spread = opacity_spread(low, high, (0, 1), opacity)
    for brick in np.ndindex(low.shape):
        first = int(np.clip(np.floor(low[brick] * (entries - 1)), 0, entries - 1))
        last = int(np.clip(np.ceil(high[brick] * (entries - 1)), 0, entries - 1))
        reached = opacity[first : last + 1]
        assert visible[brick] == (reached > 0).any()
        assert spread[brick] == reached.max() - reached.min()
    assert spread.dtype == np.float32


@pytest.mark.parametrize("dtype", ["u1", "i1", "u2", "i2"])
def test_small_integers_are_as_visible_as_floats(dtype):
    """Also where nothing above a brick's least value is visible."""
    span = np.iinfo(dtype)
    low, high = np.sort(np.random.default_rng(6).integers(span.min, span.max, (2, 3, 30, 40)), 0)
    for domain in ((span.min, span.max), (span.min / 3, span.max / 2)):
        as_floats = visible_bricks(*(np.float64(v) for v in (low, high)), domain, TABLE[:10])
        ours = visible_bricks(low.astype(dtype), high.astype(dtype), domain, TABLE[:10])
        assert np.array_equal(ours, as_floats)
        assert ours.any() and not ours.all()


def test_a_brick_is_visible_where_any_gradient_s_row_is(ranges):
    rows = np.stack([TABLE * (np.arange(11) < 4), TABLE * (np.arange(11) > 8)])
    union, one, other = (visible_bricks(*ranges, (0, 1), each) for each in (rows, *rows))
    assert np.array_equal(union, one | other)
    assert union.any() and not union.all()
    apart = np.array([[0.2] * 11, [0.7] * 11])
    assert np.allclose(opacity_spread(*ranges, (0, 1), apart), 0.5)


def test_labels_between_a_brick_s_least_and_greatest_count_and_none_beyond_the_table():
    """Values would take the table's ends, here both opaque."""
    opacity = np.array([0.5, 0.0, 0.5])
    low = np.array([[[-3, -3, 3, 2, 2, 1, 0]]], np.int16)
    high = np.array([[[-1, 0, 9, 2, 9, 1, 2]]], np.int16)
    given = low, high, (0, 2), opacity
    assert visible_bricks(*given, labels=True).astype(int).tolist() == [[[0, 1, 0, 1, 1, 0, 1]]]
    assert opacity_spread(*given, labels=True).tolist() == [[[0.0, 0.5, 0.0, 0.0, 0.5, 0.0, 0.5]]]
    assert visible_bricks(low[..., :5], high[..., :5], (0, 2), opacity).all()


@pytest.mark.parametrize("dtype", ["u1", "i2", "f4"])
def test_a_level_straddles_the_bricks_whose_range_holds_it(dtype):
    rng = np.random.default_rng(5)
    low = rng.integers(0, 100, (3, 4, 5)).astype(dtype)
    high = low + rng.integers(0, 20, low.shape).astype(dtype)
    for levels in ([50.0], [90.5, 3, 47], [300.0], []):
        each = [(low <= level) & (level <= high) for level in levels]
        expected = np.any(each, axis=0) if each else np.zeros(low.shape, bool)
        assert np.array_equal(straddled_bricks(low, high, np.array(levels)), expected)


def test_a_level_straddles_as_float32():
    """0.1 as float32 is above 0.1 as a double; the kernel sees them equal."""
    same = np.full((1, 1, 1), 0.1, np.float32)
    assert straddled_bricks(same, same, np.array([0.1])).all()


def test_leaps_are_chessboard_distances_up_to_the_furthest():
    visible = np.zeros((5, 6, 7), bool)
    assert (chessboard_distance(visible) == FURTHEST).all()
    assert chessboard_distance(~visible).flags.c_contiguous
    long = np.zeros((2, 2, 300), bool)
    long[..., 0] = True
    assert np.array_equal(chessboard_distance(long)[1, 1], np.minimum(np.arange(300), FURTHEST))


@pytest.mark.parametrize("shape", [(20, 31, 27), (34, 26, 21), (21, 34, 3), (9, 5, 1), (3, 2, 80)])
def test_leaps_are_chessboard_distances_among_many_bricks(shape):
    rng = np.random.default_rng(5)
    for _ in range(8):
        many = rng.random(shape) > 0.999
        many.flat[rng.integers(many.size)] = True
        away = np.indices(shape)[:, None] - np.argwhere(many).T[:, :, None, None, None]
        nearest = np.abs(away).max(axis=0).min(axis=0)
        assert np.array_equal(chessboard_distance(many), np.minimum(nearest, FURTHEST))
