"""The palette in the window, used with a mouse."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from benchmarks.robot import Robot, along

pytestmark = pytest.mark.usefixtures("screen")


def ask(robot: Robot, menu: str, action: str) -> None:
    for name in (f"menu {menu}", f"action {action}"):
        robot.click(name)
        robot.rest()


def test_a_colour_is_dragged_and_a_material_hidden_with_no_cast_after_the_first(
    tmp_path: Path,
) -> None:
    with Robot(tmp_path, (), (1000, 700)) as robot:
        robot.whole()
        for _ in range(2):  # closed and opened, it comes to the front
            ask(robot, "Window", "panel-palette")
        robot.click("cell 6")  # the inserts under A
        before = robot.rest()
        x, y, _, _ = robot.area("picker")
        robot.drag(along((x + 60, y + 60), (x + 120, y + 90), 0.5))
        cast = robot.rest()
        assert any(row["event"] == "design" and row["whole"] for row in robot.since(before))
        # The materials become channels: the one cast.
        assert any(row["event"] == "cast" and row["divisor"] == 1 for row in robot.since(before))

        # From now on the picture only relights.
        robot.drag(along((x + 120, y + 90), (x + 40, y + 60), 1.0))
        dragged = robot.rest()
        designs = [row for row in robot.since(cast) if row["event"] == "design"]
        # A muted pink by lamp light can be had: seen side by side it is the one wanted.
        assert designs[-1]["whole"] and designs[-1]["worst"] < 1.0
        assert len([row for row in robot.since(cast) if row["event"] == "relight"]) > 3

        # A wizard hides them again.
        robot.click("picture")
        robot.rest()
        ask(robot, "Palette", "hide")
        (hidden,) = (row for row in robot.since(dragged) if row["event"] == "wizard")
        found = re.search(r"^A: inserts – block ΔE ([\d.]+)", hidden["reached"][0])
        assert found and float(found[1]) < 1.0
        assert any(row["event"] == "relight" for row in robot.since(hidden["t"]))

        # One step back are the colours from before.
        before = robot.rest()
        robot.key("ctrl+z")
        robot.rest()
        assert any(row["event"] == "relight" and row["whole"] for row in robot.since(before))
        assert [row for row in robot.since(before) if row["event"] == "design"] == []
        assert [row for row in robot.since(cast) if row["stage"] == "cast"] == []
        assert robot.viewer.poll() is None
