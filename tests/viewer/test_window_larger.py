"""The window under Xvfb with a volume that is larger than memory."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from tests.support.pyramids import stored
from tests.support.window import Robot, along
from volspec.volume import Volume

pytestmark = pytest.mark.usefixtures("screen")


def casts(robot: Robot, after: float = -1.0) -> list[bool]:
    """Return True for each cast of the level asked for, False for those of the one in memory."""
    found = [row for row in robot.since(after) if row["event"] == "cast"]
    return [(row["divisor"], row["steps"]) == (1, "own") for row in found]


def test_coarse_at_once_and_finer_when_it_rests(tmp_path: Path) -> None:
    z, y, x = np.mgrid[-1:1:160j, -1:1:150j, -1:1:170j]
    values = np.clip(1 - np.sqrt(x**2 + y**2 + z**2), 0, 1)
    values[::4] *= 0.5  # slats, of which the coarse level shows none
    stored(Volume((255 * values).astype(np.uint8)), tmp_path)
    with Robot(tmp_path, ["v.zarr?memory=3MB"], (900, 600)) as robot:
        robot.wait_for(lambda row: row["event"] == "cast")
        robot.whole()
        robot.rest()
        first = casts(robot)
        assert not first[0] and first[-1]
        x0, y0, width, height = robot.area("picture")
        left, right = (x0 + width / 3, y0 + height / 2), (x0 + width / 2, y0 + height / 2)
        # On a busy machine the mouse rests on its way, or no cast ends before it does: once more.
        for _ in range(3):
            robot.do("mousemove", *left)  # the probe shows the same place before and after
            robot.rest()
            fine = picture(robot, "fine")
            pressed = robot.now()
            # There and back: the same view.
            robot.drag([*along(left, right, 2.0), left])
            moving = casts(robot, pressed)
            robot.rest()
            rested = casts(robot, pressed)
            assert rested[-1]
            if moving and not any(moving):
                break
        assert moving and not any(moving)
        again = picture(robot, "again")
        assert np.abs(fine - again).mean() < 0.5
        assert fine.std() > 5
        assert not [row for row in robot.rows() if row["event"] in ("warning", "error")]


def picture(robot: Robot, name: str) -> np.ndarray:
    """Return the RGB of the picture in the window."""
    path = robot.folder / f"{name}.png"
    robot.grab(path)
    x, y, width, height = robot.area("picture")
    with Image.open(path) as window:
        return np.asarray(window.convert("RGB").crop((x, y, x + width, y + height)), float)
