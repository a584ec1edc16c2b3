"""Named lights and reflectances, and the photometry they are scaled with."""

import colour
import numpy as np
import pytest

from volspec.spectra import (
    DEFAULT_GRID,
    SpectralGrid,
    XYZ_from_spectra,
    colour_matching_functions,
    illuminance_lux,
    light,
    light_names,
    light_set,
    reflectance,
    reflectance_names,
    reflectance_set,
    white_XYZ,
)
from volspec.spectra.library.catalogue import EVERYDAY, describe_light, library_names, search_lights
from volspec.spectra.library.reflectances import reflectance_set_names

FINE = SpectralGrid(360, 830, 1)


def test_equal_energy_matching_functions_have_equal_areas():
    areas = colour_matching_functions(FINE).sum(1)
    # The CIE's tables agree to a third of a thousandth.
    assert areas == pytest.approx(areas[1], rel=5e-4)
    assert areas[1] == pytest.approx(106.857, abs=0.01)


@pytest.mark.parametrize(
    ("name", "XYZ"),
    [("D65", (95.047, 100, 108.883)), ("A", (109.850, 100, 35.585)), ("C", (98.074, 100, 118.232))],
)
def test_whites_agree_with_the_cie_at_1_nm(name, XYZ):
    # 5 nm source tables interpolated linearly against the CIE's own interpolation.
    assert white_XYZ(light(name, FINE)) == pytest.approx(XYZ, abs=0.07)


@pytest.mark.parametrize("grid", [DEFAULT_GRID, SpectralGrid(360, 830, 5), FINE])
def test_perfect_diffuser_has_Y_100_on_every_grid(grid):
    assert white_XYZ(light("FL2", grid))[1] == pytest.approx(100)
    grey = reflectance("grey:0.5", grid)
    lamp = light("A", grid)
    assert XYZ_from_spectra(lamp, grey) == pytest.approx(white_XYZ(lamp) / 2)


def test_ten_nanometre_bands_see_the_same_white_as_one_nanometre():
    # The tails outside 400-700 nm hold up to 0.8 % of Z (FL2).
    for name in ("D65", "A", "FL2", "HP1"):
        fine, coarse = white_XYZ(light(name, FINE)), white_XYZ(light(name))
        assert coarse == pytest.approx(fine, rel=0.01), name


def test_what_is_listed_loads_and_what_is_not_listed_does_not():
    known = {*colour.SDS_ILLUMINANTS, *colour.SDS_LIGHT_SOURCES}
    assert set(light_names()) < known and len(light_names()) == len(set(light_names())) == 114
    V = colour_matching_functions(DEFAULT_GRID)[1]
    for name in light_names():
        assert light(name).values.min() >= 0.0, name
        assert V @ light(name).values == pytest.approx(V.sum()), name
    assert light("E").values == pytest.approx(1.0)
    for name in reflectance_names():
        # Means over bands of 1 are 1 to rounding.
        values = reflectance(name).values
        assert 0 <= values.min() <= values.max() <= 1 + 1e-12, name
    # Its table ends at 560 nm.
    assert known - set(light_names()) == {"ISO 7589 Sensitometric Printer"}


@pytest.mark.parametrize(
    ("everyday", "name"),
    [
        ("tungsten", "A"),
        ("Daylight", "D65"),
        ("sodium", "HP1"),
        ("street light", "HP1"),
        ("office", "FL2"),
        ("candle", "lamp:candle-1900"),
        ("incandescent", "Incandescent"),  # the library's own names come first
    ],
)
def test_everyday_names_are_lights_of_the_library(everyday, name):
    assert light(everyday).name == name
    assert np.array_equal(light(everyday).values, light(name).values)
    assert light(f"{everyday}*0.25+E*0.75").name == f"{name}*0.25+E*0.75"
    assert light("daylight:6500").name == "daylight:6500"


def test_everyday_names_find_their_light_first():
    for word, name in EVERYDAY.items():
        assert search_lights(word)[0] == name and name in library_names()


