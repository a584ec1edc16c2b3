"""The panel of lights in the window, used with a mouse and keys; nothing of it casts."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from benchmarks.robot import Robot

pytestmark = pytest.mark.usefixtures("screen")


def test_lights_are_drawn_given_lux_saved_and_faded_without_a_cast(tmp_path: Path) -> None:
    with Robot(tmp_path, (), (1280, 720)) as robot:
        first = robot.whole()

        def click(name: str) -> None:
            robot.rest()
            robot.click(name)

        # The first state, as the scene has it.
        click("tab States")
        click("save state")
        plain = picture(robot, tmp_path)

        # A spectrum, drawn in one stroke.
        click("tab Spectrum")
        robot.rest()
        x, y, width, height = robot.area("spectrum")
        waves = [
            (x + width * i / 30, y + height * (0.5 + 0.4 * math.cos(i / 3))) for i in range(2, 29)
        ]
        robot.drag(waves)
        drawn = picture(robot, tmp_path)
        # How much depends on how many of the stroke's places a slow window sees; 1 is rounding.
        assert np.abs(drawn - plain).max() > 1

        # Lux: an eye adapted to little light sees the picture otherwise.
        click("tab Light")
        click("lux given")
        robot.rest()
        x, y, width, height = robot.area("lux")
        robot.drag([(x + width * 0.5, y + height / 2), (x + width * 0.05, y + height / 2)])
        dim = picture(robot, tmp_path)
        assert np.abs(dim - drawn).max() > 5

        # The second state, and back to the first in a fade.
        robot.key("alt+s")
        before = robot.rest()
        robot.key("alt+1")
        robot.rest()
        fade = [row for row in robot.since(before) if row["stage"] == "relight"]
        # 1.5 s; a slow machine draws few frames of it, one would be a cut.
        assert len(fade) > 1 and fade[-1]["whole"]
        assert np.abs(picture(robot, tmp_path) - plain).max() <= 1
        # Undo is one step, and has the lights that were before the fade.
        robot.key("ctrl+z")
        assert np.abs(picture(robot, tmp_path) - dim).max() <= 1

        assert [row for row in robot.since(first["t"]) if row["stage"] == "cast"] == []
        assert robot.viewer.poll() is None


def picture(robot: Robot, folder: Path) -> NDArray[np.int16]:
    """What of the picture nothing stands over, once it is whole."""
    from PIL import Image

    robot.rest()
    robot.grab(folder / "screen.png")
    x, y, width, height = robot.area("picture")
    screen = np.asarray(Image.open(folder / "screen.png").convert("RGB"), dtype=np.int16)
    # Between what is said at the top and what is under the mouse.
    return screen[y + height // 4 : y + height // 2, x : x + width - 8]
