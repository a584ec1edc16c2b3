"""Make what README.md shows first: ``python -m tools.gallery.readme``; needs Xvfb and xdotool.

data/scenes/figure-2.toml -> viewer, page -> [readme] -> docs/images/viewer.webp, docs/head.html

In the moving picture the mouse drags the dial of lights from daylight to two designed lights and
back; the volume is cast once, before the first frame.
"""

from __future__ import annotations

import subprocess
import sys
import tempfile
import time
from itertools import pairwise
from pathlib import Path

import numpy as np
from PIL import Image, ImageDraw

from tests.support.window import Place, Robot
from tools.gallery.studio import ROOT
from tools.gallery.viewer import command

SCENE = ROOT / "data" / "scenes" / "figure-2.toml"
PICTURE, PAGE = ROOT / "docs" / "images" / "viewer.webp", ROOT / "docs" / "head.html"
_SIZE = 1040, 640
# Seconds of a frame, and frames from one light to the next and at rest on each.
_FRAME_S, _MOVING, _RESTING = 0.08, 17, 12
_ANSWER_S, _HINT_S = 0.4, 10.0
_BYTES = 1_500_000
_ARROW = [(0, 0), (0, 16), (4, 12), (7, 18), (9, 17), (6, 11), (11, 11)]


def main() -> None:
    """Record the viewer, and write the page."""
    with tempfile.TemporaryDirectory() as folder:
        frames = record(Path(folder))
    for quality in range(80, 30, -5):
        frames[0].save(
            PICTURE,
            save_all=True,
            append_images=frames[1:],
            duration=round(1000 * _FRAME_S),
            loop=0,
            quality=quality,
            method=6,
        )
        if PICTURE.stat().st_size <= _BYTES:
            break
    title = "A head, one cast, three lights"
    page = ["page", str(SCENE), "-o", str(PAGE), "--size", "640x560", "--title", title]
    subprocess.run([sys.executable, "-m", "volspec", *page], check=True)
    for path in (PICTURE, PAGE):
        print(f"{path.name}: {path.stat().st_size / 1000:.0f} kB")


def record(folder: Path) -> list[Image.Image]:
    """Drag the dial in the viewer; return its screen at each step, with the mouse."""
    shot, frames = folder / "screen.png", []
    with Robot(folder, [str(SCENE)], _SIZE) as robot:
        robot.whole()
        robot.key("i")
        command(robot, "planes handles")
        dial, radius = robot.middle("dial"), 0.26 * robot.area("dial")[3]
        corners = [
            (dial[0] + radius * np.sin(angle), dial[1] - radius * np.cos(angle))
            for angle in np.radians([0, 120, 240, 0])
        ]
        robot.do("mousemove", *corners[0])
        time.sleep(_HINT_S)  # until the hint is gone
        robot.do("mousedown", "1")
        for start, end in pairwise(corners):
            frames += [frames[-1]] * _RESTING if frames else []
            for place in _eased(np.array(start), np.array(end)):
                robot.do("mousemove", *place)
                time.sleep(_ANSWER_S)
                robot.grab(shot)
                frames.append(_with_mouse(Image.open(shot).convert("RGB"), place))
        robot.do("mouseup", "1")
    return frames


def _eased(start: np.ndarray, end: np.ndarray) -> list[Place]:
    """Return places from start to end, slow at both."""
    times = (1 - np.cos(np.pi * np.linspace(0, 1, _MOVING))) / 2
    return [(float(x), float(y)) for x, y in start + times[:, None] * (end - start)]


def _with_mouse(screen: Image.Image, place: Place) -> Image.Image:
    """Draw an arrow, which a grabbed screen lacks."""
    arrow = [(place[0] + x, place[1] + y) for x, y in _ARROW]
    ImageDraw.Draw(screen).polygon(arrow, fill="white", outline="black")
    return screen


if __name__ == "__main__":
    main()
