"""Form factors of the brick are exact, and its radiosity keeps the energy."""

import numpy as np
import pytest

from tests.support.errors import refuses
from volspec.errors import RoomError
from volspec.room import cube_radiosity, lux_from_irradiance
from volspec.room.brick import PATCHES, SURFACES, Brick, exchange_area
from volspec.spectra import DEFAULT_GRID, SpectralGrid, light

BANDS = DEFAULT_GRID.size
THREE = SpectralGrid(450.0, 650.0, 100.0)
OFFICE = Brick(4.0, 5.0, 2.7, window_m=(1.0, 0.9, 2.0, 1.4), furnished=0.3)
ROOMS = [
    OFFICE,
    Brick(1.0, 1.0, 1.0),
    Brick(3.0, 12.0, 2.2, window_m=(0.0, 0.0, 3.0, 2.2), furnished=1.0),
    Brick(20.0, 8.0, 4.0, window_m=(0.5, 1.0, 19.0, 2.9), furnished=0.01),
    Brick(0.3, 0.2, 0.1, window_m=(0.1, 0.02, 0.2, 0.05), furnished=0.9),
]


def quadrature(one, other) -> float:
    """Return A_1 F_12 of two rectangles by Gauss-Legendre quadrature over their four ranges."""
    nodes, weights = np.polynomial.legendre.leggauss(24)
    points, areas, normals = [], [], []
    for rectangle in (np.array(one, dtype=float), np.array(other, dtype=float)):
        low, size = rectangle[:, 0], np.ptp(rectangle, axis=1)
        u, v = np.flatnonzero(size)
        grid = np.tile(low, (24, 24, 1))
        grid[..., u] += size[u] * (nodes[:, None] + 1) / 2
        grid[..., v] += size[v] * (nodes[None, :] + 1) / 2
        points.append(grid.reshape(-1, 3))
        areas.append(np.outer(weights, weights).ravel() * size[u] * size[v] / 4)
        normals.append(int(size.argmin()))
    way = points[1][None] - points[0][:, None]
    cosines = np.abs(way[..., normals[0]] * way[..., normals[1]])
    return float(areas[0] @ (cosines / (np.pi * (way**2).sum(-1) ** 2)) @ areas[1])


FLOOR = [(0, 1), (0, 1), (0, 0)]


def test_unit_squares_have_the_analytic_form_factors():
    assert exchange_area(FLOOR, [(0, 1), (0, 1), (1, 1)]) == pytest.approx(0.199825, abs=5e-7)
    assert exchange_area(FLOOR, [(0, 0), (0, 1), (0, 1)]) == pytest.approx(0.200044, abs=5e-7)


@pytest.mark.parametrize(
    "other",
    [
        [(-0.5, 0.3), (0.2, 2.0), (1.5, 1.5)],
        [(3.0, 4.0), (-2.0, -1.0), (1.0, 1.0)],
        [(1.5, 1.5), (-1.0, 0.4), (0.3, 2.0)],
        [(-0.4, -0.4), (0.2, 0.7), (0.5, 3.0)],
        [(0.1, 0.6), (2.0, 2.0), (0.0, 1.0)],
    ],
)
def test_exchange_areas_match_a_quadrature(other):
    exact = exchange_area(FLOOR, other)
    assert exact == pytest.approx(quadrature(FLOOR, other), rel=1e-9)
    assert exact == pytest.approx(exchange_area(other, FLOOR), rel=1e-12)


def test_rectangles_in_one_plane_exchange_nothing():
    assert exchange_area(FLOOR, [(1, 2), (0, 1), (0, 0)]) == 0.0


@pytest.mark.parametrize("room", ROOMS)
def test_rows_sum_to_1_and_exchange_is_reciprocal(room):
    F, areas = room.form_factors, room.areas_m2
    np.testing.assert_allclose(F.sum(axis=1), areas > 0.0, atol=1e-9)
    exchange = areas[:, None] * F
    np.testing.assert_allclose(exchange, exchange.T, atol=1e-12 * areas.sum())
    assert F.min() >= 0.0
    w, d, h = room.width_m, room.depth_m, room.height_m
    assert areas.sum() == pytest.approx(2 * (w * d + d * h + h * w), rel=1e-12)


def test_patches_are_where_their_names_say():
    areas = dict(zip(PATCHES, OFFICE.areas_m2.tolist(), strict=True))
    assert areas["window"] == pytest.approx(2.8)
    assert areas["window wall"] == pytest.approx(4.0 * 2.7 - 2.8)
    assert areas["floor"] == areas["ceiling"] == pytest.approx(20.0)
    assert areas["left lower"] == areas["right lower"] == pytest.approx(5.0 * 0.81)
    assert areas["back upper"] == pytest.approx(4.0 * 1.89)
    F = OFFICE.form_factors
    left, right, back = (PATCHES.index(f"{side} lower") for side in ("left", "right", "back"))
    floor, ceiling, window = (PATCHES.index(name) for name in ("floor", "ceiling", "window"))
    # The window is in the middle of its wall, and lower than it is high above.
    assert F[window, left] == pytest.approx(F[window, right], rel=1e-12)
    assert F[window, floor] < F[window, ceiling]
    assert F[left, back] > 0.0 and F[left, PATCHES.index("left upper")] == 0.0


