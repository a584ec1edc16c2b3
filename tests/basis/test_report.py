"""The report of a basis: what its figures mean, and that the picture of them is one."""

import io
import json
import subprocess
import sys
from dataclasses import asdict
from pathlib import Path

import numpy as np
import pytest

from tests.support.fixtures import slow
from volspec._figures import spread_apart
from volspec.basis import MaterialBasis, SpectralBasis, figure, report_table
from volspec.basis.display import MODES
from volspec.basis.figure import basis_figure, save_figure, worst_pairs
from volspec.basis.report import (
    PRODUCT_MODES,
    RGB_PRODUCT,
    ErrorSummary,
    WorstPair,
    basis_report,
    product_rows,
    sRGB_codes,
)
from volspec.basis.report_table import ErrorTable, error_table, format_delta_e
from volspec.spectra import XYZ_from_spectra, light, reflectance, white_XYZ

LAMPS = {"smooth": [light("D65"), light("A")], "spiky": [light("FL2"), light("HP1")]}
SAMPLES = [reflectance(f"ColorChecker/{n}") for n in ("red", "green", "blue", "yellow")]
WHITE = reflectance("white")
WAYS_OF_PRODUCTS = (*PRODUCT_MODES, RGB_PRODUCT)
PACKAGE = Path(figure.__file__).parents[1]


@pytest.fixture(scope="module")
def table(general: SpectralBasis) -> ErrorTable:
    return error_table(general, LAMPS, SAMPLES)


@pytest.fixture(scope="module")
def materials() -> MaterialBasis:
    return MaterialBasis({"rotor": reflectance("copper"), "case": reflectance("iron")})


def test_a_channel_for_every_band_has_no_error_and_no_product_has():
    errors = basis_report(SpectralBasis.bands(), [*LAMPS["smooth"], *LAMPS["spiky"]], SAMPLES)
    assert max(errors.errors[mode].max for mode in MODES) < 1e-9
    for products in errors.products.values():
        assert max(products.fitted.max, products.componentwise.max) < 1e-9
    assert set(errors.products) == {2, 3}
    assert errors.rgb_product.mean > 0.1


def test_products_with_white_alone_are_the_single_surfaces(general):
    for products in basis_report(general, LAMPS["spiky"], [WHITE]).products.values():
        assert max(products.fitted.max, products.componentwise.max) < 1e-6
    pairs = basis_report(general, LAMPS["spiky"], [SAMPLES[0], WHITE]).pairs
    assert product_rows(2, 2).tolist() == [[0, 0], [0, 1], [1, 1]]
    assert product_rows(2, 3).tolist() == [[0, 0, 0], [0, 0, 1], [0, 1, 1], [1, 1, 1]]
    for way in WAYS_OF_PRODUCTS:
        products, single = pairs.products[way], pairs.delta_e[way]
        # (red, white) is red, (red, red, white) is (red, red), (red, white, white) is red.
        assert products[2][:, 1] == pytest.approx(single[:, 0])
        assert products[3][:, 1] == pytest.approx(products[2][:, 0])
        assert products[3][:, 2] == pytest.approx(single[:, 0])
        assert np.abs(products[2][:, 0] - single[:, 0]).min() > 0.01, "two reds are not one"


def test_products_are_all_of_them_or_the_same_sample():
    assert len(product_rows(84, 2)) == 84 * 85 / 2
    assert len(product_rows(5, 3)) == 35
    drawn = product_rows(84, 3)
    assert np.array_equal(drawn, product_rows(84, 3)) and 1000 < len(drawn) < 10000
    assert (np.diff(drawn, axis=1) >= 0).all() and drawn.max() == 83


@pytest.mark.not_quick
def test_interreflection_costs_less_than_in_rgb(general):
    errors = general.report()
    for n in (2, 3):
        theirs = errors.products[n].rgb_product
        for ours in (errors.products[n].fitted, errors.products[n].componentwise):
            # Measured .09 against 2.2 for two surfaces, .12 against 2.3 for three.
            assert ours.mean < 0.1 * theirs.mean and ours.max < theirs.max


