"""``volspec design``: a palette in, a palette out, a report and a picture."""

from __future__ import annotations

from pathlib import Path

import pytest

import volspec as vs
from tests.support.commands import PALETTE, call, figures


@pytest.fixture
def palette(tmp_path: Path) -> Path:
    path = tmp_path / "palette.toml"
    path.write_text(PALETTE, encoding="utf-8")
    return path


def test_it_writes_what_addresses_find_and_draws(
    palette: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out, picture = tmp_path / "out.toml", tmp_path / "picture.svg"
    assert call("design", palette, "-o", out, "--figure", picture) == 0
    printed = capsys.readouterr().out.splitlines()
    assert printed[1].split() == ["a", "#4682b4", "0.0"]
    assert printed[-2:] == [str(out), str(picture)]
    assert "# given" in out.read_text(encoding="utf-8")
    assert vs.reflectance(f"{out}#a").designed
    assert "<svg" in picture.read_text(encoding="utf-8")


def test_json_holds_every_cell(palette: Path, capsys: pytest.CaptureFixture[str]) -> None:
    data = figures(capsys, "design", palette)
    assert [c["reflectance"] for c in data["cells"]] == ["a", "b"]
    assert data["cells"][0]["hex"] == "#4682b4" and data["max"] < 0.1
    assert data["metamers"][0]["reflectances"] == ["a", "b"]


def test_a_designed_palette_can_be_designed_again(palette: Path) -> None:
    assert call("design", palette, "-o", palette) == 0 == call("design", palette, "-o", palette)
    assert palette.read_text(encoding="utf-8").count("values = [") == 2
