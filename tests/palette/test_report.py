"""The report and picture of a design: figures are those of the colours, advice comes true."""

import json
import re
from dataclasses import replace

import numpy as np
import pytest
from matplotlib.colors import to_hex
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle

import volspec as vs
from tests.support.fixtures import slow_each
from tests.support.palettes import free_light, given, lamp, must, palette_of, surface
from volspec.appearance import ViewingConditions
from volspec.appearance.comparison.difference import cam16_ucs, delta_E_CAM16
from volspec.appearance.models.lab import cielab, delta_E_2000
from volspec.palette import Cell, Criteria, Design, DesignReport, Palette, PaletteSpectrum, design
from volspec.palette.figure import palette_figure, save_palette_figure
from volspec.palette.file import palette_file
from volspec.palette.model import hexadecimal
from volspec.palette.state import DesignState
from volspec.spectra import DEFAULT_GRID, PAPERS_GRID, SpectralGrid, Spectrum, XYZ_from_spectra

GREY = (0.6, 0.6, 0.6)


def advised(made: Design) -> DesignReport:
    return DesignReport.of(made, vs.suggestions(made))


@pytest.fixture(scope="module")
def flames(sodium: Design) -> DesignReport:
    return advised(sodium)


def test_a_cell_shows_the_colour_that_its_spectra_make():
    rows = (PaletteSpectrum("copper", vs.reflectance("copper")), surface("s"))
    cells = {("s", "A"): must(*GREY)}
    report = DesignReport.of(design(Palette(rows, (lamp("A"),), cells, vs.Viewing("CAT02"))))
    copper, grey = report.cells
    assert np.allclose(copper.XYZ, XYZ_from_spectra(vs.light("A"), vs.reflectance("copper")))
    assert (copper.kind, copper.wanted, copper.delta_E_2000) == ("", None, None)
    assert grey.wanted == pytest.approx(GREY) and grey.delta_E_2000 == pytest.approx(0, abs=1e-3)
    assert report.mean == grey.error, "of what is wanted only"
    assert grey.to_dict()["hex"] == "#999999" and grey.to_dict()["weight"] == "must"


def test_colours_outside_the_display_are_marked():
    """Skin under a sodium lamp, taken as it is, is more orange than sRGB."""
    rows = (PaletteSpectrum("skin", vs.reflectance("ColorChecker/dark skin")), surface("s"))
    cells = {("s", "D65"): Cell(colour=GREY)}
    report = DesignReport.of(design(Palette(rows, (lamp("D65"), lamp("HP1")), cells)))
    assert report.cell(("skin", "D65")).in_gamut
    orange = report.cell(("skin", "HP1"))
    assert not orange.in_gamut and min(orange.obtained) < 0


@pytest.mark.not_quick
def test_metamers_are_found_through_groups_colours_and_likeness():
    cells = {
        ("a", "D65"): Cell("free", group="g"),
        ("b", "D65"): Cell("free", group="g"),
        ("c", "D65"): Cell("same", other=("a", "D65")),
        ("c", "A"): Cell(colour=GREY),
        ("d", "A"): Cell(colour=GREY),
        ("d", "D65"): Cell("distinct", other=("a", "D65"), distance=30),
    }
    report = DesignReport.of(design(palette_of(cells)))
    found = {pair.light + "".join(pair.reflectances) for pair in report.metamers}
    assert found == {"D65ab", "D65ac", "D65bc", "Acd"}
    assert all(set(pair.apart) == {"D65", "A"} - {pair.light} for pair in report.metamers)
    apart = report.cell(("d", "D65"))
    assert apart.error is None and apart.wanted is None
    assert apart.delta_E_1976 == pytest.approx(30, abs=1)


