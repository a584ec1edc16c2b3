"""Palettes on disk: read, written back with their comments, and refused in one line."""

import math
import re
from pathlib import Path

import numpy as np
import pytest

import volspec as vs
from tests.support.palettes import surface
from tests.support.scenes import scene_text
from volspec.appearance import Display
from volspec.appearance.display.spaces import SPACES
from volspec.export.png import icc_profile
from volspec.palette import Cell, Criteria, Palette, PaletteSpectrum
from volspec.spectra import DEFAULT_GRID, read_spectrum

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


def designed(source: Path, target: Path | None = None) -> vs.Design:
    """Design the palette of a file; write it over the file, or into another one."""
    made = vs.design(vs.load_palette(source))
    vs.save_palette(made, target or source, source=source)
    return made


def changed(old: str, new: str) -> str:
    assert old in SMALL
    return SMALL.replace(old, new)


def test_a_file_becomes_the_palette_it_says(tmp_path):
    palette = vs.load_palette(written(tmp_path))
    assert palette.names == (("red", "blue"), ("day", "split 1"))
    red, blue = palette.reflectances
    assert red.free and (red.lower, red.upper, blue.upper) == (0.0, 1.0, None)
    day, split = palette.lights
    assert not day.free and split.free and split.band_nm == (420, 680) and split.upper == 4
    free = Cell("free", group="m", high=(0.5, 0.5, 0.9), weight=4)
    assert dict(palette.cells) == {
        ("red", "day"): Cell(colour=(202 / 255, 0.0, 32 / 255)),
        ("red", "split 1"): free,
        ("blue", "split 1"): free,
    }
    assert palette.criteria.rounds == 2 and palette.viewing.model == "none"


def test_every_kind_of_cell_has_a_key(tmp_path):
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


def test_writing_back_keeps_comments_and_loads_designed(tmp_path):
    source, target = written(tmp_path), tmp_path / "out" / "made.toml"
    made = designed(source, target)
    text = target.read_text(encoding="utf-8")
    added = ("values", "    ", "]", "design")
    kept, given = (
        [line for line in each.splitlines() if not line.startswith(added)] for each in (text, SMALL)
    )
    assert kept == given
    again = vs.load_palette(target)
    for one, other in zip(again.reflectances, made.palette.reflectances, strict=True):
        assert one.free and one.spectrum is not None and other.spectrum is not None
        assert np.abs(one.spectrum.values - other.spectrum.values).max() < 1e-6
    # Written again it says the same, also over itself.
    vs.save_palette(again, target, source=target)
    assert target.read_text(encoding="utf-8") == text


def test_a_table_in_one_line_is_filled_too(tmp_path):
    text = """
    light = [{ name = "day", spectrum = "D65" }]  # one
    reflectance = [{ name = "a" }, { name = "b", design = true }]
    cell = [{ at = ["a", "day"], colour = "teal" }, { at = ["b", "day"], colour = [0.5, 0.2, 0.1] }]
    """
    source = written(tmp_path, text)
    designed(source)
    assert "# one" in source.read_text(encoding="utf-8")
    assert vs.reflectance(f"{source}#b").designed


def test_a_palette_made_in_python_is_written_whole(tmp_path):
    lamps = (vs.light("LED-B1"), vs.light("FL11"))
    rows = surface("a", lower=None), PaletteSpectrum("b", vs.reflectance("copper"))
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


def test_an_exposure_is_fitted_so_that_reflectances_stay_below_one(tmp_path):
    text = changed("[criteria]", '[viewing]\nexposure = "auto"\n\n[criteria]')
    source = written(tmp_path, text.replace('"#ca0020"', '"red"'))
    exposure = vs.load_palette(source).viewing.exposure
    assert exposure > 1.2, "a full red under D65 needs more than all its light"
    made = designed(source)
    assert made.state.S[0].max() <= 1.0
    assert made.state.RGB()[0, 0] == pytest.approx([1, 0, 0], abs=0.02)
    assert vs.load_palette(source).viewing.exposure == pytest.approx(exposure, rel=1e-5)


def test_an_address_is_a_light_and_a_reflectance_wherever_files_are(tmp_path):
    source, target = written(tmp_path), tmp_path / "made.toml"
    made = designed(source, target)
    split = vs.light("made.toml#split 1", folder=tmp_path)
    assert split.designed
    assert np.allclose(split.values, made.light("split 1").values, atol=2e-6)
    # Normalised twice, to a luminance that a product of matrices gives to its last bits.
    day = vs.light("made.toml#DAY", folder=tmp_path)
    np.testing.assert_allclose(day.values, vs.light("D65").values, rtol=1e-12)
    red = vs.reflectance(f"{target}#red")
    assert red.designed and np.allclose(red.values, made.reflectance("red").values, atol=1e-6)
    assert vs.reflectance(f"{target}#1").values.tolist() == red.values.tolist()
    assert vs.light("made.toml#split 1*0.5+A*0.5", folder=tmp_path).designed
    assert read_spectrum(f"{target}#blue").values.size == DEFAULT_GRID.size


@pytest.mark.not_quick
def test_a_scene_of_designed_spectra_trains_its_own_basis(tmp_path):
    source = written(tmp_path)
    designed(source)
    text = scene_text(
        {"m": "small.toml#red"},
        [(0, 0.1, "m")],
        lights={"lamp": "small.toml#split 1"},
        more='[viewing]\nmode = "componentwise"\n',
    )
    reason = vs.Scene.load(written(tmp_path, text, "scene.toml")).basis_reason
    assert "small#split 1" in reason and "small#red" in reason


