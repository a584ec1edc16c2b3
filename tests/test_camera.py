"""Cameras and raycast settings refuse nonsense at birth."""

from __future__ import annotations

import numpy as np
import pytest

from volspec.errors import CameraError
from volspec.raycast import Camera, RaycastSpec
from volspec.raycast.gpu import Raycaster
from volspec.transfer import TransferTable
from volspec.volume import Volume, phantom


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: Camera((0, 0, 0), (0, 0, 0)), "stands on its target"),
        (lambda: Camera((0, 0, 0), (0, 0, 9)), "looks along its up"),
        (lambda: Camera((0, 0, 0), (0, 9, 0), up=(0, 0, 0)), "looks along its up"),
        (lambda: Camera((0, np.nan, 0), (0, 9, 0)), "give three numbers"),
        (lambda: Camera((0, 0, 0), (0, 9, 0), fov_deg=180), "fov_deg is 180"),
        (lambda: Camera((0, 0, 0), (0, 9, 0), height_mm=0), "height_mm is 0"),
        (lambda: Camera.orbit(phantom.ball(8), zoom=0), "zoom is 0"),
        (lambda: Camera.orbit(phantom.ball(8), up=(0, 0, 0)), "up is"),
        (lambda: RaycastSpec(step_mm=0), "step_mm is 0"),
        (lambda: RaycastSpec(ambient=-1), "ambient is -1"),
        (lambda: RaycastSpec(alpha_stop=0), "alpha_stop is 0"),
        (lambda: RaycastSpec(shininess=0), "shininess is 0"),
        (lambda: Raycaster(phantom.ball(8), lanes=3), "lanes is 3"),
    ],
)
def test_nonsense_is_named(make: object, message: str) -> None:
    with pytest.raises(CameraError, match=message):
        make()  # type: ignore[operator]


def test_orbit_looks_from_where_the_angles_say() -> None:
    volume = phantom.ball(11)
    centre = np.full(3, 5.0)
    for azimuth, elevation, direction in [
        (0, 0, (0, -1, 0)),
        (90, 0, (1, 0, 0)),
        (180, 0, (0, 1, 0)),
        (0, 90, (0, 0, 1)),
        (0, -90, (0, 0, -1)),
    ]:
        camera = Camera.orbit(volume, azimuth_deg=azimuth, elevation_deg=elevation)
        away = np.subtract(camera.position_mm, centre)
        assert np.allclose(away / np.linalg.norm(away), direction, atol=1e-9)
        right, up, forward = camera.frame()
        assert np.allclose(np.cross(right, forward), up) and np.isclose(up @ up, 1)


def test_the_first_row_is_the_top_and_the_first_column_the_left() -> None:
    """A bright voxel high up (+z) and to the right (+x), seen from −y."""
    values = np.zeros((9, 9, 9), np.float32)
    values[7, 4, 7] = 1
    volume = Volume(values)
    table = TransferTable((0.0, 1.0), np.linspace(0, 1, 1024), np.ones((1024, 1)), 1.0)
    camera = Camera.orbit(volume, azimuth_deg=0, elevation_deg=0)
    _, alpha, _ = Raycaster(volume).cast(table, camera, (40, 40), RaycastSpec())
    row, column = np.unravel_index(alpha.argmax(), alpha.shape)
    assert row < 15 and column > 25


def test_pictures_need_a_positive_size_and_at_most_sixteen_channels() -> None:
    volume = phantom.ball(8)
    caster, camera = Raycaster(volume), Camera.orbit(volume)
    table = TransferTable((0.0, 1.0), np.linspace(0, 1, 64), np.ones((64, 17)), 1.0)
    with pytest.raises(CameraError, match="0x5"):
        caster.cast(table, camera, (0, 5), RaycastSpec())
    with pytest.raises(CameraError, match="17 channels; at most 16"):
        caster.cast(table, camera, (5, 5), RaycastSpec())
