"""One browser for all of a page's tests: Debian's Chromium, drawing in software."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Any
from urllib.parse import urlencode

import numpy as np
import pytest
from numpy.typing import NDArray

from tests.support.browser import chromium, missing, saved_picture
from tests.support.patience import PATIENCE_S, wait_until
from volspec._gpu.sources import asset
from volspec.export.page import write_page
from volspec.image import CoefficientImage
from volspec.scene import Scene

VIEWPORT = {"width": 900, "height": 640}


@dataclass
class Opened:
    """A page in the browser, with what it asked for and complained of."""

    page: Any
    requests: list[str] = field(default_factory=list)
    complaints: list[str] = field(default_factory=list)
    states: int = 0

    def show(self, **words: object) -> None:
        """Go to a state by the address, even if it has this address and is to have another."""
        self.states += 1
        text = urlencode({**words, "number": self.states}, safe=",")
        self.page.evaluate("(words) => { location.hash = words; }", text)
        self.settle()

    def settle(self) -> None:
        """Wait two frames: one to note a change, one to draw it."""
        frames = "new Promise((done) => requestAnimationFrame(() => requestAnimationFrame(done)))"
        self.page.evaluate(frames)

    def until(self, expression: str) -> None:
        """Wait until it is true; the page's policy lets no text be run inside of it."""
        self.eventually(lambda: self.page.evaluate(expression), expression)

    def eventually(self, holds: Callable[[], Any], what: str) -> None:
        """Wait until a condition holds; the limit only ends a hang."""
        wait_until(holds, f"never true: {what}", lambda: self.page.wait_for_timeout(25))

    def click(self, selector: str) -> None:
        """Click on an element, and wait until that is drawn."""
        self.page.click(selector)
        self.settle()

    def press(self, selector: str, key: str) -> None:
        """Press a key on an element, and wait until that is drawn."""
        self.page.press(selector, key)
        self.settle()

    def drag(self, across: float, down: float) -> None:
        """Drag over the middle of the picture by some pixels."""
        box = self.page.locator("#port").bounding_box()
        x, y = box["x"] + box["width"] / 2, box["y"] + box["height"] / 2
        self.page.mouse.move(x, y)
        self.page.mouse.down()
        self.page.mouse.move(x + across, y + down, steps=4)
        self.page.mouse.up()

    def value(self, name: str) -> float:
        """Return a slider's value."""
        return float(self.page.input_value(f"#{name}"))

    def output(self, name: str) -> str:
        """Return the text next to a slider."""
        return str(self.page.text_content(f".row:has(#{name}) output"))

    def picture(self) -> NDArray[np.uint8]:
        """Files that the page saves."""
        return saved_picture(self.page)

    def open(self, address: str, ready: str = "ready") -> None:
        """Open an address, note what it asks for and complains of, and wait for its picture."""
        for event, noted in self._noted.items():
            self.page.on(event, noted)
        self.page.goto(address)
        self.page.wait_for_selector(f"html.{ready}", state="attached")

    def close(self) -> None:
        """Leave the page as a new one is."""
        for event, noted in self._noted.items():
            self.page.remove_listener(event, noted)
        self.page.goto("about:blank")
        self.page.set_viewport_size(VIEWPORT)

    @cached_property
    def _noted(self) -> dict[str, Callable[[Any], None]]:
        """Listeners of the page's events."""
        errors = self.complaints
        return {
            "request": lambda request: self.requests.append(request.url),
            "console": lambda said: errors.append(said.text) if said.type == "error" else None,
            "pageerror": lambda error: errors.append(str(error)),
        }


def new_page(browser: Any) -> Any:
    """Return a blank page in a context of its own; the limit of its waits only ends a hang."""
    page = browser.new_context(viewport=VIEWPORT).new_page()
    page.set_default_timeout(1000 * PATIENCE_S)
    return page


def open_file(
    page: Any, path: Path, words: str = "", before: str = "", ready: str = "ready"
) -> Opened:
    """Open a file in a page, and wait for its picture."""
    made = Opened(page)
    if before:
        page.add_init_script(before)
    made.open(f"{path.as_uri()}{words}", ready)
    return made


Open = Callable[..., Opened]
Frame = Callable[..., NDArray[np.uint8]]


@pytest.fixture(scope="session")
def browser() -> Iterator[Any]:
    """Chromium under Playwright, with a user-data folder of its own."""
    if why := missing():
        pytest.skip(why)
    with chromium() as made:
        yield made


@pytest.fixture(scope="session")
def blank(browser: Any) -> Any:
    """A page that files are opened in, one after the other."""
    return new_page(browser)


@pytest.fixture
def opened(browser: Any, blank: Any) -> Iterator[Open]:
    """`open_file`, in a page of its own if a script runs before it or another file is open."""
    made: list[Opened] = []

    def open_one(path: Path, words: str = "", before: str = "", ready: str = "ready") -> Opened:
        page = new_page(browser) if before or made else blank
        made.append(open_file(page, path, words, before, ready))
        return made[-1]

    yield open_one
    for each in made:
        each.close()
        if each.page is not blank:
            each.page.context.close()


@pytest.fixture
def written(opened: Open, tmp_path: Path) -> Open:
    """`write_page` into a file, which is opened."""

    def write(*page: Any, words: str = "", **more: Any) -> Opened:
        write_page(tmp_path / "page.html", *page, **more)
        return opened(tmp_path / "page.html", words)

    return write


@pytest.fixture(scope="session")
def engine_scene() -> Scene:
    return Scene.load(asset("data/scenes/engine.toml"))


@pytest.fixture(scope="session")
def engine_image(engine_scene: Scene) -> CoefficientImage:
    """The engine at 128 x 96: another height than width, so that no mix-up of them stays hidden."""
    return engine_scene.render(size=(128, 96))


@pytest.fixture(scope="session")
def web() -> Path:
    return Path(__file__).resolve().parents[2] / "volspec" / "export" / "page" / "web"
