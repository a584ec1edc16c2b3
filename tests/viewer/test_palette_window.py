"""The palette in the window, used with a mouse."""

from __future__ import annotations

import re
import time
from pathlib import Path

import pytest

from benchmarks.robot import Robot, along

pytestmark = pytest.mark.usefixtures("screen")


def click(robot: Robot, name: str) -> None:
    x, y = robot.middle(name)
    robot.do("mousemove", x, y, "sleep", "0.15", "click", "1")
    time.sleep(0.4)


def ask(robot: Robot, menu: str, action: str) -> None:
    click(robot, f"menu {menu}")
    click(robot, f"action {action}")


def test_a_colour_is_dragged_and_a_material_hidden_with_no_cast_after_the_first(
    tmp_path: Path,
) -> None:
    with Robot(tmp_path, (), (1000, 700)) as robot:
        robot.whole()
        for _ in range(2):  # closed and opened, it comes to the front
            ask(robot, "Window", "panel-palette")
        before = robot.now()
        click(robot, "cell 6")  # the inserts under A
        x, y, _, _ = robot.area("picker")
        robot.drag(along((x + 60, y + 60), (x + 120, y + 90), 0.5))
        robot.wait_for(lambda row: row["event"] == "design" and row["whole"], before)
        # The materials become channels: the one cast.
        robot.wait_for(lambda row: row["event"] == "cast" and row["divisor"] == 1, before)
        time.sleep(0.5)

        # From now on the picture only relights.
        before = robot.now()
        robot.drag(along((x + 120, y + 90), (x + 40, y + 60), 1.0))
        done = robot.wait_for(lambda row: row["event"] == "release", before)
        whole = robot.wait_for(lambda row: row["event"] == "design" and row["whole"], done["t"])
        time.sleep(0.3)
        # A muted pink by lamp light can be had: seen side by side it is the one wanted.
        assert whole["worst"] < 1.0
        relit = [row for row in robot.since(before) if row["event"] == "relight"]
        assert len(relit) > 3

        # A wizard hides them again.
        left, top = robot.middle("picture")
        robot.do("mousemove", left, top, "sleep", "0.1", "click", "1")
        time.sleep(0.3)
        ask(robot, "Palette", "hide")
        hidden = robot.wait_for(lambda row: row["event"] == "wizard", before)
        found = re.search(r"^A: inserts – block ΔE ([\d.]+)", hidden["reached"][0])
        assert found and float(found[1]) < 1.0
        robot.wait_for(lambda row: row["event"] == "relight", hidden["t"])

        # One step back are the colours from before.
        robot.key("ctrl+z")
        undone = robot.now()
        robot.wait_for(lambda row: row["event"] == "relight" and row["whole"], hidden["t"] + 0.2)
        time.sleep(0.5)
        assert [row for row in robot.since(before) if row["stage"] == "cast"] == []
        assert [row for row in robot.since(undone) if row["event"] == "design"] == []
        assert robot.viewer.poll() is None
