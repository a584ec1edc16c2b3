"""The closed form of the cube equals a dense solve, and a uniform cube a geometric series."""

from __future__ import annotations

from timeit import repeat

import numpy as np
import pytest

from tests.support.errors import raises, refuses
from volspec.errors import RoomError, SpectrumError
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


def test_a_change_of_paint_at_471_bands_takes_less_than_2_ms():
    rho, S = random_cube(FINE)
    paint = np.linspace(0.2, 0.8, FINE.size)
    times = repeat(
        lambda: cube_radiosity(with_paint(rho, paint, [2], FINE), S, FINE), number=1, repeat=20
    )
    assert min(times) < 2e-3


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


@pytest.mark.parametrize(
    ("reflectance", "emission", "expected"),
    [
        (GREY + [[0.0, 0.5, 0.0]], LIT, "range reflectance"),
        (GREY - [[0.0, 0.6, 0.0]], LIT, "range reflectance"),
        (GREY[:5], LIT, "shape reflectance"),
        (GREY, LIT[:5], "shape emission"),
        (GREY, LIT[0], "shape emission"),
        (GREY, LIT - [[0.0, 0.0, 1.5]], "range emission"),
        (GREY, 0.0 * LIT, "missing emission"),
    ],
)
def test_impossible_cubes_are_refused(reflectance, emission, expected):
    refuses(lambda: cube_radiosity(reflectance, emission, THREE), expected, RoomError)


def test_a_message_names_wall_and_band():
    bright = with_paint(GREY, [0.5, 1.0, 0.5], [3], THREE)
    with raises(RoomError, "range", "reflectance") as caught:
        cube_radiosity(bright, LIT, THREE)
    assert caught.value.given == 1.0
    assert caught.value.problem.split() == ["wall", "4", "reflects", "1", "at", "550", "nm"]


def test_arrays_on_another_grid_are_refused():
    with raises(SpectrumError, "shape"):
        cube_radiosity(GREY, LIT)


@pytest.mark.parametrize("lux", [0.0, -1.0, np.nan, np.inf, "300"])
def test_lux_that_no_light_has_are_refused(lux):
    refuses(lambda: irradiance_from_lux(light("A"), lux), "range lux", RoomError)


def test_walls_and_reflectances_that_cannot_be_painted_are_refused():
    refuses(lambda: with_paint(GREY, GREY[0], [6], THREE), "range walls", RoomError)
    refuses(lambda: with_paint(GREY, GREY[0], [], THREE), "range walls", RoomError)
    refuses(lambda: with_paint(GREY[0], GREY[0], [0], THREE), "shape reflectance", RoomError)
    refuses(lambda: with_paint(GREY, GREY, [0], THREE), "shape paint", RoomError)
