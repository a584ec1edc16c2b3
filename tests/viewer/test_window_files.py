"""The window under Xvfb: messages, menus by keyboard, and the dialogs that open files."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from tests.support.window import Robot, Row
from volspec.pipeline import raycast
from volspec.volume import phantom

pytestmark = pytest.mark.usefixtures("screen")


def event(robot: Robot, name: str, after: float = -1.0) -> Row:
    return robot.wait_for(lambda row: row["event"] == name, after)


def pixels(robot: Robot, name: str, area: str) -> np.ndarray:
    """Return the RGB of an area of the window."""
    path = robot.folder / f"{name}.png"
    robot.grab(path)
    x, y, width, height = robot.area(area)
    with Image.open(path) as window:
        return np.asarray(window.convert("RGB").crop((x, y, x + width, y + height)), float)


def red(picture: np.ndarray) -> int:
    """Return the number of pixels as red as errors are, where messages are shown."""
    r, g, b = np.moveaxis(picture[:90], -1, 0)
    return int(((r > 150) & (r > 1.7 * g) & (r > 1.7 * b)).sum())


def test_warnings_and_errors_stay_readable(tmp_path: Path) -> None:
    values = phantom.ball(16).values.copy()
    np.save(tmp_path / "ball.npy", values)
    values[3, 4, 5] = np.nan
    np.save(tmp_path / "nan.npy", values)
    (tmp_path / "bad.npy").write_text("no numbers", encoding="utf-8")
    with Robot(tmp_path, ["ball.npy"], (720, 520)) as robot:
        robot.whole()
        before = robot.rest()
        # A file's warning comes each time that it is opened.
        for _ in range(2):
            robot.drop((tmp_path / "nan.npy").as_uri())
            assert "NaN" in event(robot, "warning", before)["message"]
            before = robot.rest()
        robot.drop((tmp_path / "bad.npy").as_uri())
        event(robot, "error", before)
        robot.rest()
        for theme in ("dark", "light"):
            assert red(pixels(robot, theme, "picture")) > 150, theme
            robot.key("t")
            robot.rest()
        # The count of errors opens the list; the cross dismisses the message.
        robot.click("errors")
        robot.rest()
        assert {f"message {number}" for number in range(5)} <= set(layout(robot))
        robot.click("close message")
        robot.rest()
        assert red(pixels(robot, "dismissed", "picture")) < 20
        robot.click("clear messages")
        robot.rest()
        assert robot.viewer.poll() is None


def layout(robot: Robot) -> dict[str, list[int]]:
    """Return the items' last rectangles."""
    areas: dict[str, list[int]] = [r["areas"] for r in robot.rows() if r["event"] == "layout"][-1]
    return areas


@pytest.mark.slow
def test_arrows_lead_from_menu_to_menu(tmp_path: Path) -> None:
    np.save(tmp_path / "ball.npy", phantom.ball(16).values)
    with Robot(tmp_path, ["ball.npy"], (720, 520)) as robot:

        def pressed(*names: str) -> list[str]:
            """Return what the keys have cast, relit and opened."""
            before = robot.rest()
            for name in names:
                robot.key(name)
                robot.rest()
            return [row["event"] for row in robot.since(before) if row["event"] in ("cast", "open")]

        robot.whole()
        # From File to View, around the end to Window, and into a submenu and back.
        assert pressed("F10", "Right", "Right") == [] and "action view-front" in layout(robot)
        assert pressed("Left", "Left", "Left") == [] and "action panel-cuts" in layout(robot)
        assert pressed("Right", "Down", "Right") == [] and "recent 0" in layout(robot)
        assert pressed("Left", "Escape", "Escape") == []
        assert "cast" in pressed("Right")  # the picture's again
        # Enter runs a command; a menu that the mouse has opened is left alike.
        assert "cast" in pressed("F10", "Right", "Right", "Down", "Return")
        robot.click("menu Edit")
        assert pressed("Right", "Right") == [] and "action crop" in layout(robot)
        assert pressed("Escape", "Escape") == []
        assert "cast" in pressed("Left")


