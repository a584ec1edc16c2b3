"""Casts of served views: cameras, coarse and whole, the newest first, marks, gaps, failures."""

import json
import socket
import struct
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from threading import Event
from types import SimpleNamespace

import numpy as np
import pytest

from tests.serve.conftest import entered
from tests.support.patience import PATIENCE_S, wait_until
from tests.support.pyramids import stored
from volspec.camera.camera import Orbit
from volspec.errors import CastCancelled, OpenCLError, RaycastError
from volspec.export.page import pack_view
from volspec.export.serve import views as served_views
from volspec.export.serve.views import CastQueue, SceneViews, ViewRequest, scene_orbit
from volspec.pipeline import raycast
from volspec.scene import Scene
from volspec.scene.tables.specs import CameraSpec
from volspec.volume import phantom


def test_a_view_is_what_the_pipeline_casts(client, ball_scene):
    camera = Orbit(75.0, -30.0, ball_scene.file.camera.zoom / 0.5)
    volume = ball_scene.volume()
    given = ball_scene.transfer, camera.camera(volume), (42, 30), ball_scene.raycast
    packed = pack_view(raycast(volume, *given), 8)
    numbers, data = client.view(azimuth=75, elevation=-30, distance=0.5).view()
    assert data == packed.data
    assert (numbers["width"], numbers["height"], numbers["coarse"]) == (42, 30, False)
    assert (tuple(numbers["low"]), tuple(numbers["high"])) == (packed.low, packed.high)
    assert numbers["notice"] == ""


def test_a_coarse_view_is_smaller_and_has_the_marks_of_the_whole(client):
    whole, _ = client.view().view()
    coarse, _ = client.view(coarse=1).view()
    assert coarse["width"] <= whole["width"] and coarse["marks"] == whole["marks"]
    assert [inside for name, _, inside in whole["marks"] if name == "text"] == ["here & there"]


def test_the_page_opens_with_the_scenes_own_camera(client):
    text = client.get("/").body.decode()
    assert '"served":{"azimuth_deg":20.0,"elevation_deg":10.0' in text
    assert '"width":42,"height":30,"count":6' in text


@pytest.mark.parametrize(
    "table",
    [
        CameraSpec(azimuth_deg=200.0, elevation_deg=-20.0, zoom=1.3, roll_deg=30.0),
        CameraSpec(azimuth_deg=20.0, elevation_deg=120.0),
        CameraSpec(azimuth_deg=20.0, elevation_deg=-250.0, orthographic=True),
        CameraSpec(position_mm=(30.0, -20.0, 25.0), target_mm=(7.0, 8.0, 9.0), fov_deg=40.0),
        CameraSpec(position_mm=(30.0, -20.0, 25.0), up=(0.0, 1.0, 0.0)),
    ],
)
def test_the_orbit_of_a_scene_is_its_camera(ball_scene, table):
    scene, volume = ball_scene.with_camera(table), ball_scene.volume()
    orbit = scene_orbit(scene, volume)
    assert abs(orbit.elevation_deg) <= 90 and abs(orbit.azimuth_deg) <= 180
    own, made = scene.camera(volume), orbit.camera(volume)
    assert np.allclose(own.position_mm, made.position_mm, atol=1e-9)
    assert np.allclose(own.frame(), made.frame(), atol=1e-9)
    assert (own.fov_deg, own.height_mm) == (made.fov_deg, made.height_mm)


def waiting(started: Event) -> Callable[..., bytes]:
    """Return a cast that ends at once, or if it is coarse when it is cancelled."""

    def message(request: ViewRequest, cancel: Callable[[], bool]) -> bytes:
        if not request.coarse:
            return b"whole"
        started.set()
        wait_until(cancel)
        raise CastCancelled("raycast: cancelled", code="state")

    return message


def test_of_a_clients_requests_the_newest_counts():
    started = Event()
    queue = CastQueue(waiting(started))
    first, running = queue.submit(ViewRequest(0, 0, coarse=True, client=1))
    assert started.wait(PATIENCE_S)
    _, other = queue.submit(ViewRequest(0, 0, client=2))
    second, waits = queue.submit(ViewRequest(1, 0, coarse=True, client=1))
    third, newest = queue.submit(ViewRequest(2, 0, client=1))
    for replaced in (running, waits):
        assert isinstance(replaced.exception(PATIENCE_S), CastCancelled)
    assert (other.result(PATIENCE_S), newest.result(PATIENCE_S)) == (b"whole", b"whole")
    for pending in (first, second):
        queue.done(pending)
    assert first.superseded.is_set() and not third.superseded.is_set()
    queue.close()


