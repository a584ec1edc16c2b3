"""Colour errors in CIEDE2000: the figures of docs/method.md, section 2.

All errors are against full spectra, on reflectances no basis was trained on, with the light
as white. Limits are about a tenth above what was measured, since another BLAS stops the descent
elsewhere; the prototype's figures (METHOD) are given if they are worse.
"""

import numpy as np
import pytest

from tests.support.fixtures import slow, slow_each
from volspec.basis import SpectralBasis
from volspec.basis.make import NAMES, fit_shipped
from volspec.spectra import (
    DEFAULT_GRID,
    PAPERS_GRID,
    Spectrum,
    light,
    light_set,
    reflectance,
    reflectance_set,
)

# Paper 001 figure 2, the spectra printed without damage (errata of the papers' list).
_SPLIT1 = """.6678 1.102 1.107 .6561 .1297 .043 .4404 .8899 .9883 .7145 .273 0 .2365 1.07 1.065
    .7561 .292 .0444 .1839 .858 1.136 .8329 .288 .05081 .2354 .5776 .8495 .959 .8936 .6613 .3666"""
_SPLIT2 = """.5569 .9856 1.172 1.064 .7426 .3406 .03923 0 .2016 .6381 1.012 1.013 .8544 .8999
    .3158 0 .01159 .3446 .6981 1.119 1.049 .8205 .5588 .2338 0 .07294 .4685 .8727 1.039 .9004
    .5156"""
_REFL1 = """0 0 0 0 0 .1908 .337 .08154 0 0 0 0 0 0 0 .1881 .5014 .1729 0 0 .005627 .1097 0 0 0
    .09737 .524 .8975 1 .8346 .4686"""
_REFL2 = """0 .006213 .03533 .0938 .155 .1646 .1112 .04728 .0334 .0771 .1367 .1579 .1164 .04379
    .005049 .03718 .1136 .1759 .1892 .1624 .1227 .08678 .05953 .04195 .03305 .02917 .02617
    .02203 .01681 .01118 .005552"""
_REFL4 = """.158 .2753 .3143 .2531 .1204 .01347 .01666 .09516 .1335 .08491 .02991 .09995 .2566
    .2573 .07249 0 0 0 .141 .1585 .00007 .001365 .2275 .3689 .2555 .0623 0 0 .02455 .04152
    .03306"""


def _spectrum(numbers: str, name: str) -> Spectrum:
    return Spectrum(PAPERS_GRID.wavelengths_nm, np.array([float(x) for x in numbers.split()]), name)


PALETTE_LIGHTS = [_spectrum(_SPLIT1, "split1"), _spectrum(_SPLIT2, "split2"), light("D65")]
PALETTE_REFLECTANCES = [
    _spectrum(n, name) for n, name in ((_REFL1, "refl1"), (_REFL2, "refl2"), (_REFL4, "refl4"))
]


@pytest.mark.parametrize(
    ("name", "mean", "maximum"),
    # METHOD, mean and max: .13, 1.1; .07, .45; .04, .30; positive .44, 1.9; .32, 1.7; .15, .84.
    [
        slow("smooth-5", 0.056, 0.63),
        ("smooth-7", 0.011, 0.10),
        slow("smooth-9", 0.009, 0.12),
        slow("smooth-5-positive", 0.34, 2.6),
        slow("smooth-7-positive", 0.13, 0.70),
        slow("smooth-9-positive", 0.035, 0.22),
        slow("general-5", 0.095, 0.80),
        ("general-7", 0.025, 0.20),
        slow("general-9", 0.010, 0.16),
        slow("general-5-positive", 0.39, 3.1),
        ("general-7-positive", 0.11, 0.72),
        slow("general-9-positive", 0.062, 0.40),
    ],
)
def test_shipped_sensors_under_smooth_lights(name, mean, maximum):
    report = SpectralBasis.load(f"{name}-10nm").report()
    print(name, report.componentwise)
    assert report.componentwise.mean <= mean and report.componentwise.max <= maximum


@pytest.mark.parametrize(
    ("name", "means"),
    [
        # METHOD: 1.11, .43, .16.
        slow("general-5", {"componentwise": 1.05}),
        ("general-7", {"componentwise": 0.36}),
        slow("general-9", {"componentwise": 0.158}),
        # METHOD: .49, .20, .07. The componentwise picture is what such channels allow.
        slow("exact-5", {"exact": 0.489, "componentwise": 2.3}),
        ("exact-7", {"exact": 0.18, "componentwise": 1.1}),
        slow("exact-9", {"exact": 0.0699, "componentwise": 0.45}),
    ],
)
def test_shipped_bases_under_spiky_lights(name, means):
    report = SpectralBasis.load(f"{name}-10nm").report(light_set("spiky", PAPERS_GRID))
    for way, mean in means.items():
        assert getattr(report, way).mean <= mean, way


