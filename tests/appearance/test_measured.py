"""Viewing conditions from a picture: solid angles with known answers."""

import math

import numpy as np
import pytest

from volspec.appearance.measured import adapting_fields, measured_conditions
from volspec.appearance.models.cam import CamConditions

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
        assert seen.Y_b == pytest.approx(18.0, rel=1e-12)
        assert pytest.approx(36.0, rel=1e-12) == seen.L_A
        assert seen.white_XYZ == WHITE
    Y_b, L_A = adapting_fields(picture, fov_deg, 200.0)
    assert Y_b.shape == L_A.shape == shape
    np.testing.assert_allclose(Y_b, 18.0, rtol=1e-12)
    np.testing.assert_allclose(L_A, 36.0, rtol=1e-12)


@pytest.mark.parametrize("radius_deg", [3.0, 5.0, 9.0])
def test_a_disc_counts_by_its_solid_angle(radius_deg):
    Y = np.where(angles_deg((512, 512), 40.0) < radius_deg, 100.0, 0.0)
    share = (cap(radius_deg) - cap(1.0)) / (cap(11.0) - cap(1.0))
    seen = measured_conditions(Y, WHITE, 40.0, 100.0)
    # A rim of pixels of 0.08°: measured 0.02.
    assert seen.Y_b == pytest.approx(100.0 * share, abs=0.1)
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
    assert seen.Y_b == pytest.approx(10.0, abs=1e-6)
    assert pytest.approx(10.0, abs=1e-6) == seen.L_A


def test_maps_are_the_one_place_measurement_everywhere():
    rng = np.random.default_rng(3)
    coarse = rng.random((8, 12)) * 100.0
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