@pytest.mark.not_quick
def test_binding_bounds_are_counted_and_costs_add_up(flames, figure_2):
    flame, _ = flames.spectra
    assert (flame.kind, flame.name, flame.bands) == ("reflectance", "flame", PAPERS_GRID.size)
    assert flame.at_lower > 10 and flame.largest <= 1.0
    # The design counts the colours straight between two rounds: 1e-6 of them.
    assert sum(DesignReport.of(figure_2).cost.values()) == pytest.approx(figure_2.cost, abs=1e-5)


def test_a_mixture_is_counted_by_its_lamps():
    mixed = free_light(mixture=(vs.light("LED-B1"), vs.light("FL11")))
    report = DesignReport.of(design(palette_of({("s", "L"): Cell(colour=GREY)}, mixed)))
    counts = {each.kind: each.bands for each in report.spectra}
    assert counts == {"reflectance": DEFAULT_GRID.size, "light": 2}


def test_a_mixture_s_shares_are_those_of_the_illuminance(tmp_path):
    """The report's text, the file and the mix of `volspec.light` are one light."""
    lamps = ("HP1", "LED-B5", "FL7")
    free = free_light("L", mixture=tuple(vs.light(name) for name in lamps))
    mixed = vs.light("HP1*0.3+LED-B5*0.7")
    given = PaletteSpectrum("copper", vs.reflectance("copper"))
    shown = vs.Viewing("none").display.colours
    colour = shown.encode(XYZ_from_spectra(mixed, given.spectrum) @ shown.RGB_from_XYZ.T)
    cells = {("copper", "L"): Cell(colour=tuple(np.clip(colour, 0, 1).tolist()), weight=100)}
    made = design(Palette((given,), (free,), cells))
    (light,) = DesignReport.of(made).spectra
    assert sum(light.lamps.values()) == pytest.approx(1.0) and tuple(light.lamps) == lamps
    mix = re.search(r"L = (\S+),", str(DesignReport.of(made)))
    assert mix
    own = made.light("L").on(DEFAULT_GRID).values
    assert np.allclose(vs.light(mix[1]).values, own, atol=2e-4 * own.max())
    vs.save_palette(made, tmp_path / "made.toml")
    (row,) = palette_file(tmp_path / "made.toml").light
    assert row.shares == pytest.approx(list(light.lamps.values()), abs=6e-5)


def test_metamers_are_compared_at_1_nm_too():
    """The product of interpolated spectra is not the interpolated product."""
    nm = PAPERS_GRID.wavelengths_nm
    wave = 0.5 + 0.5 * np.cos(np.pi * (nm - 400) / 10)  # 1 and 0 in turn
    comb = free_light("comb", spectrum=Spectrum(nm, wave + 1e-9))
    rows = surface("a"), surface("b", spectrum=Spectrum(nm, wave))
    cells = {(name, "comb"): Cell(colour=GREY) for name in "ab"}
    palette = Palette(rows, (comb, lamp("HP1")), cells, grid=PAPERS_GRID)
    state = DesignState.start(palette)
    report = DesignReport.of(Design(palette, state, 0.0, 0.0))
    (pair,) = report.metamers
    fine = SpectralGrid(400, 700, 1)
    light, a, b = (Spectrum(nm, v).on(fine) for v in (wave + 1e-9, np.full(nm.size, 0.5), wave))
    white = vs.Viewing("none").display.colours.white_XYZ
    colours = [cielab(XYZ_from_spectra(light, row), white) for row in (a, b)]
    assert pair.delta_E_1nm == pytest.approx(float(delta_E_2000(*colours)), abs=1e-3)
    assert pair.delta_E > pair.delta_E_1nm + 5.0
    assert f"{pair.delta_E:.2f} ({pair.delta_E_1nm:.2f} at 1 nm)" in str(report)
    # A light of the library is looked up, as bands of 10 nm hide its lines.
    sodium = DesignState.at_1_nm(state).E[1]
    found = vs.light("HP1", fine).values
    assert np.allclose(sodium / sodium.sum(), found / found.sum())


