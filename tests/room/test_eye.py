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
from volspec.room.eye import picture_XYZ
from volspec.room.mesh import SIDES
from volspec.room.wall_paint import atlas_appearance
from volspec.spectra import light, reflectance_from_colour, white_XYZ

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