def emitting(room: Brick, grid: SpectralGrid) -> np.ndarray:
    draw = np.random.default_rng(5)
    return draw.uniform(0.0, 2.0, (len(PATCHES), grid.size)) * (room.areas_m2 > 0.0)[:, None]


@pytest.mark.parametrize("room", ROOMS)
def test_what_a_room_emits_is_absorbed(room):
    rho = np.random.default_rng(4).uniform(0.0, 0.95, (len(SURFACES), THREE.size))
    S = emitting(room, THREE)
    B = room.radiosity(rho, S, THREE)
    E = room.irradiance(B, THREE)
    np.testing.assert_allclose(B[:9], S[:9] + rho * E[:9], rtol=1e-12)
    np.testing.assert_array_equal(B[9], S[9])
    absorption = np.vstack([1.0 - rho, np.ones((1, THREE.size))])
    np.testing.assert_allclose(room.areas_m2 @ (absorption * E), room.areas_m2 @ S, rtol=1e-8)


def test_white_furnace_without_a_window():
    room = Brick(4.0, 5.0, 2.7, furnished=0.4)
    rho = np.array([0.2, 0.5, 0.99])
    B = room.radiosity(rho, np.ones((10, 3)), THREE)
    np.testing.assert_allclose(B[:9], np.tile(1.0 / (1.0 - rho), (9, 1)), rtol=1e-9)


def test_a_cubic_brick_matches_the_cube():
    """The cube's form factors of 0.2 cost less than 1e-4 of the light."""
    draw = np.random.default_rng(6)
    rho, S = draw.uniform(0.1, 0.9, (6, 3)), draw.uniform(0.0, 1.0, (6, 3))
    six = [PATCHES.index(n) for n in ("floor", "ceiling", "window wall")] + [3, 4, 5]
    all_rho, all_S = np.full((9, 3), 0.5), np.zeros((10, 3))
    all_rho[six], all_S[six] = rho, S
    B = Brick(1.0, 1.0, 1.0).radiosity(all_rho, all_S, THREE)
    np.testing.assert_allclose(B[six], cube_radiosity(rho, S, THREE), rtol=2e-4)


def test_black_walls_get_the_window_s_light_alone():
    S = OFFICE.window_emission(light("D65"), 5000.0)
    E = OFFICE.irradiance(OFFICE.radiosity(np.zeros(BANDS), S))
    lux = lux_from_irradiance(E)
    np.testing.assert_allclose(lux, 5000.0 * OFFICE.form_factors[:, -1], rtol=1e-12)
    assert lux_from_irradiance(S[-1]) == pytest.approx(5000.0, rel=1e-12)


def test_a_window_may_exceed_its_wall_by_rounding():
    room = Brick(0.3, 1.0, 0.3, window_m=(0.1, 0.1, 0.1 + 0.1, 0.2))
    assert 0.1 + 0.2 > 0.3
    np.testing.assert_allclose(room.form_factors.sum(axis=1), room.areas_m2 > 0.0, atol=1e-9)


def brick(**change) -> Brick:
    return Brick(**{"width_m": 4.0, "depth_m": 5.0, "height_m": 2.7, **change})


LIT = np.ones((10, BANDS))


@pytest.mark.parametrize(
    ("call", "expected"),
    [
        (lambda: brick(depth_m=-1.0), "range Brick.depth_m"),
        (lambda: brick(furnished=1.1), "range Brick.furnished"),
        (lambda: brick(window_m=(3.0, 0.9, 2.0, 1.4)), "range Brick.window_m"),
        (lambda: brick(window_m=(1.0, 0.9, 2.0, 2.0)), "range Brick.window_m"),
        (lambda: brick(window_m=(-0.1, 0.9, 2.0, 1.0)), "range Brick.window_m"),
        (lambda: brick(window_m=(1.0, 0.9, 0.0, 1.4)), "range Brick.window_m[2]"),
        # No window, no sky.
        (lambda: brick().window_emission(light("D65"), 100.0), "missing Brick.window_m"),
        (lambda: brick().radiosity(np.zeros(BANDS), 0.0 * LIT), "missing emission"),
        (lambda: OFFICE.radiosity(np.ones(BANDS), LIT), "range reflectance"),
    ],
)
def test_impossible_bricks_are_refused(call, expected):
    refuses(call, expected, RoomError)
