"""Conditions of an eye, appearance of surfaces, and pictures."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from tests.room.test_response import CUBE, even_room
from tests.support.errors import refuses
from volspec.appearance import Viewing
from volspec.errors import RoomError
from volspec.room import (
    Eye,
    Room,
    RoomLight,
    default_eye,
    irradiance_from_lux,
    look,
    lux_from_irradiance,
    room_picture,
    solve_room,
    surface_appearance,
)
from volspec.room.eye import picture_XYZ, white_surfaces
from volspec.room.mesh import SIDES
from volspec.room.wall_paint import atlas_appearance
from volspec.spectra import (
    colour_matching_functions,
    light,
    reflectance,
    reflectance_from_colour,
    white_XYZ,
)

WHITES = ("front", "back", "ceiling")
PAINT = reflectance_from_colour("#f0d9b5")


@cache
def furnace() -> RoomLight:
    """A room that is lit alike everywhere, by D65 of 100 lm/m² from every wall."""
    room = even_room(0.5, irradiance_from_lux(light("D65"), 100.0))
    return solve_room(room, 150, rays=1 << 18)


@cache
def painted() -> RoomLight:
    """A painted room with a tungsten ceiling."""
    emission = irradiance_from_lux(light("A"), 100.0)
    room = Room(CUBE, np.tile(PAINT.values, (6, 1)), {"ceiling": emission})
    return solve_room(room, 400, rays=1 << 19)


def test_conditions_in_even_light_are_those_of_the_radiosity():
    """B = 200 lm/m² everywhere, of which a perfect diffuser's E is 200 lx: Y_b = 100."""
    found = look(furnace(), default_eye(furnace().room))
    assert found.viewing.Y_b == pytest.approx(100.0, rel=1e-3)
    assert pytest.approx(200.0 / np.pi, rel=1e-3) == found.viewing.L_A
    assert found.viewing.surround == pytest.approx(1.0, rel=1e-3)
    assert found.L_Aw == pytest.approx(200.0 / np.pi, rel=1e-3)
    assert found.white_XYZ == pytest.approx(white_XYZ(light("D65")), rel=1e-3)
    assert found.surface == "back"


def test_a_surface_of_the_room_may_be_the_white():
    found = look(furnace(), default_eye(furnace().room), white="floor")
    assert found.white_XYZ[1] == pytest.approx(50.0) and found.viewing.surround == 1.0
    assert found.L_Aw == pytest.approx(100.0 / np.pi, rel=1e-3)
    seen = [surface_appearance(furnace(), "back", white).seen.J for white in (None, "floor")]
    assert seen[1] == pytest.approx(100.0, abs=0.1) and seen[0] < 90


def test_interreflections_colour_a_wall_more_than_its_paint():
    """The paper's section 5: chroma grows with each reflection, and less so for an adapted eye."""
    found = surface_appearance(painted(), "floor")
    assert pytest.approx(float(atlas_appearance(PAINT).C)) == found.chosen.C
    assert found.seen_xy[0] > found.chosen_xy[0] + 0.1
    assert found.difference > 5
    rows = painted().mesh.surface == SIDES.index("floor")
    mean = lux_from_irradiance(painted().irradiance[rows].mean(axis=0))
    assert found.lux == pytest.approx(float(mean), rel=0.1)


def test_a_picture_shows_what_leaves_the_surfaces():
    """Y of even light: B over the E of a perfect diffuser."""
    eye = default_eye(furnace().room)
    XYZ = picture_XYZ(furnace(), eye, (16, 12), furnace().irradiance[0], samples=1)
    assert XYZ.shape == (12, 16, 3)
    assert XYZ[..., 1] == pytest.approx(100.0, rel=1e-2)


def test_an_adapted_eye_sees_white_where_a_camera_sees_orange():
    eye = default_eye(painted().room)
    adapted = look(painted(), eye)
    seen, taken = (
        room_picture(painted(), eye, conditions, (16, 12), samples=1)
        for conditions in (adapted, replace(adapted, viewing=Viewing(model="none")))
    )
    assert seen.shape == (12, 16, 3) and seen.min() >= 0 and seen.max() <= 1
    yellow = [codes[..., 0].mean() - codes[..., 2].mean() for codes in (seen, taken)]
    assert yellow[1] > 2 * yellow[0] > 0


def test_rows_of_a_picture_run_downwards():
    eye = Eye(position_m=(1.5, 0.2, 1.5), target_m=(1.5, 3.0, 1.5), fov_deg=90.0)
    XYZ = picture_XYZ(painted(), eye, (12, 12), painted().irradiance[0], samples=1)
    assert XYZ[0, 6, 1] > 2 * XYZ[-1, 6, 1]