def test_advice_comes_true(flames, figure_1):
    weights = [each for each in flames.suggestions if each.startswith("(paint, sodium): weight 4")]
    assert len(weights) == 1 and "without it" in " ".join(flames.suggestions)
    assert f"brings ΔE {flames.cell(('paint', 'sodium')).error:.1f} to" in weights[0]
    place = ("paint", "sodium")
    cells = {**figure_1.cells, place: replace(figure_1.cells[place], weight=4)}
    after = DesignReport.of(design(replace(figure_1, cells=cells)))
    promised = float(weights[0].partition(" to ")[2].partition(";")[0])
    assert after.cell(place).error == pytest.approx(promised, abs=0.051)


def test_advice_begins_at_the_design_that_is_shown():
    """If more iterations help too, the other sentences still go by the palette's own."""
    cells = {
        **{(name, "D65"): Cell(colour=GREY) for name in "ab"},
        ("a", "L"): Cell(colour=(0.9, 0.1, 0.1)),
        ("b", "L"): Cell(colour=(0.1, 0.1, 0.9)),
    }
    report = advised(design(palette_of(cells, free_light(), criteria=Criteria(rounds=1))))
    rounds, *others = report.suggestions
    assert rounds.startswith("rounds 5 instead of 1 bring") and others
    for each in others:
        if "brings ΔE" in each:
            reflectance, light = each[1 : each.index(")")].split(", ")
            assert f"brings ΔE {report.cell((reflectance, light)).error:.1f} to" in each


def test_a_light_without_bounds_that_came_out_negative_has_a_report():
    cells = {("s", "D65"): Cell(colour=GREY), ("t", "D65"): Cell(colour=GREY)}
    cells |= {("s", "L"): Cell(colour=(0.9, 0, 0)), ("t", "L"): Cell(colour=(0, 0, 0.9))}
    made = design(palette_of(cells, free_light(lower=None), criteria=Criteria(rounds=1)))
    assert made.state.E[1].min() < 0
    assert advised(made).max > 1


def test_a_colour_beyond_every_reflectance_is_reported_with_the_nearest():
    """Blue under sodium: no reflectance has it."""
    cells = {("s", "HP1"): Cell(colour=(0.1, 0.2, 0.9)), ("s", "D65"): Cell(colour=GREY)}
    found = advised(design(palette_of(cells))).suggestions
    assert any("(s, HP1): #1a33e6 is out of reach" in each for each in found)


def test_a_brighter_light_is_advised_where_upper_bounds_bind():
    cells = {("s", "A"): Cell(colour=(0.9, 0.9, 0.95))}
    found = advised(design(palette_of(cells, criteria=Criteria(rounds=3)))).suggestions
    assert any(each.startswith("exposure 1.5 instead of 1 brings") for each in found)


def test_it_reads_as_text_and_as_json(flames):
    text = str(flames)
    assert all(text.count(name) > 1 for name in ("sodium", "paint", "flame"))
    assert max(map(len, text.splitlines())) <= 100
    data = json.loads(json.dumps(flames.to_dict()))
    assert len(data["cells"]) == 4 and data["cells"][0].keys() >= {"X", "Y", "Z", "wanted_hex"}
    assert data["mean"] == pytest.approx(np.mean(flames.errors))


def test_a_report_may_count_differences_in_cam16_ucs(flames, sodium):
    report = DesignReport.of(sodium, difference="CAM16-UCS")
    for cell, usual in zip(report.cells, flames.cells, strict=True):
        assert cell.delta_E_CAM16 == usual.delta_E_CAM16 and cell.delta_E == cell.delta_E_CAM16
        assert usual.delta_E == usual.delta_E_2000 == cell.delta_E_2000
        if cell.error is not None:
            space = sodium.palette.viewing.display.colours
            XYZ = space.decode(np.array([cell.obtained, cell.wanted])) @ space.XYZ_from_RGB.T
            white = tuple(space.white_XYZ.tolist())
            apart = delta_E_CAM16(*cam16_ucs(XYZ, ViewingConditions(white, discount=True)))
            assert cell.error == pytest.approx(float(apart), abs=1e-6)
    assert report.max > 0 and report.max != flames.max
    assert "ΔE′ mean" in str(report) and "ΔE00 mean" in str(flames)
    assert report.to_dict()["difference"] == "CAM16-UCS"


