"""Light of a room on a specimen, as an ambient light and a few directional ones."""

import numpy as np
import pytest

from tests.room.test_response import CUBE, PAINTED, even_room, two_lights
from tests.support.errors import raises
from volspec.errors import RoomError
from volspec.room import Room, irradiance_from_lux, lux_from_irradiance, solve_room
from volspec.room.model import PointLamp
from volspec.room.response import RoomResponse
from volspec.room.specimen import SpecimenLight
from volspec.spectra import DEFAULT_GRID, light

POINT = (1.5, 1.5, 1.2)


def solved(room: Room) -> RoomResponse:
    return RoomResponse.of(solve_room(room, 150, rays=1 << 18))


@pytest.mark.slow
def test_even_light_is_ambient():
    """White furnace: one group, with all of S / (1 − ρ)."""
    found = SpecimenLight.of(solved(even_room(0.5, np.ones(DEFAULT_GRID.size))), POINT)
    assert found.names == ("ambient",)
    assert found.irradiance.sum(axis=0)[0] == pytest.approx(2.0, rel=0.01)
    assert found.error < 0.01


def test_a_single_lamp_is_a_single_direction():
    """Black walls: the inverse square of the distance, from the lamp."""
    lamp = PointLamp((1.5, 1.5, 2.7), irradiance_from_lux(light("A"), 100.0), "bulb")
    black = np.zeros((6, DEFAULT_GRID.size))
    found = SpecimenLight.of(solved(Room(CUBE, black, {}, (lamp,))), POINT)
    assert found.names == ("ambient", "ceiling")
    assert found.directions[0] == pytest.approx((0.0, 0.0, 1.0), abs=0.02)
    assert found.irradiance[0, 1] == pytest.approx(1.0 / 1.5**2, rel=0.01)
    assert found.irradiance[0, 0] == pytest.approx(0.0, abs=0.01)
    assert found.brightest_lux == pytest.approx(100.0 / 1.5**2, rel=0.02)


def test_the_groups_give_the_light_on_a_surface_of_any_direction():
    """Against rays gathered at the point: 3 per cent of the mean, root mean square."""
    response = two_lights()
    found = SpecimenLight.of(response, POINT)
    assert 2 <= len(found.directions) <= 5 and found.error < 0.05
    normals = np.random.default_rng(3).normal(size=(40, 3))
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    there = response.solved.irradiance_at(np.broadcast_to(POINT, (40, 3)), normals)
    true = lux_from_irradiance(there)
    power = np.array([*response.solved.room.lights.values()])
    groups = lux_from_irradiance(np.einsum("lgb,lb->gb", found.irradiance, power))
    made = groups[0] + np.maximum(normals @ found.directions.T, 0.0) @ groups[1:]
    assert np.sqrt(np.mean((made - true) ** 2)) < 0.06 * true.mean()


def test_the_error_on_a_large_specimen_is_that_of_light_along_its_surface():
    """A lamp of 100 cd in a black room: by the inverse square, over a ball of 0.8 m."""
    lamp = PointLamp((1.5, 1.5, 2.7), irradiance_from_lux(light("A"), 100.0), "bulb")
    response = solved(Room(CUBE, np.zeros((6, DEFAULT_GRID.size)), {}, (lamp,)))
    found = SpecimenLight.of(response, POINT)
    normals = np.random.default_rng(5).normal(size=(200_000, 3))
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    for radius in (0.001, 0.8):
        ray = np.array(lamp.position_m) - POINT - radius * normals
        true = 100.0 * np.maximum(np.einsum("kc,kc->k", normals, ray), 0.0)
        true /= np.linalg.norm(ray, axis=1) ** 3
        at_middle = 100.0 / 1.5**2 * np.maximum(normals[:, 2], 0.0)
        expected = np.sqrt(np.mean((at_middle - true) ** 2)) / true.mean()
        error = found.error_on(response.solved, np.array(POINT), radius * np.eye(3))
        assert error == pytest.approx(expected, rel=0.08, abs=0.02)
    assert expected > 0.5


def test_other_paints_keep_the_directions():
    response = two_lights()
    found, painted = SpecimenLight.of(response, POINT), response.painted(PAINTED)
    there, new = found.under(painted), SpecimenLight.of(painted, POINT)
    assert there.names == found.names
    assert there.brightest_lux == pytest.approx(new.brightest_lux, rel=1e-6)
    assert there.brightest_lux != pytest.approx(found.brightest_lux, rel=0.01)


@pytest.mark.parametrize("point", [(1.5, 1.5, 0.45), (4.0, 1.5, 1.0)])
def test_a_specimen_in_a_table_or_outside_is_refused(point):
    with raises(RoomError, "range"):
        SpecimenLight.of(two_lights(), point)
