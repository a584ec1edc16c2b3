"""Pictures of the viewer's window: ``python -m tools.gallery.viewer``; needs Xvfb and xdotool."""

from __future__ import annotations

import tempfile
import time
from pathlib import Path

from PIL import Image

from benchmarks.robot import Robot

GALLERY = Path(__file__).resolve().parents[2] / "docs" / "gallery"
SIZE = (1160, 700)
DATA = Path(__file__).resolve().parents[2] / "data" / "scenes"


def blended(robot: Robot) -> None:
    """Lights mixed on the dial, the mouse over the picture."""
    x, y = robot.middle("dial")
    robot.drag([(x, y), (x + 6, y - 4), (x + 12, y - 6), (x + 17, y - 8)])
    robot.do("mousemove", 410.0, 226.0)


def beside(robot: Robot) -> None:
    """Daylight at the right of the divide, a sodium lamp at its left; the transfer function."""
    robot.do("mousemove", 410.0, 350.0)
    robot.key("b")
    for _ in range(3):
        robot.key("space")
        time.sleep(0.3)
    x, y = robot.area("model")[:2]
    # The tab beside "Viewing", above the first row.
    robot.do("mousemove", float(x + 92), float(y - 20), "click", "1")


def evening(robot: Robot) -> None:
    """A tungsten lamp and a blue sky, in the light theme, with the keys."""
    robot.do("mousemove", 410.0, 226.0)
    robot.key("t")
    robot.key("h")


PICTURES = {
    "viewer-1": ("engine.toml", blended),
    "viewer-2": ("engine.toml", beside),
    "viewer-3": ("engine-groups.toml", evening),
}


def main() -> None:
    """Write all of them."""
    for name, (scene, use) in PICTURES.items():
        with tempfile.TemporaryDirectory() as folder:
            file = Path(folder) / "screen.png"
            with Robot(Path(folder), [str(DATA / scene)], SIZE) as robot:
                robot.whole()
                time.sleep(0.5)
                use(robot)
                time.sleep(1.5)
                robot.grab(file)
            # In full colour: of a palette's 256 the swatches would get none of their own.
            Image.open(file).convert("RGB").save(GALLERY / f"{name}.png", optimize=True)


if __name__ == "__main__":
    main()