def test_metamers_are_alike_to_some_observers(flames, sodium):
    (pair,) = flames.metamers
    seen = pair.observers
    assert seen.count == 1000 and pair.delta_E < 0.2
    assert 0.2 < seen.alike < 0.7 and 0.8 < seen.median < seen.p95 < 6
    assert f"alike to {100 * seen.alike:.0f} % of 1000 observers" in " ".join(str(flames).split())
    assert flames.to_dict()["metamers"][0]["observers"]["alike"] == seen.alike
    assert DesignReport.of(sodium).metamers == flames.metamers, "the same observers"

    paint = PaletteSpectrum("paint", vs.reflectance("ColorChecker/red"))
    twin = replace(paint, name="twin")
    same = {("paint", "D65"): Cell(colour=GREY), ("twin", "D65"): Cell(colour=GREY)}
    lights, criteria = (lamp("D65"), free_light("open")), Criteria(rounds=1)
    made = design(Palette((paint, twin), lights, same, criteria=criteria))
    (equal,) = DesignReport.of(made).metamers
    assert (equal.observers.alike, equal.observers.p95) == (1.0, 0.0)


def many(count: int) -> Design:
    rows = tuple(given(f"reflectance {i}", 0.3) for i in range(count))
    columns = tuple(given(f"a light called {j}", 1.0) for j in range(count - 1))
    cells = {("reflectance 0", "open"): Cell(colour=(0.5, 0.4, 0.3))}
    return design(Palette(rows, (*columns, free_light("open")), cells, criteria=Criteria(rounds=1)))


def texts(figure: Figure) -> list[str]:
    return [t.get_text() for t in [*figure.texts, *(t for a in figure.axes for t in a.texts)]]


def test_squares_have_the_colours_of_the_report(sodium):
    report = DesignReport.of(sodium)
    patches = [each for axes in palette_figure(sodium, report).axes for each in axes.patches]
    drawn = [to_hex(each.get_facecolor()) for each in patches if isinstance(each, Rectangle)]
    for cell in report.cells:
        assert hexadecimal(cell.obtained) in drawn
        assert cell.wanted is None or hexadecimal(cell.wanted) in drawn


def test_it_says_what_is_what(sodium):
    words = texts(palette_figure(sodium, title="Flames"))
    assert {"Flames", "flame", "paint", "sodium", "D65"} <= set(words)
    assert any("dashed" in each and "outside" not in each for each in words)
    report = DesignReport.of(sodium)
    assert f"{report.cell(('paint', 'sodium')).error:.1f}" in words


@pytest.mark.parametrize("count", [4, *slow_each(1, 12)])
def test_names_are_whole_and_inside_whatever_the_size(count):
    figure = palette_figure(many(count), title="Many")
    assert {f"reflectance {count - 1}", "open"} <= set(texts(figure))
    wide, tall = figure.get_size_inches() * figure.dpi
    for text in [*figure.texts, *(t for axes in figure.axes for t in axes.texts)]:
        box = text.get_window_extent()
        assert box.x0 >= 0 and box.y0 >= 0 and box.x1 <= wide and box.y1 <= tall, text.get_text()


@pytest.mark.not_quick
def test_files_are_what_their_names_say(sodium, tmp_path):
    import imageio.v3 as iio

    picture, drawing = tmp_path / "p.png", tmp_path / "p.svg"
    save_palette_figure(sodium, picture)
    assert len(np.unique(iio.imread(picture).reshape(-1, 4), axis=0)) > 100
    save_palette_figure(sodium, drawing)
    assert "<svg" in drawing.read_text(encoding="utf-8")
