"""Paints found for a room have the wanted radiosity or appearance there, and are the smoothest."""

import math

import numpy as np
import pytest
from scipy.optimize import minimize

from tests.support.errors import raises
from volspec.appearance import ViewingConditions
from volspec.appearance.models import ciecam02
from volspec.errors import RoomError
from volspec.room import cube_irradiance, cube_radiosity, irradiance_from_lux, with_paint
from volspec.room.brick import Brick
from volspec.room.wall_paint import (
    appearance_distance,
    atlas_appearance,
    cube_paint_for_radiosity,
    paint_for_appearance,
    wall_appearance,
)
from volspec.spectra import (
    DEFAULT_GRID,
    SpectralGrid,
    XYZ_from_spectra,
    light,
    reflectance,
    white_XYZ,
)

BANDS = DEFAULT_GRID.size
THREE = SpectralGrid(450.0, 650.0, 100.0)
PASTELS = {"apricot": "#ffd9b3", "salmon": "#ffc4b8", "green": "#e2f0c4", "beige": "#f5f5dc"}


def random_room(seed: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return reflectances, emissions and a paint."""
    draw = np.random.default_rng(seed).uniform
    return draw(0, 0.95, (6, BANDS)), draw(0, 3, (6, BANDS)), draw(0, 0.95, BANDS)


@pytest.mark.parametrize("walls", [(0,), (4,), (1, 3), (5, 0, 2), range(6)])
def test_the_cube_s_inverse_finds_the_paint(walls):
    for seed in range(10):
        rho, S, paint = random_room(seed)
        wanted = cube_radiosity(with_paint(rho, paint, walls), S)[walls[0]]
        found = cube_paint_for_radiosity(wanted, rho, S, walls)
        np.testing.assert_allclose(found, paint, rtol=1e-9, atol=1e-12)


def test_a_wall_with_its_own_emission_only_is_black():
    rho, S, _ = random_room(1)
    S[1:, 3] = 0.0
    wanted = cube_radiosity(with_paint(rho, np.zeros(BANDS), [0]), S)[0]
    np.testing.assert_array_equal(cube_paint_for_radiosity(wanted, rho, S), np.zeros(BANDS))


def test_a_wall_is_seen_by_an_eye_adapted_to_its_light():
    """Equations 4, 6, 8 and 9, and the wall's own Y as background."""
    paint, A = reflectance("ColorChecker/dark skin"), light("A")
    XYZ = XYZ_from_spectra(A, paint)
    conditions = ViewingConditions(tuple(white_XYZ(A)), L_A=700.0 / math.pi, Y_b=float(XYZ[1]))
    seen = wall_appearance(paint, irradiance_from_lux(A, 700.0))
    assert appearance_distance(seen, ciecam02.forward(XYZ, conditions)) < 1e-9


def test_in_the_light_of_an_atlas_a_wall_looks_as_in_the_atlas():
    paint, D65 = reflectance("ColorChecker/orange"), light("D65")
    XYZ = XYZ_from_spectra(D65, paint)
    printed = ViewingConditions(tuple(white_XYZ(D65)), L_A=636.62, Y_b=20.0)
    assert appearance_distance(atlas_appearance(paint), ciecam02.forward(XYZ, printed)) < 1e-5
    seen = wall_appearance(paint, irradiance_from_lux(D65, 2000.0), Y_b=20.0)
    assert appearance_distance(seen, atlas_appearance(paint)) < 1e-9
    assert appearance_distance(seen, atlas_appearance(XYZ)) < 1e-9


def cube_wall(lamp: str, grid: SpectralGrid = DEFAULT_GRID):
    """Return a function of the paint of five walls: the light on one, from a bright ceiling."""
    emission = np.zeros((6, grid.size))
    emission[0] = irradiance_from_lux(light(lamp, grid), 3000.0, grid)
    rho = np.full((6, grid.size), 0.8)

    def irradiance(paint):
        painted = with_paint(rho, paint, range(1, 6), grid)
        return cube_irradiance(cube_radiosity(painted, emission, grid), grid)[1]

    return irradiance


def brick_wall(lamp: str, grid: SpectralGrid = DEFAULT_GRID):
    """Return a function of the paint of four walls: the light on the one behind, by a window."""
    room = Brick(4.0, 5.0, 2.7, window_m=(1.0, 0.9, 2.0, 1.4), furnished=0.3)
    emission = room.window_emission(light(lamp, grid), 5000.0, grid)
    rho = np.full((9, grid.size), 0.5)

    def irradiance(paint):
        painted = with_paint(rho, paint, (2, 3, 4, 5), grid)
        return room.irradiance(room.radiosity(painted, emission, grid), grid)[5]

    return irradiance


@pytest.mark.parametrize("colour", PASTELS.values(), ids=PASTELS.keys())
@pytest.mark.parametrize("lamp", ["D65", "A"])
@pytest.mark.parametrize("room", [cube_wall, brick_wall])
def test_pastel_paints_look_as_wanted_in_their_room(room, lamp, colour):
    wanted, irradiance = atlas_appearance(colour), room(lamp)
    found = paint_for_appearance(wanted, irradiance)
    paint = found.reflectance.values
    assert paint.min() > 0.0 and paint.max() < 1.0 and found.reflectance.designed
    assert found.distance < 1e-5
    seen = wall_appearance(paint, irradiance(paint))
    assert appearance_distance(seen, wanted) == pytest.approx(found.distance, abs=1e-9)


def test_471_bands_give_the_same_paint_as_95():
    coarse, fine = SpectralGrid(360.0, 830.0, 5.0), SpectralGrid(360.0, 830.0, 1.0)
    paints = [
        paint_for_appearance(atlas_appearance("#e2f0c4", grid), brick_wall("D65", grid), grid)
        for grid in (coarse, fine)
    ]
    few, many = (paint.reflectance.values for paint in paints)
    # Beyond the visible, only the extrapolation of the smoothest curve is left.
    visible = (coarse.wavelengths_nm >= 400.0) & (coarse.wavelengths_nm <= 700.0)
    np.testing.assert_allclose(many[::5][visible], few[visible], atol=2e-3)


def test_a_background_that_is_given_is_used():
    wanted, irradiance = atlas_appearance("#ffd9b3"), brick_wall("D65")
    paint = paint_for_appearance(wanted, irradiance, Y_b=20.0).reflectance.values
    seen = wall_appearance(paint, irradiance(paint), Y_b=20.0)
    assert appearance_distance(seen, wanted) < 1e-5
    assert appearance_distance(wall_appearance(paint, irradiance(paint)), wanted) > 1.0


@pytest.mark.slow
def test_the_paint_is_the_smoothest():
    """SLSQP, started at the result and at grey, finds none with smaller second differences."""
    wanted, irradiance = atlas_appearance("#ffd9b3"), brick_wall("A")
    paint = paint_for_appearance(wanted, irradiance).reflectance.values
    bend = np.diff(np.eye(BANDS), 2, axis=0)

    def off(rho):
        seen = wall_appearance(rho, irradiance(rho))
        angle = np.radians([seen.h, wanted.h])
        look, target = (
            np.array([each.J, each.C * np.cos(h), each.C * np.sin(h)])
            for each, h in zip((seen, wanted), angle, strict=True)
        )
        return look - target

    def roughness(rho):
        return 1e3 * np.sum((bend @ rho) ** 2)

    for start in (paint, np.full(BANDS, 0.6)):
        rival = minimize(
            roughness,
            start,
            jac=lambda rho: 2e3 * bend.T @ (bend @ rho),
            method="SLSQP",
            bounds=[(1e-4, 0.999)] * BANDS,
            constraints={"type": "eq", "fun": off},
            options={"maxiter": 300, "ftol": 1e-12},
        )
        assert rival.success and np.abs(off(rival.x)).max() < 1e-5
        assert roughness(paint) <= roughness(rival.x) * (1.0 + 1e-4)


def test_a_red_light_without_any_Z_shows_red_walls_only():
    """No colour-matching function but x and y is above 0 beyond 650 nm."""
    red = SpectralGrid(650.0, 750.0, 10.0)
    E = irradiance_from_lux(light("E", red), 300.0, red)
    grey = wall_appearance(np.full(red.size, 0.5), E, red)
    found = paint_for_appearance(grey, lambda paint: E, red)
    np.testing.assert_allclose(found.reflectance.values, 0.5, atol=1e-4)


GREY, LIT = np.full((6, 3), 0.5), np.ones((6, 3))
ALONE = np.vstack([np.ones((1, 3)), np.zeros((5, 3))])
WHITE = cube_radiosity(with_paint(GREY, np.full(3, 1.0 - 1e-12), [0], THREE), LIT, THREE)[0]
APRICOT, GREEN = map(atlas_appearance, ("#ffd9b3", "#00ff00"))
SEVERAL = ciecam02.forward(np.full((2, 3), 40.0), ViewingConditions((95.0, 100.0, 109.0)))


def radiosity(wanted, rho=GREY, S=LIT, walls=(0,)):
    return cube_paint_for_radiosity(wanted, rho, S, walls, grid=THREE)


@pytest.mark.parametrize(
    ("call", "expected", "problem"),
    [
        (lambda: radiosity(WHITE * [0.9, 1.001, 0.9]), "impossible wanted", "550 nm"),
        (lambda: radiosity(WHITE * [0.9, 50.0, 0.9]), "impossible wanted", "550 nm"),
        (lambda: radiosity([1.0, 1.0, 0.9]), "impossible wanted", "650 nm"),
        (lambda: radiosity([2.0] * 3, 0 * GREY, ALONE), "impossible wanted", ""),
        *((lambda w=w: radiosity(WHITE, walls=w), "range walls", "") for w in ((), (6,), (-1,))),
        (lambda: paint_for_appearance(GREEN, brick_wall("A")), "impossible wanted", ""),
        (lambda: paint_for_appearance(SEVERAL, brick_wall("A")), "shape wanted", ""),
        (lambda: paint_for_appearance(APRICOT, lambda paint: 0.0 * paint), "missing", ""),
        (lambda: wall_appearance(np.ones((2, BANDS)), np.ones(BANDS)), "shape reflectance", ""),
    ],
)
def test_a_look_that_no_paint_has_is_refused(call, expected, problem):
    with raises(RoomError, *expected.split()) as caught:
        call()
    assert problem in caught.value.problem
