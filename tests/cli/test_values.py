"""Values of options that cannot be used: exit code 1 and one line that names the option."""

from __future__ import annotations

import io
import os
from pathlib import Path

import numpy as np
import pytest

from tests.cli.test_scene import TEXT
from volspec import cli
from volspec.basis import SpectralBasis
from volspec.raycast import CoefficientImage
from volspec.volume import phantom


def call(*words: object) -> int:
    with pytest.raises(SystemExit) as caught:
        cli.main([*map(str, words)])
    return int(caught.value.code or 0)


@pytest.fixture(scope="module")
def files(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with a scene, its volume and an image."""
    folder = tmp_path_factory.mktemp("files")
    np.save(folder / "ball.npy", phantom.ball(8).values)
    (folder / "s.toml").write_text(TEXT, encoding="utf-8")
    grey, opaque = np.full((2, 2, 7), 0.5, np.float32), np.ones((2, 2), np.float32)
    CoefficientImage(grey, opaque, opaque, SpectralBasis.load("general-7")).save(folder / "i.exr")
    return folder


EXPORT = "export s.toml -o out"
PAGE = "page s.toml -o out.html"
RELIGHT = "relight i.exr --light A -o out.png"
LAMP = "light lamp:tungsten-2850"


@pytest.mark.parametrize(
    "words", ["foo", "export s.toml", f"{EXPORT} --nope", f"{EXPORT} --sweep", "light D65 A"]
)
def test_words_that_are_no_command_are_a_usage_error(
    words: str, files: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(files)
    assert call(*words.split()) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert line.endswith("; see volspec --help")


@pytest.mark.parametrize(
    ("words", "meant"),
    [
        ("relight s.toml --light A -o out.png", "volspec export s.toml -o FOLDER"),
        ("compositing s.toml -o out.py", "volspec render s.toml -o IMAGE.exr"),
        ("appearance --image s.toml -o out.png", "volspec render s.toml -o IMAGE.exr"),
        ("export i.exr -o out", "volspec relight i.exr --light LIGHT -o FRAME.png"),
        ("render i.exr -o out.exr", "volspec relight i.exr --light LIGHT -o FRAME.png"),
        ("page i.exr -o out.html", "volspec page SCENE.toml -o PAGE.html"),
        ("view i.exr", "volspec view SCENE.toml"),
        ("wizard keep i.exr ball -o out.toml", "volspec relight i.exr"),
        ("info i.exr", "volspec relight i.exr"),
        ("info s.toml", "volspec scene check s.toml"),
        ("export ball.npy -o out", "is no text; give a scene file (.toml)"),
    ],
)
def test_a_file_of_another_kind_is_told_the_command_that_takes_it(
    words: str,
    meant: str,
    files: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.chdir(files)
    assert call(*words.split()) == 1
    (line,) = [s for s in capsys.readouterr().err.splitlines() if s.startswith("volspec: ")]
    assert meant in line


@pytest.mark.parametrize("words", ["light --list", "light --help", "light D65", "light D65 --json"])
def test_a_pipe_that_nobody_reads_ends_the_command_quietly(
    words: str, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    ours, theirs = os.pipe()
    os.close(ours)
    with io.TextIOWrapper(os.fdopen(theirs, "wb")) as stdout:
        monkeypatch.setattr("sys.stdout", stdout)
        assert call(*words.split()) == 141
        monkeypatch.undo()
    assert capsys.readouterr().err == ""


@pytest.mark.parametrize(
    "words",
    [
        ("light", "x" * 100_000),
        ("reflectance", "9" * 5000),
        ("info", "(" * 3000),
        ("compositing", "\0", "-o", "x.nk"),
        ("render", "\udcff.toml", "-o", "x.exr"),
        ("+" * 5000,),
    ],
    ids=lambda words: words[0][:12],
)
def test_a_value_of_any_length_is_refused_in_one_short_line(
    words: tuple[str, ...], capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(SystemExit) as ended:
        cli.main(list(words))
    [line] = capsys.readouterr().err.splitlines()
    assert ended.value.code in (1, 2) and len(line) < 1100 and line.startswith("volspec: ")
