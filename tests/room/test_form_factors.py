"""Form factors by rays against analytic values; direct light against Lambert's formula."""

import numpy as np
import pytest

from volspec.room import Room
from volspec.room.direct_light import direct_irradiance, seen_part
from volspec.room.form_factors import Rays, form_factors
from volspec.room.mesh import SIDES, box, rectangle
from volspec.room.model import PointLamp, SunBeam
from volspec.spectra import DEFAULT_GRID

FLOOR = rectangle((0, 0, 0), (1, 0, 0), (0, 1, 0), "floor")
CEILING = rectangle((0, 1, 1), (1, 0, 0), (0, -1, 0), "ceiling")
WALL = rectangle((0, 0, 0), (0, 1, 0), (0, 0, 1), "wall")
ONE = np.ones(DEFAULT_GRID.size)


@pytest.mark.parametrize(
    ("other", "analytic"),
    [(CEILING, 0.199824895698), (WALL, 0.200043776)],
    ids=["parallel", "adjacent"],
)
@pytest.mark.parametrize("longest_m", [2.0, 0.3])
def test_two_squares_have_their_analytic_form_factor(other, analytic, longest_m):
    mesh = (FLOOR + other).with_edges(longest_m)
    factors = form_factors(Rays(mesh), (1 << 18) // len(mesh.surface)).factors
    floor = mesh.surface == 0
    found = mesh.areas_m2[floor] @ factors[floor][:, ~floor].sum(axis=1)
    assert found == pytest.approx(analytic, rel=5e-3)


def test_in_a_closed_room_rows_sum_to_one_and_flows_are_reciprocal():
    table = box((1.5, 1.5, 0.5), (2.5, 3, 0.6), "table")
    mesh = (box((0, 0, 0), (4, 5, 2.7), SIDES, inside=True) + table).with_edges(0.7)
    found = form_factors(Rays(mesh), 1024)
    assert found.escaped.max() == 0
    assert np.asarray(found.factors.sum(axis=1)) == pytest.approx(1.0, abs=5e-3)
    flow = (found.factors * mesh.areas_m2[:, None]).toarray()
    assert np.abs(flow - flow.T).max() <= 1e-3 * flow.max()
    assert flow.trace() == 0


def test_rays_that_leave_or_hit_a_back_are_counted():
    mesh = FLOOR + rectangle((0, 0, 1), (1, 0, 0), (0, 1, 0), "back of a ceiling")
    found = form_factors(Rays(mesh), 4096)
    assert found.backs[:2].mean() == pytest.approx(0.1998, abs=0.01)
    assert found.escaped[:2].mean() == pytest.approx(0.8002, abs=0.01)
    assert found.factors.nnz == 0


def test_the_part_of_a_square_that_a_point_sees_is_exact():
    """Howell's B-3: a point below the corner of a parallel unit square at distance 1."""
    analytic = np.arctan(1 / np.sqrt(2)) / (np.pi * np.sqrt(2))
    origin, up = np.zeros((1, 3)), np.array([[0.0, 0.0, 1.0]])
    assert sum(seen_part(origin, up, each) for each in CEILING.corners_m) == pytest.approx(analytic)
    # What is below the horizon of a point does not count.
    aside = np.array([[1.0, 0.0, 0.0]])
    wide = rectangle((-1, 1, 1), (2, 0, 0), (0, -1, 0), "ceiling")
    half = sum(seen_part(origin, aside, each) for each in CEILING.corners_m)
    assert sum(seen_part(origin, aside, each) for each in wide.corners_m) == pytest.approx(half)
    behind = rectangle((0, 0, 1), (1, 0, 0), (0, 1, 0), "ceiling")
    assert sum(seen_part(origin, up, each) for each in behind.corners_m) == 0


def test_lamps_and_the_sun_follow_their_laws():
    mesh = box((0, 0, 0), (4, 4, 4), SIDES, inside=True)
    lamp = PointLamp((2.0, 2.0, 3.0), 9.0 * ONE)
    point, up = np.array([[2.0, 2.0, 0.0]]), np.array([[0.0, 0.0, 1.0]])
    black, rays = np.zeros((6, DEFAULT_GRID.size)), Rays(mesh)
    room = Room(mesh, black, lamps=(lamp,))
    assert direct_irradiance(room, rays, point, up) == pytest.approx(1.0, rel=1e-4)
    at_60 = np.array([[0.0, np.sqrt(0.75), 0.5]])
    assert direct_irradiance(room, rays, point, at_60) == pytest.approx(0.5, rel=1e-4)
    assert not direct_irradiance(room, rays, point, -up).any()
    direction = (0.0, -np.sqrt(0.75), 0.5)
    for window, expected in ((2, 50.0), (1, 0.0)):
        sunny = Room(mesh, black, suns=(SunBeam(direction, 100.0 * ONE, frozenset({window})),))
        assert direct_irradiance(sunny, rays, point, up) == pytest.approx(expected, rel=1e-6, abs=0)


def test_a_board_casts_a_shadow():
    board = box((1.9, 1.9, 1.5), (2.1, 2.1, 1.6), "board")
    mesh = box((0, 0, 0), (4, 4, 4), SIDES, inside=True) + board
    points = np.array([[2.0, 2.0, 1.4], [3.5, 3.5, 1.4]])
    up = np.broadcast_to([0.0, 0.0, 1.0], points.shape)
    room = Room(mesh, np.zeros((7, DEFAULT_GRID.size)), {"ceiling": ONE})
    below, aside = direct_irradiance(room, Rays(mesh), points, up)
    assert below.max() < 0.6 * aside.min()
