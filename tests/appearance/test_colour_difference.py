"""Differences of colours, rendition by lights and metamerism against published data."""

from typing import Any

import colour
import numpy as np
import pytest

from tests.appearance._models import CONDITIONS, D65, colours
from volspec.appearance.comparison.difference import (
    XYZ_from_cam16_ucs,
    cam16_ucs,
    delta_E_CAM16,
    distance,
    uniform,
)
from volspec.appearance.comparison.rendition import (
    RENDITION_GRID,
    SIMILARITY_GRID,
    Rendition,
    colour_rendition,
    metamerism,
    similarity_reference,
    spectral_similarity,
)
from volspec.appearance.models.lab import cielab, delta_E_2000
from volspec.basis.light_figure import light_figure, save_light_figure
from volspec.spectra import Spectrum, colour_matching_functions, light, reflectance
from volspec.spectra.datasets import colour_science

# Sharma, Wu & Dalal (2005), table 1: pairs about the mean hue's turn (1-16), large differences
# (17-20) and small ones (25, 31, 34).
PUBLISHED = [
    ((50.0, 2.6772, -79.7751), (50.0, 0.0, -82.7485), 2.0425),
    ((50.0, 3.1571, -77.2803), (50.0, 0.0, -82.7485), 2.8615),
    ((50.0, 2.8361, -74.0200), (50.0, 0.0, -82.7485), 3.4412),
    ((50.0, -1.3802, -84.2814), (50.0, 0.0, -82.7485), 1.0000),
    ((50.0, 0.0, 0.0), (50.0, -1.0, 2.0), 2.3669),
    ((50.0, 2.49, -0.001), (50.0, -2.49, 0.0009), 7.1792),
    ((50.0, 2.49, -0.001), (50.0, -2.49, 0.0011), 7.2195),
    ((50.0, -0.001, 2.49), (50.0, 0.0009, -2.49), 4.8045),
    ((50.0, -0.001, 2.49), (50.0, 0.0011, -2.49), 4.7461),
    ((50.0, 2.5, 0.0), (50.0, 0.0, -2.5), 4.3065),
    ((50.0, 2.5, 0.0), (73.0, 25.0, -18.0), 27.1492),
    ((50.0, 2.5, 0.0), (61.0, -5.0, 29.0), 22.8977),
    ((60.2574, -34.0099, 36.2677), (60.4626, -34.1751, 39.4387), 1.2644),
    ((22.7233, 20.0904, -46.6940), (23.0331, 14.9730, -42.5619), 2.0373),
    ((2.0776, 0.0795, -1.1350), (0.9033, -0.0636, -0.5514), 0.9082),
]


@pytest.mark.parametrize(("one", "other", "difference"), PUBLISHED)
def test_published_pairs_differ_as_published(one, other, difference):
    both = delta_E_2000([one, other], [other, one])
    assert both == pytest.approx([difference] * 2, abs=5e-5), "four decimals"


def test_differences_are_those_of_colour_science():
    rng = np.random.default_rng(3)
    one = rng.uniform([0, -120, -120], [100, 120, 120], (20_000, 3))
    grey = one * [1, 0, 0]
    for other in (one + rng.normal(0, 8, one.shape), one[::-1], grey, one * [1, -1, -1], one):
        theirs = colour.delta_E(one, other, method="CIE 2000")
        # Sums in another order; measured 2e-13.
        np.testing.assert_allclose(delta_E_2000(one, other), theirs, rtol=1e-12, atol=1e-12)


@pytest.mark.parametrize("where", ["office under D65", "room under A", "television", "cinema"])
def test_cam16_ucs_is_that_of_colour_science(where):
    conditions = CONDITIONS[where]
    XYZ = colours(conditions.white_XYZ, 500)[:-1]
    theirs = colour.XYZ_to_CAM16UCS(
        XYZ / 100.0,
        XYZ_w=np.array(conditions.white_XYZ) / 100.0,
        L_A=conditions.L_A,
        Y_b=conditions.Y_b,
        surround=colour.appearance.InductionFactors_CAM16(*conditions.factors),
        discount_illuminant=conditions.discount,
    )
    ours = cam16_ucs(XYZ, conditions)
    np.testing.assert_allclose(ours, theirs, atol=1e-9)
    np.testing.assert_allclose(XYZ_from_cam16_ucs(ours, conditions), XYZ, rtol=1e-9, atol=1e-9)
    apart = colour.delta_E(ours[1:], ours[:-1], method="CAM16-UCS")
    np.testing.assert_allclose(delta_E_CAM16(ours[1:], ours[:-1]), apart, rtol=1e-12)