def test_the_worst_pair_is_the_maximum_of_all_classes(table):
    assert table.worst.delta_e == max(r.fitted.max for r in table.classes.values())
    assert table.worst.light in {"FL2", "HP1"} and table.worst_class == "spiky"
    assert table.worst.reflectance.startswith("ColorChecker/")
    pairs = table.classes["spiky"].pairs
    j, i = pairs.lights.index(table.worst.light), pairs.reflectances.index(table.worst.reflectance)
    assert pytest.approx(pairs.XYZ[j, i]) == table.worst.XYZ


def test_the_worst_pair_is_shown_both_ways(table, general):
    worst = table.worst
    lamp, S = light(worst.light), reflectance(worst.reflectance)
    assert pytest.approx(XYZ_from_spectra(lamp, S)) == worst.XYZ
    assert pytest.approx(general.xyz(general.analyse(S), lamp)) == worst.XYZ_shown
    for XYZ, code in ((worst.XYZ, worst.sRGB), (worst.XYZ_shown, worst.sRGB_shown)):
        assert "#" + bytes(sRGB_codes(np.array(XYZ), white_XYZ(lamp))).hex() == code
    assert worst.sRGB != worst.sRGB_shown


@pytest.mark.parametrize("way", ["exact", "linear-model"])
def test_a_pair_is_shown_another_way(table, general, way):
    pairs = table.classes["spiky"].pairs
    pair = WorstPair.at(pairs, 1, 2, way)
    assert (pair.light, pair.reflectance) == (pairs.lights[1], pairs.reflectances[2])
    matrix = general.colour_matrix(light("HP1"), way)
    assert pytest.approx(general.analyse(SAMPLES[2]) @ matrix.T) == pair.XYZ_shown
    assert pair.delta_e == pairs.delta_e[way][1, 2]


def test_a_report_is_a_text_and_a_dict(general):
    report = general.report(LAMPS["spiky"], SAMPLES)
    data = report.to_dict()
    assert report.worst.delta_e == report.fitted.max == data["worst"]["delta_e"]
    assert data["componentwise"]["mean"] == report.componentwise.mean
    assert "general-7" in str(report) and report.worst.light in str(report)


def test_a_summary_by_hand():
    # The 95th percentile lies at place .95 x 3 = 2.85 of 0, 0, 0, 10.
    found = ErrorSummary.of([[0, 0], [0, 10]])
    assert asdict(found) == pytest.approx({"mean": 2.5, "median": 0.0, "p95": 8.5, "max": 10.0})


def test_the_rgb_product_is_pooled_over_classes(table):
    means = [r.rgb_product.mean for r in table.classes.values()]
    assert table.rgb_product.mean == pytest.approx(np.mean(means))
    assert table.rgb_product.max == max(r.rgb_product.max for r in table.classes.values())


FOUR = {"mean", "median", "p95", "max"}
KEYS = "method size trained_on classes rgb_product worst name fingerprint observer_deg grid_nm"
WORST_KEYS = "light reflectance delta_e XYZ XYZ_shown sRGB adaptation"


def test_json_has_the_keys_that_scripts_rely_on(table):
    data = json.loads(json.dumps(table.to_dict()))
    assert set(data) >= set(KEYS.split())
    assert data["grid_nm"] == [380.0, 780.0, 5.0]
    for name in ("smooth", "spiky"):
        row = data["classes"][name]
        assert set(row) >= FOUR and row["lights"] == 2 and row["reflectances"] == 4
        assert all(set(row[way]) == FOUR for way in ("exact", "linear_model", "rgb_product"))
        assert set(row["products"]) == {"2", "3"} and set(row["products"]["2"]) > FOUR
        assert set(data["rgb_product"][name]) == FOUR
    assert set(data["worst"]) >= set(WORST_KEYS.split()) and data["worst"]["sRGB"].startswith("#")


