"""CIECAM02, viewing conditions and the display's encoding against colour-science and reason."""

import math

import numpy as np
import pytest

from tests.appearance._models import CONDITIONS, A, colours
from volspec.appearance import Display, Viewing, ViewingConditions, view_transform
from volspec.appearance.constants import (
    ACHROMATIC,
    CHROMA_SKEW,
    CHROMA_SUM,
    OPPONENT_A,
    OPPONENT_B,
    RESPONSE_FROM_OPPONENT,
)
from volspec.appearance.models.cam import CamConditions, CamTransform, forward, inverse
from volspec.appearance.models.cielab import cielab, cielab_derivative
from volspec.appearance.presets import PRESETS, preset
from volspec.appearance.spaces import SPACES

SOME = ("room under A", "television", "cinema")


def conditions(name: str) -> CamConditions:
    return CamConditions.of_viewing(CONDITIONS[name])


@pytest.mark.parametrize("scene", SOME)
@pytest.mark.parametrize("display", SOME)
def test_one_step_transport_is_inverse_after_forward(scene, display):
    XYZ = colours(CONDITIONS[scene].white_XYZ, 2000)
    seen = forward(XYZ, conditions(scene))
    two_steps = inverse(seen.J, seen.C, seen.h, conditions(display))
    one_step = CamTransform.between(conditions(scene), conditions(display)).apply(XYZ)
    np.testing.assert_allclose(one_step, two_steps, atol=1e-9)


def test_opponent_weights_give_the_standard_s_inverse():
    printed = [[460.0, 451.0, 288.0], [460.0, -891.0, -261.0], [460.0, -220.0, -6300.0]]
    np.testing.assert_allclose(RESPONSE_FROM_OPPONENT * 1403.0, printed, atol=1e-9)
    # 23 (R + G + 21/20 B) + 11 a + 108 b = 23 p2, which the inverse of t rests on.
    skewed = CHROMA_SUM + CHROMA_SKEW @ np.stack([OPPONENT_A, OPPONENT_B])
    np.testing.assert_allclose(skewed, ACHROMATIC, atol=1e-15)


def test_cielab_derivative_is_its_slope():
    ratio = np.array([[0.5, 0.3, 0.9], [0.001, 0.02, 0.0], [-0.01, 1.0, 0.008]])
    h = 1e-6
    moved = (ratio[:, None] + h * np.eye(3), ratio[:, None] - h * np.eye(3))
    slope = (cielab(moved[0], np.ones(3)) - cielab(moved[1], np.ones(3))) / (2 * h)
    np.testing.assert_allclose(cielab_derivative(ratio), slope.swapaxes(1, 2), rtol=1e-6)


@pytest.mark.parametrize("size", [1e6, 1.0, 1e-30])
def test_no_finite_input_gives_nan(size):
    XYZ = np.random.default_rng(3).uniform(-size, size, (10_000, 3))
    for scene in SOME:
        transform = CamTransform.between(conditions(scene), conditions("room under A"))
        assert np.isfinite(transform.apply(XYZ)).all()


def test_black_and_colours_without_lightness_are_black():
    c = conditions("room under A")
    transform = CamTransform.between(c, conditions("television"))
    for XYZ in ([0.0, 0.0, 0.0], [-5.0, -5.0, -5.0], [0.0, -80.0, 30.0]):
        assert np.array_equal(transform.apply(XYZ), np.zeros(3))
    assert np.array_equal(inverse(0.0, 0.0, 120.0, c), np.zeros(3))
    # Nothing is black and has a chroma, or is darker than black.
    assert np.isnan(inverse([0.0, -3.0], [50.0, 0.0], [120.0, 10.0], c)).all()


def test_white_keeps_full_lightness_and_loses_its_tint_at_complete_adaptation():
    viewing = Viewing(D=1.0)
    display = CamConditions.of_viewing(viewing.display.conditions)
    shown = view_transform(viewing, A).apply(A)
    np.testing.assert_allclose(forward(shown, display).J, 100.0, atol=1e-9)
    tinted = view_transform(Viewing(D=0.6), A).apply(A)
    # Less adapted eyes see more of tungsten's yellow.
    assert shown[2] > tinted[2]


def test_adapting_luminance_follows_from_illuminance_and_background():
    assert Viewing(illuminance_lux=2000.0, Y_b=100.0).adapting_luminance == pytest.approx(
        636.62, abs=5e-3
    )
    assert Viewing(L_A=12.0).adapting_luminance == 12.0
    assert pytest.approx(63.66, abs=5e-3) == ViewingConditions.of_lux(A, 1000.0).L_A


def test_srgb_is_the_default_display():
    assert preset("sRGB").display() == Display()


def test_numbers_are_those_of_the_sources():
    # SMPTE ST 431-1; Moroney et al. 2002, table 1; ISO 3664 P1, as the errata of Neumann have it.
    assert preset("cinema").white_luminance == 48.0
    assert preset("dim room").L_A == 20.0
    assert pytest.approx(0.2 * preset("projector").white_luminance) == preset("projector").L_A
    assert preset("light booth").white_luminance == pytest.approx(636.62, abs=5e-3)
    assert pytest.approx(40.0 / math.pi) == preset("sRGB office").L_A


@pytest.mark.parametrize("name", PRESETS)
def test_every_preset_says_where_each_number_comes_from_and_can_be_used(name):
    given = PRESETS[name]
    assert given.name == name
    assert all(given.sources)
    assert hash(given) == hash(PRESETS[name])
    assert given.space in ("", *SPACES)
    assert given.white_luminance > given.L_A
    CamConditions.of_viewing(given.display().conditions)
    seen = CamConditions.of_viewing(given.conditions((96.42, 100.0, 82.49)))
    assert seen.L_A == given.L_A


def test_surrounds_darken_from_office_to_cinema():
    c = [preset(name).display().conditions.factors.c for name in ("sRGB", "dim room", "cinema")]
    assert c == sorted(c, reverse=True)
