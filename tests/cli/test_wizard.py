"""`volspec wizard`: a new scene that renders, its palette, the figures, and errors in a line."""

import tomllib
from functools import partial
from pathlib import Path

import numpy as np
import pytest

import volspec as vs
from tests.support.commands import call as command
from tests.support.commands import figures, refusal, write_wizard_scene
from tests.support.fixtures import slow
from volspec.appearance.models.lab import delta_E_2000
from volspec.palette import load_palette
from volspec.wizard.result import displayed_Lab


@pytest.fixture
def ball(tmp_path: Path) -> Path:
    """A scene whose materials are its channels, in a folder of its own."""
    folder = tmp_path / "scenes"
    folder.mkdir()
    return write_wizard_scene(folder)


call = partial(command, "wizard")


def refused(*words: object) -> str:
    """The code of a refusal."""
    return refusal("wizard", *words).code


def test_hide_writes_a_scene_that_renders_and_keeps_its_comments(ball, tmp_path, capsys):
    new = tmp_path / "elsewhere" / "new.toml"
    assert call("hide", ball, "core", "--under", "lamp", "--in", "shell", "-o", new) == 0
    assert "new-palette.toml" in capsys.readouterr().out
    text = new.read_text(encoding="utf-8")
    assert text.count("# ") == 3, "its comments"
    table = tomllib.loads(text)
    assert table["material"][1]["reflectance"] == "new-palette.toml#core"
    assert table["volume"]["file"] == "../scenes/ball.npy"
    assert table["material"][2]["reflectance"] == "../scenes/stone.csv"
    scene = vs.Scene.load(new)
    assert scene.materials["core"].designed and not scene.materials["stone"].designed
    assert scene.render(size=(16, 16)).alpha.max() > 0.5
    shell, core, _ = scene.basis.channels_for_materials(scene.materials)
    seen = (scene.basis.xyz(row, scene.lights[1].spectrum) for row in (shell, core))
    assert np.abs(np.subtract(*seen)).max() < 0.01
    palette = load_palette(new.with_name("new-palette.toml"))
    assert palette.cells["core", "lamp"].other == ("shell", "lamp")


def test_a_new_light_is_a_row_of_the_new_scene(ball, capsys):
    new = ball.with_name("dark.toml")
    words = ("--under", "dark", "--black", "--like", "day", "-o", new)
    said = figures(capsys, "wizard", "hide", ball, "core", *words)
    assert said["scene"] == str(new)
    assert said["lights"][-1]["light"] == "dark" and said["lights"][-1]["like"] == "day"
    row = {"name": "dark", "spectrum": "dark-palette.toml#dark"}
    assert tomllib.loads(new.read_text())["light"][-1] == row
    assert [light.name for light in vs.Scene.load(new).lights] == ["day", "lamp", "tube", "dark"]


@pytest.mark.parametrize(
    "words",
    [
        "reveal core --distance 25",
        "merge core stone --average",
        slow("merge core stone --split x --colour firebrick --colour #4080c0"),
    ],
)
def test_reveal_and_merge_write_theirs(ball, words):
    kind, *more = words.split()
    assert call(kind, ball, *more, "--under", "day", "-o", ball.with_name("out.toml")) == 0


def test_keep_prints_how_constant_the_colour_is(ball, capsys):
    out = ball.with_name("out.toml")
    assert call("keep", ball, "stone", "-o", out) == 0
    table = capsys.readouterr().out
    rows = figures(capsys, "wizard", "keep", ball, "stone", "-o", out)["lights"]
    scene = vs.Scene.load(out)
    number = list(scene.materials).index("stone")
    Lab = [displayed_Lab(scene, light)[number] for light in scene.lights]
    for row, seen in zip(rows, Lab, strict=True):
        assert row["constancy"] == {"stone": pytest.approx(delta_E_2000(Lab[0], seen), abs=1e-4)}
        assert row["constancy"]["stone"] < 1.0
    assert "stone from day" in table and f"{rows[1]['constancy']['stone']:.2f}" in table


@pytest.mark.slow
def test_a_new_light_of_lamps_comes_with_their_shares(ball, capsys):
    lamps = [word for name in ("LED-B1", "LED-RGB1", "HP1") for word in ("--lamp", name)]
    words = ("merge", ball, "shell", "core", "--under", "day", "--split", "apart", *lamps)
    out = ball.with_name("out.toml")
    assert call(*words, "-o", out) == 0
    text = capsys.readouterr().out.replace("\n", " ")
    shares = figures(capsys, "wizard", *words, "-o", out)["lamps"]
    assert list(shares) == lamps[1::2] and pytest.approx(sum(shares.values())) == 1.0
    row = tomllib.loads(out.with_name("out-palette.toml").read_text())["light"][-1]
    assert row["shares"] == pytest.approx(list(shares.values()), abs=1e-4)
    best = max(shares, key=lambda name: shares[name])
    assert f"{best}*{round(shares[best], 4):g}" in text


@pytest.mark.parametrize("words", [("reveal", "--distance", "1"), ("hide", "--black")])
def test_what_needs_no_new_light_is_told(ball, capsys, words):
    """Colours that are apart already; a black under an even light, which is black everywhere."""
    kind, *more = words
    assert call(kind, ball, "core", "--under", "day", *more, "-o", ball.with_name("new.toml")) == 0
    assert "'day'" in capsys.readouterr().err


def test_what_is_not_a_wizards_is_not_written_over(ball):
    out, palette = ball.with_name("clash.toml"), ball.with_name("clash-palette.toml")
    palette.write_text("# my own\n", encoding="utf-8")
    assert refused("keep", ball, "stone", "-o", out) == "duplicate"
    assert palette.read_text(encoding="utf-8") == "# my own\n" and not out.exists()
    before = ball.read_bytes()
    assert refused("keep", ball, "stone", "-o", ball) == "conflict"
    assert ball.read_bytes() == before and not ball.with_name("wizard-palette.toml").exists()
    palette.unlink()
    own = ball.read_text(encoding="utf-8").replace("[volume]", "# mine\n[volume]")
    out.write_text(own, encoding="utf-8")
    assert refused("keep", ball, "stone", "-o", out) == "duplicate"
    assert out.read_text(encoding="utf-8") == own and not palette.exists()
    out.unlink()
    assert call("keep", ball, "stone", "-o", out) == 0 == call("keep", ball, "stone", "-o", out)
    other = out.rename(ball.with_name("other.toml"))
    assert refused("keep", other, "core", "-o", out) == "conflict"


@pytest.mark.slow
def test_names_like_mixes_and_mixes_of_files_load_again(ball, tmp_path):
    (ball.parent / "mine.csv").write_text((ball.parent / "stone.csv").read_text())
    text = ball.read_text().replace('"FL11"', '"D65*0.5+mine.csv*0.5"')
    ball.write_bytes(b"\xef\xbb\xbf" + text.replace("\n", "\r\n").encode())
    new = tmp_path / "elsewhere" / "new.toml"
    words = ("hide", ball, "core", "--under", "x + y*2", "--like", "day", "--lamp", "FL11")
    assert call(*words, "-o", new) == 0 == call(*words, "-o", new)
    made, scene = vs.Scene.load(new), vs.Scene.load(ball)
    assert made.lights[-1].spectrum.designed
    np.testing.assert_allclose(made.lights[2].spectrum.values, scene.lights[2].spectrum.values)
    said = new.read_bytes()
    assert said.count(b"\r\n") == said.count(b"\n")
