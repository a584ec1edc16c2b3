"""Palettes on disk: read, written back with their comments, and refused in one line."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import volspec as vs
from tests.support.errors import raises
from tests.support.palettes import surface
from volspec.appearance import Display
from volspec.errors import PaletteError, SpectrumError
from volspec.palette import Cell, Criteria, Palette, PaletteSpectrum
from volspec.palette.model import hexadecimal, parse_colour
from volspec.spectra import read_spectrum

ROOT = Path(__file__).resolve().parents[2]
SMALL = """
title = "Small"

[criteria]
rounds = 2   # quick

[[light]]
name = "day"
spectrum = "D65"

# the lamp is ours
[[light]]
name = "split 1"
design = true
band_nm = [420, 680]
upper = 4

[[reflectance]]
name = "red"

[[reflectance]]
name = "blue"
upper = "none"

[[cell]]
at = ["red", "day"]
colour = "#ca0020"

[[cell]]
reflectance = "*"
light = "split 1"
free = "m"
high = [0.5, 0.5, 0.9]
weight = 4
"""


def written(folder: Path, text: str = SMALL, name: str = "small.toml") -> Path:
    path = folder / name
    path.write_text(text, encoding="utf-8")
    return path


def changed(old: str, new: str) -> str:
    assert old in SMALL
    return SMALL.replace(old, new)


def test_a_file_becomes_the_palette_it_says(tmp_path: Path) -> None:
    palette = vs.load_palette(written(tmp_path))
    assert palette.names == (("red", "blue"), ("day", "split 1"))
    red, blue = palette.reflectances
    assert red.free and (red.lower, red.upper, blue.upper) == (0.0, 1.0, None)
    day, split = palette.lights
    assert not day.free and split.free and split.band_nm == (420, 680) and split.upper == 4
    free = Cell("free", group="m", high=(0.5, 0.5, 0.9), weight=4)
    red_code = Cell(colour=(202 / 255, 0.0, 32 / 255))
    assert dict(palette.cells) == {
        ("red", "day"): red_code,
        ("red", "split 1"): free,
        ("blue", "split 1"): free,
    }
    assert palette.criteria.rounds == 2 and palette.viewing.model == "none"


def test_every_kind_of_cell_has_a_key(tmp_path: Path) -> None:
    more = """
    [viewing]
    model = "CAT02"
    display = { preset = "sRGB", Y_b = 18 }
    [[cell]]
    at = ["blue", "day"]
    distinct = ["red", "day"]
    distance = 40
    [[reflectance]]
    name = "three"
    constant = true
    [[light]]
    name = "dusk"
    spectrum = "A"
    [[cell]]
    at = ["three", "day"]
    same = ["red", "day"]
    must = true
    [[cell]]
    at = ["three", "dusk"]
    black = true
    """
    palette = vs.load_palette(written(tmp_path, SMALL + more))
    assert palette.cells["blue", "day"] == Cell("distinct", other=("red", "day"), distance=40)
    assert palette.cells["three", "day"] == Cell("same", other=("red", "day"), weight=math.inf)
    assert palette.cells["three", "dusk"] == Cell("black")
    assert palette.reflectances[2].constant
    assert palette.viewing.model == "CAT02" and palette.viewing.display.Y_b == 18


def test_writing_back_keeps_comments_order_and_what_is_written_loads_designed(
    tmp_path: Path,
) -> None:
    source, target = written(tmp_path), tmp_path / "out" / "made.toml"
    made = vs.design(vs.load_palette(source))
    vs.save_palette(made, target, source=source)
    text = target.read_text(encoding="utf-8")
    kept = [line for line in text.splitlines() if not line.startswith(("values", "    ", "]"))]
    assert [line for line in kept if line != "design = true"] == [
        line for line in SMALL.splitlines() if line != "design = true"
    ]
    again = vs.load_palette(target)
    for one, other in zip(again.reflectances, made.palette.reflectances, strict=True):
        assert one.free and one.spectrum is not None and other.spectrum is not None
        assert np.abs(one.spectrum.values - other.spectrum.values).max() < 1e-6
    # Written again it says the same, also over itself.
    vs.save_palette(again, target, source=target)
    assert target.read_text(encoding="utf-8") == text


def test_a_table_in_one_line_is_filled_too(tmp_path: Path) -> None:
    text = """
    light = [{ name = "day", spectrum = "D65" }]  # one
    reflectance = [{ name = "a" }, { name = "b", design = true }]
    cell = [{ at = ["a", "day"], colour = "teal" }, { at = ["b", "day"], colour = [0.5, 0.2, 0.1] }]
    """
    source = written(tmp_path, text)
    vs.save_palette(vs.design(vs.load_palette(source)), source, source=source)
    assert "# one" in source.read_text(encoding="utf-8")
    assert vs.reflectance(f"{source}#b").designed


def test_files_are_found_from_where_the_palette_is_written(tmp_path: Path) -> None:
    (tmp_path / "lamp.csv").write_text("380,1\n780,1\n", encoding="utf-8")
    source = written(tmp_path, changed('"D65"', '"lamp.csv"'))
    target = tmp_path / "deep" / "er" / "made.toml"
    vs.save_palette(vs.design(vs.load_palette(source)), target, source=source)
    assert 'spectrum = "../../lamp.csv"' in target.read_text(encoding="utf-8")
    assert vs.load_palette(target).lights[0].spectrum is not None


def test_a_palette_made_in_python_is_written_whole(tmp_path: Path) -> None:
    lamps = (vs.light("LED-B1"), vs.light("FL11"))
    rows = (
        surface("a", lower=None),
        PaletteSpectrum("b", vs.reflectance("copper")),
    )
    columns = (PaletteSpectrum("L", free=True, mixture=lamps),)
    cells = {
        ("a", "L"): Cell(colour=(0.3, 0.25, 0.1), weight=3),
        ("b", "L"): Cell("free", group="g", low=(0.2, 0.2, 0.2)),
    }
    viewing = vs.Viewing("CAT02", exposure=2, display=Display(Y_b=30))
    palette = Palette(rows, columns, cells, viewing, criteria=Criteria(rounds=1), level="absolute")
    vs.save_palette(palette, tmp_path / "new.toml")
    again = vs.load_palette(tmp_path / "new.toml")
    assert again.cells == palette.cells and again.viewing == palette.viewing
    assert again.criteria == palette.criteria and again.level == "absolute"
    assert again.reflectances[0].lower is None and not again.reflectances[1].free
    assert [lamp.name for lamp in again.lights[0].mixture] == ["LED-B1", "FL11"]


def test_a_lamp_that_no_name_finds_cannot_be_written(tmp_path: Path) -> None:
    lamp = vs.Spectrum([380, 780], [0, 1], "D65")
    mixed = PaletteSpectrum("L", free=True, mixture=(lamp,))
    rows = (PaletteSpectrum("a", vs.reflectance("copper")),)
    palette = Palette(rows, (mixed,), {("a", "L"): Cell("black")})
    with raises(PaletteError, "unknown", "PaletteSpectrum.mixture"):
        vs.save_palette(palette, tmp_path / "p.toml")
    with raises(PaletteError, "unsupported", "path"):
        vs.save_palette(palette, tmp_path / "p.json")


def test_an_exposure_is_fitted_so_that_reflectances_stay_below_one(tmp_path: Path) -> None:
    text = changed("[criteria]", '[viewing]\nexposure = "auto"\n\n[criteria]').replace(
        '"#ca0020"', '"red"'
    )
    source = written(tmp_path, text)
    exposure = vs.load_palette(source).viewing.exposure
    assert exposure > 1.2, "a full red under D65 needs more than all its light"
    made = vs.design(vs.load_palette(source))
    assert made.state.S[0].max() <= 1.0
    red = made.state.RGB()[0, 0]
    assert red == pytest.approx([1, 0, 0], abs=0.02)
    vs.save_palette(made, source, source=source)
    assert vs.load_palette(source).viewing.exposure == pytest.approx(exposure, rel=1e-5)


def test_an_address_is_a_light_and_a_reflectance_wherever_files_are(tmp_path: Path) -> None:
    source, target = written(tmp_path), tmp_path / "made.toml"
    made = vs.design(vs.load_palette(source))
    vs.save_palette(made, target, source=source)
    split = vs.light("made.toml#split 1", folder=tmp_path)
    assert split.designed and split.name == "made#split 1"
    assert np.allclose(split.values, made.light("split 1").values, atol=2e-6)
    # Normalised twice, to a luminance that a product of matrices gives to its last bits.
    day = vs.light("made.toml#DAY", folder=tmp_path)
    np.testing.assert_allclose(day.values, vs.light("D65").values, rtol=1e-12)
    red = vs.reflectance(f"{target}#red")
    assert red.designed and np.allclose(red.values, made.reflectance("red").values, atol=1e-6)
    assert vs.reflectance(f"{target}#1").values.tolist() == red.values.tolist()
    assert vs.light("made.toml#split 1*0.5+A*0.5", folder=tmp_path).designed
    assert read_spectrum(f"{target}#blue").values.size == 31


def test_a_scene_of_designed_spectra_trains_its_own_basis(tmp_path: Path) -> None:
    source = written(tmp_path)
    vs.save_palette(vs.design(vs.load_palette(source)), source, source=source)
    scene = written(
        tmp_path,
        """
        volume = { file = "none.nrrd" }
        material = [{ name = "m", reflectance = "small.toml#red" }]
        transfer = { points = [{ value = 0, opacity = 0.1, material = "m" }] }
        light = [{ name = "lamp", spectrum = "small.toml#split 1" }]
        """,
        "scene.toml",
    )
    reason = vs.Scene.load(scene).basis_reason
    assert reason == "small#split 1, small#red came from a designer"


@pytest.mark.parametrize(
    ("address", "message"),
    [
        ("small.toml#split 1", "open and not designed yet; run volspec design small.toml"),
        ("small.toml#split", "no light is named 'split'; did you mean 'split 1'? there is day"),
        ("small.toml", "is a palette; choose a light: small.toml#day"),
        ("none.toml#x", "no such file"),
        ("bad.toml#x", "not valid TOML"),
        ("empty.toml#x", "holds no light"),
        ("short.toml#a", "its values belong on [criteria] grid_nm, 400"),
        ("loop.toml#a", "itself; name another"),
    ],
)
def test_addresses_that_lead_nowhere_are_refused(
    tmp_path: Path, address: str, message: str
) -> None:
    written(tmp_path)
    written(tmp_path, "[[light]", "bad.toml")
    written(tmp_path, "light = 3", "empty.toml")
    written(tmp_path, 'light = [{ name = "a", values = [1.0, 2.0] }]', "short.toml")
    written(tmp_path, 'light = [{ name = "a", spectrum = "loop.toml#a" }]', "loop.toml")
    with pytest.raises(SpectrumError) as caught:
        vs.light(address, folder=tmp_path)
    assert message in str(caught.value) and "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("rounds = 2", "round = 2", "criteria.round: unknown key; did you mean 'rounds'"),
        ("rounds = 2", "rounds = 0", "criteria.rounds is 0"),
        (
            "upper = 4",
            'upper = "all"',
            "[[light]] split 1: upper is 'all'",
        ),
        ('"D65"', '"D66"', "[[light]] day: light 'D66' is unknown; did you mean 'D65'"),
        ('name = "red"', 'name = "red"\nvalues = [1.0]', "1 values, but 31 bands"),
        ('name = "red"', 'name = "blue"', "no reflectance is named 'red'"),
        ('"#ca0020"', '"#ca00"', "cell 1: colour '#ca00': expected #rrggbb"),
        ('"#ca0020"', '"crimsom"', "did you mean 'crimson'"),
        ('"#ca0020"', "[202, 0, 32]", "has a code of 202, which no display shows; divide by 255"),
        ('"#ca0020"', "[0.1, 0.2]", "cell 1 colour is (0.1, 0.2)"),
        ("weight = 4", "weight = 0", "weight is 0"),
        ("weight = 4", "weight = 4\nmust = true", "[[cell]] 2: weight: given with must"),
        ("weight = 4", "black = true", "asks for free and black; give one of colour"),
        ("weight = 4", "distance = 4", "[[cell]] 2: distance: for distinct cells"),
        ('free = "m"', 'same = ["red", "day"]', "[[cell]] 2: high: for free cells"),
        ('reflectance = "*"', 'at = ["red", "day"]', "[[cell]] 2: at: no place, or two"),
        (
            '"*"\nlight = "split 1"',
            '["red", "rod"]\nlight = "day"',
            "no reflectance is named 'rod'",
        ),
        ('light = "split 1"', 'light = ["day", "split 1"]', "(red, day) is asked for twice"),
        (
            'spectrum = "D65"',
            'spectrum = "D65"\nupper = 3',
            "[[light]] day: design: it is not designed, but has upper",
        ),
        (
            'name = "day"',
            'name = "day"\nvalues = [1.0]',
            "[[light]] day: values: given with spectrum",
        ),
        ("[420, 680]", "[680, 420]", "band_nm is (680.0, 420.0); the band is empty"),
        ("title", "[viewing]\nmodel = 'CAT2'\n[extra]\ntitle", "extra: unknown key"),
        (
            "[criteria]",
            "[viewing]\nmodel = 'CAT2'\n[criteria]",
            "viewing.model is 'CAT2'",
        ),
        ("[criteria]", "[criteria]\nsubspace = 1.0", "but the basis is missing"),
        ("[criteria]", "[criteria]\ngrid_nm = [400, 700]", "criteria.grid_nm"),
        ("[[cell]]", "[[kell]]", "kell: unknown key; did you mean 'cell'"),
        ("rounds = 2", "grid_nm = [400, 700, 0.01]", "grid_nm has 30001 bands; a design takes up"),
        ('name = "red"', 'name = " "', "[[reflectance]] 1: name is ' '"),
        ('name = "red"', "", "[[reflectance]] 1: name: missing"),
        ("upper = 4", "upper = 0", "lower: 0 is not below upper 0; leave a range between them"),
    ],
)
def test_a_mistake_is_refused_in_one_line(tmp_path: Path, old: str, new: str, message: str) -> None:
    path = written(tmp_path, changed(old, new))
    with raises(PaletteError) as caught:
        vs.load_palette(path)
    text = str(caught.value)
    assert text.startswith(f"{path}: ") and message in text


def test_one_free_colour_has_one_pair_of_bounds(tmp_path: Path) -> None:
    more = '[[cell]]\nat = ["blue", "day"]\nfree = "m"\n'
    with pytest.raises(PaletteError, match="'m' has other bounds than in cell 2"):
        vs.load_palette(written(tmp_path, SMALL + more))


def test_a_source_with_other_spectra_is_refused(tmp_path: Path) -> None:
    source = written(tmp_path)
    palette = vs.load_palette(source)
    other = replace(palette, lights=(*palette.lights, PaletteSpectrum("dusk", vs.light("A"))))
    with raises(PaletteError, "conflict", "source"):
        vs.save_palette(other, tmp_path / "out.toml", source=source)
    assert not (tmp_path / "out.toml").exists()


@pytest.mark.parametrize("name", ["figure-1", "figure-2"])
def test_palettes_that_ship_reach_the_figures_of_the_paper(name: str) -> None:
    report = vs.DesignReport.of(vs.design(vs.load_palette(ROOT / f"data/palettes/{name}.toml")))
    assert report.mean < 3 and max(pair.delta_E for pair in report.metamers) < 1
    if name == "figure-1":
        (pair,) = report.metamers
        assert pair.light == "D65" and pair.apart["sodium"] > 20
        assert report.cell(("flame", "sodium")).error == pytest.approx(0, abs=5)


def test_colours_are_read_as_css_writes_them() -> None:
    assert parse_colour("#fff") == parse_colour("White") == (1.0, 1.0, 1.0)
    assert hexadecimal(parse_colour("#0571b0")) == "#0571b0"
    assert parse_colour([0, 0.5, 1]) == (0.0, 0.5, 1.0)


def test_a_light_whose_name_looks_like_a_mix_is_found(tmp_path: Path) -> None:
    path = written(tmp_path, SMALL.replace('"split 1"', '"x*2 + y"'))
    made = tmp_path / "made.toml"
    vs.save_palette(vs.design(vs.load_palette(path)), made, source=path)
    own = vs.light("made.toml#x*2 + y", folder=tmp_path)
    assert own.designed
    mixed = vs.light("made.toml#x*2 + y*0.5+made.toml#day*0.5", folder=tmp_path)
    np.testing.assert_allclose(mixed.values, 0.5 * own.values + 0.5 * vs.light("D65").values)


def test_a_mix_of_files_is_found_from_the_new_place(tmp_path: Path) -> None:
    rows = "\n".join(f"{nm},{nm / 700}" for nm in range(380, 731, 10))
    (tmp_path / "mine.csv").write_text(rows)
    text = SMALL.replace('spectrum = "D65"', 'spectrum = "D65*0.25+mine.csv*0.5"')
    text = text.replace("upper = 4", 'mixture = ["D65", "mine.csv*2+A"]').replace("band_nm", "#")
    path = written(tmp_path, text)
    made = vs.design(vs.load_palette(path))
    target = tmp_path / "sub" / "made.toml"
    vs.save_palette(made, target, source=path)
    assert 'spectrum = "D65*0.25+../mine.csv*0.5"' in target.read_text(encoding="utf-8")
    assert '"../mine.csv*2.0+A"' in target.read_text(encoding="utf-8")
    again = vs.load_palette(target).lights[0].spectrum
    assert again is not None and made.palette.lights[0].spectrum is not None
    np.testing.assert_allclose(again.values, made.palette.lights[0].spectrum.values)


def test_a_byte_order_mark_is_read_and_line_ends_are_kept(tmp_path: Path) -> None:
    path = tmp_path / "windows.toml"
    path.write_bytes(b"\xef\xbb\xbf" + SMALL.replace("\n", "\r\n").encode())
    vs.save_palette(vs.design(vs.load_palette(path)), path, source=path)
    said = path.read_bytes()
    assert said.count(b"\r\n") == said.count(b"\n") > 40 and b"\r\r" not in said


def test_an_empty_palette_and_a_missing_one_are_refused(tmp_path: Path) -> None:
    with pytest.raises(PaletteError, match=r"light: missing; add \[\[light\]\]"):
        vs.load_palette(written(tmp_path, ""))
    with pytest.raises(SpectrumError) as refused:
        vs.light("none.toml#x", folder=tmp_path)
    assert "no such file" in str(refused.value) and "not valid" not in str(refused.value)
