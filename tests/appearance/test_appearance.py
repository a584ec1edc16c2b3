"""CIECAM02 and viewing conditions: against reason, named ones, and measured in pictures."""

import math

import numpy as np
import pytest

from tests.appearance._models import CONDITIONS, A, colours
from volspec.appearance import Viewing, ViewingConditions, view_transform
from volspec.appearance.display import constants
from volspec.appearance.display.monitors import PRESETS, preset
from volspec.appearance.display.spaces import SPACES
from volspec.appearance.measured import adapting_fields, measured_conditions
from volspec.appearance.models.cam import CamConditions, CamTransform, forward, inverse
from volspec.appearance.models.lab import cielab, cielab_derivative

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
    np.testing.assert_allclose(constants.RESPONSE_FROM_OPPONENT * 1403.0, printed, atol=1e-9)
    # 23 (R + G + 21/20 B) + 11 a + 108 b = 23 p2, which the inverse of t rests on.
    opponents = np.stack([constants.OPPONENT_A, constants.OPPONENT_B])
    skewed = constants.CHROMA_SUM + constants.CHROMA_SKEW @ opponents
    np.testing.assert_allclose(skewed, constants.ACHROMATIC, atol=1e-15)


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
    lit = Viewing(illuminance_lux=2000.0, Y_b=100.0)
    assert lit.adapting_luminance == pytest.approx(636.62, abs=5e-3)
    assert Viewing(L_A=12.0).adapting_luminance == 12.0
    assert pytest.approx(63.66, abs=5e-3) == ViewingConditions.of_lux(A, 1000.0).L_A


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
    assert given.name == name and all(given.sources) and given.space in ("", *SPACES)
    assert given.white_luminance > given.L_A
    CamConditions.of_viewing(given.display().conditions)
    assert CamConditions.of_viewing(given.conditions((96.42, 100.0, 82.49))).L_A == given.L_A


WHITE = (95.05, 100.0, 108.88)


def angles_deg(shape: tuple[int, int], fov_deg: float) -> np.ndarray:
    """(H, W) angle of every pixel to the line of sight through the middle."""
    height, width = shape
    scale = 2.0 * math.tan(math.radians(fov_deg) / 2.0) / height
    u, v = np.meshgrid(np.arange(width) - (width - 1) / 2, np.arange(height) - (height - 1) / 2)
    return np.degrees(np.arctan(np.hypot(u, v) * scale))


def cap(degrees: float) -> float:
    """Solid angle of a cone around its axis, over 2π."""
    return 1.0 - math.cos(math.radians(degrees))


@pytest.mark.parametrize("fov_deg", [2.0, 60.0, 120.0])
@pytest.mark.parametrize("shape", [(1, 1), (1, 7), (300, 2), (64, 96)])
def test_a_uniform_picture_of_any_shape_gives_its_own_Y(fov_deg, shape):
    picture = np.full(shape, 18.0)
    for at in (None, (0, 0)):
        seen = measured_conditions(picture, WHITE, fov_deg, 200.0, at)
        assert (seen.Y_b, seen.L_A) == pytest.approx((18.0, 36.0), rel=1e-12)
        assert seen.white_XYZ == WHITE
    Y_b, L_A = adapting_fields(picture, fov_deg, 200.0)
    np.testing.assert_allclose(Y_b, np.full(shape, 18.0), rtol=1e-12, strict=True)
    np.testing.assert_allclose(L_A, np.full(shape, 36.0), rtol=1e-12, strict=True)


@pytest.mark.parametrize("radius_deg", [3.0, 5.0, 9.0])
def test_a_disc_counts_by_its_solid_angle(radius_deg):
    Y = np.where(angles_deg((512, 512), 40.0) < radius_deg, 100.0, 0.0)
    share = (cap(radius_deg) - cap(1.0)) / (cap(11.0) - cap(1.0))
    # A rim of pixels of 0.08°: measured 0.02.
    assert measured_conditions(Y, WHITE, 40.0, 100.0).Y_b == pytest.approx(100.0 * share, abs=0.1)
    Y_b, _ = adapting_fields(Y, 40.0)
    # Cells of 0.8°; measured 0.06.
    assert Y_b[256, 256] == pytest.approx(100.0 * share, abs=0.3)