def test_a_replaced_request_is_answered_as_such_and_others_go_on(ball_scene):
    started = Event()
    with entered(ball_scene, waiting(started)) as client, ThreadPoolExecutor(1) as pool:
        earlier = pool.submit(client.view, coarse=1, client=7)
        assert started.wait(PATIENCE_S)
        assert client.get("/").status == 200, "the page does not wait for a cast"
        assert client.view(client=7).body == b"whole"
        assert earlier.result(PATIENCE_S).status == 409 and earlier.result().line


def test_a_browser_that_leaves_ends_its_cast(ball_scene):
    started, ended = Event(), Event()

    def message(request: ViewRequest, cancel: Callable[[], bool]) -> bytes:
        try:
            return waiting(started)(request, cancel)
        finally:
            ended.set()

    with entered(ball_scene, message) as client:
        words = "azimuth=0&elevation=0&distance=1&coarse=1&transfer=0&client=1"
        head = f"GET /view?{words} HTTP/1.1\r\nHost: localhost\r\nCookie: {client.cookie}\r\n\r\n"
        with socket.create_connection(("127.0.0.1", client.server.port), PATIENCE_S) as browser:
            browser.sendall(head.encode())
            assert started.wait(PATIENCE_S)
        assert ended.wait(PATIENCE_S)


def test_stopping_ends_a_cast_in_progress(ball_scene):
    started = Event()
    with entered(ball_scene, waiting(started)) as client, ThreadPoolExecutor(1) as pool:
        unanswered = pool.submit(client.view, coarse=1)
        assert started.wait(PATIENCE_S)
        client.server.stop()
        assert unanswered.exception(PATIENCE_S) is not None or unanswered.result().status == 409


@pytest.mark.parametrize(
    ("error", "status"),
    [
        (RaycastError("step_mm: 1\nis too long", "give less"), 422),
        (OpenCLError("the device is lost", "see volspec doctor"), 500),
        (MemoryError(), 500),
        (ZeroDivisionError("by\n0"), 500),
    ],
)
@pytest.mark.filterwarnings("ignore")
def test_a_failed_cast_is_one_line_and_the_next_succeeds(ball_scene, error, status):
    def message(request: ViewRequest, cancel: Callable[[], bool]) -> bytes:
        if request.coarse:
            raise error
        return b"whole"

    with entered(ball_scene, message) as client:
        answer = client.view(coarse=1)
        assert answer.status == status and answer.line
        assert client.view().body == b"whole"


def test_coarse_views_are_coarser_on_a_slow_network(ball_scene, monkeypatch):
    """Casts take no time here: their clock does not move."""
    monkeypatch.setattr(served_views, "time", SimpleNamespace(perf_counter=lambda: 0.0))
    views = SceneViews(ball_scene, size=(64, 48))
    assert [divisor_of(views, transfer_ms=2000) for _ in range(4)][-1] == 8, "the coarsest"
    assert divisor_of(views) == 8 and divisor_of(views) < 8, "the next is as the last was"


def divisor_of(views: SceneViews, transfer_ms: int = 0) -> int:
    """Cast a coarse view; return the divisor of its sides."""
    message = views.message(ViewRequest(0, 0, coarse=True, transfer_ms=transfer_ms))
    (length,) = struct.unpack_from(">I", message)
    return -(-64 // json.loads(message[4 : 4 + length])["width"])


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore::volspec.errors.VolspecWarning")
def test_missing_parts_of_a_store_are_told_to_the_page(tmp_path):
    pytest.importorskip("zarr")
    volume = stored(phantom.ball(150), tmp_path, "8MB")
    for chunk in (tmp_path / "v.zarr/0/c/1/1").iterdir():
        chunk.unlink()
    scene = Scene.from_volume(str(tmp_path / "v.zarr?memory=8MB"), volume=volume, lights=["D65"])
    scene = scene.casting(level=0, step_mm=None)
    with entered(scene, volume=volume, size=(24, 24)) as client:
        coarse, _ = client.view(coarse=1).view()
        assert coarse["notice"] == "" and coarse["coarse"]
        whole, _ = client.view().view()
        assert "cannot be read" in whole["notice"]
