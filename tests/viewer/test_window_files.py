"""The window under Xvfb: messages, menus by keyboard, and the dialogs that open files."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from tests.support.viewer import opened
from tests.support.window import Robot
from volspec.pipeline import raycast
from volspec.volume import phantom

pytestmark = [pytest.mark.usefixtures("screen"), pytest.mark.not_quick]


def red(picture: NDArray[np.int16]) -> int:
    """Return the number of pixels as red as errors are, where messages are shown."""
    r, g, b = np.moveaxis(picture[:90], -1, 0)
    return int(((r > 150) & (r > 1.7 * g) & (r > 1.7 * b)).sum())


@pytest.fixture
def ball(window: Robot, tmp_path: Path) -> Robot:
    """The window with a volume alone."""
    np.save(tmp_path / "ball.npy", phantom.ball(16).values)
    window.open(tmp_path / "ball.npy")
    return window


@pytest.mark.slow
def test_warnings_and_errors_stay_readable(ball: Robot, tmp_path: Path) -> None:
    values = phantom.ball(16).values.copy()
    values[3, 4, 5] = np.nan
    np.save(tmp_path / "nan.npy", values)
    (tmp_path / "bad.npy").write_text("no numbers", encoding="utf-8")
    # A file's warning comes each time that it is opened.
    for _ in range(2):
        before = ball.rest()
        ball.open(tmp_path / "nan.npy")
        assert "NaN" in ball.event("warning", before)["message"]
    before = ball.rest()
    ball.drop((tmp_path / "bad.npy").as_uri())
    ball.event("error", before)
    for theme in ("dark", "light"):
        assert red(ball.pixels()) > 150, theme
        ball.keys("t")
    # The count of errors opens the list; the cross dismisses the message.
    ball.click("errors")
    ball.rest()
    assert {f"message {number}" for number in range(5)} <= ball.areas().keys()
    ball.click("close message")
    assert red(ball.pixels()) < 20
    ball.click("clear messages")
    ball.rest()


@pytest.mark.slow
def test_arrows_lead_from_menu_to_menu(ball: Robot) -> None:
    def pressed(*names: str) -> list[str]:
        """Return what the keys have cast and opened."""
        before = ball.rest()
        ball.keys(*names)
        return [row["event"] for row in ball.since(before, "cast", "open")]

    # From File to View, around the end to Window, and into a submenu and back.
    assert pressed("F10", "Right", "Right") == [] and "action view-front" in ball.areas()
    assert pressed("Left", "Left", "Left") == [] and "action panel-cuts" in ball.areas()
    assert pressed("Right", "Down", "Right") == [] and "recent 0" in ball.areas()
    assert pressed("Left", "Escape", "Escape") == []
    assert "cast" in pressed("Right")  # the picture's again
    # Enter runs a command; a menu that the mouse has opened is left alike.
    assert "cast" in pressed("F10", "Right", "Right", "Down", "Return")
    ball.click("menu Edit")
    assert pressed("Right", "Right") == [] and "action crop" in ball.areas()
    assert pressed("Escape", "Escape") == []
    assert "cast" in pressed("Left")


@pytest.mark.slow
def test_files_are_found_by_mouse_arrows_and_tab(ball: Robot, tmp_path: Path) -> None:
    data = tmp_path / "data"
    (data / "inner" / "more").mkdir(parents=True)
    for name in ("data/one.npy", "data/two.npy", "data/inner/three.npy"):
        np.save(tmp_path / name, phantom.ball(16).values)
    (data / "notes.txt").touch()

    def titles(after: float) -> list[str]:
        ball.rest()
        return [row["title"] for row in ball.since(after, "open")]

    @contextmanager
    def dialog(title: str = "") -> Iterator[None]:
        """Open the dialog, and assert what is opened by it."""
        before = ball.rest()
        ball.keys("ctrl+o")
        yield
        assert titles(before) == [title] * bool(title)

    # It starts next to the open file; a double click goes into a folder, and opens a file.
    with dialog("two.npy"):
        ball.double_click("file data/", lambda: "file inner/" in ball.areas())
        assert "file notes.txt" not in ball.areas()
        ball.double_click("file inner/", lambda: "file three.npy" in ball.areas())
        ball.click("path up")
        before = ball.rest()
        ball.double_click("file two.npy", lambda: titles(before))
    # Arrows choose a row, and a chord selects the text.
    with dialog("three.npy"):
        ball.keys("Down", "Down", "ctrl+a")
        ball.enter("inn", "Tab", "Down", "Down", "Return")
    # A name to be saved under is completed as well, by the folders next to the open file.
    before = ball.keys("ctrl+s")
    ball.enter("mo", "Tab")
    ball.enter("mine")
    assert Path(ball.event("export-scene", before)["path"]) == data / "inner" / "more" / "mine.toml"
    # All files; the place of the open file, and Escape.
    with dialog():
        ball.click("place Home", "place Folder of the open file", "path filter")
        ball.keys("Escape", "Escape")
    before = ball.rest()
    ball.key("Left")
    assert ball.event("cast", before)


@pytest.mark.slow
def test_steps_play_and_raw_layouts_are_chosen_from_lists(tmp_path: Path) -> None:
    tifffile = pytest.importorskip("tifffile", reason="tifffile is not installed")
    values = (phantom.ball(16).values * 1000).astype(np.uint16)
    stack = np.stack([np.stack([values, values[::-1]])] * 3)
    names = {"Name": ["DAPI", "GFP"]}
    tifffile.imwrite(tmp_path / "c.ome.tif", stack, metadata={"axes": "TCZYX", "Channel": names})
    values.tofile(tmp_path / "ball.raw")
    (tmp_path / "bad.npy").write_text("no numbers", encoding="utf-8")
    with Robot(tmp_path, ["bad.npy"], (1000, 700)) as robot:
        # Nothing can be opened: the window says why, and offers another file.
        robot.wait_for(lambda row: "open another" in row.get("areas", {}))
        # imgui measures a new window for a frame before it draws it.
        robot.until(lambda: red(robot.look()[300:]) > 100)
        robot.key("ctrl+o")
        robot.wait_for(lambda row: "file c.ome.tif" in row.get("areas", {}))
        robot.click("file c.ome.tif")
        robot.key("Return")
        robot.whole(robot.event("open")["t"])
        # Steps are chosen by key, by the slider and while they play.
        before = robot.rest()
        robot.key("comma")
        assert robot.event("step", before)["step"] == 2
        before = robot.rest()
        robot.steps([robot.at("time step", 0.95), robot.at("time step")], "step")
        assert robot.event("step", before)["step"] == 1
        before = robot.rest()
        robot.click("time play")
        robot.until(lambda: {row["step"] for row in robot.since(before, "step")} == {0, 1, 2})
        robot.key("j")
        before = robot.rest()
        robot.drop((tmp_path / "ball.raw").as_uri())
        robot.wait_for(lambda row: "guess 0" in row.get("areas", {}), before)
        robot.key("Return")
        assert robot.event("open", before)["title"] == "ball.raw"
        robot.rest()
        robot.key("ctrl+q")
        assert robot.ends() == 0


def test_a_cast_image_is_relit_and_says_what_it_cannot(window: Robot, tmp_path: Path) -> None:
    state = opened(tmp_path)
    volume = state.document.volume
    image = raycast(volume, state.transfer, state.view.camera(volume), (64, 32), state.shading)
    image.save(tmp_path / "it.exr")
    window.resize((1000, 700))
    before = window.open(tmp_path / "it.exr")
    # The picture keeps the image's shape; another light is a relight.
    x, y, width, height = window.area("picture")
    assert width / height == pytest.approx(2.0, abs=0.02)
    window.keys("space")
    assert window.since(before, "relight") and not window.since(before, "cast")
    # It cannot be turned, and is saved at its own size.
    shown = window.pixels()
    before = window.rest()
    window.drag([(x + width / 4, y + height - 9), (x + width / 4 + 60, y + height - 30)])
    window.rest()
    assert not window.since(before, "cast")
    below = slice(height // 2, None), slice(width // 2, None)  # the message
    np.testing.assert_array_equal(window.pixels()[below], shown[below])
    window.key("s")
    assert window.saved("screenshot", before).shape == (32, 64, 3)


@pytest.mark.slow
def test_a_picture_dialog_stays_until_its_folder_can_be_made(ball: Robot, tmp_path: Path) -> None:
    def save_to(folder: str) -> None:
        ball.click("file folder")
        ball.keys("ctrl+a")
        ball.type(folder)
        ball.rest()
        ball.click("picture ok")
        ball.rest()

    before = ball.keys("ctrl+i")
    save_to("/proc/none")
    assert "file problem" in ball.areas()
    save_to(f"{tmp_path}/new/deeper")
    assert ball.event("screenshot", before)["path"] == str(tmp_path / "new" / "deeper" / "ball.png")


@pytest.mark.slow
def test_a_click_on_a_swatch_picks_a_colour_for_its_material(tmp_path: Path) -> None:
    np.save(tmp_path / "ball.npy", phantom.ball(16).values)
    with Robot(tmp_path, ["ball.npy"], (1000, 800), ahead=False) as robot:
        robot.whole()
        robot.front("transfer")
        robot.click(next(name for name in robot.areas() if name.startswith("swatch ")))
        before = robot.rest()
        robot.click(robot.at("picker", 0.3, 0.3))
        assert robot.event("design", before)