def test_differences_by_name():
    one, other = colours(D65, 50)[:40], colours(D65, 50)[10:50]
    by_name = {
        name: distance(name, *(uniform(name, XYZ, D65) for XYZ in (one, other)))
        for name in ("CIEDE2000", "CAM16-UCS")
    }
    Lab = [cielab(XYZ, D65) for XYZ in (one, other)]
    np.testing.assert_array_equal(by_name["CIEDE2000"], delta_E_2000(*Lab))
    assert np.corrcoef(*by_name.values())[0, 1] > 0.9
    # The eye is adapted to the white: black and white are 100 apart, and no grey has a colour.
    black, white = uniform("CAM16-UCS", [[0.0, 0.0, 0.0], D65], D65)
    assert distance("CAM16-UCS", black, white) == pytest.approx(100.0, abs=1e-9)


# R_a that CIE 15 gives with FL1 to FL12.
PUBLISHED_R_A = {
    f"FL{number}": R_a
    for number, R_a in enumerate([76, 64, 57, 51, 72, 59, 90, 95, 90, 81, 83, 83], start=1)
}
LEDS = [f"LED-{kind}" for kind in ("B1", "B2", "B3", "B4", "B5", "BH1", "RGB1", "V1", "V2")]


def rendition(name: str) -> Rendition:
    found = colour_rendition(light(name, RENDITION_GRID))
    assert found is not None
    return found


def similarity(one: str, other: str) -> float:
    return spectral_similarity(*(light(name, SIMILARITY_GRID) for name in (one, other)))


@pytest.mark.parametrize(("name", "R_a"), PUBLISHED_R_A.items())
def test_fluorescent_lamps_have_the_published_R_a(name, R_a):
    assert rendition(name).R_a == pytest.approx(R_a, abs=0.55)


def test_references_are_rendered_perfectly():
    for name in ("planck:2700", "planck:3999", "daylight:5010", "D65", "A"):
        found = rendition(name)
        assert (found.R_a, found.R_f, found.R_g) == pytest.approx((100, 100, 100), abs=0.05)
        assert np.abs(found.chroma_shift).max() < 1e-3
    # Between 4000 and 5000 K the reference of CIE 224 is a mixture, that of CIE 13.3 is not.
    assert rendition("planck:4500").R_a == pytest.approx(100, abs=0.05)
    assert rendition("planck:4500").R_f < 99.5


@pytest.mark.not_quick
@pytest.mark.filterwarnings("ignore:Aligning")
def test_figures_are_those_of_colour_science():
    """Its R_i interpolate to 1 nm first; samples at a hue bin's border move the bins a little."""
    colour: Any = colour_science()
    for name in (*list(PUBLISHED_R_A)[1::3], *LEDS[::2]):
        own = rendition(name)
        theirs = colour.SDS_ILLUMINANTS[name].copy().align(colour.SpectralShape(380, 780, 5))
        cri = colour.colour_rendering_index(theirs, additional_data=True)
        method = {"additional_data": True, "method": "ANSI/IES TM-30-18"}
        tm30 = colour.colour_fidelity_index(theirs, **method)
        np.testing.assert_allclose(own.R, [cri.Q_as[i].Q_a for i in range(1, 15)], atol=1)
        assert own.R_a == pytest.approx(cri.Q_a, abs=0.3)
        assert own.fidelity == pytest.approx(tm30.R_s, abs=0.2)
        assert own.R_f == pytest.approx(tm30.R_f, abs=0.03)
        assert own.R_g == pytest.approx(tm30.R_g, abs=0.2)
        assert 100 * own.chroma_shift == pytest.approx(tm30.R_cs, abs=1.5)
        assert own.hue_shift == pytest.approx(tm30.R_hs, abs=0.01)
        assert own.hue_fidelity == pytest.approx(tm30.R_fs, abs=2)


def test_fl2_has_tm_30_s_hue_bins():
    """Rounded figures that colour-science's tests list."""
    found = rendition("FL2")
    assert (round(found.R_f), round(found.R_g)) == (70, 86)
    cs = [-25, -18, -9, 5, 11, 4, -8, -15, -17, -15, -4, 5, 11, 7, -6, -16]
    assert 100 * found.chroma_shift == pytest.approx(cs, abs=0.75)
    fidelity = [60, 61, 53, 68, 80, 88, 77, 73, 76, 62, 70, 77, 81, 71, 64, 65]
    assert found.hue_fidelity == pytest.approx(fidelity, abs=0.75)


