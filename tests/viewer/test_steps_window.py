"""Steps, names and sessions of lights in the window itself, under Xvfb."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest

from benchmarks.robot import Robot

pytestmark = pytest.mark.usefixtures("screen")


def test_lights_are_renamed_and_chosen_and_a_crash_is_told_of(tmp_path: Path) -> None:
    def state(robot: Robot, name: str) -> dict[str, Any]:
        """What a session that is saved now holds."""
        robot.rest()
        robot.key("ctrl+shift+s")
        robot.rest()
        robot.type(name)
        robot.key("Return")
        robot.rest()
        found = json.loads((tmp_path / f"{name}.volspec.json").read_text(encoding="utf-8"))
        assert isinstance(found["state"], dict)
        return dict(found["state"])

    with Robot(tmp_path, (), (1000, 640)) as robot:
        robot.whole()
        robot.rest()
        # A name of one's own, for the light that Space has chosen.
        robot.key("space")
        robot.rest()
        robot.key("F2")
        robot.rest()
        robot.type("my lamp")
        robot.key("Return")
        first = state(robot, "first")
        assert first["lights"][1]["name"] == "my lamp" and first["interface"]["light"] == 1
        # The wheel's three notches are one step, and the mix before them another.
        robot.key("k")
        robot.rest()
        x, y = robot.middle("picture")
        robot.do("mousemove", x, y, "click", "--repeat", "3", "--delay", "100", "4")
        second = state(robot, "second")
        assert second["interface"]["light"] == len(second["lights"]) - 1 == len(first["lights"])
        robot.key("ctrl+z")
        robot.rest()
        robot.key("ctrl+z")
        third = state(robot, "third")
        assert third["view"] == first["view"] != second["view"]
        assert third["lights"] == first["lights"] and third["interface"]["light"] == 1
        # What is kept by itself, which a crash leaves.
        kept = tmp_path / "state" / "sessions"
        assert robot.until(lambda: any(kept.glob("*.json")))
        robot.viewer.kill()
        robot.viewer.wait()
    (tmp_path / "trace.jsonl").unlink()

    with Robot(tmp_path, (), (1000, 640)) as robot:
        robot.wait_for(lambda row: row["event"] == "ended-early")
