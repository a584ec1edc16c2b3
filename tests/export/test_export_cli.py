"""``volspec export``: exit codes, one line for what is wrong, figures for machines."""

from __future__ import annotations

import re
from pathlib import Path

from tests.export.conftest import Make
from tests.support.commands import call, figures
from tests.support.fixtures import Capture


def test_the_command_makes_frames_and_tells_of_them(
    scene: Make, tmp_path: Path, capsys: Capture
) -> None:
    out = tmp_path / "out"
    words = ("export", scene().path, "-o", out, "--size", "16x12", "--turntable", 2, "-l", "day")
    made = figures(capsys, *words)
    assert (made["frames"], made["made"], made["casts"]) == (2, 2, 2)
    assert all((out / name).is_file() for name in made["files"])
    assert call(*words) == 0
    printed = capsys.readouterr().out.rpartition(":")[2]
    assert re.findall(r"\b\d+\b", printed) == ["2", "0", "0", "2"]


def test_a_turntable_is_one_turn_unless_more_lights_are_asked_for(
    scene: Make, tmp_path: Path, capsys: Capture
) -> None:
    def files(name: str, *more: object, scene_text: str = "") -> list[str]:
        path = scene(scene_text).path
        words = (path, "-o", tmp_path / name, "--size", "8x6", "--turntable", 2, *more)
        made = figures(capsys, "export", *words)["files"]
        return sorted({name.partition("/")[0] for name in made} - {"sheet.png"})

    assert files("first") == ["day"]
    assert files("all", "--light", "all") == ["day", "lamp", "tube"]
    assert files("two", "--light", "lamp", "--light", "day") == ["day", "lamp"]
    # A scene's own lights and its sweep keep their meaning.
    own = '[export]\nlights = ["lamp", "tube"]'
    assert files("own", scene_text=own) == ["lamp", "tube"]
    assert files("every", "--light", "all", scene_text=own) == ["day", "lamp", "tube"]
    assert files("sweep", scene_text="[export.sweep]\n") == ["0000.png", "0001.png"]
