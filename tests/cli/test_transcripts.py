"""Words of the commands, as transcripts; `pytest tests/cli --remake` writes them."""

from __future__ import annotations

import io
import os
import re
import shlex
from contextlib import redirect_stderr, redirect_stdout
from pathlib import Path

import numpy as np
import pytest

from tests.cli.test_scene import TEXT
from volspec import cli
from volspec.basis import SpectralBasis
from volspec.raycast import CoefficientImage
from volspec.volume import phantom

FOLDER = Path(__file__).parent / "transcripts"
WRONG = TEXT.replace("spectrum", "spectrm").replace("opacity = 0.4", 'opacity = "much"')


@pytest.fixture(scope="module")
def files(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with scenes, a volume and an image."""
    folder = tmp_path_factory.mktemp("files")
    np.save(folder / "ball.npy", phantom.ball(8).values)
    (folder / "s.toml").write_text(TEXT, encoding="utf-8")
    (folder / "wrong.toml").write_text(WRONG, encoding="utf-8")
    (folder / "lost.toml").write_text(TEXT.replace("D65", "D56").replace("ball", "bell"))
    grey, opaque = np.full((2, 2, 7), 0.5, np.float32), np.ones((2, 2), np.float32)
    CoefficientImage(grey, opaque, opaque, SpectralBasis.load("general-7")).save(folder / "i.exr")
    return folder


def transcript(text: str) -> str:
    """Run every ``$ volspec …`` of a transcript; return it with what they print now."""
    lines = []
    for command in re.findall(r"^\$ volspec (.*)$", text, re.MULTILINE):
        printed, code = io.StringIO(), 0
        with redirect_stdout(printed), redirect_stderr(printed):
            try:
                cli.main(shlex.split(command))
            except SystemExit as stop:
                code = int(stop.code or 0)
        lines.append(f"$ volspec {command}")
        lines += [line.rstrip() for line in printed.getvalue().splitlines()]
        lines += [f"[exit {code}]", ""] if code else [""]
    return "\n".join(lines)


@pytest.mark.parametrize("name", sorted(path.stem for path in FOLDER.glob("*.txt")))
def test_commands_print_their_transcripts(
    name: str,
    files: Path,
    monkeypatch: pytest.MonkeyPatch,
    request: pytest.FixtureRequest,
) -> None:
    monkeypatch.chdir(files)
    monkeypatch.setenv("COLUMNS", "100")
    path = FOLDER / f"{name}.txt"
    before, there = path.read_text(encoding="utf-8"), sorted(os.listdir())
    now = transcript(before)
    if request.config.getoption("--remake"):
        path.write_text(now, encoding="utf-8")
        return
    assert now == before, "other words? read them, then pytest tests/cli --remake"
    assert sorted(os.listdir()) == there, "a refused command left something behind"


def test_every_command_has_a_transcript() -> None:
    commands = {name for name in cli.app if not name.startswith("-")}
    assert commands - {"demo", "doctor"} == {path.stem for path in FOLDER.glob("*.txt")}
