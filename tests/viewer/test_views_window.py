"""What stands over the picture and beside it, in the window itself under Xvfb."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from benchmarks.robot import Robot

pytestmark = pytest.mark.usefixtures("screen")


def casts(robot: Robot, after: float) -> list[int]:
    """Casts since then that came to an end, by what their sides are divided by."""
    return [row["divisor"] for row in robot.since(after) if row["event"] == "cast"]


def slices(robot: Robot, folder: Path) -> list[NDArray[np.int64]]:
    """What the two slices show that a click into the third moves."""
    from PIL import Image

    robot.grab(folder / "screen.png")
    screen = np.asarray(Image.open(folder / "screen.png")).astype(int)
    areas = (robot.area(f"slice {plane}") for plane in ("Coronal", "Sagittal"))
    return [screen[y : y + height, x : x + width] for x, y, width, height in areas]


def test_handles_cube_and_slices_take_the_mouse(tmp_path: Path) -> None:
    with Robot(tmp_path, (), (1000, 640)) as robot:
        robot.whole()
        before = robot.rest()

        # A face of the crop's box: cast coarsely while it is dragged, whole when it is let go.
        robot.key("c")
        robot.rest()
        assert casts(robot, before) == []
        (x, y), (far_x, far_y) = robot.middle("crop 4"), robot.middle("crop 5")
        shares = np.linspace(0.0, 0.4, 20)
        robot.drag([(x + s * (far_x - x), y + s * (far_y - y)) for s in shares])
        robot.rest()
        # One that comes between may be whole, as a busy machine holds the mouse still.
        first, *_, last = casts(robot, before)
        assert first > 1 and last == 1
        # What was taken hold of stands where it was let go, to a pixel or two.
        there = x + 0.4 * (far_x - x), y + 0.4 * (far_y - y)
        np.testing.assert_allclose(robot.middle("crop 4"), there, atol=2.0)
        assert robot.middle("crop 5") == (far_x, far_y)
        robot.key("ctrl+z")
        before = robot.rest()
        assert robot.middle("crop 4") == (x, y)

        # The cube: a click on its front face looks straight at it, and there is one face.
        robot.click("cube 3")
        robot.rest()
        assert casts(robot, before)[-1] == 1

        # Slices: a click moves the other two, and nothing is cast.
        robot.key("o")
        before = robot.rest()
        ax, ay, width, height = robot.area("slice Axial")
        place = ax + 0.4 * width, ay + 0.62 * height
        first = slices(robot, tmp_path)
        robot.click(place)
        robot.rest()
        pairs = zip(first, slices(robot, tmp_path), strict=True)
        assert min(np.abs(a - b).mean() for a, b in pairs) > 2
        assert casts(robot, before) == []

        # A light relights them, and still nothing is cast.
        robot.key("space")
        robot.rest()
        assert any(row["event"] == "relight" for row in robot.since(before))
        assert casts(robot, before) == []
        assert robot.viewer.poll() is None
