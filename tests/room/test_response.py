"""Response of a room to its lights: other spectra, other paints, and the closed form of paints."""

from functools import cache

import numpy as np
import pytest

from tests.support.errors import raises
from volspec.errors import RoomError
from volspec.room import Room, irradiance_from_lux, lux_from_irradiance, solve_room
from volspec.room.mesh import SIDES, RoomMesh, box, panel
from volspec.room.model import PointLamp, SunBeam
from volspec.room.response import RoomResponse
from volspec.spectra import DEFAULT_GRID, light, reflectance_from_colour

CUBE = box((0, 0, 0), (3, 3, 3), SIDES, inside=True)
GREY = np.full(DEFAULT_GRID.size, 0.5)
SALMON = reflectance_from_colour("#f4b8a0").values
PAINTED = dict.fromkeys(SIDES[:4], SALMON)


def even_room(rho: float, emission: np.ndarray) -> Room:
    """A cube whose walls are all alike and all emit: a furnace."""
    return Room(CUBE, np.full((6, DEFAULT_GRID.size), rho), dict.fromkeys(SIDES, emission))


@cache
def two_lights() -> RoomResponse:
    """A grey room with a tungsten panel, a small daylight lamp and a table."""
    ceiling = panel((0, 0, 3), (0, 3, 0), (3, 0, 0), "ceiling", [("lamp", (1.2, 1.2, 0.6, 0.6))])
    rest = CUBE.part(CUBE.surface != SIDES.index("ceiling"))
    table = box((1, 1, 0.4), (2, 2, 0.5), "table")
    mesh = RoomMesh(rest.corners_m, rest.surface, SIDES) + ceiling + table
    reflectances = np.array([GREY * (name != "lamp") for name in mesh.names])
    small = PointLamp((0.6, 0.6, 2.0), irradiance_from_lux(light("D65"), 50.0), "bulb")
    exitances = {"lamp": irradiance_from_lux(light("A"), 2000.0)}
    room = Room(mesh, reflectances, exitances, (small,))
    return RoomResponse.of(solve_room(room, 500, rays=1 << 19))


@pytest.mark.slow
def test_the_lights_of_a_room_have_names():
    assert two_lights().names == ("lamp", "bulb")
    emission = irradiance_from_lux(light("A"), 1.0)
    lamps, suns = (PointLamp((1, 1, 1), emission),), (SunBeam((0, 0, 1), emission),)
    room = Room(CUBE, np.tile(GREY, (6, 1)), {"floor": emission}, lamps, suns)
    assert list(room.lights) == ["floor", "lamp 1", "sun 1"]


def test_its_own_spectra_give_the_solution_back():
    """Both compute direct light by shadow rays of their own, which differ by a thousandth."""
    solved = solve_room(two_lights().solved.room, 500, rays=1 << 19)
    own = two_lights().under([*solved.room.lights.values()])
    found, true = (lux_from_irradiance(each.irradiance) for each in (own, solved))
    assert found == pytest.approx(true, rel=0.03)
    assert own.irradiance.sum() == pytest.approx(solved.irradiance.sum(), rel=1e-3)


def test_another_spectrum_is_as_bright():
    """Lumens stay when the spectrum of a lamp is replaced."""
    response = two_lights()
    own, other = (response.spectra({"lamp": light(name)}) for name in ("A", "HP1"))
    assert lux_from_irradiance(own[0]) == pytest.approx(lux_from_irradiance(other[0]))
    assert not own[1].any()


@pytest.mark.slow
def test_new_spectra_need_no_new_solution():
    """A product equals a solution of the room with these lights, to rounding."""
    response = two_lights()
    relit = response.under(response.spectra({"lamp": light("D65"), "bulb": light("HP1")}))
    assert RoomResponse.of(relit).solved.irradiance == pytest.approx(relit.irradiance, rel=1e-6)
    dark = response.under(response.spectra({"bulb": light("HP1")}))
    assert list(dark.room.lights) == ["lamp", "bulb"] and not dark.room.lights["lamp"].any()


def test_painted_is_the_solution_with_that_paint():
    found, true = two_lights().painted(PAINTED), two_lights().solved.painted(PAINTED)
    assert found.solved.irradiance == pytest.approx(true.irradiance, rel=2e-3)


@pytest.mark.slow
def test_the_closed_form_is_close_where_light_is_even():
    """Each wall's own light is uneven; all together are even."""
    room = even_room(0.5, irradiance_from_lux(light("D65"), 100.0))
    response = RoomResponse.of(solve_room(room, 150, rays=1 << 18))
    paints = dict.fromkeys(SIDES, SALMON)
    exact, fast = response.painted(paints), response.estimated(paints)
    assert fast.solved.irradiance == pytest.approx(exact.solved.irradiance, rel=0.02)


@pytest.mark.slow
def test_the_closed_form_is_near_the_solution_elsewhere():
    """Present paints are exact; others are far nearer than without a change."""
    response = two_lights()
    same = response.estimated(dict.fromkeys(SIDES[:4], GREY))
    assert same.irradiance == pytest.approx(response.irradiance, rel=1e-9)
    fast, exact, old = (
        lux_from_irradiance(each.solved.irradiance)
        for each in (response.estimated(PAINTED), response.painted(PAINTED), response)
    )
    error, change = np.abs(fast / exact - 1.0).mean(), np.abs(old / exact - 1.0).mean()
    assert error < 0.02 < 5.0 * error < change


def test_from_black_reflected_light_is_spread_evenly():
    """Nothing can be scaled there: a surface has the light of its closed form."""
    paints = dict.fromkeys((*SIDES, "table"), GREY)
    black = two_lights().painted({name: 0.0 * grey for name, grey in paints.items()})
    fast, exact = (
        lux_from_irradiance(each.solved.irradiance).mean()
        for each in (black.estimated(paints), black.painted(paints))
    )
    assert fast == pytest.approx(exact, rel=0.1)


def named_twice() -> Room:
    emission = irradiance_from_lux(light("A"), 1.0)
    lamp = PointLamp((1, 1, 1), emission, "floor")
    return Room(CUBE, np.tile(GREY, (6, 1)), {"floor": emission}, (lamp,))


@pytest.mark.parametrize(
    ("call", "code"),
    [
        (named_twice, "duplicate"),
        (lambda: two_lights().spectra({"lamb": light("A")}), "unknown"),
        (lambda: two_lights().under(np.zeros((2, DEFAULT_GRID.size))), "missing"),
        (lambda: two_lights().painted({"roof": SALMON}), "unknown"),
    ],
)
def test_unknown_names_and_no_light_are_refused(call, code):
    with raises(RoomError, code):
        call()
