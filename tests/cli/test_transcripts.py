"""Words of the commands, as transcripts; `pytest tests/cli --remake` writes them."""

import io
import os
import re
import shlex
from contextlib import redirect_stderr, redirect_stdout
from pathlib import Path

import pytest

from tests.support.commands import write_files
from volspec import cli

FOLDER = Path(__file__).parent / "transcripts"


@pytest.fixture(scope="module")
def files(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with scenes, a volume and images."""
    folder = tmp_path_factory.mktemp("files")
    write_files(folder)
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
def test_commands_print_their_transcripts(name, files, monkeypatch, request):
    monkeypatch.chdir(files)
    monkeypatch.setenv("COLUMNS", "100")
    path = FOLDER / f"{name}.txt"
    before, there = path.read_text(encoding="utf-8"), sorted(os.listdir())
    now = transcript(before)
    if request.config.getoption("--remake"):
        path.write_text(now, encoding="utf-8")
        return
    assert now == before, "other words? read them, then pytest tests/cli --remake"
    assert sorted(os.listdir()) == there, "a command that failed left something behind"


def test_every_command_has_a_transcript():
    commands = {name for name in cli.app if not name.startswith("-")}
    apart = {"demo", "doctor"}  # their words are about this machine
    assert commands - apart | {"unknown"} == {path.stem for path in FOLDER.glob("*.txt")}
