"""``volspec design``: a palette in, a palette out, a report and a picture."""

import re
import shutil
from pathlib import Path

import pytest

import volspec as vs
from tests.support.commands import PALETTE, call, figures
from volspec.palette import Apart

ROOT = Path(__file__).resolve().parents[2]


@pytest.fixture
def palette(tmp_path: Path) -> Path:
    path = tmp_path / "palette.toml"
    path.write_text(PALETTE, encoding="utf-8")
    return path


def test_it_writes_what_addresses_find_and_draws(palette, tmp_path, capsys):
    out, picture = tmp_path / "out.toml", tmp_path / "picture.svg"
    assert call("design", palette, "-o", out, "--figure", picture) == 0
    printed = capsys.readouterr().out.splitlines()
    assert printed[1].split() == ["a", "#4682b4", "0.0"]
    assert printed[-2:] == [str(out), str(picture)]
    assert "# given" in out.read_text(encoding="utf-8")
    assert vs.reflectance(f"{out}#a").designed
    assert "<svg" in picture.read_text(encoding="utf-8")


def test_json_holds_every_cell(palette, capsys):
    data = figures(capsys, "design", palette)
    assert [c["reflectance"] for c in data["cells"]] == ["a", "b"]
    assert data["cells"][0]["hex"] == "#4682b4" and data["max"] < 0.1
    assert data["metamers"][0]["reflectances"] == ["a", "b"]


def test_a_designed_palette_can_be_designed_again(palette, capsys):
    assert call("design", palette, "-o", palette) == 0 == call("design", palette, "-o", palette)
    assert palette.read_text(encoding="utf-8").count("values = [") == 2
    assert "--again" in capsys.readouterr().err
    kept = palette.read_text(encoding="utf-8")
    rough = kept.replace("[[light]]", "[criteria]\nsmoothness = 1\n[[light]]", 1)
    palette.write_text(rough, encoding="utf-8")
    assert call("design", palette, "-o", palette) == 0
    assert palette.read_text(encoding="utf-8") == rough
    assert call("design", palette, "--again", "-o", palette) == 0
    assert palette.read_text(encoding="utf-8") != rough
    other = kept.replace("steelblue", "firebrick")
    palette.write_text(other, encoding="utf-8")
    assert call("design", palette, "-o", palette) == 0
    assert palette.read_text(encoding="utf-8") != other, "a cell is not met"


def test_options_add_reflectances_to_be_told_apart(tmp_path, capsys):
    own, out = GALLERY / "colour-vision.toml", tmp_path / "out.toml"
    options = "--apart", "*", "--under", "for all", "--deficiency", "tritan", "--distance", "25"
    data = figures(capsys, "design", own, *options, "-o", out)
    (asked, added) = data["apart"]
    assert added["deficiencies"] == ["none", "tritan"] and added["lights"] == ["for all"]
    assert asked["smallest"] == added["smallest"] and added["smallest"]["tritan"] > 25
    assert vs.load_palette(out).apart[1] == Apart(
        light=("for all",), deficiency=("none", "tritan"), distance=25.0
    )
    data = figures(capsys, "design", own, "--deficiency", "tritan")
    assert data["apart"][0]["deficiencies"] == ["none", "protan", "deutan", "tritan"]


GALLERY = ROOT / "data" / "palettes"


@pytest.mark.parametrize("name", ["figure-2-volume", "figure-6", "figure-7"])
def test_the_command_of_a_gallery_s_palette_keeps_its_colours(name, tmp_path):
    """Pictures are cast from the values in the file, and its command writes it."""
    own = tmp_path / f"{name}.toml"
    shutil.copy(GALLERY / own.name, own)
    assert call("design", own, "-o", own) == 0
    assert own.read_bytes() == (GALLERY / own.name).read_bytes()


@pytest.mark.parametrize("name", ["figure-1", "figure-2"])
def test_a_gallery_s_palette_comes_out_in_the_colours_on_its_page(name, tmp_path, capsys):
    page = (ROOT / "docs/gallery/palette.md").read_text(encoding="utf-8")
    report = page.partition(f"volspec design data/palettes/{name}.toml")[2].partition("\n## ")[0]
    shown = re.findall(r"#[0-9a-f]{6} \d\.\d", report)
    assert call("design", GALLERY / f"{name}.toml") == 0
    printed = re.findall(r"#[0-9a-f]{6} \d\.\d", capsys.readouterr().out)
    assert len(shown) == {"figure-1": 4, "figure-2": 15}[name]
    for one, other in zip(shown, printed, strict=True):
        codes = [bytes.fromhex(text[1:7]) for text in (one, other)]
        assert max(abs(a - b) for a, b in zip(*codes, strict=True)) <= 1
