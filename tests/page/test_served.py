"""A served page in a browser: the camera moves by casts, lights change without any."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from threading import Event
from typing import Any

import numpy as np
import pytest

from tests.page.conftest import VIEWPORT, Opened, new_page
from tests.page.test_access import PHONE, WIDE, breaches
from tests.serve.conftest import serving
from tests.support.browser import mean_difference
from tests.support.fixtures import slow
from tests.support.patience import PATIENCE_S
from volspec.export.page import PageSpec
from volspec.export.serve.views import SceneViews, ViewRequest
from volspec.pipeline import raycast, relight
from volspec.raycast.progressive import Pace
from volspec.scene import Scene

SIZE = 128, 96
# As in test_page.py: the error of eight bits.
EIGHT = 0.4
STATUS = "document.getElementById('camera-status').textContent"
NOTICE = "document.getElementById('notice')"
MORE = """
[[annotation]]
points_mm = [[128, 128, 50]]
text = "bore"
"""


@dataclass
class Served(Opened):
    """A page, its server, and the views that it asked for."""

    server: Any = None
    asked: list[ViewRequest] = field(default_factory=list)
    # Whole pictures wait for it.
    whole: Event = field(default_factory=Event)

    def rest(self, count: int) -> None:
        """Wait for a whole picture, after more requests than a count."""
        self.eventually(
            lambda: len(self.asked) > count and not self.asked[-1].coarse, "a whole is asked for"
        )
        self.until(f"{STATUS}.startsWith('The whole')")

    def number(self, name: str) -> float:
        """Number of a slider's text."""
        return float(self.page.inner_text(f"#{name}-read").rstrip("°×"))


@pytest.fixture(scope="module")
def scene(engine_scene: Scene, tmp_path_factory: pytest.TempPathFactory) -> Scene:
    """The engine with a mark, next to its own files."""
    text = engine_scene.path.read_text(encoding="utf-8")
    path = tmp_path_factory.mktemp("served") / "engine.toml"
    path.write_text(text.replace('"../', f'"{engine_scene.folder.parent}/') + MORE, "utf-8")
    return Scene.load(path)


@contextmanager
def served_page(browser: Any, scene: Scene) -> Iterator[Served]:
    """Serve a page; yield it after its first whole picture; coarse ones have a quarter's sides."""
    with (
        pytest.MonkeyPatch.context() as patched,
        serving(scene, spec=PageSpec("Engine"), size=SIZE) as server,
    ):
        patched.setattr(Pace, "after", lambda pace, *made: pace)
        made = Served(new_page(browser), server=server)
        cast = server._queue._message

        def message(request: ViewRequest, cancel: Callable[[], bool]) -> bytes:
            made.asked.append(request)
            assert request.coarse or made.whole.wait(PATIENCE_S)
            return cast(request, cancel)

        server._queue._message = message
        made.open(server.address)
        assert "coarse" in made.page.inner_text("#label-a"), "it opens before the whole is cast"
        made.whole.set()
        made.rest(0)
        yield made
        made.whole.set()
        made.page.context.close()


@pytest.fixture(scope="module")
def shared(browser: Any, scene: Scene) -> Iterator[Served]:
    with served_page(browser, scene) as made:
        yield made


@pytest.fixture
def served(shared: Served) -> Served:
    """The page as it is opened: the scene's camera and light, nothing zoomed."""
    shared.whole.set()
    shared.page.set_viewport_size(VIEWPORT)
    shared.show()
    home = replace(shared.asked[0], transfer_ms=0)
    shared.eventually(lambda: replace(shared.asked[-1], transfer_ms=0) == home, "its camera")
    if not shared.page.is_disabled("#zoom-fit"):
        shared.page.focus("#zoom-fit")
        shared.page.keyboard.press("Enter")
    shared.until(f"{STATUS}.startsWith('The whole')")
    return shared


def test_a_drag_brings_coarse_pictures_and_then_the_whole(served, scene):
    assert served.page.url.partition("#")[0] == f"http://127.0.0.1:{served.server.port}/"
    count, azimuth, elevation = len(served.asked), served.number("azimuth"), 32.0
    served.whole.clear()
    served.drag(120, 40)
    served.until(f"{STATUS}.startsWith('A coarse')")
    assert "coarse" in served.page.inner_text("#label-a")
    assert all(request.coarse for request in served.asked[count:-1])
    served.whole.set()
    served.rest(count)
    last = served.asked[-1]
    assert served.number("azimuth") < azimuth and served.number("elevation") > elevation
    assert abs(last.azimuth_deg - served.number("azimuth")) <= 0.5
    assert "coarse" not in served.page.inner_text("#label-a")
    # The whole picture is the desktop's.
    camera = SceneViews(scene, size=SIZE).camera(last)
    image = raycast(scene.volume(), scene.transfer, camera, SIZE, scene.raycast)
    wanted = relight(image, scene.lights[0].rig, scene.relight)
    assert mean_difference(served.picture(), wanted) <= EIGHT
    served.until(f"location.hash.includes('azimuth={last.azimuth_deg:g}')")
    assert served.complaints == []


