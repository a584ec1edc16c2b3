"""Files, commands and sessions in the window itself, under Xvfb."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from benchmarks.robot import Robot, Row
from volspec.scene import Scene

pytestmark = pytest.mark.usefixtures("screen")

_PASTE = """
import copykitten, sys
data, width, height = copykitten.paste_image()
sys.stdout.write(f"{width}x{height} {min(data[3::4])} {max(data[0::4])}")
"""


def event(robot: Robot, name: str, after: float = -1.0) -> Row:
    return robot.wait_for(lambda row: row["event"] == name, after)


def typed(robot: Robot, text: str) -> None:
    """Into what a key has opened."""
    robot.rest()
    robot.type(text)
    robot.key("Return")
    robot.rest()


def test_work_is_exported_found_by_name_kept_and_restored(tmp_path: Path) -> None:
    from PIL import Image

    with Robot(tmp_path, ["--screenshot", "160x120"], (900, 600)) as robot:
        robot.whole()
        robot.rest()
        # A command by a few letters, and a light in the list by name.
        for words in ("hp1 alo", "view right"):
            robot.key("ctrl+p")
            typed(robot, words)

        # As a scene, by a path that Tab completes.
        (tmp_path / "folder").mkdir()
        robot.key("ctrl+s")
        robot.rest()
        robot.type("fol")
        robot.rest()
        robot.key("Tab")
        typed(robot, "mine")
        saved = event(robot, "export-scene")
        assert saved["path"] == "folder/mine.toml"
        scene = Scene.load(tmp_path / "folder" / "mine.toml")
        assert scene.lights[0].name == "HP1" and scene.file.camera.azimuth_deg == 90.0

        # A picture, also for other programs.
        robot.key("s")
        first = tmp_path / event(robot, "screenshot")["path"]
        robot.key("ctrl+c")
        event(robot, "copied")
        pasted = subprocess.run(
            [sys.executable, "-c", _PASTE],
            env=robot.environment,
            capture_output=True,
            text=True,
            check=True,
        )
        width, height = (int(side) for side in pasted.stdout.split()[0].split("x"))
        assert (width, height) == robot.area("picture")[2:]
        assert pasted.stdout.split()[1] == "255" and int(pasted.stdout.split()[2]) > 50

        # Plain keys belong to a panel while the keyboard is in it: Space does not change lights.
        robot.key("F6")
        before = robot.rest()
        robot.key("space")
        robot.rest()
        assert [row for row in robot.since(before) if row["event"] == "relight"] == []
        robot.key("Escape")
        for key in ("space", "ctrl+z"):
            before = robot.rest()
            robot.key(key)
            robot.rest()
            assert any(row["event"] == "relight" for row in robot.since(before))
        robot.key("ctrl+q")
        assert robot.viewer.wait(20) == 0
    (tmp_path / "trace.jsonl").unlink()

    with Robot(tmp_path, ["--restore", "--screenshot", "160x120"], (900, 600)) as robot:
        robot.whole()
        robot.rest()
        robot.key("s")
        second = tmp_path / event(robot, "screenshot")["path"]
        assert second != first
        np.testing.assert_array_equal(np.asarray(Image.open(first)), np.asarray(Image.open(second)))
        # Read again, the scene is as its file has it, seen from where one was.
        before = robot.rest()
        robot.key("F5")
        event(robot, "open", before)
        # What was restored is not lost by that.
        before = robot.rest()
        robot.key("ctrl+shift+r")
        event(robot, "open", before)
        assert robot.viewer.poll() is None


def test_a_broken_session_does_not_prevent_the_start(tmp_path: Path) -> None:
    sessions = tmp_path / "state" / "sessions"
    sessions.mkdir(parents=True)
    (sessions / "x.volspec.json").write_text("{", encoding="utf-8")
    with Robot(tmp_path, ["--restore"], (400, 300)) as robot:
        assert "it is kept as" in event(robot, "error")["message"]
        robot.whole()
    assert [path.name for path in sessions.iterdir()] == ["x.volspec.json.broken"]
