"""What stands over the picture and beside it, in the window itself under Xvfb."""

from __future__ import annotations

import time
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from benchmarks.robot import Robot

pytestmark = pytest.mark.usefixtures("screen")


def casts(robot: Robot, after: float) -> list[str]:
    """Whole and coarse casts since then, that came to an end."""
    return [row["event"] for row in robot.since(after) if row["event"] == "cast"]


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

        # A face of the crop's box: cast coarsely while it is dragged, whole when it is let go.
        robot.key("c")
        time.sleep(0.5)
        assert casts(robot, robot.now() - 0.5) == []
        (x, y), (far_x, far_y) = robot.middle("crop 4"), robot.middle("crop 5")
        before = robot.now()
        shares = np.linspace(0.0, 0.4, 20)
        robot.drag([(x + s * (far_x - x), y + s * (far_y - y)) for s in shares])
        released = robot.wait_for(lambda row: row["event"] == "release", before)
        robot.whole(released["t"])
        # What was taken hold of stands where it was let go, to a pixel or two.
        there = x + 0.4 * (far_x - x), y + 0.4 * (far_y - y)
        robot.until(lambda: np.allclose(robot.middle("crop 4"), there, atol=2.0))
        np.testing.assert_allclose(robot.middle("crop 4"), there, atol=2.0)
        assert robot.middle("crop 5") == (far_x, far_y)
        robot.key("ctrl+z")
        assert robot.until(lambda: robot.middle("crop 4") == (x, y))

        # The cube: a click on its front face looks straight at it, and there is one face.
        before = robot.now()
        robot.do("mousemove", *robot.middle("cube 3"), "sleep", "0.2", "click", "1")
        robot.whole(before)

        # Slices: a click moves the other two, and nothing is cast.
        before = robot.now()
        robot.key("o")
        robot.wait_for(lambda row: "slice Axial" in row.get("areas", {}), before)
        robot.whole(before)
        time.sleep(1.0)
        ax, ay, width, height = robot.area("slice Axial")
        place = ax + 0.4 * width, ay + 0.62 * height
        first, before = slices(robot, tmp_path), robot.now()
        robot.do("mousemove", *place, "sleep", "0.2", "click", "1")

        def moved() -> list[float]:
            return [
                np.abs(a - b).mean() for a, b in zip(first, slices(robot, tmp_path), strict=True)
            ]

        robot.until(lambda: min(moved()) > 2)
        assert min(moved()) > 2
        assert casts(robot, before - 1.0) == []

        # A light relights them, and still nothing is cast.
        before = robot.now()
        robot.key("space")
        robot.whole(before)
        assert casts(robot, before) == []
        assert robot.viewer.poll() is None