@pytest.mark.slow
def test_files_are_found_by_mouse_arrows_and_tab(tmp_path: Path) -> None:
    data = tmp_path / "data"
    (data / "inner" / "more").mkdir(parents=True)
    for name in ("ball.npy", "data/one.npy", "data/two.npy", "data/inner/three.npy"):
        np.save(tmp_path / name, phantom.ball(16).values)
    (data / "notes.txt").touch()
    with Robot(tmp_path, ["ball.npy"], (720, 520)) as robot:

        def titles(after: float) -> list[str]:
            robot.rest()
            return [row["title"] for row in robot.since(after) if row["event"] == "open"]

        def dialog() -> float:
            after = robot.rest()
            robot.key("ctrl+o")
            robot.rest()
            return after

        robot.whole()
        # It starts next to the open file; a double click goes into a folder, and opens a file.
        before = dialog()
        twice(robot, "file data/", lambda: "file inner/" in layout(robot))
        assert "file notes.txt" not in layout(robot)
        twice(robot, "file inner/", lambda: "file three.npy" in layout(robot))
        robot.click("path up")
        robot.rest()
        twice(robot, "file two.npy", lambda: bool(titles(before)))
        assert titles(before) == ["two.npy"]
        # Arrows choose a row, and a chord selects the text.
        before = dialog()
        for key in ("Down", "Down", "ctrl+a"):
            robot.key(key)
            robot.rest()
        robot.type("inn")
        robot.rest()
        for key in ("Tab", "Down", "Down"):
            robot.key(key)
            robot.rest()
        robot.key("Return")
        assert titles(before) == ["three.npy"]
        # A name to be saved under is completed as well, by the folders next to the open file.
        before = robot.rest()
        robot.key("ctrl+s")
        robot.rest()
        robot.type("mo")
        robot.rest()
        robot.key("Tab")
        robot.rest()
        robot.type("mine")
        robot.key("Return")
        saved = event(robot, "export-scene", before)["path"]
        assert Path(saved) == data / "inner" / "more" / "mine.toml"
        # All files; the place of the open file, and Escape.
        dialog()
        robot.click("place Home")
        robot.rest()
        robot.click("place Folder of the open file")
        robot.rest()
        robot.click("path filter")
        robot.rest()
        robot.key("Escape")
        robot.rest()
        before = robot.rest()
        robot.key("Escape")
        robot.rest()
        robot.key("Left")
        assert event(robot, "cast", before)


def twice(robot: Robot, area: str, done: Callable[[], bool]) -> None:
    """Double-click an item, again if the machine was too slow to see one."""
    x, y = robot.middle(area)
    click = ("click", "--repeat", "2", "--delay", "60", "1")
    for _ in range(4):
        robot.do("mousemove", x, y, "sleep", "0.1", *click)
        if robot.until(done, 5.0):
            return
    raise TimeoutError(area)


@pytest.mark.slow
def test_steps_play_and_raw_layouts_are_chosen_from_lists(tmp_path: Path) -> None:
    tifffile = pytest.importorskip("tifffile", reason="tifffile is not installed")
    ball = (phantom.ball(16).values * 1000).astype(np.uint16)
    stack = np.stack([np.stack([ball, ball[::-1]])] * 3)
    names = {"Name": ["DAPI", "GFP"]}
    tifffile.imwrite(tmp_path / "c.ome.tif", stack, metadata={"axes": "TCZYX", "Channel": names})
    ball.tofile(tmp_path / "ball.raw")
    (tmp_path / "bad.npy").write_text("no numbers", encoding="utf-8")
    with Robot(tmp_path, ["bad.npy"], (1000, 700)) as robot:
        # Nothing can be opened: the window says why, and offers another file.
        robot.wait_for(lambda row: "open another" in row.get("areas", {}))
        # imgui measures a new window for a frame before it draws it.
        assert robot.until(lambda: red(pixels(robot, "nothing", "picture")[300:]) > 100)
        robot.key("ctrl+o")
        robot.wait_for(lambda row: "file c.ome.tif" in row.get("areas", {}))
        twice(robot, "file c.ome.tif", lambda: "time play" in layout(robot))
        opened = event(robot, "open")
        robot.whole(opened["t"])
        # Steps are chosen by key, by the slider and while they play.
        before = robot.rest()
        robot.key("comma")
        assert event(robot, "step", before)["step"] == 2
        before = robot.rest()
        x, y, width, height = robot.area("time step")
        robot.drag([(x + width - 8, y + height / 2), (x + width / 2, y + height / 2)])
        assert event(robot, "step", before)["step"] == 1
        before = robot.rest()
        robot.click("time play")

        def all_shown() -> bool:
            rows = robot.since(before)
            return {row["step"] for row in rows if row["event"] == "step"} == {0, 1, 2}

        assert robot.until(all_shown)
        robot.key("j")
        before = robot.rest()
        robot.drop((tmp_path / "ball.raw").as_uri())
        robot.wait_for(lambda row: "guess 0" in row.get("areas", {}), before)
        robot.key("Return")
        assert event(robot, "open", before)["title"] == "ball.raw"
        robot.rest()
        robot.key("ctrl+q")
        assert robot.viewer.wait(20) == 0