@cache
def mixed() -> RoomLight:
    """White walls, a blue floor, daylight from the left and a tungsten panel on the right."""
    spectra = {"left": ("D65", 400.0), "right": ("A", 400.0)}
    emission = {
        side: irradiance_from_lux(light(name), lux) for side, (name, lux) in spectra.items()
    }
    paints = dict.fromkeys(WHITES, "grey:0.85") | {"floor": "ColorChecker/blue"}
    rho = [reflectance(paints.get(side, "black")).values for side in SIDES]
    return solve_room(Room(CUBE, np.array(rho), emission), 600, rays=1 << 19)


def mean_light_on(names: tuple[str, ...], eye: Eye) -> np.ndarray:
    """Mean irradiance (B,) on surfaces in view: two cones, each of half a million directions."""
    solved, forward = mixed(), np.subtract(eye.target_m, eye.position_m)
    mesh, seen = solved.mesh, np.zeros(len(solved.mesh.surface))
    axis = forward / np.linalg.norm(forward)
    side = np.cross(axis, [0.31, 0.2, 0.93])
    side /= np.linalg.norm(side)
    for low, high in ((1, 11), (11, 90)):
        steps = (np.arange(700) + 0.5) / 700
        angle, turn = np.meshgrid(np.radians(low + (high - low) * steps), 2 * np.pi * steps)
        across = np.cos(turn)[..., None] * side + np.sin(turn)[..., None] * np.cross(axis, side)
        ways = np.cos(angle)[..., None] * axis + np.sin(angle)[..., None] * across
        hit = solved.rays.first(
            np.broadcast_to(eye.position_m, (angle.size, 3)), ways.reshape(-1, 3)
        )
        part = np.sin(angle).ravel() / np.sin(angle).sum()
        seen += np.bincount(hit, part, len(seen))
    seen[~np.isin(mesh.surface, [mesh.names.index(name) for name in names])] = 0.0
    return seen @ solved.irradiance / seen.sum()


@pytest.mark.parametrize("white", [None, "ceiling"])
def test_the_white_is_a_mean_over_the_white_surfaces_in_view(white):
    """A sum over a million directions, within 0.2 %, along a wall."""
    Z, local = [], []
    for x in (0.4, 1.5, 2.6):
        eye = Eye(position_m=(1.5, 0.5, 1.5), target_m=(x, 3.0, 1.4))
        found = look(mixed(), eye, white=white)
        E = mean_light_on(WHITES if white is None else (white,), eye)
        rho = 1.0 if white is None else 0.85
        Q = colour_matching_functions(mixed().room.grid)
        assert found.white_XYZ == pytest.approx(100 * rho * Q @ E / (Q[1] @ E), rel=2e-3)
        assert found.L_Aw == pytest.approx(rho * float(lux_from_irradiance(E)) / np.pi, rel=2e-3)
        assert not found.note
        Z.append(found.white_XYZ[2] / rho)
        local.append(100 * float(Q[2] @ found.irradiance / (Q[1] @ found.irradiance)))
    assert np.ptp(Z) < 0.8 * np.ptp(local)


def test_an_eye_that_sees_no_white_is_told_what_was_taken():
    room = painted()
    found = look(room, default_eye(room.room))
    assert "no white surface" in found.note
    assert white_surfaces(room.room) == ()
    # PAINT is on all that reflects, so that the light is that of the walls.
    Q = colour_matching_functions(room.room.grid)
    E = room.irradiance[room.mesh.surface == SIDES.index("back")].mean(axis=0)
    assert found.white_XYZ == pytest.approx(100 * Q @ E / (Q[1] @ E), rel=0.08)
    level = Eye(position_m=(1.5, 1.5, 1.5), target_m=(1.5, 3.0, 1.5))
    behind = look(room, level, white="front")
    assert "out of view" in behind.note


def test_white_is_pale_and_nearly_neutral():
    """Munsell N 8.5 has Y 66.6 (ASTM D1535), N 8 has 57.6; cream and light blue are no white."""
    paints = ("grey:0.7", "grey:0.576", "ColorChecker/white 9.5 (.05 D)", *["grey:0.1"] * 3)
    rho = np.array([reflectance(name).values for name in paints])
    rho[3:5] = [reflectance_from_colour(code).values for code in ("#f0d9b5", "#d0e8ff")]
    room = Room(CUBE, rho, {"ceiling": irradiance_from_lux(light("D65"), 1.0)})
    assert white_surfaces(room) == (SIDES[0], SIDES[2])


OUTSIDE = Eye(position_m=(1.5, 1.5, 9.0), target_m=(1.5, 1.5, 20.0))


@pytest.mark.parametrize(
    ("call", "expected"),
    [
        (lambda: look(furnace(), default_eye(furnace().room), white="wall"), "unknown "),
        (lambda: look(furnace(), OUTSIDE), "range eye"),
    ],
)
def test_an_eye_outside_and_an_unknown_white_are_refused(call, expected):
    refuses(call, expected, RoomError)