def test_rgb_product_is_as_far_off_as_in_the_method():
    # METHOD: .95 / .62 / 3.1 / 9.1.
    report = SpectralBasis.load("general-7-10nm").report()
    assert report.rgb_product.mean == pytest.approx(0.95, abs=0.01)
    assert report.rgb_product.max == pytest.approx(9.1, abs=0.15)


def test_mixed_lights_are_no_worse_than_their_components(general):
    mixes = [light("D65*0.7+A*0.3"), light("planck:2000*0.5+daylight:10000*0.5")]
    assert general.report(mixes).componentwise.max <= 0.2


@pytest.mark.parametrize("name", ["general-7", "general-7-positive", "smooth-5-positive"])
def test_measured_reflectances_have_coefficients_in_0_to_1(name):
    # 8-bit textures need this; the signed sensors of general-7 happen to give it too.
    basis = SpectralBasis.load(name)
    c = basis.analyse(np.concatenate([reflectance_set("training"), reflectance_set("test")]))
    assert c.min() >= 0 and c.max() <= 1


@pytest.mark.parametrize("name", [n for n in NAMES if n.endswith("-positive")])
def test_positive_sensors_are_positive(name):
    assert SpectralBasis.load(name).analysis.min() >= 0


@pytest.mark.not_quick
@pytest.mark.parametrize("name", ["general-7", *slow_each("exact-5", "smooth-5-positive")])
def test_shipped_basis_is_what_the_command_fits(name):
    shipped, again = SpectralBasis.load(name), fit_shipped(name)
    # Another BLAS rounds differently and the descent stops elsewhere in a flat valley; what
    # counts, the colour, does not follow.
    assert again.analysis == pytest.approx(shipped.analysis, abs=1e-2)
    assert again.trained_on == shipped.trained_on


def test_all_that_the_command_makes_ships():
    assert [SpectralBasis.load(n).name for n in NAMES] == list(NAMES)


@pytest.mark.parametrize(
    ("size", "mean", "maximum"), [(5, 2.2, 36.0), (7, 0.27, 4.8), (9, 0.10, 1.2)]
)
def test_sharpened_pca_reaches_the_papers_model(size, mean, maximum):
    # Measured 2.19 (max 35.8), .253 and .093; METHOD: 2.2 (33), .27 (4.8) and .07.
    lights, samples = light_set("smooth", PAPERS_GRID), reflectance_set("training", PAPERS_GRID)
    options = {"method": "pca-sharpened", "grid": PAPERS_GRID}
    report = SpectralBasis.fit(lights, samples, size=size, **options).report()
    assert report.componentwise.mean <= mean and report.componentwise.max <= maximum


def test_designed_palette_trains_for_itself(general):
    basis = SpectralBasis.fit(PALETTE_LIGHTS, PALETTE_REFLECTANCES, size=7, grid=PAPERS_GRID)
    # Measured .000 in .3 s; METHOD has .014 in 3 s. The general basis is far off here.
    assert basis.report(PALETTE_LIGHTS, PALETTE_REFLECTANCES).componentwise.mean <= 0.002
    assert general.report(PALETTE_LIGHTS, PALETTE_REFLECTANCES).componentwise.mean > 5


W = DEFAULT_GRID.wavelengths_nm
LINES = [Spectrum(W, np.where(nm == W, 1.0, 0.0), f"line {nm}") for nm in (450, 550, 680)]


@pytest.mark.not_quick
@pytest.mark.parametrize(
    ("lights", "reflectances", "size", "maximum"),
    [
        # METHOD: .85 in the mean. Nine colours under three lights, and one of several minima.
        (PALETTE_LIGHTS, PALETTE_REFLECTANCES, 5, 0.1),
        # Lights of one line each.
        slow(LINES, reflectance_set("test")[:6], 7, 1.0),
        slow([light("A")], [reflectance("PMC/Carrot")], 7, 0.01),
    ],
)
def test_few_spectra_of_a_scene_are_held(lights, reflectances, size, maximum):
    basis = SpectralBasis.fit(lights, reflectances, size=size, grid=lights[0].grid)
    assert basis.report(lights, reflectances).componentwise.max <= maximum
