"""Transfer functions of value and gradient: where regions are, how they mix, what is refused."""

import math
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.support.errors import refuses
from tests.support.transfers import BASIS, COPPER, MATERIALS, STEEL
from tests.support.transfers import regions as function
from volspec.errors import TransferError, VolspecWarning
from volspec.transfer import Region, TransferFunction2D


def test_a_region_is_full_inside_and_falls_smoothly_to_its_rim():
    region = Region((0, 40), (10, 30), 0.8, "copper", softness=0.5)
    table = function(region).bake(1.0, size=(41, 31))
    assert table.domain == (0, 40) and table.gradient_top == 30
    assert np.allclose(table.opacity[15:26, 10:31], 0.8)
    # Half of the half-width of 20 is soft: a quarter of it is smoothstep(1/4) = 5/32.
    assert np.allclose(table.opacity[20, [0, 2, 5, 8, 10]] / 0.8, [0, 0.104, 0.5, 0.896, 1])
    assert np.allclose(table.opacity[[10, 12, 30], 20] / 0.8, [0, 0.352, 0])
    assert not table.opacity[:10].any()
    # Both sides fall in a corner.
    assert np.isclose(table.opacity[12, 5], 0.8 * 0.352 * 0.5)


def test_a_region_to_infinity_stays_open_upwards():
    open_up = Region((0, 10), (20, math.inf), 0.5, "copper", softness=1)
    table = function(open_up).bake(1.0, size=(11, 41))
    assert table.gradient_top == 40
    # Soft over half of the nominal 20 to 40.
    assert np.allclose(table.opacity[[20, 25, 30, 40], 5], [0, 0.25, 0.5, 0.5])
    closed = Region((0, 10), (0, 100), 0.5, "steel")
    higher = function(open_up, closed).bake(1.0, size=(11, 41))
    assert higher.gradient_top == 100 and higher.opacity[-1, 5] == 0.5
    everywhere = function(Region((0, 10), (0, math.inf), 0.5, "copper")).bake(1.0)
    assert everywhere.opacity[:, 100].tolist() == [0.5] * 64


def test_a_hard_region_is_a_step():
    table = function(Region((0, 10), (0, 10), 0.5, "copper", softness=0)).bake(1.0, size=(11, 11))
    assert np.array_equal(table.opacity[:10, 1:10], np.full((10, 9), 0.5))
    assert not table.opacity[10].any() and not table.opacity[:, [0, 10]].any()


def test_overlapping_regions_mix_by_opacity():
    first = Region((0, 20), (0, 10), 0.2, "copper", softness=0)
    second = Region((10, 30), (0, 10), 0.6, {"steel": 0.5}, softness=0)
    table = function(first, second).bake(1.0, size=(31, 11))
    assert np.allclose(table.opacity[5, [5, 15, 25]], [0.2, 1 - 0.8 * 0.4, 0.6])
    mixed = (0.2 * COPPER + 0.6 * 0.5 * STEEL) / 0.8
    assert np.allclose(table.coefficients[5, [5, 15, 25]], [COPPER, mixed, 0.5 * STEEL])


def test_entries_around_a_region_have_its_colour():
    left = Region((0, 10), (0, 10), 0.5, "copper", softness=0)
    right = Region((20, 30), (5, 10), 0.5, "steel", softness=0)
    off = Region((10, 20), (0, 20), 0.0, "gold")
    table = function(left, right, off).bake(1.0, size=(31, 21))
    assert table.channels.shape == (2, 7)  # what is transparent lends nothing
    shares = table.material_weights
    assert (shares[:, :15] == [1, 0]).all() and (shares[5:, 16:] == [0, 1]).all()


@pytest.mark.filterwarnings("ignore:.*too narrow")
@settings(derandomize=True, deadline=None, max_examples=20)
@given(
    st.lists(
        st.builds(
            lambda v, dv, g, dg, *look: Region((v, v + dv), (g, g + dg), *look),
            st.floats(-100, 100),
            st.floats(5, 100),
            st.just(0.0) | st.floats(1e-30, 50),
            st.floats(5, 50) | st.just(math.inf),
            st.floats(0, 1),
            st.sampled_from(sorted(MATERIALS)),
            st.floats(0, 1),
        ),
        min_size=1,
        max_size=5,
    )
)
def test_any_regions_are_transparent_at_both_ends_and_fully_coloured(regions):
    table = function(*regions).bake(1.0, size=(64, 16))
    assert not table.opacity[:, [0, -1]].any()
    assert np.allclose(table.material_weights.sum(axis=-1), 1)
    if all(math.isfinite(region.gradients[1]) for region in regions):
        assert not table.opacity[-1].any()


@settings(derandomize=True, deadline=None, max_examples=20)
@given(st.floats(0.1, 1), st.floats(0, 1), st.permutations(range(3)))
def test_the_order_of_regions_does_not_matter(opacity, softness, order):
    regions = [
        Region((0, 50), (0, 20), opacity, "copper", softness),
        Region((20, 80), (10, 40), 0.5, "steel"),
        Region((60, 90), (30, math.inf), 0.9, "gold"),
    ]
    one, other = function(*regions).bake(1), function(*(regions[i] for i in order)).bake(1)
    assert np.allclose(one.opacity, other.opacity)
    seen = one.opacity > 0
    assert np.allclose(one.coefficients[seen], other.coefficients[seen])


def test_narrow_regions_get_more_entries_or_a_warning():
    wide = Region((0, 1000), (0, 1000), 0.1, "steel")
    assert function(wide).bake(1.0).opacity.shape == (64, 256)
    table = function(wide, Region((500, 505), (500, 520), 1, "copper")).bake(1.0)
    assert table.opacity.shape == (256, 1024) and table.opacity.max() > 0.9
    with pytest.warns(VolspecWarning) as caught:
        function(wide, Region((500.1, 500.2), (0, 20), 1, "copper")).bake(1.0)
    assert caught[0].filename == __file__


def of_regions(regions: Any) -> TransferFunction2D:
    return TransferFunction2D(regions, MATERIALS, BASIS)


def region(**change: Any) -> Region:
    good = {"values": (0, 1), "gradients": (0, 1), "opacity": 0.5, "material": "gold"}
    return Region(**{**good, **change})


@pytest.mark.parametrize(
    ("make", "expected"),
    [
        (lambda: region(values=(5, 1)), "range Region.values"),
        (lambda: region(values=(5, 5)), "range Region.values"),
        (lambda: region(values=(5, 1e39)), "range Region.values"),
        (lambda: region(values=(1, "5")), "type Region.values[1]"),
        (lambda: region(gradients=(-1, 5)), "range Region.gradients"),
        (lambda: region(gradients=(5e-324, math.inf)), "range Region.gradients"),
        (lambda: region(opacity=2), "range Region.opacity"),
        (lambda: region(softness=-0.1), "range Region.softness"),
        (lambda: region(material={"gold": 1.5}), "range Region.material"),
        (lambda: of_regions([]), "missing TransferFunction2D.regions"),
        (
            lambda: of_regions([region(material="glod")]),
            "unknown TransferFunction2D.regions[0].material",
        ),
    ],
)
def test_bad_regions_are_named(make, expected):
    refuses(make, expected, TransferError)
