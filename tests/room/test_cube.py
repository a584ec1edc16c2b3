"""The closed form of the cube equals a dense solve, and a uniform cube a geometric series."""

import numpy as np
import pytest

from tests.support.errors import raises
from volspec.errors import InputError
from volspec.room import (
    cube_irradiance,
    cube_radiosity,
    irradiance_from_lux,
    lux_from_irradiance,
    with_paint,
)
from volspec.spectra import SpectralGrid, Spectrum, illuminance_lux, light

FINE = SpectralGrid(360.0, 830.0, 1.0)
THREE = SpectralGrid(450.0, 650.0, 100.0)
GREY = np.full((6, 3), 0.5)
LIT = np.ones((6, 3))


def random_cube(grid: SpectralGrid) -> tuple[np.ndarray, np.ndarray]:
    draw = np.random.default_rng(22)
    return draw.uniform(0.0, 0.99, (6, grid.size)), draw.uniform(0.0, 3.0, (6, grid.size))


def test_cube_matches_a_dense_solve():
    rho, S = random_cube(FINE)
    F = 0.2 * (1.0 - np.eye(6))
    dense = [np.linalg.solve(np.eye(6) - rho[:, [k]] * F, S[:, k]) for k in range(FINE.size)]
    np.testing.assert_allclose(cube_radiosity(rho, S, FINE), np.transpose(dense), rtol=1e-12)


def test_the_introduction_s_room_multiplies_direct_light_by_19_9_and_4():
    paint = np.array([0.95, 0.90, 0.80])
    radiosity = cube_radiosity(paint, np.tile(paint, (6, 1)), THREE)
    np.testing.assert_allclose(radiosity, np.tile([19.0, 9.0, 4.0], (6, 1)), rtol=1e-12)


def test_white_furnace():
    rho = np.array([0.0, 0.5, 0.99])
    radiosity = cube_radiosity(rho, 2.0 * LIT, THREE)
    np.testing.assert_allclose(radiosity, np.tile(2.0 / (1.0 - rho), (6, 1)), rtol=1e-12)


def test_irradiance_is_what_a_wall_reflects_without_its_own_emission():
    rho, S = random_cube(FINE)
    B = cube_radiosity(rho, S, FINE)
    np.testing.assert_allclose(rho * cube_irradiance(B, FINE), B - S, rtol=1e-9, atol=1e-12)


def test_what_walls_emit_they_absorb():
    rho, S = random_cube(FINE)
    absorbed = (1.0 - rho) * cube_irradiance(cube_radiosity(rho, S, FINE), FINE)
    np.testing.assert_allclose(absorbed.sum(0), S.sum(0), rtol=1e-11)


def test_lux_of_a_light_are_the_same_on_every_grid():
    for grid in (SpectralGrid(), FINE):
        E = irradiance_from_lux(light("A", grid), 300.0, grid)
        assert lux_from_irradiance(E, grid) == pytest.approx(300.0, rel=1e-12)
        spectral = Spectrum(grid.wavelengths_nm, E / grid.step_nm)  # W/(m² nm)
        assert illuminance_lux(spectral) == pytest.approx(300.0, rel=1e-12)


def test_spectra_are_put_on_the_grid():
    paint = Spectrum([300.0, 900.0], [0.3, 0.3])
    one, each = (cube_radiosity(given, LIT, THREE) for given in (paint, [paint] * 6))
    np.testing.assert_allclose(one, LIT / 0.7)
    np.testing.assert_array_equal(one, each)


def cube(rho=GREY, S=LIT) -> np.ndarray:
    return cube_radiosity(rho, S, THREE)


BRIGHT = with_paint(GREY, [0.5, 1.0, 0.5], [3], THREE)


@pytest.mark.parametrize(
    ("call", "expected"),
    [
        (lambda: cube(BRIGHT), "range reflectance wall 4 reflects 1 at 550 nm"),
        (lambda: cube(GREY - [[0.0, 0.6, 0.0]]), "range reflectance"),
        (lambda: cube(GREY[:5]), "shape reflectance"),
        (lambda: cube(S=LIT[:5]), "shape emission"),
        (lambda: cube(S=LIT[0]), "shape emission"),
        (lambda: cube(S=LIT - [[0.0, 0.0, 1.5]]), "range emission"),
        (lambda: cube(S=0.0 * LIT), "missing emission"),
        (lambda: cube_radiosity(GREY, LIT), "shape "),  # of another grid
        *(
            (lambda lux=lux: irradiance_from_lux(light("A"), lux), "range lux")
            for lux in (0.0, -1.0, np.nan, np.inf)
        ),
        (lambda: with_paint(GREY, GREY[0], [6], THREE), "range walls"),
        (lambda: with_paint(GREY, GREY[0], [], THREE), "range walls"),
        (lambda: with_paint(GREY[0], GREY[0], [0], THREE), "shape reflectance"),
        (lambda: with_paint(GREY, GREY, [0], THREE), "shape paint"),
    ],
)
def test_impossible_cubes_are_refused(call, expected):
    code, field, *problem = expected.split(" ", 2)
    with raises(InputError, code, field) as caught:
        call()
    assert not problem or caught.value.problem.split() == problem[0].split()
