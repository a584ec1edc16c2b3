"""``volspec scene``: files checked without being cast; the schema."""

import json
from functools import partial
from pathlib import Path

import numpy as np
import pytest

from tests.support.commands import SCENE, figures
from tests.support.commands import call as command
from volspec.volume import phantom

call = partial(command, "scene")


@pytest.fixture
def good(tmp_path: Path) -> Path:
    np.save(tmp_path / "ball.npy", phantom.ball(12).values[:, :11, :10])
    return written(tmp_path / "good.toml", SCENE)


def written(path: Path, text: str) -> Path:
    path.write_text(text, encoding="utf-8")
    return path


def test_a_scene_that_is_well_is_one_line(good, capsys):
    assert call("check", good) == 0
    (line,) = capsys.readouterr().out.splitlines()
    assert line.startswith(f"{good}: ok: ") and "10 × 11 × 12" in line and "general-7" in line


def test_names_are_shown_and_never_obeyed(good, capsys):
    name = "a\x1b[31m\u202e\nb größer 骨"
    group = f'[[group]]\nname = {json.dumps(name)}\nsources = [{{ kind = "headlight" }}]\n'
    wrong = written(good.with_name("wrong\x1b[1m.toml"), SCENE + group)
    assert call("check", wrong, good.rename(good.with_name("good\u202e.toml"))) == 1
    first, second = capsys.readouterr().out.splitlines()
    assert "wrong\\x1b[1m.toml: [[group]] a\\x1b[31m\\u202e b größer 骨: " in first
    assert "good\\u202e.toml: ok: " in second


def test_figures_are_json(good, capsys):
    """Transcripts have those of a scene with faults."""
    (found,) = figures(capsys, "scene", "check", good)
    assert (found["path"], found["ok"], found["errors"]) == (str(good), True, [])
    assert (found["materials"], found["lights"], found["room_error"]) == (2, 1, None)
    assert (found["volume"], found["basis"]) == ([10, 11, 12], "general-7")


def test_the_schema_is_the_one_that_ships(capsys):
    assert call("schema") == 0
    shipped = Path(__file__).resolve().parents[2] / "data" / "scenes" / "scene.schema.json"
    assert capsys.readouterr().out == shipped.read_text(encoding="utf-8")
