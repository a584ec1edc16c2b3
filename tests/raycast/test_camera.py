"""Cameras refuse nonsense at birth, and casters what they cannot cast."""

from dataclasses import replace

import numpy as np
import pytest

import volspec as vs
from tests.support.errors import refuses, warns
from tests.support.raycasts import FLAT, ramp, turned

METAL = {"copper": vs.reflectance("copper")}
BASIS = vs.MaterialBasis(METAL)
COPPER = vs.TransferFunction([(0.2, 0.5, "copper")], METAL, BASIS)
SMALL, BALL = vs.phantom.ball(8), vs.phantom.ball(12)
SIDE = vs.Camera.orbit(BALL)


def cast(caster: vs.Raycaster, channels: int) -> object:
    table, camera = ramp(1, channels=channels), vs.Camera.orbit(SMALL)
    return caster.cast(table, camera, (256, 256), vs.RaycastSpec())


def with_one_mebibyte() -> vs.Raycaster:
    caster = vs.Raycaster(SMALL)
    caster._compute.info = replace(caster._compute.info, memory_bytes=1 << 20)
    return caster


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: vs.Camera((0, 0, 0), (0, 0, 0)), "range Camera.position_mm"),
        (lambda: vs.Camera.orbit(SMALL, zoom=1e30), "range Camera.zoom"),
        (lambda: vs.Camera((0, 0, 0), (0, 0, 9)), "conflict Camera.up"),
        (lambda: vs.Camera((0, 0, 0), (0, 0, 9), up=(0, 0, -1e-200)), "conflict Camera.up"),
        (lambda: vs.Camera((0, 0, 0), (0, 9, 0), up=(0, 0, 0)), "range Camera.up"),
        (lambda: vs.Camera((0, 0, 0), (0, 9, 0), up="abc"), "type Camera.up"),
        (lambda: vs.Camera("123", (0, 9, 0)), "type Camera.position_mm"),
        (lambda: vs.Camera((0, 0, 0), (0, np.inf, 0)), "range Camera.target_mm[1]"),
        (lambda: vs.Camera((-1e308,) * 3, (1e308,) * 3), "range Camera.position_mm"),
        (lambda: vs.Camera.orbit(SMALL, zoom=1e-320), "range Camera.fov_deg"),
        (lambda: vs.Camera.orbit(SMALL, zoom=0), "range Orbit.zoom"),
        (lambda: vs.Camera.orbit(SMALL, target_mm=(1, 2)), "shape Orbit.target_mm"),
        (lambda: vs.Camera.orbit(SMALL, up=(0, 0, 0)), "range Orbit.up"),
        (lambda: vs.Raycaster(SMALL, lanes=3), "range Raycaster: lanes"),
        (lambda: cast(vs.Raycaster(SMALL), 129), "size "),
        (lambda: cast(with_one_mebibyte(), 16), "size "),
        (lambda: vs.raycast(BALL, COPPER, SIDE, caster=vs.Raycaster(SMALL)), "conflict "),
    ],
)
def test_nonsense_is_named(make, message):
    refuses(make, message)


@pytest.mark.parametrize("length", [5e-324, 1e-200, 1e200, 1e308])
def test_a_camera_stands_upright_whatever_the_length_of_up(length):
    """And at any distance from its target that is a number."""
    camera = vs.Camera((0, -min(length, 1e300), 0), (0, 0, 0), up=(0, length, length))
    right, up, forward = camera.frame()
    assert np.allclose([right, up, forward], [(1, 0, 0), (0, 0, 1), (0, 1, 0)])
    assert vs.Camera(camera.position_mm, camera.target_mm, camera.up) == camera


def test_orbit_looks_from_where_the_angles_say():
    angles = (0, 0), (90, 0), (180, 0), (0, 90), (0, -90)
    directions = (0, -1, 0), (1, 0, 0), (0, 1, 0), (0, 0, 1), (0, 0, -1)
    for view, direction in zip(angles, directions, strict=True):
        camera = turned(vs.phantom.ball(11), *view)
        away = np.subtract(camera.position_mm, 5.0)
        assert np.allclose(away / np.linalg.norm(away), direction, atol=1e-9)
        right, up, forward = camera.frame()
        assert np.allclose(np.cross(right, forward), up) and np.isclose(up @ up, 1)


def test_the_first_row_is_the_top_and_the_first_column_the_left():
    """A bright voxel high up (+z) and to the right (+x), seen from −y."""
    values = np.zeros((9, 9, 9), np.float32)
    values[7, 4, 7] = 1
    volume = vs.Volume(values)
    given = ramp(1, channels=1, entries=1024), turned(volume, 0, 0), (40, 40), FLAT
    alpha = vs.Raycaster(volume).cast(*given).alpha
    row, column = np.unravel_index(alpha.argmax(), alpha.shape)
    assert row < 15 and column > 25


def test_an_empty_picture_is_warned_about_with_its_likely_reason():
    beyond = replace(COPPER, points=[(100, 0, "copper"), (200, 0.5, "copper")])
    with warns("100", "200", " 0 "):
        vs.raycast(BALL, beyond, SIDE, (16, 16))
    clear = replace(COPPER, points=[(0, 0, "copper"), (1, 0, "copper")])
    with warns("opacity", "0"):
        vs.raycast(BALL, clear, SIDE, (16, 16))
    for target in ((900.0, 900.0, 0.0), (-50.0, 5.5, 5.5)):  # to one side, and behind
        with warns("5.5, 5.5, 5.5", "target_mm"):
            vs.raycast(BALL, COPPER, vs.Camera((-20.0, 5.5, 5.5), target), (16, 16))


def test_arrays_and_pyvista_grids_are_volumes():
    pictures = [
        vs.raycast(given, COPPER, vs.Camera.orbit(given), (16, 16)).alpha
        for given in (BALL, BALL.values, BALL.to_pyvista())
    ]
    assert all(np.array_equal(picture, pictures[0]) for picture in pictures)
