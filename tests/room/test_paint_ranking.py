"""Ranking of paints: the same best as with every paint solved, in rooms of several kinds."""

from functools import cache

import numpy as np
import pytest

from tests.support.errors import raises
from tests.support.fixtures import slow_each
from volspec.appearance import Viewing
from volspec.appearance.models import ciecam02
from volspec.errors import InputError, RoomError
from volspec.room import (
    Room,
    RoomLight,
    RoomResponse,
    irradiance_from_lux,
    lamp_powers,
    look,
    lux_from_irradiance,
    mix_paints,
    paint_set,
    painted_surfaces,
    rank_paints,
    rank_paints_by_lamp,
    solve_room,
    wanted_appearance,
)
from volspec.room.eye import surface_eye
from volspec.room.mesh import SIDES, box
from volspec.room.model import PointLamp
from volspec.room.paint_ranking import interpolated_irradiance
from volspec.room.wall_paint import appearance_distance, atlas_appearance, wall_appearance
from volspec.spectra import (
    DEFAULT_GRID,
    Spectrum,
    colour_matching_functions,
    light,
    reflectance,
    reflectance_from_colour,
)

CUBE = box((0, 0, 0), (4, 5, 2.7), SIDES, inside=True)
CHEST = box((1, 2, 0.1), (2, 4, 1), "chest")
MIXED = ("grey:0.9", "ColorChecker/yellow", "ColorChecker/red", "ColorChecker/blue")


@cache
def room(number: int) -> RoomLight:
    """A bright room by day, a brown one by tungsten, and a coloured one under a small lamp."""
    bright = dict.fromkeys(SIDES, "grey:0.9")
    brown = dict.fromkeys(SIDES, "ColorChecker/dark skin") | {"floor": "ColorChecker/red"}
    coloured = {"floor": "ColorChecker/blue", "ceiling": "PMC/Banana", "chest": "ColorChecker/red"}
    mesh, paints = CUBE + CHEST, (bright, brown, coloured)[number]
    rho = np.array([reflectance(paints.get(each, "grey:0.5")).values for each in mesh.names])
    if number == 2:
        lamp = PointLamp((2.0, 1.0, 2.0), irradiance_from_lux(light("FL2"), 80.0))
        return solve_room(Room(mesh, rho, lamps=(lamp,)), 150, rays=1 << 17)
    name, spectrum = (("ceiling", "D65"), ("front", "A"))[number]
    rho[mesh.names.index(name)] = 0.0
    exitance = irradiance_from_lux(light(spectrum), 500.0)
    return solve_room(Room(mesh, rho, {name: exitance}), 150, rays=1 << 17)


@pytest.mark.parametrize("number", [1, *slow_each(0, 2)])
def test_the_best_are_those_of_a_ranking_that_solves_every_paint(number):
    mixed = [reflectance(name) for name in MIXED]
    paints = mix_paints(mixed, 1 / 7) if number == 1 else paint_set(["training"])
    assert len(paints) > 100
    surface = ("walls", "floor", "walls")[number]
    names = painted_surfaces(room(number).room, surface)
    seen = []
    for paint in paints:
        painted = room(number).painted(dict.fromkeys(names, paint))
        seen.append(wall_appearance(paint, painted.mean_irradiance(*names)))
    for colour in ("#f0d9b5", "#c04030", "ColorChecker/blue sky"):
        wanted = wanted_appearance(colour)
        found = rank_paints(room(number), paints, surface, wanted, top=5)
        distances = np.array([float(appearance_distance(each, wanted)) for each in seen])
        order = np.argsort(distances, kind="stable")[:5]
        assert [each.name for each in found.best] == [paints[i].name for i in order]
        assert [each.distance for each in found.best] == pytest.approx(distances[order], abs=1e-6)
        assert found.candidates == len(paints) and found.solved < 20


def test_the_best_over_lamps_are_those_of_solving_every_paint_under_each():
    paints = paint_set(["ColorChecker"])
    names = painted_surfaces(room(1).room, "walls")
    powers = lamp_powers(room(1).room, ["D65", "A", "front=room"])
    response = RoomResponse.of(room(1), shadow_rays=64)
    lights = {lamp: response.under(power) for lamp, power in powers.items()}
    wanted = wanted_appearance("#c0a890")
    distances = []
    for light_of_lamp in lights.values():
        for paint in paints:
            lit = light_of_lamp.painted(dict.fromkeys(names, paint)).mean_irradiance(*names)
            distances.append(float(appearance_distance(wall_appearance(paint, lit), wanted)))
    solved = np.array(distances).reshape(len(lights), -1)
    found = rank_paints_by_lamp(lights, paints, "walls", wanted, top=4)
    for over, best in ((solved.max(axis=0), found.by_worst), (solved.mean(axis=0), found.by_mean)):
        order = np.argsort(over, kind="stable")[:4]
        assert [paint.name for paint in best] == [paints[i].name for i in order]
    worst = [paint.worst for paint in found.by_worst]
    assert worst == pytest.approx(np.sort(solved.max(axis=0))[:4], abs=1e-6)
    for lamp, alone in zip(lights, solved, strict=True):
        distances = [paint.distance for paint in found.by_lamp[lamp].best]
        assert distances == pytest.approx(np.sort(alone)[:4], abs=1e-6)
        assert found.by_lamp[lamp].solved < len(paints)


def test_a_lamp_is_as_bright_as_the_room_s_own_light():
    powers = lamp_powers(room(1).room, ["D65", "front=A", "room"])
    lux = [float(lux_from_irradiance(power).sum()) for power in powers.values()]
    assert lux == pytest.approx([500.0] * 3)
    assert powers["D65"][0] == pytest.approx(irradiance_from_lux(light("D65"), 500.0))
    with raises(RoomError, "unknown"):
        lamp_powers(room(1).room, ["back=A"])


