"""``volspec export``: exit codes, one line for what is wrong, figures for machines."""

from __future__ import annotations

import json
import re
from pathlib import Path

import pytest

from tests.export.conftest import Make
from volspec.cli import main


def run(*words: object) -> int:
    with pytest.raises(SystemExit) as caught:
        main(["export", *map(str, words)])
    return int(caught.value.code or 0)


def test_the_command_makes_frames_and_tells_of_them(
    scene: Make, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path, out = scene().path, tmp_path / "out"
    words = (path, "-o", out, "--size", "16x12", "--turntable", 2, "--light", "day", "--json")
    assert run(*words) == 0
    made = json.loads(capsys.readouterr().out)
    assert (made["frames"], made["made"], made["casts"]) == (2, 2, 2)
    assert all((out / name).is_file() for name in made["files"])
    assert run(*words[:-1]) == 0
    assert re.findall(r"\b\d+\b", capsys.readouterr().out.rpartition(":")[2]) == [
        "2",
        "0",
        "0",
        "2",
    ]


def test_a_turntable_is_one_turn_unless_more_lights_are_asked_for(
    scene: Make, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    def files(name: str, *more: object, scene_text: str = "") -> list[str]:
        path = scene(scene_text).path
        words = (path, "-o", tmp_path / name, "--size", "8x6", "--turntable", 2, "--json", *more)
        assert run(*words) == 0
        made = json.loads(capsys.readouterr().out)["files"]
        return sorted({name.partition("/")[0] for name in made} - {"sheet.png"})

    assert files("first") == ["day"]
    assert files("all", "--light", "all") == ["day", "lamp", "tube"]
    assert files("two", "--light", "lamp", "--light", "day") == ["day", "lamp"]
    # A scene's own lights and its sweep keep their meaning.
    own = '[export]\nlights = ["lamp", "tube"]'
    assert files("own", scene_text=own) == ["lamp", "tube"]
    assert files("every", "--light", "all", scene_text=own) == ["day", "lamp", "tube"]
    assert files("sweep", scene_text="[export.sweep]\n") == ["0000.png", "0001.png"]
