"""Transfer functions of points: what a table holds, and what is refused."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.support.errors import raises
from tests.support.transfers import BASIS, COPPER, MATERIALS, STEEL, labels, regions, surfaces
from tests.support.transfers import curve as function
from volspec.basis import MaterialBasis
from volspec.errors import TransferError, VolspecWarning
from volspec.spectra import Spectrum, reflectance
from volspec.transfer import Region, TransferFunction

# Each kind of transfer function, in gold.
KINDS = {
    "curve": lambda **given: function((0, 0.5, "gold"), **given),
    "labels": lambda **given: labels({1: (1, "gold")}, **given),
    "surfaces": lambda **given: surfaces((1, 1, "gold"), **given),
    "regions": lambda **given: regions(Region((0, 1), (0, 1), 1, "gold"), **given),
}
# Ten reflectances for seven channels.
MANY = {f"CES/{i}": reflectance(f"CES/{i}") for i in range(1, 11)}
AMBER = Spectrum([390, 500, 600, 710], [0.1, 0.2, 0.9, 0.9])


def test_table_runs_linearly_between_points_and_stays_beyond() -> None:
    table = function((10, 0.0, "copper"), (30, 0.8, "steel")).bake(1.0, size=21)
    assert table.domain == (10, 30)
    assert np.allclose(table.opacity, np.linspace(0, 0.8, 21))
    assert np.allclose(table.coefficients[[0, 10, 20]], [COPPER, (COPPER + STEEL) / 2, STEEL])


def test_mixes_are_weighted_sums_of_materials() -> None:
    table = function((0, 1.0, {"copper": 0.3, "steel": 0.5})).bake(1.0)
    assert np.allclose(table.coefficients, 0.3 * COPPER + 0.5 * STEEL)


def test_two_points_of_one_value_make_a_step() -> None:
    points = [(0, 0.0, "steel"), (5, 0.0, "steel"), (5, 1.0, "copper"), (10, 1.0, "copper")]
    table = function(*points).bake(1.0, size=1001)
    assert set(table.opacity.round(9)) == {0.0, 1.0}
    assert (table.opacity > 0).argmax() in (500, 501)


def test_a_step_at_an_end_holds_beyond_it() -> None:
    table = function((0, 0.0, "steel"), (60, 0.0, "steel"), (60, 1.0, "copper")).bake(1.0)
    assert table.domain[1] > 60
    assert (table.opacity[-3:] == [0, 1, 1]).all() and table.left_limits.opacity[-2] == 0
    assert np.allclose(table.coefficients[-1], COPPER)
    table = function((0, 0.3, "steel"), (0, 1.0, "steel"), (60, 1.0, "copper")).bake(1.0)
    assert table.domain[0] < 0
    assert (table.opacity[:2] == [0.3, 1]).all() and table.left_limits.opacity[1] == 0.3


def test_narrow_peaks_are_not_missed() -> None:
    peak = [(0, 0, "steel"), (1000, 0, "steel"), (1010, 1, "steel"), (1020, 0, "steel")]
    table = function(*peak, (65535, 0, "steel")).bake(1.0)
    assert table.opacity.max() > 0.8 and len(table.opacity) <= 65536
    with pytest.warns(VolspecWarning):
        function(
            (0, 0, "steel"), (1010, 0, "steel"), (1010.01, 1, "steel"), (1e6, 0, "steel")
        ).bake(1)


def test_only_materials_in_use_are_rows() -> None:
    table = function((0, 0.5, "steel"), (1, 0.5, {"steel": 0.5, "copper": 0})).bake(1.0)
    assert table.material_weights.shape == (1024, 1) and table.channels.shape == (1, 7)
    assert np.allclose(table.channels[0], STEEL)


@settings(derandomize=True, deadline=None, max_examples=20)
@given(st.lists(st.lists(st.floats(0, 0.1), min_size=10, max_size=10), min_size=2, max_size=4))
def test_rows_are_never_more_than_channels_and_colours_are_the_mixes(shares: list) -> None:
    mixes = [dict(zip(MANY, row, strict=True)) for row in shares]
    mixes = [mix if any(mix.values()) else {"CES/1": 0.1} for mix in mixes]
    points = [(value, 0.5, mix) for value, mix in enumerate(mixes)]
    table = TransferFunction(points, MANY, BASIS).bake(1.0, size=3 * (len(mixes) - 1) + 1)
    assert len(table.channels) <= 7 == table.size
    for i, mix in enumerate(mixes):
        expected = sum(share * BASIS.analyse(MANY[name]) for name, share in mix.items())
        assert np.allclose(table.coefficients[3 * i], expected)


def test_gradients_multiply_the_opacity() -> None:
    points = (0, 0.2, "steel"), (1, 0.8, "copper")
    gradients = [(10, 0.0), (20, 1.0), (40, 0.5)]
    plain = function(*points).bake(1.0, size=5)
    table = function(*points, gradient_opacity=gradients).bake(1.0, size=5, rows=9)
    assert table.gradient_top == 40 and table.opacity.shape == (9, 5)
    factors = np.array([0, 0, 0, 0.5, 1, 0.875, 0.75, 0.625, 0.5])  # at 0, 5, … 40
    assert np.allclose(table.opacity, factors[:, None] * plain.opacity)
    assert np.array_equal(
        table.material_weights, np.broadcast_to(plain.material_weights, (9, 5, 2))
    )
    assert table.material_weights.flags.c_contiguous
    # The factor is of a reference step: half a step lets the root through.
    assert np.isclose(table.step_opacity(0.5)[3, 0], 1 - 0.9**0.5)


def test_tables_of_gradients_are_64_rows_or_more_for_close_points() -> None:
    def rows(*gradients: tuple) -> int:
        return len(function((0, 1, "steel"), gradient_opacity=gradients).bake(1.0).opacity)

    assert rows((0, 0), (50, 1)) == rows((5, 0.5)) == 64
    assert rows((0, 0), (40, 0), (41, 1)) == 165
    with pytest.warns(VolspecWarning):
        assert rows((0, 0), (400, 0), (401, 1)) == 256


def test_filters_are_mixed_by_weights_and_free_of_opacity() -> None:
    table = function(
        (0, 0.1, "steel"), (1, 0.9, {"copper": 0.25, "steel": 0.25}), filters={"copper": AMBER}
    ).bake(1.0, size=3)
    amber = BASIS.analyse(AMBER)
    assert amber.min() > 0 and amber.max() < 1
    # In the middle 0.125 of copper and 0.625 of steel: a sixth.
    assert table.filters is not None
    assert np.allclose(table.filters, np.outer([0, 1 / 6, 1 / 2], amber))


def test_a_table_without_a_filter_in_use_has_none() -> None:
    for filters in ({}, {"copper": AMBER}):
        assert function((0, 0.5, "steel"), filters=filters).bake(1.0).filters is None


def test_filters_beyond_the_basis_are_clipped_with_a_warning() -> None:
    narrow = Spectrum([390, 549, 550, 560, 561, 710], [0, 0, 1, 1, 0, 0])
    signed = function((0, 0.5, "copper"), filters={"copper": narrow})
    assert BASIS.analyse(narrow).min() < -0.02
    with pytest.warns(VolspecWarning) as caught:
        filters = signed.bake(1.0).filters
    assert filters is not None and filters.min() == 0 and filters.max() <= 1
    assert caught[0].filename == __file__


@pytest.mark.parametrize(
    ("settings", "code", "field"),
    [
        ({"gradient_opacity": []}, "missing", "gradient_opacity"),
        ({"gradient_opacity": 5}, "type", "gradient_opacity"),
        ({"gradient_opacity": [5]}, "type", "gradient_opacity[0]"),
        ({"gradient_opacity": [(0, 1)]}, "range", "gradient_opacity"),
        ({"gradient_opacity": [(-1, 1)]}, "range", "gradient_opacity[0].gradient"),
        ({"gradient_opacity": [(float("inf"), 1)]}, "range", "gradient_opacity[0].gradient"),
        ({"gradient_opacity": [(0, 0), (0, 1)]}, "range", "gradient_opacity[1].gradient"),
        ({"gradient_opacity": [(5, 2)]}, "range", "gradient_opacity[0].factor"),
        ({"filters": [AMBER]}, "type", "filters"),
        ({"filters": {"coper": AMBER}}, "unknown", "filters"),
        ({"filters": {"copper": "amber"}}, "type", "filters['copper']"),
        ({"filters": {"copper": Spectrum([390, 710], [0, 2])}}, "range", "filters['copper']"),
        ({"filters": {"copper": AMBER}, "gradient_opacity": [(5, 1)]}, "conflict", ""),
        ({"reference_step_mm": 0}, "range", "reference_step_mm"),
        ({"reference_step_mm": "long"}, "type", "reference_step_mm"),
    ],
)
def test_bad_settings_are_named_in_one_line(settings: dict, code: str, field: str) -> None:
    with raises(TransferError, code, f"TransferFunction.{field}".rstrip(".")):
        function((0, 0.5, "steel"), **settings)


def test_channels_of_materials_have_no_filters() -> None:
    basis = MaterialBasis(MATERIALS)
    with raises(TransferError, "conflict", "TransferFunction.filters"):
        TransferFunction([(0, 1, "steel")], MATERIALS, basis, filters={"steel": AMBER})


def test_materials_must_be_reflectances() -> None:
    def one(material: object) -> TransferFunction:
        return TransferFunction([(0, 0.5, "m")], {"m": material}, BASIS)

    with raises(TransferError, "range", "TransferFunction.materials['m']"):
        one(Spectrum([400, 700], [-1, 0.5]))
    with raises(TransferError, "type", "TransferFunction.materials['m']"):
        one("copper")
    with pytest.warns(VolspecWarning) as caught:
        one(Spectrum([390, 710], [5, 5]))
    assert caught[0].filename == __file__


def test_step_opacity_is_corrected_for_the_step() -> None:
    table = function((0, 0.5, "steel"), (1, 1.0, "steel"), reference_step_mm=2.0).bake(9.0)
    assert table.reference_step_mm == 2
    corrected = table.step_opacity(1.0)
    assert np.isclose(corrected[0], 1 - 0.5**0.5) and corrected[-1] == 1


@pytest.mark.parametrize("kind", ["curve", "labels", "regions"])
def test_the_reference_step_is_its_own_or_the_smallest_spacing(kind: str) -> None:
    assert KINDS[kind]().bake(0.7).reference_step_mm == 0.7
    assert KINDS[kind](reference_step_mm=2).bake(0.7).reference_step_mm == 2


@pytest.mark.parametrize("make", KINDS.values(), ids=KINDS)
def test_every_kind_names_itself_and_checks_materials_and_basis(make: Callable[..., Any]) -> None:
    made = make()
    assert repr(made).startswith(type(made).__name__) and all(m in repr(made) for m in MATERIALS)
    with raises(TransferError, "type", f"{type(made).__name__}.basis"):
        replace(made, basis="general-7")
    with raises(TransferError, "type", f"{type(made).__name__}.materials"):
        replace(made, materials=["gold"])


@pytest.mark.parametrize(
    ("points", "code", "field"),
    [
        ((), "missing", "points"),
        (((0, 1.2, "steel"),), "range", "points[0].opacity"),
        (((0, float("nan"), "steel"),), "range", "points[0].opacity"),
        (((float("inf"), 0.5, "steel"),), "range", "points[0].value"),
        (((5, 0.5, "steel"), (4, 0.5, "steel")), "range", "points[1].value"),
        (((0, 0.5, "coper"),), "unknown", "points[0].material"),
        (((0, 0.5, {"steel": 0.9, "copper": 0.3}),), "range", "points[0].material"),
        (((0, 0.5, {"steel": -1}),), "range", "points[0].material['steel']"),
        (((0, 0.5, {}),), "range", "points[0].material"),
        (((0, 0.5),), "type", "points[0]"),
        (((0, "much", "steel"),), "type", "points[0].opacity"),
        (((0, True, "steel"),), "type", "points[0].opacity"),
        (((0, 0.5, 7),), "type", "points[0].material"),
        (((0, 0.5, {"steel": "all"}),), "type", "points[0].material['steel']"),
    ],
)
def test_bad_points_are_named_in_one_line(points: tuple, code: str, field: str) -> None:
    with raises(TransferError, code, f"TransferFunction.{field}"):
        function(*points)