def test_materials_have_no_error_and_no_products(materials):
    errors = basis_report(materials, LAMPS["spiky"])
    assert errors.pairs.reflectances == ("rotor", "case")
    assert max(errors.errors[mode].max for mode in MODES) < 1e-9
    assert errors.rgb_product.max > 0.1 and errors.products == {}
    # Found again by their spectra, as the demo asks.
    asked = basis_report(materials, LAMPS["spiky"], [reflectance("iron")])
    assert asked.pairs.reflectances == ("iron",) and asked.exact.max < 1e-9


def test_white_is_shown_as_the_display_s_white_under_any_light():
    for name in ("D65", "A", "planck:2000", "HP1", "LPS", "FL2"):
        white = white_XYZ(light(name))
        assert sRGB_codes(white, white).min() >= 254, name


def test_worst_pairs_are_of_different_lights_and_samples(table):
    pairs = worst_pairs(table.classes["spiky"], 9)
    assert len(pairs) == 2 and {p.light for p in pairs} == {"FL2", "HP1"}
    assert len({p.reflectance for p in pairs}) == 2
    assert pairs[0].delta_e == table.classes["spiky"].worst.delta_e


def test_numbers_keep_three_figures():
    shown = [format_delta_e(v) for v in (1e-12, 2e-4, 0.0214, 0.9999, 3.049, 45.23, 140.4)]
    assert shown == ["0", "< .001", "0.021", "1.000", "3.05", "45.2", "140"]


def test_the_terminal_table_fits_80_columns(table):
    from rich.console import Console

    console = Console(width=80, record=True, file=io.StringIO())
    console.print(report_table.terminal_table(table))
    console.print(report_table.worst_line(table, colours=True))
    shown = console.export_text()
    assert max(map(len, shown.splitlines())) <= 80 and "…" not in shown
    assert shown.count("two surfaces") == shown.count("three surfaces") == len(table.classes)
    for each in table.classes.values():
        times = f" {each.rgb_product.mean / each.fitted.mean:.0f} times"
        assert times in report_table.verdict(table)


def test_names_are_pushed_apart_and_keep_their_order():
    places = spread_apart(np.array([0.5, 0.5, 0.52, 0.99, 0.98]), 0.1, 0.0, 1.0)
    assert np.diff(np.sort(places)).min() >= 0.1 - 1e-9
    assert places.min() >= 0 and places.max() <= 1
    assert np.argsort(places, kind="stable").tolist() == [0, 1, 2, 4, 3]
    assert spread_apart(np.zeros(0), 0.1, 0.0, 1.0).size == 0


@pytest.mark.parametrize("suffix", [".svg", slow(".pdf")])
def test_figures_are_what_they_say(materials, tmp_path, suffix):
    path = tmp_path / f"figure{suffix}"
    save_figure(error_table(materials, LAMPS), path)
    assert path.read_bytes()[:5].startswith({".pdf": b"%PDF", ".svg": b"<?xml"}[suffix])
    assert [p.name for p in tmp_path.iterdir()] == [path.name]


def test_texts_of_the_figure_do_not_overlap(table, general):
    drawn = basis_figure(table)
    drawn.canvas.draw()
    boxes = [
        (text.get_text(), text.get_window_extent())
        for holder in (drawn, *drawn.axes)
        for text in holder.texts
        if text.get_text() and not text.get_rotation()
    ]
    for i, (one, box) in enumerate(boxes):
        assert box.x0 >= 0 and box.x1 <= 1600, one
        for other, second in boxes[:i]:
            assert not box.shrunk(0.95, 0.6).overlaps(second.shrunk(0.95, 0.6)), (one, other)


@pytest.mark.not_quick
def test_matplotlib_is_imported_late_and_pyplot_never():
    """Figures have a canvas of their own; pyplot has global state and may open windows."""
    modules = "volspec.basis.figure, volspec.relight.difference_maps"
    code = f"import sys, {modules}; sys.exit('matplotlib' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0
    texts = {path: path.read_text(encoding="utf-8") for path in PACKAGE.rglob("*.py")}
    drawing = {path for path, text in texts.items() if "matplotlib" in text}
    assert len(drawing) >= 4
    assert [path for path in drawing if "pyplot" in texts[path]] == []
