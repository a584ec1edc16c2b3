"""The transfer function under Xvfb: presets, gradients, regions, a material, drags, undo."""

from __future__ import annotations

import time
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from benchmarks.robot import Robot, along

pytestmark = pytest.mark.usefixtures("screen")


def test_a_preset_is_edited_as_regions_and_windowed_in_the_picture(tmp_path: Path) -> None:
    from PIL import Image

    with Robot(tmp_path, (), (900, 640)) as robot:
        robot.whole()

        def click(name: str) -> float:
            robot.wait_for(lambda row: row["event"] == "layout" and name in row["areas"])
            before = robot.now()
            robot.do("mousemove", *map(float, robot.middle(name)), "sleep", "0.2", "click", "1")
            time.sleep(0.5)
            return before

        def picture(before: float) -> NDArray[np.float64]:
            """What is drawn once a cast after a time is whole."""
            cast = robot.wait_for(
                lambda row: row["event"] == "cast" and row["divisor"] == 1, before
            )
            robot.whole(cast["t"] - 1e-6)
            time.sleep(0.4)
            robot.grab(tmp_path / "screen.png")
            x, y, width, height = robot.area("picture")
            screen = np.asarray(Image.open(tmp_path / "screen.png").convert("RGB"), float)
            # Between what is said at the top and what is under the mouse.
            return screen[y + height // 4 : y + height // 2, x : x + width]

        # Closed and opened again, the panel is in front of the others.
        for _ in range(2):
            click("menu Window")
            click("action panel-transfer")
        click("presets")
        curve = picture(click("preset glass"))

        # Glass leaves out flat parts; where gradient 0 counts as well, they are seen.
        x, y = robot.middle("gradient 0")
        before = robot.now()
        robot.drag(along((x, y), (x, y - 24), 1))
        assert np.abs(picture(before) - curve).mean() > 1
        before = robot.now()
        robot.key("ctrl+z")
        assert np.abs(picture(before) - curve).mean() < 0.1

        click("kind")
        regions = picture(click("kind regions"))
        assert np.abs(curve - regions).mean() < 10

        # The first region's middle, dragged down: flat parts, which glass leaves out, are seen.
        x, y = robot.middle("region 0")
        before = robot.now()
        robot.drag(along((x, y), (x, y + 60), 0.5))
        dragged = picture(before)
        assert np.abs(dragged - regions).mean() > 1

        # The library's gold, by the first letters of its name: redder than glass.
        click("material")
        robot.do("type", "--delay", "30", "gol")
        robot.wait_for(lambda row: row["event"] == "layout" and "found 0" in row["areas"])
        before = robot.now()
        robot.key("Return")
        golden = picture(before)
        assert (golden - dragged)[..., 0].mean() > 2 + (golden - dragged)[..., 2].mean()
        robot.key("Escape")

        # Ctrl and a drag in the picture: another window, undone as one step.
        x, y = robot.middle("picture")
        before = robot.now()
        robot.do("keydown", "ctrl")
        robot.drag([(x, y), (x + 10, y), (x + 40, y - 20), (x + 60, y - 30)])
        robot.do("keyup", "ctrl")
        windowed = picture(before)
        assert np.abs(windowed - golden).mean() > 1
        before = robot.now()
        robot.key("ctrl+z")
        assert np.abs(picture(before) - golden).mean() < 0.1
        assert [row for row in robot.rows() if row["event"] == "error"] == []
        assert robot.viewer.poll() is None
