"""Steps, names and sessions of lights in the window itself, under Xvfb."""

from __future__ import annotations

import json
import time
from pathlib import Path
from typing import Any

import pytest

from benchmarks.robot import Robot

pytestmark = pytest.mark.usefixtures("screen")


def test_lights_are_renamed_and_chosen_and_a_crash_is_told_of(tmp_path: Path) -> None:
    kept = tmp_path / "state" / "sessions"

    def state(robot: Robot) -> dict[str, Any]:
        """What is kept once nothing changes any more; 10 s are some times what that takes."""
        newest = max((path.stat().st_mtime for path in kept.glob("*.json")), default=0.0)
        end = time.time() + 10
        while time.time() < end:
            for path in kept.glob("*.json"):
                if path.stat().st_mtime > newest:
                    found = json.loads(path.read_text(encoding="utf-8"))["state"]
                    assert isinstance(found, dict)
                    return found
            assert robot.viewer.poll() is None
            time.sleep(0.1)
        raise TimeoutError("no session is kept")

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
        first = state(robot)
        assert first["lights"][1]["name"] == "my lamp" and first["interface"]["light"] == 1
        # The wheel's three notches are one step, and the mix before them another.
        robot.key("k")
        robot.rest()
        x, y = robot.middle("picture")
        robot.do("mousemove", x, y, "click", "4", "sleep", "0.1", "click", "4", "sleep", "0.1")
        robot.do("click", "4")
        second = state(robot)
        assert second["interface"]["light"] == len(second["lights"]) - 1 == len(first["lights"])
        robot.key("ctrl+z")
        robot.rest()
        robot.key("ctrl+z")
        third = state(robot)
        assert third["view"] == first["view"] != second["view"]
        assert third["lights"] == first["lights"] and third["interface"]["light"] == 1
        robot.viewer.kill()
        robot.viewer.wait()
    (tmp_path / "trace.jsonl").unlink()

    with Robot(tmp_path, (), (1000, 640)) as robot:
        robot.wait_for(lambda row: row["event"] == "ended-early")
