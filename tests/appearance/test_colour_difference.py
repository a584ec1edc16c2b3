"""CIEDE2000 and CAM16-UCS against published data and against colour-science."""

from __future__ import annotations

import colour
import numpy as np
import pytest

from tests.appearance._models import CONDITIONS, D65, colours
from volspec.appearance import ViewingConditions
from volspec.appearance.difference import (
    XYZ_from_cam16_ucs,
    cam16_ucs,
    delta_E_CAM16,
    distance,
    uniform,
)
from volspec.appearance.models.cielab import cielab, delta_E_2000

# Sharma, Wu & Dalal (2005), table 1: pairs about the mean hue's turn (1-16), large differences
# (17-20) and small ones (25, 31, 34).
PUBLISHED = [
    ((50.0, 2.6772, -79.7751), (50.0, 0.0, -82.7485), 2.0425),
    ((50.0, 3.1571, -77.2803), (50.0, 0.0, -82.7485), 2.8615),
    ((50.0, 2.8361, -74.0200), (50.0, 0.0, -82.7485), 3.4412),
    ((50.0, -1.3802, -84.2814), (50.0, 0.0, -82.7485), 1.0000),
    ((50.0, 0.0, 0.0), (50.0, -1.0, 2.0), 2.3669),
    ((50.0, 2.49, -0.001), (50.0, -2.49, 0.0009), 7.1792),
    ((50.0, 2.49, -0.001), (50.0, -2.49, 0.0011), 7.2195),
    ((50.0, -0.001, 2.49), (50.0, 0.0009, -2.49), 4.8045),
    ((50.0, -0.001, 2.49), (50.0, 0.0011, -2.49), 4.7461),
    ((50.0, 2.5, 0.0), (50.0, 0.0, -2.5), 4.3065),
    ((50.0, 2.5, 0.0), (73.0, 25.0, -18.0), 27.1492),
    ((50.0, 2.5, 0.0), (61.0, -5.0, 29.0), 22.8977),
    ((60.2574, -34.0099, 36.2677), (60.4626, -34.1751, 39.4387), 1.2644),
    ((22.7233, 20.0904, -46.6940), (23.0331, 14.9730, -42.5619), 2.0373),
    ((2.0776, 0.0795, -1.1350), (0.9033, -0.0636, -0.5514), 0.9082),
]


@pytest.mark.parametrize(("one", "other", "difference"), PUBLISHED)
def test_published_pairs_differ_as_published(
    one: tuple[float, ...], other: tuple[float, ...], difference: float
) -> None:
    assert delta_E_2000(one, other) == pytest.approx(difference, abs=5e-5), "four decimals"
    assert delta_E_2000(other, one) == pytest.approx(difference, abs=5e-5), "symmetric"


def test_differences_are_those_of_colour_science() -> None:
    rng = np.random.default_rng(3)
    one = rng.uniform([0, -120, -120], [100, 120, 120], (20_000, 3))
    grey = one * [1, 0, 0]
    for other in (one + rng.normal(0, 8, one.shape), one[::-1], grey, one * [1, -1, -1], one):
        theirs = colour.delta_E(one, other, method="CIE 2000")
        # Sums in another order; measured 2e-13.
        np.testing.assert_allclose(delta_E_2000(one, other), theirs, rtol=1e-12, atol=1e-12)


def test_equal_colours_do_not_differ_and_shapes_broadcast() -> None:
    one = np.array([[0.0, 0.0, 0.0], [50.0, 20.0, -30.0], [100.0, 0.0, 0.0]])
    assert (delta_E_2000(one, one) == 0).all()
    assert delta_E_2000(one[:, None], one).shape == (3, 3)
    assert delta_E_2000(one[0], one[1]).shape == ()


@pytest.mark.parametrize("where", ["office under D65", "room under A", "television", "cinema"])
def test_cam16_ucs_is_that_of_colour_science(where: str) -> None:
    conditions = CONDITIONS[where]
    XYZ = colours(conditions.white_XYZ, 500)[:-1]
    theirs = colour.XYZ_to_CAM16UCS(
        XYZ / 100.0,
        XYZ_w=np.array(conditions.white_XYZ) / 100.0,
        L_A=conditions.L_A,
        Y_b=conditions.Y_b,
        surround=colour.appearance.InductionFactors_CAM16(*conditions.factors),
        discount_illuminant=conditions.discount,
    )
    ours = cam16_ucs(XYZ, conditions)
    np.testing.assert_allclose(ours, theirs, atol=1e-9)
    np.testing.assert_allclose(XYZ_from_cam16_ucs(ours, conditions), XYZ, rtol=1e-9, atol=1e-9)
    apart = colour.delta_E(ours[1:], ours[:-1], method="CAM16-UCS")
    np.testing.assert_allclose(delta_E_CAM16(ours[1:], ours[:-1]), apart, rtol=1e-12)


def test_cam16_ucs_has_colour_science_s_numbers_in_the_room_that_both_assume() -> None:
    seen = ViewingConditions((95.047, 100.0, 108.883))
    found = cam16_ucs([20.654008, 12.197225, 5.136952], seen)
    np.testing.assert_allclose(found, [46.06573617, 31.02084967, 10.95700456], atol=1e-8)


def test_differences_by_name() -> None:
    one, other = colours(D65, 50)[:40], colours(D65, 50)[10:50]
    by_name = {
        name: distance(name, *(uniform(name, XYZ, D65) for XYZ in (one, other)))
        for name in ("CIEDE2000", "CAM16-UCS")
    }
    Lab = [cielab(XYZ, D65) for XYZ in (one, other)]
    np.testing.assert_array_equal(by_name["CIEDE2000"], delta_E_2000(*Lab))
    assert np.corrcoef(*by_name.values())[0, 1] > 0.9
    # The eye is adapted to the white: black and white are 100 apart, and no grey has a colour.
    black, white = uniform("CAM16-UCS", [[0.0, 0.0, 0.0], D65], D65)
    assert distance("CAM16-UCS", black, white) == pytest.approx(100.0, abs=1e-9)