def test_saturated_lights_have_no_reference():
    assert colour_rendition(light("led:450", RENDITION_GRID)) is None
    assert rendition("FL1").is_white is False and rendition("FL2").is_white is True


def test_similarity_is_that_of_colour_science():
    assert round(similarity("C", "D65")) == 94
    assert similarity("D65", "D65") == pytest.approx(100)
    colour: Any = colour_science()
    from colour.quality.tests.test_ssi import DATA_HMI

    lamp = Spectrum(*map(list, zip(*DATA_HMI.items(), strict=True)))
    daylight = light("D50", SIMILARITY_GRID)
    assert round(spectral_similarity(lamp, daylight)) == 72  # a metal-halide lamp, another one
    for name in ("C", "LED-B3", "FL2", "HP1", "A"):
        theirs = colour.spectral_similarity_index(
            colour.SDS_ILLUMINANTS[name], colour.SDS_ILLUMINANTS["D65"], round_result=False
        )
        # Tables that begin at 380 nm continue here; there they are 0 from 375 to 380 nm.
        assert similarity(name, "D65") == pytest.approx(float(theirs), abs=0.2)
    assert similarity_reference(3999.4) == "planck:3999"
    assert similarity_reference(3999.5) == "daylight:4000"
    assert similarity_reference(26_000) is None


def test_metamerism_grows_with_the_difference_and_is_0_for_the_same_paint():
    D65, A = (light(name, RENDITION_GRID) for name in ("D65", "A"))
    red = reflectance("ColorChecker/red", RENDITION_GRID)
    same = metamerism(red, red, D65, A)
    assert (same.delta_E, same.general, same.illuminant) == (0, 0, 0)
    assert set(same.observers) == {10, "CIE 2015 2", "CIE 2015 10"}
    # A metameric black in front of a grey: nothing under D65, visible elsewhere.
    Q = (colour_matching_functions(RENDITION_GRID) * D65.values).T
    wave = np.cos(RENDITION_GRID.wavelengths_nm / 25.0)
    black = wave - Q @ np.linalg.lstsq(Q, wave, rcond=None)[0]
    small, large = (metamerism(_grey(0 * black), _grey(k * black), D65, A) for k in (0.05, 0.2))
    assert small.delta_E == pytest.approx(0, abs=1e-6) == large.delta_E
    assert large.general == pytest.approx(4 * small.general) and small.general > 0
    assert large.illuminant > 2 * small.illuminant > 0.1
    assert all(large.observers[key] > small.observers[key] > 0.01 for key in small.observers)


def test_metamerism_counts_what_fluorescent_materials_emit():
    D65, A = (light(name, RENDITION_GRID) for name in ("D65", "A"))
    glowing = reflectance("fluorophore:EGFP*0.5+grey:0.2*0.5", RENDITION_GRID)
    white = reflectance("white", RENDITION_GRID)
    found = metamerism(glowing, white, A, D65)
    Q = colour_matching_functions(RENDITION_GRID)
    leaving = glowing.values * A.values + glowing.fluorescence.on(RENDITION_GRID).emitted(A.values)
    both, lamp = (Q @ (each * A.values) for each in (white.values, 1.0))
    Lab = (cielab(XYZ * 100 / lamp[1], lamp * 100 / lamp[1]) for XYZ in (Q @ leaving, both))
    assert found.delta_E == pytest.approx(delta_E_2000(*Lab), rel=1e-9)
    assert found.illuminant > 10  # what is emitted under D65, too


def test_a_mismatch_under_the_reference_light_is_not_counted_again():
    D65, A = (light(name, RENDITION_GRID) for name in ("D65", "A"))
    found = metamerism(_grey(np.zeros(81)), _grey(np.full(81, 0.1)), D65, A)
    assert found.delta_E > 4 and found.illuminant == pytest.approx(0, abs=1e-6)
    assert max(found.observers.values()) == pytest.approx(0, abs=1e-6)


def _grey(more: np.ndarray) -> Spectrum:
    return Spectrum(RENDITION_GRID.wavelengths_nm, 0.5 + more)


@pytest.mark.not_quick
def test_the_figure_has_the_numbers_in_its_corners(tmp_path):
    own, found = light("FL4", RENDITION_GRID), rendition("FL4")
    figure = light_figure(own, light("A", RENDITION_GRID), found, "SSI 32")
    texts = {text.get_text() for axes in figure.axes for text in axes.texts}
    assert {"57", "83", "-0.0008", "2939 K", *map(str, range(1, 17))} <= texts
    save_light_figure(own, own, found, tmp_path / "f.svg")
    assert (tmp_path / "f.svg").read_text().startswith("<?xml")
