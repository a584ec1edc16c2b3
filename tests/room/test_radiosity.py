"""Radiosity of rooms: white furnace, the cube, refinement, points in the room, refusals."""

import numpy as np
import pytest

from tests.room.test_response import CUBE, even_room
from tests.support.errors import raises
from tests.support.fixtures import slow_each
from volspec.errors import RoomError
from volspec.room import Room, RoomLight, cube_radiosity, lux_from_irradiance, solve_room
from volspec.room.mesh import SIDES, RoomMesh, box, panel, rectangle
from volspec.room.model import PointLamp
from volspec.spectra import DEFAULT_GRID

BANDS = DEFAULT_GRID.size
# Fewer than by default, for speed.
RAYS = 1 << 19
SMOOTH = np.linspace(0.2, 0.95, BANDS)


@pytest.mark.parametrize("rho", [0.95, *slow_each(0.3)])
def test_a_white_furnace_is_full_of_light(rho):
    """Closed, uniform emission S, reflectance ρ: B = S / (1 − ρ) everywhere, also within."""
    solved = solve_room(even_room(rho, np.full(BANDS, 2.0)), 300, rays=RAYS)
    assert solved.radiosity == pytest.approx(2.0 / (1.0 - rho), rel=5e-3)
    assert solved.sampling_error < 5e-3 and solved.patch_error < 1e-6
    found = solved.light_at((1.0, 1.2, 1.4))
    assert found.values == pytest.approx(2.0 / (1.0 - rho) / DEFAULT_GRID.step_nm, rel=5e-3)


def test_a_cube_of_alike_walls_agrees_with_its_closed_form():
    """All walls of one paint, all emit: the mesh is the closed form, band by band."""
    reflectance, emission = np.tile(SMOOTH, (6, 1)), np.full((6, BANDS), 0.7)
    room = Room(CUBE, reflectance, dict(zip(SIDES, emission, strict=True)))
    closed, solved = cube_radiosity(reflectance, emission), solve_room(room, 300, rays=RAYS)
    assert solved.radiosity.mean(axis=0) == pytest.approx(closed[0], rel=5e-3)


def test_energy_is_conserved():
    """Closed room: the surfaces absorb the power that lights emit."""
    lamp = panel((0, 0, 3), (0, 3, 0), (3, 0, 0), "ceiling", [("lamp", (1.2, 1.2, 0.6, 0.6))])
    rest = CUBE.part(CUBE.surface != SIDES.index("ceiling"))
    table = box((1, 1, 0.4), (2, 2, 0.5), "table")
    mesh = RoomMesh(rest.corners_m, rest.surface, SIDES) + lamp + table
    reflectances = np.array([SMOOTH * (name != "lamp") for name in mesh.names])
    room = Room(mesh, reflectances, {"lamp": np.full(BANDS, 100.0)})
    solved = solve_room(room, 2000, rays=RAYS)
    absorbed = solved.mesh.areas_m2 @ ((1.0 - solved.reflectances) * solved.irradiance)
    assert absorbed == pytest.approx(100.0 * 0.36, rel=1e-2)
    assert 1500 < len(solved.mesh.surface) <= 2000
    # Direct light is uneven near the table's shadow: there patches are smaller.
    areas = solved.mesh.areas_m2[solved.mesh.surface == SIDES.index("floor")]
    assert areas.max() > 3.9 * areas.min()


@pytest.mark.slow
def test_points_of_the_room_receive_what_the_patches_do():
    room = Room(CUBE, np.tile(SMOOTH, (6, 1)), {"ceiling": np.full(BANDS, 10.0)})
    solved = solve_room(room, 2000, rays=RAYS)
    floor = np.flatnonzero(solved.mesh.surface == SIDES.index("floor"))
    patch = floor[np.linalg.norm(solved.mesh.centres_m[floor] - [1.5, 1.5, 0], axis=1).argmin()]
    point = solved.mesh.centres_m[patch] + [0, 0, 1e-3]
    found = solved.irradiance_at(point, (0, 0, 1))[0]
    assert found == pytest.approx(solved.irradiance[patch], rel=2e-2)
    mean = lux_from_irradiance(solved.mean_irradiance("floor"))
    assert 0.5 * lux_from_irradiance(found) < mean < lux_from_irradiance(found)


def test_another_paint_needs_no_other_rays():
    room = Room(CUBE, np.tile(SMOOTH, (6, 1)), {"ceiling": np.full(BANDS, 10.0)})
    paints = {"left": np.full(BANDS, 0.4), "floor": SMOOTH[::-1]}
    found = solve_room(room, 200, rays=RAYS).painted(paints)
    again = solve_room(room.painted(paints), 200, rays=RAYS)
    assert found.irradiance == pytest.approx(again.irradiance)
    assert found.room.reflectance("left") == pytest.approx(0.4)
    assert found.sampling_error == pytest.approx(again.sampling_error)


def lit(mesh: RoomMesh, **settings: object) -> Room:
    """Return a grey room whose last surface emits."""
    grey = np.full((len(mesh.names), BANDS), 0.5)
    return Room(mesh, grey, {mesh.names[-1]: np.ones(BANDS)}, **settings)


def solve(mesh: RoomMesh, patches: int = 100, **settings: object) -> RoomLight:
    return solve_room(lit(mesh, **settings), patches, rays=RAYS)


def inverted(mesh: RoomMesh) -> RoomMesh:
    return RoomMesh(mesh.corners_m[:, ::-1], mesh.surface, mesh.names)


def grey(**emission: np.ndarray) -> Room:
    return Room(CUBE, np.full((6, BANDS), 0.5), emission)


def with_lamp(*place: float) -> RoomLight:
    return solve(CUBE + CHEST, lamps=(PointLamp(place, np.ones(BANDS)),))


CHEST = box((1, 1, 1), (2, 2, 2), "chest")
FLOOR = rectangle((0, 0, 0), (1, 0, 0), (0, 1, 0), "floor")
OPENED = RoomMesh(CUBE.corners_m[2:], CUBE.surface[2:], SIDES)


def test_an_open_room_may_be_solved_as_such():
    assert solve(OPENED, open=True).irradiance.max() > 0


@pytest.mark.parametrize(
    ("call", "expected"),
    [
        (lambda: solve(OPENED), "conflict open"),
        (lambda: solve(FLOOR, 10), "conflict open"),
        (lambda: solve(inverted(CUBE)), "conflict mesh"),
        (lambda: solve(CUBE + inverted(CHEST)), "conflict chest"),
        (lambda: with_lamp(1.5, 1.5, 1.5), "range"),
        (lambda: with_lamp(5.0, 1.0, 1.0), "range"),
        (lambda: solve(CUBE, 10**9), "size patches"),
        (lambda: solve(CUBE).light_at((1.0, 1.2, 3.4)), "range"),
        (lambda: grey(floor=SMOOTH).painted({"walls": SMOOTH}), "unknown"),
        (lambda: grey(floor=SMOOTH).painted({"left": np.ones(BANDS)}), "range reflectance"),
        (grey, "missing"),
        (lambda: grey(floor=-SMOOTH), "range emission"),
        (lambda: grey(flor=SMOOTH), "unknown"),
    ],
)
def test_rooms_that_cannot_be_solved_are_refused(call, expected):
    with raises(RoomError, *expected.split()):
        call()
