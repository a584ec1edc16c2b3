"""The colour models on the command line: triples in, tables, JSON and a picture out."""

import io
import json
import re
from dataclasses import replace

import numpy as np
import pytest
from PIL import Image

from tests.support.commands import call, figures, write_image
from volspec.appearance import ViewingConditions
from volspec.appearance.adaptation import adapt
from volspec.appearance.display.monitors import preset
from volspec.appearance.display.spaces import SPACES
from volspec.appearance.models import APPEARANCE_MODELS, model
from volspec.appearance.models.hunt import HuntSettings
from volspec.appearance.models.nayatani95 import NayataniSettings
from volspec.export.png import icc_profile
from volspec.spectra import light, white_XYZ

A = "109.85,100,35.58"
WHITE = (109.85, 100.0, 35.58)
COLOUR = ("appearance", 40, 35, 10)


def done(*words: str) -> None:
    assert call(*words) == 0


def test_adapt_gives_the_corresponding_colours(capsys):
    words = (*(40, 35, 10, 20, 20, 20), "--from", A, "--to", "95.05,100,108.88")
    rows = figures(capsys, "adapt", *words)
    source, target = (ViewingConditions.of_lux(XYZ, 1000) for XYZ in (WHITE, (95.05, 100, 108.88)))
    expected = adapt([[40, 35, 10], [20, 20, 20]], source, target)
    assert np.allclose([[row[name] for name in "XYZ"] for row in rows], expected, rtol=1e-12)
    assert rows[0]["X_from"] == 40 and rows[0]["defined"] is True


def test_appearance_and_its_inverse(capsys):
    seen = ("--white", A, "--Y_b", "18")
    (row,) = figures(capsys, *COLOUR, *seen)
    assert {"J", "C", "h", "H", "Q", "M", "s", "L_A", "Y_b", "composition"} <= set(row)
    words = [row[name] for name in "JCh"]
    (back,) = figures(capsys, "appearance", "--inverse", *words, *seen)
    assert [back[name] for name in "XYZ"] == pytest.approx([40, 35, 10], rel=1e-9)


def test_all_models_at_once(capsys):
    rows = figures(capsys, *COLOUR, "--white", A, "--model", "all")
    assert [row["model"] for row in rows] == list(APPEARANCE_MODELS)


def test_a_look_s_title_is_one_line_above_its_table(capsys):
    done("appearance", "--inverse", "60", "40", "90", "--white", "A")
    title, head, figures = capsys.readouterr().out.splitlines()
    assert title.startswith("under A, 1000 lx") and title.endswith("h 90.0")
    assert head.split() == list("XYZ") and len(figures.split()) == 3


def test_what_has_no_chroma_has_no_hue_in_words(capsys):
    colours = (0, 0, 0, 95.05, 100, 108.88, 40, 35, 10)
    rows = figures(capsys, "appearance", *map(str, colours), *CIELAB)
    assert [row["composition"] != "" for row in rows] == [False, False, True]


def test_looks_that_no_colour_has_are_marked_by_every_model(capsys):
    words = ("appearance", "--inverse", "25", "163", "125", "--white", "A", "--model")
    for name in ("CIELAB", "RLAB"):
        (row,) = figures(capsys, *words, name, noted=True)
        assert row["defined"] is False and row["Z"] is None


def test_tables_are_read_by_their_columns(tmp_path, capsys):
    table = tmp_path / "patches.csv"
    table.write_text("name,Z,X,Y\nred,10,40,35\n\nblue,80,20,15\n")
    rows = figures(capsys, "adapt", "--table", str(table), "--from", "A")
    assert [row["X_from"] for row in rows] == [40, 20]
    table.write_text("40,35,10\n20,15,80\n")
    assert len(figures(capsys, "appearance", "--table", str(table))) == 2


def test_digits_are_never_cut_and_standard_input_is_read(capsys, monkeypatch):
    monkeypatch.setattr("sys.stdin", io.StringIO("40,35,10\n50,50,40\n"))
    done("appearance", "--white", "A", "--table", "-")
    out = capsys.readouterr().out
    assert "\N{HORIZONTAL ELLIPSIS}" not in out and "40.00" in out and "162.96" in out


def test_a_preset_is_the_room_of_numbers_and_options_win(capsys):
    cinema = preset("cinema").conditions(WHITE)
    for more, seen in {
        (): cinema,
        ("--surround", "dim", "--Y_b", "10"): replace(cinema, surround="dim", Y_b=10.0),
        ("--L_A", "3"): replace(cinema, L_A=3.0),
        ("--lux", "50"): ViewingConditions.of_lux(WHITE, 50.0, surround="dark"),
        ("--discount",): replace(cinema, discount=True),
    }.items():
        (row,) = figures(capsys, *COLOUR, "--white", A, "--preset", "cinema", *more)
        look = APPEARANCE_MODELS["CIECAM02"].forward([40, 35, 10], seen)
        assert [row["J"], row["C"], row["h"]] == pytest.approx([look.J, look.C, look.h]), more
        assert (row["L_A"], row["Y_b"]) == (seen.L_A, seen.Y_b)