def test_a_white_surface_counts_in_the_ranking():
    """White and look are those of an eye before the floor, whatever its paint."""
    paints = [reflectance(f"ColorChecker/{name}") for name in ("red", "blue", "yellow", "green")]
    wanted = wanted_appearance("#c04030")
    found = rank_paints(room(0), paints, "floor", wanted, top=4, white="left")
    for paint in found.best:
        light_on = room(0).painted({"floor": paint.reflectance})
        eye = surface_eye(light_on, "floor")
        white = look(light_on, eye, white="left").white_XYZ
        E, Q = light_on.mean_irradiance("floor"), colour_matching_functions(light_on.room.grid)
        lux = float(lux_from_irradiance(E))
        XYZ = 100.0 / (Q[1] @ E) * (Q @ (paint.reflectance.values * E))
        viewing = Viewing(L_A=lux / np.pi, Y_b=float(XYZ[1]))
        own = ciecam02.forward(XYZ, viewing.conditions(white))
        for name in "JCh":
            assert float(getattr(paint.seen, name)) == pytest.approx(getattr(own, name), rel=1e-5)
    distances = [float(appearance_distance(paint.seen, wanted)) for paint in found.best]
    assert distances == sorted(distances)
    plain = rank_paints(room(0), paints, "floor", wanted, top=4)
    assert abs(plain.best[0].distance - found.best[0].distance) > 0.1


def test_the_light_of_a_paint_is_within_its_bounds():
    """Bounds of the light hold for each paint and band, in a room as bright as they come."""
    paints = np.array([each.values for each in paint_set(["patches"])[::10]])
    greys = np.linspace(0.0, 0.99, 4)

    def E(paint: np.ndarray) -> np.ndarray:
        return room(0).painted(dict.fromkeys(SIDES[:5], paint)).mean_irradiance("left")

    found, error = interpolated_irradiance(
        greys, np.array([E(np.full(DEFAULT_GRID.size, grey)) for grey in greys]), paints
    )
    exact = np.array([E(paint) for paint in paints])
    # Of the difference, the solver's rounding may be left.
    assert (np.abs(exact - found) <= error + 1e-6 * exact).all()
    assert np.abs(exact - found).max() > 1e-4 * exact.max()


def test_interpolation_is_exact_for_polynomials():
    greys = np.array([0.1, 0.3, 0.6, 0.9])
    paints = np.array([[0.2, 0.1], [0.85, 0.9]])
    found, error = interpolated_irradiance(greys, np.stack([greys**3, 2 * greys], 1), paints)
    assert found == pytest.approx(np.stack([paints[:, 0] ** 3, 2 * paints[:, 1]], 1))
    assert error[:, 1] == pytest.approx(0.0, abs=1e-12) and (error[:, 0] > 0).all()


def test_alike_greys_need_one_solution():
    grey = reflectance("grey:0.5")
    found = rank_paints(room(1), [grey, grey], "floor", wanted_appearance("grey"))
    assert found.greys == 1 and found.solved == 2
    assert found.best[0].distance == found.best[1].distance


def test_the_present_paint_is_what_is_wanted_unless_another_is():
    paints = [reflectance("grey:0.2"), reflectance("grey:0.9")]
    found = rank_paints(room(0), paints)
    own = atlas_appearance(reflectance("grey:0.9"))
    assert float(found.wanted.J) == pytest.approx(float(own.J))
    assert found.best[0].name == "grey:0.9"
    assert float(found.best[0].chosen.J) == pytest.approx(float(own.J))
    assert found.best[0].lux > found.best[1].lux > 0


def test_walls_are_the_four_and_other_surfaces_have_names():
    assert painted_surfaces(room(0).room, "walls") == ("left", "right", "front", "back")
    assert painted_surfaces(room(1).room, "walls") == ("left", "right", "back")  # front gives light
    assert painted_surfaces(room(1).room, "chest") == ("chest",)


def mixed() -> RoomLight:
    return room(0).painted({"left": reflectance("grey:0.3")})


@pytest.mark.parametrize(
    ("call", "expected"),
    [
        (lambda grey: rank_paints(room(0), []), "missing paints"),
        (lambda grey: rank_paints(room(0), [grey], top=0), "range top"),
        (lambda grey: rank_paints(room(0), [reflectance("white")]), "range reflectance"),
        (lambda grey: rank_paints(mixed(), [grey]), "missing wanted"),
        (lambda grey: rank_paints(room(0), [grey], "floor", white="floor"), "conflict white"),
        (lambda _: painted_surfaces(room(0).room, "wall"), "unknown surface"),
        (lambda _: painted_surfaces(room(1).room, "front"), "conflict surface"),
        (lambda _: wanted_appearance("beigee"), "unknown"),
    ],
)
def test_impossible_rankings_are_refused(call, expected):
    with raises(InputError, *expected.split()):
        call(reflectance("grey:0.5"))


@pytest.mark.parametrize("word", ["#f0d9b5", "ColorChecker/blue", "grey:0.5", "41 35 12"])
def test_what_is_wanted_is_a_colour_or_a_reflectance(word):
    own: Spectrum | str = word if word[0] in "#4" else reflectance(word)
    assert float(wanted_appearance(word).J) == float(atlas_appearance(own).J)


def test_a_black_paint_has_an_appearance():
    paints = [reflectance("black"), reflectance_from_colour("#f0d9b5")]
    found = rank_paints(room(2), paints, wanted=wanted_appearance("black"))
    assert found.best[0].name == "black" and float(found.best[0].seen.J) == pytest.approx(0, abs=1)
