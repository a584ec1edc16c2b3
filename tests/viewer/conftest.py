"""A document without a device, as the pure parts of the viewer see it; a screen and a window."""

import threading
from collections.abc import Callable, Iterator
from contextlib import ExitStack
from pathlib import Path

import pytest

from tests.support.patience import PATIENCE_S
from tests.support.viewer import opened, read_scene, small_document
from tests.support.window import Robot, missing
from volspec.viewer.model.document import Document
from volspec.viewer.model.state import ViewState
from volspec.viewer.work.background import _Runner
from volspec.viewer.work.session import SUFFIX, save_session

# The panels take half of the width.
SIZE = 720, 640


@pytest.fixture(scope="session")
def document() -> Document:
    return small_document()


@pytest.fixture(scope="session")
def state(document: Document) -> ViewState:
    return ViewState.first(document, (160, 120))


@pytest.fixture
def closing(monkeypatch: pytest.MonkeyPatch) -> threading.Event:
    """An event that is set when files that are being written are waited for, however long."""
    closes, wait = threading.Event(), _Runner.wait_error

    def wait_error(runner: _Runner, _: float) -> str:
        closes.set()
        return wait(runner, PATIENCE_S)

    monkeypatch.setattr(_Runner, "wait_error", wait_error)
    return closes


@pytest.fixture(scope="session")
def screen() -> None:
    """Skip, and say why, where no display can be made for a window."""
    if lacking := missing():
        pytest.skip(lacking)


@pytest.fixture(scope="session")
def running(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Callable[[], Robot]]:
    """Return a function for the one viewer of this process, which starts it where it does not run.

    Its pictures are of 160 x 120 pixels.
    """
    robots: list[Robot] = []
    with ExitStack() as stack:

        def running_robot() -> Robot:
            if not robots or robots[-1].viewer.poll() is not None:
                folder = tmp_path_factory.mktemp("window")
                path = opened(folder, basis='method = "materials"').document.path
                assert path is not None
                # So far away that a cast takes no time.
                path.write_text(path.read_text(encoding="utf-8") + "[camera]\nzoom = 0.1\n")
                save_session(read_scene(path), folder / f"it{SUFFIX}")
                robot = Robot(folder, (path.name, "--screenshot", "160x120"), SIZE, ahead=False)
                robots.append(stack.enter_context(robot))
                robot.whole()
            return robots[-1]

        yield running_robot


@pytest.fixture
def window(running: Callable[[], Robot]) -> Iterator[Robot]:
    """The viewer as it starts, whatever other tests did to it, with a small scene."""
    if lacking := missing():
        pytest.skip(lacking)
    robot = running()
    robot.resize(SIZE)
    robot.do("mouseup", "1")  # a test may have failed with the button down
    robot.keys("Escape", "Escape")
    # A session has the settings of the window, too.
    robot.open(Path(robot.trace).with_name(f"it{SUFFIX}"))
    robot.begin()
    yield robot
    assert robot.viewer.poll() is None and robot.since(-1.0, "gl-error") == []
