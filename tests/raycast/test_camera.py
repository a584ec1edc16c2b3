"""Cameras refuse nonsense at birth, and casters what they cannot cast."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from tests.support.errors import raises, refuses, warns
from tests.support.raycasts import FLAT, ramp, turned
from volspec.basis import SpectralBasis
from volspec.errors import DeviceError, InputError, RaycastError
from volspec.pipeline import raycast
from volspec.raycast import Camera, RaycastSpec
from volspec.raycast.gpu import Raycaster
from volspec.spectra import reflectance
from volspec.transfer import TransferFunction
from volspec.volume import Volume, phantom

BASIS = SpectralBasis.load("general-7")
COPPER = {"copper": reflectance("copper")}


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: Camera((0, 0, 0), (0, 0, 0)), "range Camera.position_mm"),
        (lambda: Camera.orbit(phantom.ball(4), zoom=1e30), "range Camera.zoom"),
        (lambda: Camera((0, 0, 0), (0, 0, 9)), "conflict Camera.up"),
        (lambda: Camera((0, 0, 0), (0, 0, 9), up=(0, 0, -1e-200)), "conflict Camera.up"),
        (lambda: Camera((0, 0, 0), (0, 9, 0), up=(0, 0, 0)), "range Camera.up"),
        (lambda: Camera((0, 0, 0), (0, 9, 0), up="abc"), "type Camera.up"),
        (lambda: Camera("123", (0, 9, 0)), "type Camera.position_mm"),
        (lambda: Camera(None, (0, 9, 0)), "type Camera.position_mm"),
        (lambda: Camera((0, 0, 0), (0, np.inf, 0)), "range Camera.target_mm[1]"),
        (lambda: Camera((-1e308,) * 3, (1e308,) * 3), "range Camera.position_mm"),
        (lambda: Camera.orbit(phantom.ball(8), zoom=1e-320), "range Camera.fov_deg"),
        (lambda: Camera.orbit(phantom.ball(8), zoom=0), "range Orbit.zoom"),
        (lambda: Camera.orbit(phantom.ball(8), target_mm=(1, 2)), "shape Orbit.target_mm"),
        (lambda: Camera.orbit(phantom.ball(8), up=(0, 0, 0)), "range Orbit.up"),
        (lambda: Raycaster(phantom.ball(8), lanes=3), "range Raycaster: lanes"),
    ],
)
def test_nonsense_is_named(make: Callable[[], object], message: str) -> None:
    refuses(make, message)


@pytest.mark.parametrize("length", [5e-324, 1e-200, 1e200, 1e308])
def test_a_camera_stands_upright_whatever_the_length_of_up(length: float) -> None:
    """And at any distance from its target that is a number."""
    camera = Camera((0, -min(length, 1e300), 0), (0, 0, 0), up=(0, length, length))
    right, up, forward = camera.frame()
    assert np.allclose([right, up, forward], [(1, 0, 0), (0, 0, 1), (0, 1, 0)])
    assert Camera(camera.position_mm, camera.target_mm, camera.up) == camera


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
    given = ramp(1, channels=1, entries=1024), turned(volume, 0, 0), (40, 40), FLAT
    alpha = Raycaster(volume).cast(*given).alpha
    row, column = np.unravel_index(alpha.argmax(), alpha.shape)
    assert row < 15 and column > 25


def test_pictures_have_at_most_32_channels() -> None:
    volume = phantom.ball(8)
    with raises(RaycastError, "size"):
        Raycaster(volume).cast(ramp(1, channels=33), Camera.orbit(volume), (5, 5), RaycastSpec())


def test_a_picture_beyond_the_device_s_memory_is_refused_in_one_line(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """20 GB of picture, where 4 are free."""
    monkeypatch.setattr("volspec._gpu.opencl.host_free_bytes", lambda: 4 << 30)
    volume = phantom.ball(8)
    caster = Raycaster(volume)
    if not caster._compute.info.is_cpu:
        pytest.skip("a GPU has memory of its own")
    with raises(DeviceError, "size"):
        caster.cast(ramp(1, channels=16), Camera.orbit(volume), (16384, 16384), RaycastSpec())


def test_an_empty_picture_is_warned_about_with_its_likely_reason() -> None:
    volume = phantom.ball(12)
    transfer = TransferFunction([(100, 0, "copper"), (200, 1, "copper")], COPPER, BASIS)
    with warns("100", "200", " 0 "):
        raycast(volume, transfer, Camera.orbit(volume), (16, 16))
    clear = TransferFunction([(0, 0, "copper"), (1, 0, "copper")], COPPER, BASIS)
    with warns("opacity", "0"):
        raycast(volume, clear, Camera.orbit(volume), (16, 16))
    solid = TransferFunction([(0.2, 0.5, "copper")], COPPER, BASIS)
    for target in ((900.0, 900.0, 0.0), (-50.0, 5.5, 5.5)):  # to one side, and behind
        with warns("5.5, 5.5, 5.5", "target_mm"):
            raycast(volume, solid, Camera((-20.0, 5.5, 5.5), target), (16, 16))


def test_a_caster_casts_its_own_volume_only() -> None:
    one, other = phantom.ball(12), phantom.ball(12)
    transfer = TransferFunction([(0.2, 0.5, "copper")], COPPER, BASIS)
    with raises(InputError, "conflict"):
        raycast(one, transfer, Camera.orbit(one), caster=Raycaster(other))


def test_arrays_and_pyvista_grids_are_volumes() -> None:
    ball = phantom.ball(12)
    transfer = TransferFunction([(0.2, 0.5, "copper")], COPPER, BASIS)
    pictures = [
        raycast(given, transfer, Camera.orbit(given), (16, 16)).alpha
        for given in (ball, ball.values, ball.to_pyvista())
    ]
    assert all(np.array_equal(picture, pictures[0]) for picture in pictures)
