"""CIECAM02, viewing conditions and the display's encoding against colour-science and reason."""

import numpy as np
import pytest

from tests.appearance._models import CONDITIONS, A, colours
from tests.support.errors import refuses
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
from volspec.errors import ViewingError

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


@pytest.mark.parametrize(
    "make, message",
    [
        (lambda: Viewing(model="ciecam"), "unknown Viewing.model"),
        (lambda: Viewing(surround="dimm"), "unknown Viewing.surround"),
        (lambda: Viewing(Y_b=-1.0), "range Viewing.Y_b"),
        (lambda: Viewing(L_A=float("nan")), "range Viewing.L_A"),
        (lambda: Viewing(D=1.5), "range Viewing.D"),
        (lambda: Viewing(surround="bright"), "unknown Viewing.surround"),
        (lambda: Viewing(Y_b=1e4), "range Viewing.Y_b"),
        (lambda: Display(Y_b=1e300), "range Display.Y_b"),
        (lambda: ViewingConditions(A, Y_b=1e4), "range ViewingConditions.Y_b"),
        (lambda: ViewingConditions((1.0985, 1, 0.3558)), "range ViewingConditions.white_XYZ"),
        (lambda: ViewingConditions((1e-300,) * 3), "range ViewingConditions.white_XYZ"),
        (lambda: ViewingConditions((1e300,) * 3), "range ViewingConditions.white_XYZ"),
        (lambda: ViewingConditions((95, 100, 1e-300)), "range ViewingConditions.white_XYZ"),
        (lambda: ViewingConditions.of_lux(A, 0.0), "range illuminance_lux"),
        (lambda: Viewing(illuminance_lux=0.0), "range Viewing.illuminance_lux"),
        (lambda: Viewing(D=0.5, discount=True), "conflict Viewing.D"),
        (lambda: ViewingConditions(A, D=1.0, discount=True), "conflict ViewingConditions.D"),
        (lambda: Viewing(fov_deg=1e-300), "range Viewing.fov_deg"),
        (lambda: Viewing(fov_deg=179.0), "range Viewing.fov_deg"),
        (lambda: Viewing(exposure=1e30), "range Viewing.exposure"),
        (lambda: Viewing(exposure=-1.0), "range Viewing.exposure"),
        (lambda: Viewing(illuminance_lux=True), "type Viewing.illuminance_lux"),
        (lambda: Display(L_A=-4.0), "range Display.L_A"),
        (
            lambda: CamConditions.of((0.0, 0.0, 0.0), 60.0, 20.0),
            "range viewing conditions.white_XYZ",
        ),
        (
            lambda: CamConditions.of((10.0, 1.0, 90.0), 60.0, 20.0, D=0.0),
            "impossible viewing conditions",
        ),
    ],
)
def test_bad_conditions_are_refused_in_one_line(make, message):
    refuses(make, message, ViewingError)