def test_lights_are_found_by_the_words_of_their_descriptions():
    assert {"HP1", "HP2", "HPS", "LPS"} < {*search_lights("sodium lamp")}
    assert search_lights("d65")[0] == "D65" and search_lights("nosuch") == ()
    assert all("fl" in name.casefold() for name in search_lights("fl"))
    assert search_lights("") == library_names()
    assert "measured lamp" not in {describe_light(name) for name in library_names()}


def test_names_with_operators_work_alone_and_in_mixes():
    odd = "F32T8/TL865/PLUS (Triphosphor)"
    assert light(odd.lower()).name == odd
    assert light("4-LED-1 (461/526/576/624)").name == "4-LED-1 (461/526/576/624)"
    mix = light(f"{odd}*0.25 + D65*0.75")
    assert mix.values == pytest.approx(0.25 * light(odd).values + 0.75 * light("d65").values)


def test_weights_are_shares_of_illuminance():
    mix = light("D65*0.7+A*0.3")
    assert mix.values == pytest.approx(0.7 * light("D65").values + 0.3 * light("A").values)
    assert illuminance_lux(mix) == pytest.approx(illuminance_lux(light("D65")))
    assert light("0.3*A+0.7*D65").values == pytest.approx(mix.values)
    assert light("D65+A").values == pytest.approx(light("D65").values + light("A").values)


def test_planck_2856_is_illuminant_A_and_daylight_6504_is_D65():
    one, other = (white_XYZ(light(name, FINE)) for name in ("planck:2856", "A"))
    assert one == pytest.approx(other, abs=0.05)
    assert light("daylight:6504").values == pytest.approx(light("D65").values, abs=2e-3)


def test_extreme_planck_lights_stay_finite():
    for kelvin in (500, 100_000):
        values = light(f"planck:{kelvin}").values
        assert np.isfinite(values).all() and (values > 0).all()


def test_sets_have_the_sizes_of_method_section_2():
    assert (len(light_set("smooth")), len(light_set("spiky"))) == (26, 89)
    assert reflectance_set("training").shape == (128, DEFAULT_GRID.size)
    assert reflectance_set("test").shape == (84, DEFAULT_GRID.size)
    assert len(reflectance_set_names("test")) == 84
    assert reflectance_set("natural").shape == (170, DEFAULT_GRID.size)
    assert reflectance_set("patches").shape == (175, DEFAULT_GRID.size)


@pytest.mark.parametrize(
    "name", ["ColorChecker/dark skin", "CES/99", "TCS/15", "VS/1", "PMC/Banana", "gold"]
)
def test_reflectances_are_found_in_any_case(name):
    assert reflectance(name.swapcase()).name == name


def test_metals_reflect_as_published():
    # Fresnel values near 650 nm and 450 nm; McPeak 2015, Johnson & Christy 1974.
    published = {"silver": [0.99, 0.98], "aluminium": [0.91, 0.92], "gold": [0.97, 0.40]}
    published |= {"copper": [0.96, 0.58], "iron": [0.52, 0.50]}
    for name, red_and_blue in published.items():
        metal = reflectance(name)
        found = np.interp([650, 450], metal.wavelengths_nm, metal.values)
        assert found == pytest.approx(red_and_blue, abs=0.03), name
    assert {"steel", "brass"} <= set(reflectance_names())


def test_the_held_out_sets_repeat_nothing_of_the_others():
    """Nearest chromatic spectrum of training and test at least 1 degree away, or 0.005 RMS."""
    known = np.concatenate([reflectance_set("training"), reflectance_set("test")])
    for name in ("natural", "patches"):
        fresh = reflectance_set(name)
        cosine = (fresh @ known.T) / np.outer(*(np.linalg.norm(r, axis=1) for r in (fresh, known)))
        grey = [r.std(axis=1) <= 0.1 * r.mean(axis=1) for r in (fresh, known)]
        angle = np.degrees(np.arccos(np.clip(cosine, -1, 1)))
        assert angle[~np.outer(*grey)].min() > 1, name