def test_lights_change_without_a_request(served):
    count, before = len(served.requests), served.picture()
    for i in (2, 4, 1):
        served.page.click(f"#light-list li:nth-child({i}) .light-name")
    served.page.locator("#exposure").press("ArrowRight")
    served.page.check("#compare")
    served.settle()
    assert not np.array_equal(served.picture(), before)
    # The next request is that of the next camera.
    asked = len(served.asked)
    served.page.press("#azimuth", "ArrowLeft")
    served.rest(asked)
    own = [url for url in served.requests[count:] if not url.startswith("blob:")]
    azimuth = f"azimuth={served.asked[-1].azimuth_deg:g}&"
    assert own and all(azimuth in url for url in own) and served.complaints == []


@pytest.mark.slow
def test_the_camera_moves_by_keyboard(served):
    for keys, name, by in (
        ("ArrowUp", "elevation", 1),
        ("ArrowLeft", "azimuth", -1),
        ("ArrowRight", "distance", 0.04),
    ):
        before, count = served.number(name), len(served.asked)
        served.whole.clear()
        served.page.locator(f"#{name}").press(keys)
        served.until(f"{STATUS}.startsWith('A coarse')")
        served.whole.set()
        served.rest(count)
        assert served.number(name) == pytest.approx(before + by, abs=0.01)
    assert served.asked[-1].distance == pytest.approx(2**0.05, abs=1e-4)
    for keys, name, by in (("Shift+PageUp", "elevation", 10), ("PageDown", "azimuth", 10)):
        before = served.number(name)
        served.press("#port", keys)
        assert served.number(name) == before + by
    served.click("#reset")
    assert (served.number("azimuth"), served.number("elevation")) == (148, 32)


def test_the_wheel_zooms_into_the_picture_and_with_control_moves_the_camera(served):
    served.page.locator("#port").hover()
    count = len(served.asked)
    served.page.mouse.wheel(0, -200)
    served.settle()
    assert not served.page.is_disabled("#zoom-fit") and len(served.asked) == count
    served.whole.clear()
    served.page.keyboard.down("Control")
    served.page.mouse.wheel(0, -200)
    served.page.keyboard.up("Control")
    served.until(f"{STATUS}.startsWith('A coarse')")
    served.whole.set()
    assert served.number("distance") < 0.8


@pytest.mark.slow
def test_marks_follow_the_camera_and_are_read_out(served):
    place = "document.querySelector('#marks text').getAttribute('x')"
    before, count = served.page.evaluate(place), len(served.asked)
    assert served.page.get_attribute("#marks", "aria-label") == "bore"
    served.drag(100, 0)
    served.rest(count)
    assert served.page.evaluate(place) != before
    assert served.page.get_attribute("#marks", "aria-label") == "bore"


@pytest.mark.slow
def test_a_lost_server_leaves_a_picture_that_can_be_relit(browser, scene):
    with served_page(browser, scene) as served:
        served.server.stop()
        served.drag(60, 0)
        served.until(f"!{NOTICE}.hidden && {NOTICE}.textContent.startsWith('No picture')")
        before = served.picture()
        served.click("#light-list li:nth-child(2) .light-name")
        assert not np.array_equal(served.picture(), before)


def test_an_address_holds_the_camera(served):
    count = len(served.asked)
    served.show(azimuth=-70, elevation=-12.5, distance=1.5)
    served.rest(count)
    last = served.asked[-1]
    assert (last.azimuth_deg, last.elevation_deg, last.distance) == (-70, -12.5, 1.5)
    served.show(azimuth=400, elevation="x", distance=0)
    assert (served.number("azimuth"), served.number("elevation")) == (148, 32)


@pytest.mark.slow
@pytest.mark.parametrize("size", [slow(WIDE), PHONE])
def test_axe_finds_nothing_wrong(served, size):
    served.page.set_viewport_size({"width": size[0], "height": size[1]})
    served.show(compare=1, probe="9,9")
    # A mark's white letters have a black outline, which axe does not see.
    served.page.evaluate("document.getElementById('marks').style.display = 'none'")
    assert breaches(served.page) == []
    assert served.page.evaluate("document.documentElement.scrollWidth") <= size[0]
