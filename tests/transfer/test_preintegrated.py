"""Pre-integration: means of a transfer function over the values that a step passes."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from tests.support.errors import raises
from volspec.errors import ShapeError, TransferError
from volspec.transfer import TransferTable, integral_rows, segment_means

STEP = 0.5


def curve(size: int = 40, seed: int = 1) -> TransferTable:
    """Noise from transparent to opaque, over values -20…100."""
    rng = np.random.default_rng(seed)
    opacity = rng.uniform(0, 1, size)
    opacity[[size // 3, size // 2]] = 0, 1
    return TransferTable((-20.0, 100.0), opacity, rng.uniform(0, 1, (size, 2)), 1.0)


def rates(table: TransferTable) -> NDArray[np.float64]:
    """(N, 1 + K) by the definition."""
    tau = -np.log(np.maximum((1 - table.opacity) ** STEP, 1e-6))
    return np.concatenate([tau[:, None], tau[:, None] * table.material_weights], axis=1)


def brute_means(table: TransferTable, front: float, back: float) -> NDArray[np.float64]:
    """The mean of 200 000 samples between two values."""
    values = front + (back - front) * (np.arange(200_000) + 0.5) / 200_000
    at = np.linspace(*table.domain, len(table.opacity))
    return np.array([np.interp(values, at, column).mean() for column in rates(table).T])


@pytest.mark.parametrize(
    ("front", "back"),
    [(-20, 100), (100, -20), (3, 17.5), (30, 30.9), (-50, 10), (60, 500), (-90, 300), (-90, -40)],
)
def test_means_are_those_of_many_samples(front, back):
    """The middle rule's error over 200 000 samples of kinks is below 1e-8; measured 6e-9."""
    table = curve()
    (mean,) = segment_means(table, STEP, [front], [back])
    assert np.allclose(mean, brute_means(table, front, back), atol=1e-7)


def test_the_kernel_s_rows_give_the_same_integral():
    """Two float32 hold 48 bits of the integral; rates hold 24, so 1e-7 of the largest, 14."""
    table = curve(1024)
    rows = integral_rows(table, STEP)
    assert all(each.dtype == np.float32 and each.shape == (1024, 3) for each in rows)
    high, low, c, rises = (each.astype(np.float64) for each in rows)
    assert np.allclose(c, rates(table), rtol=1e-7, atol=0)
    assert np.allclose(rises[:-1], np.diff(rates(table), axis=0), rtol=1e-6)
    assert not rises[-1].any()
    entry = np.array([0, 1, 30, 511, 800, 1022])
    f = np.array([0.0, 0.3, 0.5, 1.0, 0.9, 1.0])[:, None]
    integral = high[entry] + low[entry] + f * (c[entry] + f * rises[entry] / 2)
    value = -20 + (entry + f[:, 0]) / 1023 * 120
    means = segment_means(table, STEP, np.full(6, -20.0), value)
    gathered = means * (entry + f[:, 0])[:, None]
    assert np.allclose(integral, gathered, atol=3e-6)


def test_two_floats_keep_what_one_would_lose():
    """Far along a long opaque table an entry adds 14 to 900 000: one float32 is 0.06 off."""
    table = TransferTable((0, 1), np.ones(65536), np.ones((65536, 1)), 1.0)
    high, low, c, _ = integral_rows(table, STEP)
    exact = np.arange(65536) * -math.log(1e-6)
    whole = high[:, 0].astype(np.float64) + low[:, 0]
    assert np.abs(high[:, 0] - exact).max() > 0.02
    assert np.allclose(whole, exact, rtol=1e-12, atol=0)
    assert np.all(c == np.float32(-math.log(1e-6)))


@settings(derandomize=True, deadline=None, max_examples=25)
@given(st.floats(0, 1), st.floats(-50, 150), st.floats(-50, 150))
def test_a_constant_table_has_its_own_rate_between_any_values(opacity, front, back):
    table = TransferTable((0, 100), np.full(9, opacity), np.full((9, 1), 0.25), 1.0)
    tau = -math.log(max((1 - opacity) ** STEP, 1e-6))
    assert np.allclose(segment_means(table, STEP, [front], [back]), [tau, tau / 4])


@settings(derandomize=True, deadline=None, max_examples=40)
@given(st.integers(0, 5), st.floats(-60, 140), st.floats(-60, 140))
def test_means_lie_between_extremes_and_have_no_direction(seed, front, back):
    table = curve(seed=seed)
    c = rates(table)
    there, here = segment_means(table, STEP, [front, back], [back, front])
    assert np.allclose(there, here)
    assert (there >= c.min(axis=0) - 1e-9).all() and (there <= c.max(axis=0) + 1e-9).all()


@settings(derandomize=True, deadline=None, max_examples=40)
@given(st.floats(-60, 140), st.floats(-60, 140), st.floats(-60, 140))
def test_parts_of_a_segment_add_up(a, b, c):
    """Ends nearer than 1/64 entry take their middle: at a kink of 28, 28 / 64² / 8 entries off."""
    ab, bc, ac = segment_means(curve(), STEP, [a, b, a], [b, c, c])
    assert np.allclose(ab * (b - a) + bc * (c - b), ac * (c - a), atol=3e-3)


def test_near_ends_take_the_values_in_their_middle():
    table = curve(121)  # an entry a value
    c = rates(table)
    means = segment_means(table, STEP, [0.0, 5.0, 200.0, -99.0], [0.0, 5.015, 200.0, -99.0])
    f = 0.0075
    assert np.allclose(means, [c[20], (1 - f) * c[25] + f * c[26], c[-1], c[0]])


def test_at_the_smallest_distance_both_ways_agree():
    """The mean of c, linear between two entries, is the value in the middle."""
    table = curve(121)
    gap = 1 / 64
    means = segment_means(table, STEP, [5.3, 5.3], [5.3 + 1.01 * gap, 5.3 + 0.99 * gap])
    slope = np.abs(np.diff(rates(table), axis=0)).max()
    assert np.abs(means[0] - means[1]).max() < 0.02 * gap * slope


GRADIENTS = TransferTable((0, 7), np.zeros((3, 8)), np.zeros((3, 8, 2)), 1.0, gradient_top=5.0)
LABELS = TransferTable((0, 7), np.zeros(8), np.zeros((8, 2)), 1.0, labels=True)


@pytest.mark.parametrize(
    ("make", "error", "expected"),
    [
        (lambda: integral_rows(GRADIENTS, STEP), TransferError, "unsupported"),
        (lambda: integral_rows(LABELS, STEP), TransferError, "unsupported"),
        (lambda: segment_means(GRADIENTS, STEP, [0], [1]), TransferError, "unsupported"),
        *(
            (lambda step=step: integral_rows(curve(), step), TransferError, "range")
            for step in (0.0, -1.0, math.nan, math.inf)
        ),
        *(
            (lambda ends=ends: segment_means(curve(), STEP, *ends), ShapeError, "shape")
            for ends in (([0, 1], [0]), (0, 1), ([[0]], [[1]]))
        ),
    ],
)
def test_what_cannot_be_integrated_is_refused(make, error, expected):
    with raises(error, expected):
        make()