def test_a_cast_image_is_relit_and_says_what_it_cannot(tmp_path: Path) -> None:
    from tests.support.viewer import opened

    state = opened(tmp_path)
    volume = state.document.volume
    image = raycast(volume, state.transfer, state.view.camera(volume), (64, 32), state.shading)
    image.save(tmp_path / "ball.exr")
    with Robot(tmp_path, ["ball.exr"], (720, 520)) as robot:
        robot.whole()
        before = robot.rest()
        # The picture keeps the image's shape; another light is a relight.
        x, y, width, height = robot.area("picture")
        assert width / height == pytest.approx(2.0, abs=0.02)
        robot.key("space")
        robot.rest()
        events = [row["event"] for row in robot.since(before)]
        assert "relight" in events and "cast" not in events
        # It cannot be turned, and is saved at its own size.
        shown = pixels(robot, "before", "picture")
        before = robot.rest()
        robot.drag([(x + width / 4, y + height - 9), (x + width / 4 + 60, y + height - 30)])
        robot.rest()
        assert "cast" not in [row["event"] for row in robot.since(before)]
        turned = pixels(robot, "after", "picture")
        rows = slice(height // 2, None)  # below the message
        np.testing.assert_array_equal(turned[rows, width // 2 :], shown[rows, width // 2 :])
        robot.key("s")
        with Image.open(event(robot, "screenshot")["path"]) as saved:
            assert saved.size == (64, 32)
        robot.key("ctrl+q")
        assert robot.viewer.wait(20) == 0


@pytest.mark.slow
def test_a_picture_dialog_stays_until_its_folder_can_be_made(tmp_path: Path) -> None:
    np.save(tmp_path / "ball.npy", phantom.ball(16).values)
    with Robot(tmp_path, ["ball.npy"], (720, 520)) as robot:

        def save_to(folder: str) -> None:
            robot.click("file folder")
            robot.key("ctrl+a")
            robot.type(folder)
            robot.rest()
            robot.click("picture ok")
            robot.rest()

        robot.whole()
        robot.key("ctrl+i")
        robot.rest()
        before = robot.rest()
        save_to("/proc/none")
        assert "file problem" in layout(robot)
        save_to(f"{tmp_path}/new/deeper")
        saved = event(robot, "screenshot", before)
        assert saved["path"] == str(tmp_path / "new" / "deeper" / "ball.png")


def test_a_click_on_a_swatch_picks_a_colour_for_its_material(tmp_path: Path) -> None:
    np.save(tmp_path / "ball.npy", phantom.ball(16).values)
    with Robot(tmp_path, ["ball.npy"], (1000, 800)) as robot:
        robot.whole()
        for _ in range(2):  # closed and opened, the panel comes to the front
            robot.click("menu Window")
            robot.rest()
            robot.click("action panel-transfer")
            robot.rest()
        swatch = next(name for name in layout(robot) if name.startswith("swatch "))
        robot.click(swatch)
        before = robot.rest()
        x, y, width, height = robot.area("picker")
        robot.click((x + 0.3 * width, y + 0.3 * height))
        assert event(robot, "design", before)
