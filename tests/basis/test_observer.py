"""Standard observers: 2 and 10 degrees, and those of cone fundamentals."""

import dataclasses
import json
from typing import get_args

import numpy as np
import pytest

from volspec.basis import MaterialBasis, SpectralBasis
from volspec.basis.display import MODES
from volspec.basis.report import basis_report
from volspec.cli import arguments
from volspec.relight import Illumination, RelightSpec
from volspec.spectra import (
    SpectralGrid,
    XYZ_from_spectra,
    colour_matching_functions,
    illuminance_lux,
    light,
    light_set,
    reflectance,
    reflectance_set,
    white_XYZ,
)
from volspec.spectra.datasets import Observer

SMOOTH, TRAINING = light_set("smooth"), reflectance_set("training")
LAMPS = [light("A"), light("FL2")]
PAINTS = {name: reflectance(f"ColorChecker/{name}") for name in ("red", "cyan")}


@pytest.fixture
def paints() -> MaterialBasis:
    """Exact for the 10 degree observer: whatever is off is seen by the other."""
    return MaterialBasis(PAINTS, observer_deg=10)


def test_whites_are_those_of_the_standard():
    # CIE 15:2004, tables T.3: white points of D65 and A for either observer.
    grid = SpectralGrid(360, 830, 1)
    for name, observer, white in (
        ("D65", 2, (95.04, 100, 108.88)),
        ("D65", 10, (94.81, 100, 107.32)),
        ("A", 2, (109.85, 100, 35.58)),
        ("A", 10, (111.14, 100, 35.20)),
    ):
        # Printed to two decimals, summed every 5 nm and partly cut off instead of rounded.
        assert white_XYZ(light(name, grid), observer) == pytest.approx(white, abs=0.02)


CONES = ("CIE 2015 2", "CIE 2015 10")


@pytest.mark.parametrize("observer", CONES)
def test_cone_fundamentals_see_equal_energy_as_white_from_390_nm(observer):
    Q = colour_matching_functions(SpectralGrid(360, 830, 1), observer)
    assert (Q[:, :30] == 0).all() and (Q[:, 30] > 0).all()
    # CIE 170-2:2015 scales x and z so that their sums equal that of y.
    assert Q.sum(1) / Q[1].sum() == pytest.approx([1, 1, 1], abs=2e-4)
    grid = SpectralGrid(380, 780, 5)
    own, older = (white_XYZ(light("D65", grid), each) for each in (observer, int(observer[9:])))
    assert own == pytest.approx(older, abs=1.5) and np.abs(own - older).max() > 0.1


def test_the_command_line_offers_the_observers_that_spectra_have():
    assert get_args(arguments.Observer) == get_args(Observer)


def test_lux_stay_with_the_2_degree_observer():
    lamp = light("A")
    V = colour_matching_functions(lamp.grid)[1]
    assert illuminance_lux(lamp) == pytest.approx(683 * lamp.grid.step_nm * V @ lamp.values)
    assert colour_matching_functions(lamp.grid, 10)[1] @ lamp.values > 1.05 * V @ lamp.values


@pytest.mark.not_quick
@pytest.mark.parametrize(
    ("method", "mean"),
    # Measured .006, .09 and .008 XYZ of white's 100 under D65; the observers differ by .7.
    [("virtual-sensors", 0.01), ("pca-sharpened", 0.12), ("reduced-rank", 0.012)],
)
def test_a_basis_for_10_degrees_shows_the_10_degree_colours(method, mean):
    basis = SpectralBasis.fit(SMOOTH, TRAINING[::2], method=method, observer_deg=10)
    c = basis.analyse(TRAINING)
    for name in ("D65", "A"):
        lamp = light(name)
        off = basis.xyz(c, lamp) - XYZ_from_spectra(lamp, TRAINING, 10)
        print(method, name, np.abs(off).mean())
        assert np.abs(off).mean() <= mean
        for mode in MODES:
            shown = basis.colour_matrix(lamp, mode) @ basis.white
            assert shown == pytest.approx(white_XYZ(lamp, 10), abs=1e-6)


@pytest.mark.parametrize("observer", [10, "CIE 2015 10"])
def test_observer_is_stored_and_part_of_the_fingerprint(observer):
    basis = SpectralBasis.fit(SMOOTH[:3], TRAINING[::9], method="pca", observer_deg=observer)
    back = SpectralBasis.from_dict(json.loads(json.dumps(basis.to_dict())))
    assert back.observer_deg == observer
    assert back.fingerprint == basis.fingerprint
    assert dataclasses.replace(basis, observer_deg=2).fingerprint != basis.fingerprint


def test_files_without_the_field_are_for_2_degrees():
    data = SpectralBasis.load("general-7").to_dict()
    del data["observer_deg"]
    assert SpectralBasis.from_dict(data).fingerprint == SpectralBasis.load("general-7").fingerprint


@pytest.mark.parametrize("lamp", LAMPS, ids=lambda lamp: lamp.name)
def test_pictures_have_the_white_of_their_observer(paints, lamp):
    card = reflectance("ColorChecker/green")
    white = XYZ_from_spectra(lamp, np.ones(lamp.values.size), 10)
    # The observers differ by far more than the rounding that is allowed below.
    assert np.abs(white - white_XYZ(lamp)).max() > 0.5
    assert np.abs(XYZ_from_spectra(lamp, card, 10) - XYZ_from_spectra(lamp, card)).max() > 0.2
    plain = Illumination.of(paints, lamp, RelightSpec(backdrop=0.3))
    coloured = Illumination.of(paints, lamp, RelightSpec(backdrop=card))
    for lit in (plain, coloured):
        assert lit.white_XYZ == pytest.approx(white)
        assert lit.XYZ_from_channels @ paints.white == pytest.approx(white)
    assert plain.backdrop_XYZ == pytest.approx(0.3 * white)
    assert coloured.backdrop_XYZ == pytest.approx(XYZ_from_spectra(lamp, card, 10))


def test_reports_compare_the_colours_of_the_basis_observer(paints):
    found = basis_report(paints, LAMPS)
    # Nothing is approximated, so that errors are rounding.
    assert max(getattr(found, way).max for way in ("componentwise", "exact")) < 1e-6
    for j, lamp in enumerate(LAMPS):
        assert found.pairs.white_XYZ[j] == pytest.approx(white_XYZ(lamp, 10))
        true = XYZ_from_spectra(lamp, list(PAINTS.values()), 10)
        assert found.pairs.XYZ[j] == pytest.approx(true)
    # Light times surface in RGB is wrong only if the light has a colour or lines: the flat one is
    # exact where surfaces, light and white are one observer's.
    assert basis_report(paints, [light("E")]).rgb_product.max < 1e-6
