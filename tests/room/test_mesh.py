"""Meshes of rooms: sides, openings, subdivision, and what is refused."""

import numpy as np
import pytest

from tests.support.errors import raises
from volspec.errors import RoomError
from volspec.room.mesh import SIDES, RoomMesh, box, panel, rectangle

ROOM = box((0, 0, 0), (4, 5, 2.7), SIDES, inside=True)


def test_a_room_is_closed_and_its_fronts_are_inside():
    numbers = ROOM.corner_numbers()
    sides = np.sort(np.stack([numbers, np.roll(numbers, -1, axis=1)], axis=-1), axis=-1)
    _, shared = np.unique(sides.reshape(-1, 2), axis=0, return_counts=True)
    assert (shared == 2).all() and ROOM.names == SIDES
    assert ROOM.areas_m2.sum() == pytest.approx(2 * (20 + 13.5 + 10.8))
    towards = np.array([2, 2.5, 1.35]) - ROOM.centres_m
    assert (np.einsum("nc,nc->n", ROOM.normals, towards) > 0).all()


def test_a_wall_has_a_window():
    found = wall((1.0, 0.9, 2.0, 1.4))
    window = found.surface == found.names.index("window 0")
    assert found.areas_m2[window].sum() == pytest.approx(2.8)
    assert found.areas_m2.sum() == pytest.approx(13.5)
    corners = found.corners_m[window].reshape(-1, 3)
    assert corners.min(axis=0).tolist() == [0, 1, 0.9]
    assert corners.max(axis=0) == pytest.approx([0, 3, 2.3])


def test_halves_cover_their_triangles():
    fine = ROOM.with_edges(0.5)
    sides = np.linalg.norm(fine.corners_m - np.roll(fine.corners_m, 1, axis=1), axis=-1)
    assert sides.max() <= 0.5
    for surface in range(6):
        share = fine.areas_m2[fine.surface == surface].sum()
        assert share == pytest.approx(ROOM.areas_m2[ROOM.surface == surface].sum())
    found, own = (np.unique(mesh.normals.round(9) + 0.0, axis=0) for mesh in (fine, ROOM))
    assert np.array_equal(found, own)


def test_points_are_uniform_over_a_triangle():
    shares = np.random.default_rng(0).random((20000, 2))
    points = ROOM.points(shares)
    assert points.shape == (12, 20000, 3)
    assert np.abs(points.mean(axis=1) - ROOM.centres_m).max() < 0.05


def wall(*places: tuple[float, float, float, float]) -> RoomMesh:
    windows = [(f"window {k}", place) for k, place in enumerate(places)]
    return panel((0, 0, 0), (0, 5, 0), (0, 0, 2.7), "left", windows)


def three_at_an_edge() -> RoomMesh:
    across, along = (1, 0, 0), (0, 1, 0)
    sides = ((across, along), (along, across), (across, along))
    a, b, c = (rectangle((0, 0, 0), *way, name) for way, name in zip(sides, "abc", strict=True))
    return a + b + c


def mesh(corners: object, count: int = 1) -> RoomMesh:
    return RoomMesh(np.array(corners, float), np.zeros(count, np.intp), ("wall",) * count)


@pytest.mark.parametrize(
    ("make", "code"),
    [
        *(
            (lambda place=place: wall(place), "range")
            for place in ((4, 0, 2, 1), (-1, 0, 2, 1), (0, 0, 0, 1), (0, 2, 1, 1))
        ),
        (lambda: wall((1.0, 1.0, 1.0, 1.0), (1.5, 1.5, 1.0, 1.0)), "conflict"),
        (lambda: mesh([[[0, 0, 0], [1, 1, 1], [2, 2, 2]]]), "conflict"),
        (three_at_an_edge, "duplicate"),
        (lambda: mesh(np.full((1, 3, 3), np.nan)), "range"),
        (lambda: mesh(np.zeros((0, 3, 3)), 0), "shape"),
    ],
)
def test_meshes_that_cannot_be_used_are_refused(make, code):
    with raises(RoomError, code):
        make()
