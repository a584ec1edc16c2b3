"""Transfer functions: what a table holds, and what is refused."""

from __future__ import annotations

import numpy as np
import pytest

from volspec.basis import SpectralBasis
from volspec.errors import TransferError, VolspecWarning
from volspec.spectra import Spectrum, reflectance
from volspec.transfer import TransferFunction, TransferTable

BASIS = SpectralBasis.load("general-7")
MATERIALS = {"copper": reflectance("copper"), "steel": reflectance("steel")}


def function(*points: object, **settings: object) -> TransferFunction:
    return TransferFunction(points, MATERIALS, BASIS, **settings)  # type: ignore[arg-type]


def test_table_runs_linearly_between_points_and_stays_beyond() -> None:
    table = function((10, 0.0, "copper"), (30, 0.8, "steel")).bake(1.0, size=21)
    assert table.domain == (10, 30)
    assert np.allclose(table.opacity, np.linspace(0, 0.8, 21))
    copper, steel = (BASIS.analyze(MATERIALS[name]) for name in ("copper", "steel"))
    assert np.allclose(table.coefficients[[0, 10, 20]], [copper, (copper + steel) / 2, steel])


def test_mixes_are_weighted_sums_of_materials() -> None:
    table = function((0, 1.0, {"copper": 0.3, "steel": 0.5})).bake(1.0)
    mix = 0.3 * BASIS.analyze(MATERIALS["copper"]) + 0.5 * BASIS.analyze(MATERIALS["steel"])
    assert np.allclose(table.coefficients, mix)


def test_two_points_of_one_value_make_a_step() -> None:
    points = [(0, 0.0, "steel"), (5, 0.0, "steel"), (5, 1.0, "copper"), (10, 1.0, "copper")]
    table = function(*points).bake(1.0, size=1001)
    assert set(table.opacity.round(9)) == {0.0, 1.0}
    assert (table.opacity > 0).argmax() in (500, 501)


def test_a_step_at_an_end_holds_beyond_it() -> None:
    table = function((0, 0.0, "steel"), (60, 0.0, "steel"), (60, 1.0, "copper")).bake(1.0)
    assert table.opacity[-1] == 1 and table.opacity[-2] == 0
    assert np.allclose(table.coefficients[-1], BASIS.analyze(MATERIALS["copper"]))
    table = function((0, 0.3, "steel"), (0, 1.0, "steel"), (60, 1.0, "copper")).bake(1.0)
    assert table.opacity[0] == 0.3 and table.opacity[1] == 1


def test_narrow_peaks_are_not_missed() -> None:
    peak = [(0, 0, "steel"), (1000, 0, "steel"), (1010, 1, "steel"), (1020, 0, "steel")]
    table = function(*peak, (65535, 0, "steel")).bake(1.0)
    assert table.opacity.max() > 0.8 and len(table.opacity) <= 65536
    with pytest.warns(VolspecWarning, match=r"1010.*too close"):
        function(
            (0, 0, "steel"), (1010, 0, "steel"), (1010.01, 1, "steel"), (1e6, 0, "steel")
        ).bake(1)


def test_materials_must_be_reflectances() -> None:
    def one(material: object, basis: object = BASIS) -> TransferFunction:
        return TransferFunction([(0, 0.5, "m")], {"m": material}, basis)  # type: ignore[arg-type,dict-item]

    with pytest.raises(TransferError, match="'m' reflects -1 at 400 nm"):
        one(Spectrum([400, 700], [-1, 0.5]))
    with pytest.raises(TransferError, match="expected a Spectrum"):
        one("copper")
    with pytest.raises(TransferError, match="expected a SpectralBasis"):
        one(MATERIALS["steel"], "general-7")
    with pytest.warns(VolspecWarning, match="reflects up to 5"):
        one(Spectrum([390, 710], [5, 5]))


@pytest.mark.parametrize(
    "change",
    [
        {"domain": (5.0, 5.0)},
        {"opacity": np.full(8, 2.0)},
        {"opacity": np.zeros(1), "coefficients": np.zeros((1, 2))},
        {"coefficients": np.zeros((7, 2))},
        {"reference_step_mm": 0.0},
    ],
)
def test_tables_are_valid_at_birth(change: dict) -> None:
    good = {"domain": (0.0, 1.0), "opacity": np.zeros(8), "coefficients": np.zeros((8, 2))}
    TransferTable(**good, reference_step_mm=1.0)
    with pytest.raises(TransferError, match="transfer table"):
        TransferTable(**{**good, "reference_step_mm": 1.0, **change})


def test_step_opacity_is_corrected_for_the_step() -> None:
    table = function((0, 0.5, "steel"), (1, 1.0, "steel"), reference_step_mm=2.0).bake(9.0)
    assert table.reference_step_mm == 2
    corrected = table.step_opacity(1.0)
    assert np.isclose(corrected[0], 1 - 0.5**0.5) and corrected[-1] == 1


def test_reference_step_defaults_to_the_smallest_spacing() -> None:
    assert function((0, 0.5, "steel")).bake(0.7).reference_step_mm == 0.7


@pytest.mark.parametrize(
    ("points", "message"),
    [
        ((), "no points"),
        (((0, 1.2, "steel"),), "opacity 1.2; give 0…1"),
        (((0, -0.1, "steel"),), "opacity -0.1"),
        (((0, float("nan"), "steel"),), "opacity nan"),
        (((float("inf"), 0.5, "steel"),), "value inf"),
        (((5, 0.5, "steel"), (4, 0.5, "steel")), "sort the points"),
        (((0, 0.5, "coper"),), "no material 'coper'; did you mean 'copper'"),
        (((0, 0.5, {"steel": 0.9, "copper": 0.3}),), "sum to 1.2; give above 0 and at most 1"),
        (((0, 0.5, {"steel": -1}),), "share -1"),
        (((0, 0.5, {}),), "sum to 0"),
        (((0, 0.5),), "expected"),
        (((0, "much", "steel"),), "expected"),
    ],
)
def test_bad_points_are_named_in_one_line(points: tuple, message: str) -> None:
    with pytest.raises(TransferError, match=message) as caught:
        function(*points)
    assert "\n" not in str(caught.value)


def test_reference_step_must_be_positive() -> None:
    with pytest.raises(TransferError, match="reference_step_mm is 0"):
        function((0, 0.5, "steel"), reference_step_mm=0)