def test_shipped_palettes_reach_the_paper_s_figures(sodium, figure_2):
    report = vs.DesignReport.of(sodium)
    for each in (report, vs.DesignReport.of(figure_2)):
        assert each.mean < 3 and max(pair.delta_E for pair in each.metamers) < 1
    (pair,) = report.metamers
    assert pair.light == "D65" and pair.apart["sodium"] > 20
    assert report.cell(("flame", "sodium")).error == pytest.approx(0, abs=5)


def test_a_light_whose_name_looks_like_a_mix_is_found(tmp_path):
    path = written(tmp_path, SMALL.replace('"split 1"', '"x*2 + y"'))
    designed(path, tmp_path / "made.toml")
    own = vs.light("made.toml#x*2 + y", folder=tmp_path)
    assert own.designed
    mixed = vs.light("made.toml#x*2 + y*0.5+made.toml#day*0.5", folder=tmp_path)
    np.testing.assert_allclose(mixed.values, 0.5 * own.values + 0.5 * vs.light("D65").values)


def test_a_mix_of_files_is_found_from_the_new_place(tmp_path):
    (tmp_path / "mine.csv").write_text("\n".join(f"{nm},{nm / 700}" for nm in range(380, 731, 10)))
    text = SMALL.replace('spectrum = "D65"', 'spectrum = "D65*0.25+mine.csv*0.5"')
    text = text.replace("upper = 4", 'mixture = ["D65", "mine.csv*2+A"]').replace("band_nm", "#")
    path = written(tmp_path, text)
    target = tmp_path / "sub" / "made.toml"
    made = designed(path, target)
    again = vs.load_palette(target).lights[0].spectrum
    assert again is not None and made.palette.lights[0].spectrum is not None
    np.testing.assert_allclose(again.values, made.palette.lights[0].spectrum.values)


def test_a_byte_order_mark_is_read_and_line_ends_are_kept(tmp_path):
    path = tmp_path / "windows.toml"
    path.write_bytes(b"\xef\xbb\xbf" + SMALL.replace("\n", "\r\n").encode())
    designed(path)
    said = path.read_bytes()
    assert said.count(b"\r\n") == said.count(b"\n") > 40 and b"\r\r" not in said


# Another display: codes are other colours there.
MEASURED = """white_cd_m2 = 120
space.primaries_xy = [[0.68, 0.32], [0.265, 0.69], [0.15, 0.06]]
space.white_xy = [0.313, 0.329]
space.transfer = 2.4
"""


def on_display(folder: Path, display: str) -> vs.Palette:
    text = changed("[criteria]", f"[viewing.display]\n{display}\n[criteria]")
    return vs.load_palette(written(folder, text))


def test_a_colour_is_what_a_measured_display_shows(tmp_path):
    usual, measured = on_display(tmp_path, ""), on_display(tmp_path, MEASURED)
    space = measured.viewing.display.colours
    assert (space.name, space.primaries_xy[0]) == ("display", (0.68, 0.32))
    one, other = (vs.design(each) for each in (usual, measured))
    assert vs.DesignReport.of(other).cell(("red", "day")).error == pytest.approx(0, abs=1)
    assert abs(one.reflectance("red").values - other.reflectance("red").values).max() > 0.02


@pytest.mark.parametrize(
    "display", [MEASURED, 'space = "Display P3"\ngamut = "reduce"', "white_cd_m2 = 200\nY_b = 18"]
)
def test_a_new_palette_file_has_the_same_display(tmp_path, display):
    palette = on_display(tmp_path, display)
    vs.save_palette(palette, tmp_path / "new.toml")
    again, own = vs.load_palette(tmp_path / "new.toml").viewing.display, palette.viewing.display
    for name in ("colours", "conditions", "gamut"):
        assert getattr(again, name) == getattr(own, name)


def test_a_profile_is_found_next_to_it(tmp_path, monkeypatch):
    (tmp_path / "mine.icc").write_bytes(icc_profile(SPACES["Display P3"]))
    monkeypatch.chdir("/")
    palette = on_display(tmp_path, 'space = "mine.icc"')
    x, _ = palette.viewing.display.colours.primaries_xy[0]
    assert x == pytest.approx(0.68, abs=1e-3)  # ICC's numbers have 16 bits
    target = tmp_path / "sub" / "made.toml"
    vs.save_palette(vs.design(palette), target, source=tmp_path / "small.toml")
    assert vs.load_palette(target).viewing.display.colours == palette.viewing.display.colours


PAGE = (ROOT / "docs/palettes.md").read_text(encoding="utf-8")


def test_the_example_of_the_docs_is_a_palette_that_is_met(tmp_path):
    (example,) = re.findall(r"```toml\n(.*?)```", PAGE, re.DOTALL)
    assert vs.DesignReport.of(vs.design(vs.load_palette(written(tmp_path, example)))).mean < 1


@pytest.mark.not_quick
def test_the_code_of_the_docs_runs(tmp_path, monkeypatch):
    (code,) = re.findall(r"```python\n(.*?)```", PAGE, re.DOTALL)
    (tmp_path / "data").symlink_to(ROOT / "data")
    monkeypatch.chdir(tmp_path)
    scope: dict[str, vs.Spectrum] = {}
    exec(code, scope)
    assert scope["split"].designed
