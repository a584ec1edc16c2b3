"""Files dragged from another program and dropped on the window, under Xvfb."""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np
import pytest

from benchmarks.robot import Robot
from volspec.volume import phantom

pytestmark = pytest.mark.usefixtures("screen")

SCENE = """
title = "%s"
[volume]
file = "plain.npy"
[[material]]
name = "grey"
reflectance = "grey:0.5"
[transfer]
points = [
    { value = 0.2, opacity = 0.0, material = "grey" },
    { value = 0.9, opacity = 0.4, material = "grey" },
]
[[light]]
name = "day"
spectrum = "D65"
"""


def opened(robot: Robot, after: float = -1.0) -> list[str]:
    """Titles of what has been opened."""
    return [row["title"] for row in robot.since(after) if row["event"] == "open"]


def fed(pipe: Path, text: str) -> bool:
    """Whether somebody reads from a named pipe, and has been given a text."""
    try:
        end = os.open(pipe, os.O_WRONLY | os.O_NONBLOCK)
    except OSError:
        return False
    with open(end, "w", encoding="utf-8") as file:
        file.write(text)
    return True


def refusal(robot: Robot, *uris: str) -> str:
    """What is said of a drop, after which all is as it was."""
    before = robot.now()
    robot.drop(*uris)
    robot.rest()
    assert not {"open", "cast"} & {row["event"] for row in robot.since(before)}
    (said,) = [row["message"] for row in robot.since(before) if row["event"] == "error"]
    return str(said)


def test_what_is_dropped_is_opened_or_refused_in_a_line_and_what_was_open_stays(
    tmp_path: Path,
) -> None:
    plain, odd = tmp_path / "plain.npy", tmp_path / "Kugel é 骨 100%.npy"
    for path in (plain, odd):
        np.save(path, phantom.ball(16).values)
    notes, scene, first = (tmp_path / name for name in ("notes.txt", "scene.toml", "first.toml"))
    notes.write_text("no volume", encoding="utf-8")
    scene.write_text(SCENE % "Dropped", encoding="utf-8")
    # Reading it takes until it is fed below.
    os.mkfifo(first)
    # On Linux a name may be bytes that are no text.
    np.save(tmp_path / os.fsdecode(b"caf\xe9.npy"), phantom.ball(16).values)

    with Robot(tmp_path, [first.name], (480, 360)) as robot:
        # What is dropped before anything is open comes after what was asked for first.
        robot.wait_for(lambda row: row["event"] == "layout")
        robot.drop(plain.as_uri())
        assert robot.until(lambda: fed(first, SCENE % "First"))
        robot.wait_for(lambda row: row.get("title") == plain.name)
        robot.rest()
        assert opened(robot) == ["First", plain.name]

        # Of two drops in a row the last is open in the end; percent-encoded names are read.
        before = robot.now()
        robot.drop(f"file://localhost{scene}")
        robot.drop(odd.as_uri())
        robot.rest()
        assert opened(robot, before)[-1] == odd.name
        before = robot.now()
        robot.drop(f"file://localhost{scene}")
        robot.rest()
        assert opened(robot, before) == ["Dropped"]

        assert refusal(robot, plain.as_uri(), odd.as_uri()) == (
            "2 files were dropped; drop one scene or volume, or the folder of its slices"
        )
        assert refusal(robot, notes.as_uri()).startswith(f"{notes}: unknown format; known are")
        plain.unlink()
        assert refusal(robot, plain.as_uri()) == f"{plain}: no such file; check the path"
        for ending in (".npy", ".volspec.json"):
            assert refusal(robot, f"{tmp_path.as_uri()}/caf%E9{ending}") == (
                f"{tmp_path}/caf\\udce9{ending}: this name is not UTF-8, no scene or session "
                "could hold it; rename it"
            )
        # A folder with such a name is listed without it.
        robot.key("ctrl+o")
        robot.rest()
        robot.key("Escape")
        robot.rest()
        robot.key("ctrl+q")
        assert robot.viewer.wait(20) == 0
