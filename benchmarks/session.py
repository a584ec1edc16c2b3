"""Does the viewer stay responsive under random input? ``python -m benchmarks.session [SECONDS]``.

A robot uses mouse and keys at random, with a fixed seed; the viewer's trace and memory are read.
As larger pictures need more memory, growth is measured on the same session, opened after a minute
and again at the end.
"""

from __future__ import annotations

import random
import sys
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path

from benchmarks.measure import Figure, report
from tests.support.window import MOUSE_S, Robot, Row, missing

SECONDS = 60.0
SIZE = (1280, 720)
# Seconds before memory is read: caches fill, and every size is drawn once.
_SETTLED_S = 60.0
# Keys in the picture, except those that end the program or open another window.
_KEYS = (
    *("1", "3", "7", "9", "5", "f", "b", "space", "t", "h", "Escape", "Return"),
    *("ctrl+z", "ctrl+z", "ctrl+shift+z", "Left", "Right", "Up", "Down", "plus", "minus"),
)
_BUTTONS = (1, 1, 1, 2, 3)


def figures(seconds: float = SECONDS) -> Iterator[Figure]:
    """Run a random session on the bundled engine, 1280 × 720."""
    if why := missing():
        yield Figure("viewer/random session", None, note=why)
        return
    with tempfile.TemporaryDirectory() as folder, Robot(Path(folder), size=SIZE) as robot:
        robot.whole()
        time.sleep(1.0)
        began, sizes = robot.now(), list[int]()
        dice = random.Random(7)
        while (t := robot.now() - began) < seconds and robot.viewer.poll() is None:
            robot.do(*_gesture(robot, dice))
            if not sizes and _SETTLED_S < t < seconds - _SETTLED_S:
                _named(robot, "ctrl+shift+s")
                sizes.append(_reopened(robot))
        if sizes and robot.viewer.poll() is None:
            sizes.append(_reopened(robot))
        time.sleep(1.0)
        alive, rows = robot.viewer.poll() is None, robot.since(began)
    label = f"viewer/random session of {seconds:.0f} s"
    longest = max((row["ms"] for row in rows if row["event"] == "unanswered"), default=0.0)
    yield Figure(f"{label}, longest unanswered", longest, 100.0, at_most=True, unit="ms")
    faults = sum(row["event"] in ("error", "gl-error") for row in rows) + (not alive)
    yield Figure(f"{label}, errors and crashes", float(faults), 0.0, at_most=True, unit="")
    if len(sizes) == 2:
        grown = 100.0 * (sizes[1] / sizes[0] - 1.0)
        yield Figure(f"{label}, memory grown", grown, 5.0, at_most=True, unit="%")


def _named(robot: Robot, key: str) -> None:
    """Enter the session's file name in the dialog of a key, regardless of keyboard focus."""
    for each in ("Escape", "Escape", "Escape", key):
        robot.key(each)
        robot.rest()
    robot.type("same.volspec.json")
    robot.key("Return")
    robot.rest()


def _reopened(robot: Robot) -> int:
    """Return the memory after the session is reopened and the viewer is idle."""
    before = robot.now()
    _named(robot, "ctrl+shift+o")
    robot.wait_for(lambda row: row["event"] == "open", before)
    robot.rest()
    return robot.memory()


def _gesture(robot: Robot, dice: random.Random) -> list[str | float]:
    """Return xdotool's arguments for a random gesture."""
    areas = _areas(robot)
    if dice.random() < 0.6:
        area = areas["picture"]
    else:
        area = areas[dice.choice(sorted(set(areas) - {"picture"}))]
    kind = dice.choice(("drag", "drag", "drag", "wheel", "key", "click"))
    if kind == "key":
        area = areas["picture"]
    x, y = _place(area, dice)
    words: list[str | float] = ["mousemove", x, y]
    if kind == "key":
        return [*words, "key", dice.choice(_KEYS)]
    if kind == "wheel":
        return [*words, "click", "--repeat", "3", "--delay", "40", dice.choice(("4", "5"))]
    if kind == "click":
        return [*words, "click", "1", "sleep", "0.1"]
    button = str(dice.choice(_BUTTONS))
    words += ["mousedown", button]
    for _ in range(dice.randint(10, 60)):
        x, y = x + dice.uniform(-12, 12), y + dice.uniform(-12, 12)
        words += ["sleep", f"{MOUSE_S:.4f}", "mousemove", max(x, 0.0), max(y, 0.0)]
    return [*words, "mouseup", button]


def _areas(robot: Robot) -> dict[str, tuple[int, int, int, int]]:
    """Return the areas of items, except menu entries, some of which open windows."""
    rows: list[Row] = [row for row in robot.rows() if row["event"] == "layout"]
    found = rows[-1]["areas"].items()
    width, height = SIZE
    return {
        name: (x, y, wide, tall)
        for name, (x, y, wide, tall) in found
        # Items of a hidden tab have never been laid out.
        if 0 <= x <= width - wide
        and 0 <= y <= height - tall
        and not name.startswith(("action", "menu"))
    }


def _place(area: tuple[int, int, int, int], dice: random.Random) -> tuple[float, float]:
    x, y, width, height = area
    return x + dice.random() * max(width - 1, 0), y + dice.random() * max(height - 1, 0)


if __name__ == "__main__":
    print(report(list(figures(float(sys.argv[1]) if len(sys.argv) > 1 else SECONDS))))