def test_what_is_looked_at_is_not_its_own_background():
    Y = np.where(angles_deg((512, 512), 40.0) < 0.9, 100.0, 20.0)
    assert measured_conditions(Y, WHITE, 40.0, 100.0).Y_b == pytest.approx(20.0, abs=0.05)


def test_an_annulus_beyond_11_degrees_counts_for_L_A_by_its_solid_angle():
    angle = angles_deg((600, 600), 60.0)
    Y = np.where((angle > 15.0) & (angle < 25.0), 80.0, 0.0)
    share = (cap(25.0) - cap(15.0)) / (cap(90.0) - cap(11.0))
    seen = measured_conditions(Y, WHITE, 60.0, 500.0, outside=0.0)
    assert pytest.approx(0.8 * 500.0 * share, rel=2e-3) == seen.L_A
    assert seen.Y_b == 0.0
    _, L_A = adapting_fields(Y, 60.0, 500.0, outside=0.0)
    assert L_A[300, 300] == pytest.approx(0.8 * 500.0 * share, rel=5e-3)


@pytest.mark.parametrize(("at", "share"), [((-0.5, 255.5), 0.5), ((-0.5, -0.5), 0.25)])
def test_at_edges_the_rest_is_what_is_outside(at, share):
    Y = np.full((512, 512), 100.0)
    seen = measured_conditions(Y, WHITE, 60.0, 100.0, at, outside=0.0)
    # Planes through the line of sight halve a cone; two cut out more than a quarter, as the
    # picture's corner is wider than a right angle seen from inside.
    if share == 0.5:
        assert seen.Y_b == pytest.approx(50.0, abs=0.05)
    else:
        corner = math.tan(math.radians(30.0))
        u = np.array([-corner, -corner, 1.0])
        n1, n2 = np.array([1.0, 0.0, corner]), np.array([0.0, 1.0, corner])
        between = math.acos(n1 @ n2 / np.linalg.norm(n1) / np.linalg.norm(n2))
        assert abs(u @ n1) < 1e-12
        assert seen.Y_b == pytest.approx(100.0 * (math.pi - between) / (2.0 * math.pi), abs=0.05)
    x, y = (max(round(v), 0) for v in at)
    Y_b, _ = adapting_fields(Y, 60.0, outside=0.0)
    assert Y_b[min(y, 511), x] == pytest.approx(seen.Y_b, abs=1.0)


def test_a_small_picture_is_mostly_what_is_outside():
    seen = measured_conditions(np.full((32, 32), 100.0), WHITE, 1.0, 100.0, outside=10.0)
    assert (seen.Y_b, seen.L_A) == pytest.approx((10.0, 10.0), abs=1e-6)


def test_maps_are_the_one_place_measurement_everywhere():
    coarse = np.random.default_rng(3).random((8, 12)) * 100.0
    Y = np.kron(coarse, np.ones((25, 25)))
    Y_b, L_A = adapting_fields(Y, 50.0, 300.0, outside=20.0)
    for x, y in ((0, 0), (299, 199), (150, 100), (13, 180), (299, 0), (77, 31)):
        seen = measured_conditions(Y, WHITE, 50.0, 300.0, (x, y), outside=20.0)
        # Cells of 1.4° and straight lines between them; measured 0.3 of Y, 0.03 cd/m².
        assert Y_b[y, x] == pytest.approx(seen.Y_b, abs=1.0), (x, y, Y_b[y, x], seen.Y_b)
        assert L_A[y, x] == pytest.approx(seen.L_A, abs=0.2), (x, y, L_A[y, x], seen.L_A)


def test_the_surround_follows_from_the_ratio_where_asked():
    dark = np.full((32, 32), 5.0)
    assert measured_conditions(dark, WHITE, 30.0, 100.0).surround == "average"
    seen = measured_conditions(dark, WHITE, 30.0, 100.0, surround=None)
    assert seen.surround == pytest.approx(0.05)
    lit = measured_conditions(np.full((32, 32), 300.0), WHITE, 30.0, 100.0, surround=None)
    assert lit.surround == 1.0


def test_a_black_picture_has_conditions_that_models_take():
    seen = measured_conditions(np.full((8, 8), -1e-3), WHITE, 30.0, 100.0)
    assert (seen.Y_b, seen.L_A) == (0.0, 0.0)
    assert CamConditions.of_viewing(seen).white_achromatic > 0.0
