"""One browser for all of a page's tests: Debian's Chromium, drawing in software."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any
from urllib.parse import urlencode

import numpy as np
import pytest
from numpy.typing import NDArray

from tests.support.browser import chromium, missing, saved_picture
from tests.support.patience import PATIENCE_S
from volspec._gpu.sources import asset
from volspec.raycast import CoefficientImage
from volspec.scene import Scene


@dataclass
class Opened:
    """A page in the browser, with what it asked for and complained of."""

    page: Any
    requests: list[str] = field(default_factory=list)
    complaints: list[str] = field(default_factory=list)

    def show(self, **words: object) -> None:
        """Go to a state by the address."""
        self.page.evaluate("(words) => { location.hash = words; }", urlencode(words, safe=","))
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
        limit = time.monotonic() + PATIENCE_S
        while not holds():
            assert time.monotonic() < limit, f"never true: {what}"
            self.page.wait_for_timeout(25)

    def click(self, selector: str) -> None:
        """Click on an element, and wait until that is drawn."""
        self.page.click(selector)
        self.settle()

    def press(self, selector: str, key: str) -> None:
        """Press a key on an element, and wait until that is drawn."""
        self.page.press(selector, key)
        self.settle()

    def value(self, name: str) -> float:
        """Return a slider's value."""
        return float(self.page.input_value(f"#{name}"))

    def output(self, name: str) -> str:
        """Return the text beside a slider."""
        return str(self.page.text_content(f".row:has(#{name}) output"))

    def picture(self) -> NDArray[np.uint8]:
        """Files that the page saves."""
        return saved_picture(self.page)

    def open(self, address: str, ready: str = "ready") -> None:
        """Open an address, note what it asks for and complains of, and wait for its picture."""
        self.page.on("request", lambda request: self.requests.append(request.url))
        self.page.on(
            "console",
            lambda said: self.complaints.append(said.text) if said.type == "error" else None,
        )
        self.page.on("pageerror", lambda error: self.complaints.append(str(error)))
        self.page.goto(address, timeout=1000 * PATIENCE_S)
        self.page.wait_for_selector(f"html.{ready}", state="attached", timeout=1000 * PATIENCE_S)


def new_page(browser: Any) -> Any:
    """Return a blank page in a context of its own; the limit of its waits only ends a hang."""
    page = browser.new_context(viewport={"width": 900, "height": 640}).new_page()
    page.set_default_timeout(1000 * PATIENCE_S)
    return page


def open_file(
    browser: Any, path: Path, words: str = "", before: str = "", ready: str = "ready"
) -> Opened:
    """Open a file, in a context of its own, and wait for its picture."""
    made = Opened(new_page(browser))
    if before:
        made.page.add_init_script(before)
    made.open(f"{path.as_uri()}{words}", ready)
    return made


Open = Callable[..., Opened]


@pytest.fixture(scope="session")
def browser() -> Iterator[Any]:
    """Chromium under Playwright, with a user-data folder of its own."""
    if why := missing():
        pytest.skip(why)
    with chromium() as made:
        yield made


@pytest.fixture
def opened(browser: Any) -> Iterator[Open]:
    """`open_file`; what it opened is closed after the test."""
    made: list[Opened] = []

    def open_one(*where: Any, **how: Any) -> Opened:
        made.append(open_file(browser, *where, **how))
        return made[-1]

    yield open_one
    for each in made:
        each.page.context.close()


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
