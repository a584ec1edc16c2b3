"""The transfer function under Xvfb: presets, gradients, regions, a material, drags, undo."""

from __future__ import annotations

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
        robot.rest()

        def picture() -> NDArray[np.float64]:
            """What is drawn once it is whole."""
            robot.rest()
            robot.grab(tmp_path / "screen.png")
            x, y, width, height = robot.area("picture")
            screen = np.asarray(Image.open(tmp_path / "screen.png").convert("RGB"), float)
            # Between what is said at the top and what is under the mouse.
            return screen[y + height // 4 : y + height // 2, x : x + width]

        def clicked(*names: str) -> NDArray[np.float64]:
            for name in names:
                robot.rest()
                robot.click(name)
            return picture()

        # Closed and opened again, the panel is in front of the others.
        clicked(*("menu Window", "action panel-transfer") * 2)
        curve = clicked("presets", "preset glass")

        # Glass leaves out flat parts; where gradient 0 counts as well, they are seen.
        x, y = robot.middle("gradient 0")
        robot.drag(along((x, y), (x, y - 24), 1))
        assert np.abs(picture() - curve).mean() > 1
        robot.key("ctrl+z")
        assert np.abs(picture() - curve).mean() < 0.1

        regions = clicked("kind", "kind regions")
        assert np.abs(curve - regions).mean() < 10

        # The first region's middle, dragged down: flat parts, which glass leaves out, are seen.
        x, y = robot.middle("region 0")
        robot.drag(along((x, y), (x, y + 60), 0.5))
        dragged = picture()
        assert np.abs(dragged - regions).mean() > 1

        # The library's gold, by the first letters of its name: redder than glass.
        clicked("material")
        robot.type("gol")
        robot.rest()
        robot.key("Return")
        golden = picture()
        assert (golden - dragged)[..., 0].mean() > 2 + (golden - dragged)[..., 2].mean()
        robot.key("Escape")
        robot.rest()

        # Ctrl and a drag in the picture: another window, undone as one step.
        x, y = robot.middle("picture")
        robot.do("keydown", "ctrl")
        robot.drag([(x, y), (x + 10, y), (x + 40, y - 20), (x + 60, y - 30)])
        robot.do("keyup", "ctrl")
        assert np.abs(picture() - golden).mean() > 1
        robot.key("ctrl+z")
        assert np.abs(picture() - golden).mean() < 0.1
        assert [row for row in robot.rows() if row["event"] == "error"] == []
        assert robot.viewer.poll() is None
