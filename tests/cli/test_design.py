"""``volspec design``: a palette in, a palette out, a report and a picture."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

import volspec as vs
from volspec import cli

PALETTE = """
title = "Two of them"
[[light]]
name = "day"      # given
spectrum = "D65"
[[reflectance]]
name = "a"
[[reflectance]]
name = "b"
[[cell]]
reflectance = "*"
light = "day"
colour = "steelblue"
"""


def call(*words: str | Path) -> int:
    """The command in this process; returns the exit code."""
    try:
        cli.main(["design", *map(str, words)])
    except SystemExit as stop:
        return int(stop.code or 0)
    return 0


@pytest.fixture
def palette(tmp_path: Path) -> Path:
    path = tmp_path / "palette.toml"
    path.write_text(PALETTE, encoding="utf-8")
    return path


def test_it_writes_what_addresses_find_and_draws(
    palette: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out, picture = tmp_path / "out.toml", tmp_path / "picture.svg"
    assert call(palette, "-o", out, "--figure", picture) == 0
    said = capsys.readouterr().out
    assert "#4682b4 0.0" in said and "alike under day: a and b" in said
    assert said.splitlines()[-2:] == [str(out), str(picture)]
    assert "# given" in out.read_text(encoding="utf-8")
    assert vs.reflectance(f"{out}#a").designed
    assert "<svg" in picture.read_text(encoding="utf-8")


def test_json_holds_every_cell(palette: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert call(palette, "--json") == 0
    said = capsys.readouterr()
    data = json.loads(said.out)
    assert said.err == "" and [c["reflectance"] for c in data["cells"]] == ["a", "b"]
    assert data["cells"][0]["hex"] == "#4682b4" and data["max"] < 0.1
    assert data["metamers"][0]["reflectances"] == ["a", "b"]


def test_a_designed_palette_can_be_designed_again(
    palette: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert call(palette, "-o", palette) == 0 == call(palette, "-o", palette)
    assert palette.read_text(encoding="utf-8").count("values = [") == 2


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (("none.toml",), "none.toml: no such file"),
        (("{palette}", "-o", "out.json"), "out.json: palettes are TOML; name it .toml"),
        (("{palette}", "--figure", "p.jpg"), "p.jpg: figures are .png, .svg, .pdf files"),
        (("{dark}",), "dark.toml: light 'day' has no luminous energy"),
        (("{must}",), "must.toml: no spectrum within its bounds meets cell (a, day)"),
    ],
)
def test_bad_input_is_one_line(
    palette: Path,
    tmp_path: Path,
    words: tuple[str, ...],
    message: str,
    capsys: pytest.CaptureFixture[str],
) -> None:
    must = tmp_path / "must.toml"
    twice = '"day"\ncolour = "steelblue"\nmust = true\n[[reflectance]]\nname = "c"\n'
    twice += '[[light]]\nname = "dusk"\nspectrum = "A"\n[[cell]]\nreflectance = "*"\n'
    twice += 'light = "dusk"\ncolour = "lime"\nmust = true'
    must.write_text(PALETTE.replace('"day"\ncolour = "steelblue"', twice), encoding="utf-8")
    dark = tmp_path / "dark.toml"
    zeros = f"values = {[0.0] * 31}"
    dark.write_text(PALETTE.replace('spectrum = "D65"', zeros), encoding="utf-8")
    assert call(*(word.format(palette=palette, must=must, dark=dark) for word in words)) == 1
    (line,) = [each for each in capsys.readouterr().err.splitlines() if "volspec:" in each]
    assert line.startswith("volspec: ") and message in line
