"""The colour models on the command line: triples in, tables, JSON and a picture out."""

from __future__ import annotations

import io
import json
from pathlib import Path

import numpy as np
import pytest

from volspec.appearance import ViewingConditions
from volspec.appearance.adaptation import adapt
from volspec.appearance.models import MODELS
from volspec.cli import main

A = "109.85,100,35.58"


def done(*words: str) -> None:
    with pytest.raises(SystemExit) as caught:
        main(list(words))
    assert caught.value.code == 0


def run(capsys: pytest.CaptureFixture[str], *words: str) -> list[dict[str, float]]:
    done(*words, "--json")
    return list(json.loads(capsys.readouterr().out))


def refused(capsys: pytest.CaptureFixture[str], *words: str, code: int = 1) -> str:
    with pytest.raises(SystemExit) as caught:
        main(list(words))
    assert caught.value.code == code
    line = capsys.readouterr().err.strip()
    assert line.startswith("volspec: ") and "\n" not in line
    return line


def test_adapt_gives_the_corresponding_colours(capsys: pytest.CaptureFixture[str]) -> None:
    rows = run(
        capsys,
        "adapt",
        *["40", "35", "10", "20", "20", "20"],
        "--from",
        A,
        "--to",
        "95.05,100,108.88",
    )
    source = ViewingConditions.of_lux((109.85, 100, 35.58), 1000)
    target = ViewingConditions.of_lux((95.05, 100, 108.88), 1000)
    expected = adapt([[40, 35, 10], [20, 20, 20]], source, target)
    assert np.allclose([[row[name] for name in "XYZ"] for row in rows], expected, rtol=1e-12)
    assert rows[0]["X_from"] == 40 and rows[0]["defined"] is True


def test_appearance_and_its_inverse(capsys: pytest.CaptureFixture[str]) -> None:
    (row,) = run(capsys, "appearance", "40", "35", "10", "--white", A, "--Y_b", "18")
    assert {"J", "C", "h", "H", "Q", "M", "s", "L_A", "Y_b", "composition"} <= set(row)
    words = [str(row[name]) for name in "JCh"]
    (back,) = run(capsys, "appearance", "--inverse", *words, "--white", A, "--Y_b", "18")
    assert [back[name] for name in "XYZ"] == pytest.approx([40, 35, 10], rel=1e-9)


def test_all_models_at_once(capsys: pytest.CaptureFixture[str]) -> None:
    rows = run(capsys, "appearance", "40", "35", "10", "--white", A, "--model", "all")
    assert [row["model"] for row in rows] == list(MODELS)
    done("appearance", "40", "35", "10", "--white", A, "--model", "CIELAB")
    assert "CIELAB" in capsys.readouterr().out


def test_tables_are_read_by_their_columns(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    table = tmp_path / "patches.csv"
    table.write_text("name,Z,X,Y\nred,10,40,35\n\nblue,80,20,15\n")
    rows = run(capsys, "adapt", "--table", str(table), "--from", "A")
    assert [row["X_from"] for row in rows] == [40, 20]
    table.write_text("40,35,10\n20,15,80\n")
    assert len(run(capsys, "appearance", "--table", str(table))) == 2


def test_digits_are_never_cut_and_standard_input_is_read(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("sys.stdin", io.StringIO("40,35,10\n50,50,40\n"))
    done("appearance", "--white", "A", "--table", "-")
    out = capsys.readouterr().out
    assert "\N{HORIZONTAL ELLIPSIS}" not in out and "40.00" in out and "162.96" in out


@pytest.mark.parametrize(
    "words, message",
    [
        (("adapt", "40", "35", "--from", "A"), "2 numbers"),
        (("adapt", "40", "35", "nan", "--from", "A"), "nan is no colour"),
        (("adapt", "40", "35", "1e308", "--from", "A"), "1e+308 is no colour"),
        (("adapt", "40", "35", "10", "--from", "A", "--method", "CAT2"), "did you mean 'CAT02'"),
        (("adapt", "40", "35", "10", "--from", "0,100,50"), "above 0"),
        (("adapt", "40", "35", "10", "--from", "0,0,0"), "above 0"),
        (("adapt", "40", "35", "10", "--from", "A", "--lux", "-1"), "illuminance_lux is -1.0"),
        (("adapt", "40", "35", "10", "--from", "A", "--surround", "1.5"), "surround is 1.5"),
        (("adapt", "40", "35", "10", "--from", "A", "--D", "2"), "D is 2.0"),
        (("adapt", "--table", "none.csv", "--from", "A"), "none.csv"),
        (("appearance", "1", "2", "3", "--model", "hunt"), "did you mean 'Hunt'"),
        (("appearance", "1", "2", "3", "-o", "x.png"), "only --image"),
        (("appearance", "--image", "x.exr"), "give -o FILE.png"),
        (("appearance", "--image", "x.exr", "-o", "x.jpg"), "PNG"),
        (("appearance", "--image", "x.exr", "-o", "x.png", "--model", "Hunter"), "'Hunt'"),
    ],
)
def test_bad_words_are_named_in_one_line(
    words: tuple[str, ...], message: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert message in refused(capsys, *words)


@pytest.mark.parametrize(
    "text, message",
    [
        ("", "empty"),
        ("a,b\n1,2\n", "no column X"),
        ("X,Y,Z\n1,2,x\n", "row 1 has 'x'"),
        ("1,2\n", "''"),
    ],
)
def test_bad_tables_are_named_in_one_line(
    text: str, message: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    table = tmp_path / "t.csv"
    table.write_text(text)
    line = refused(capsys, "adapt", "--table", str(table), "--from", "A")
    assert message in line and "t.csv" in line