def test_a_preset_is_both_rooms_of_an_adaptation(capsys):
    words = ("adapt", 40, 35, 10, "--from", A, "--to", "95.05,100,108.88", "--method", "Guth")
    (row,) = figures(capsys, *words, "--preset", "light booth")
    booth = preset("light booth").conditions
    expected = adapt([40, 35, 10], booth(WHITE), booth((95.05, 100, 108.88)), "Guth")
    assert [row[name] for name in "XYZ"] == pytest.approx(expected)


def test_colours_outside_of_a_method_are_marked_and_counted(capsys):
    words = ("90", "5", "0", "20", "20", "20", "40", "35", "10")
    done("adapt", *words, "--from", "A", "--method", "Nayatani", "--json")
    said = capsys.readouterr()
    marks = [row["defined"] for row in json.loads(said.out)]
    assert marks == [False, True, True]
    assert re.findall(r"\d+|Nayatani", said.err) == ["1", "3", "Nayatani"]
    done("adapt", *words, "--from", "A", "--method", "CAT02")
    assert capsys.readouterr().err == ""


def test_colours_outside_of_models_are_counted_by_model_in_one_line(capsys):
    words = ("90", "5", "0", "20", "20", "20", "0", "0", "50", "--white", A)
    done("appearance", *words, "--model", "Hunt", "--model", "Nayatani95", "--json")
    said = capsys.readouterr()
    rows = json.loads(said.out)
    missed = {n: sum(not r["defined"] for r in rows if r["model"] == n) for n in APPEARANCE_MODELS}
    assert missed["Hunt"] == 2 and missed["Nayatani95"] > 0
    counts = ["2", "3", "Hunt", str(missed["Nayatani95"]), "Nayatani95"]
    assert re.findall(r"\d+\b|Hunt|Nayatani95", said.err) == counts and said.err.count("\n") == 1


def test_models_side_by_side_are_made_for_the_display_asked_for(tmp_path, capsys):
    chart = str(write_image(tmp_path / "i.exr"))
    words = ("appearance", "--image", chart, "--white", "A", "--model", "CAT02")
    done(*words, "-o", str(tmp_path / "plain.png"))
    room = ("--space", "Display P3", "--gamut", "reduce", "--preset", "cinema", "--lux", "50")
    done(*words, *RLAB, *room, "-o", str(tmp_path / "p3.png"))
    with Image.open(tmp_path / "plain.png") as plain, Image.open(tmp_path / "p3.png") as shown:
        assert "icc_profile" not in plain.info
        assert shown.info["icc_profile"] == icc_profile(SPACES[room[1]])
        assert shown.width > plain.width


RLAB, CIELAB = ("--model", "RLAB"), ("--model", "CIELAB", "--white", "95.05,100,108.88")


def test_every_input_of_hunt_s_and_nayatani_s_models_is_an_option(capsys):
    hunt = HuntSettings(
        N_c=0.7,
        N_b=25.0,
        L_AS=20.0,
        CCT_kelvin=3000.0,
        p=0.5,
        proximal_XYZ=(30.0, 25.0, 8.0),
        background_XYZ=(22.0, 20.0, 7.0),
        helson_judd=True,
    )
    nayatani = NayataniSettings(E_or=2000.0, n=2.0)
    words = [
        *("--model", "Hunt", "--model", "Nayatani95"),
        *("--hunt-N_c", "0.7", "--hunt-N_b", "25", "--hunt-L_AS", "20", "--hunt-CCT", "3000"),
        *("--hunt-p", "0.5", "--hunt-proximal", "30,25,8", "--hunt-background", "22,20,7"),
        *("--hunt-helson-judd", "--hunt-S", "0.3"),
        *("--nayatani-E_or", "2000", "--nayatani-n", "2"),
    ]
    given = figures(capsys, *COLOUR, "--white", "A", *words)
    seen = ViewingConditions.of_lux(tuple(white_XYZ(light("A")).tolist()), 1000.0)
    expected = (
        model("Hunt").forward([40, 35, 10], seen, settings=hunt, S=0.3),
        model("Nayatani95").forward([40, 35, 10], seen, settings=nayatani),
    )
    for row, look in zip(given, expected, strict=True):
        assert [row["J"], row["C"], row["h"]] == pytest.approx([look.J, look.C, look.h], rel=1e-6)
