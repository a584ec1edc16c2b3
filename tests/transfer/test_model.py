"""Transfer functions of points: what a table holds, and what is refused."""

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


def test_table_runs_linearly_between_points_and_stays_beyond():
    table = function((10, 0.0, "copper"), (30, 0.8, "steel")).bake(1.0, size=21)
    assert table.domain == (10, 30) and np.allclose(table.opacity, np.linspace(0, 0.8, 21))
    assert np.allclose(table.coefficients[[0, 10, 20]], [COPPER, (COPPER + STEEL) / 2, STEEL])


def test_two_points_of_one_value_make_a_step():
    points = [(0, 0.0, "steel"), (5, 0.0, "steel"), (5, 1.0, "copper"), (10, 1.0, "copper")]
    table = function(*points).bake(1.0, size=1001)
    assert set(table.opacity.round(9)) == {0.0, 1.0}
    assert (table.opacity > 0).argmax() in (500, 501)


def test_a_step_at_an_end_holds_beyond_it():
    table = function((0, 0.0, "steel"), (60, 0.0, "steel"), (60, 1.0, "copper")).bake(1.0)
    assert table.domain[1] > 60
    assert (table.opacity[-3:] == [0, 1, 1]).all() and table.left_limits.opacity[-2] == 0
    assert np.allclose(table.coefficients[-1], COPPER)
    table = function((0, 0.3, "steel"), (0, 1.0, "steel"), (60, 1.0, "copper")).bake(1.0)
    assert table.domain[0] < 0
    assert (table.opacity[:2] == [0.3, 1]).all() and table.left_limits.opacity[1] == 0.3


@pytest.mark.parametrize("scale", [1e-300, 1e-40, 1e-9, 1.0, 1e30])
def test_a_step_at_the_only_value_is_there_at_any_scale(scale):
    table = function((scale, 0.0, "steel"), (scale, 1.0, "copper")).bake(1.0)
    (low, high), opacity = table.domain, table.opacity
    assert low < scale < high and np.linspace(low, high, len(opacity))[1] == scale
    assert (opacity[:2] == [0, 1]).all() and opacity.min(initial=1, where=opacity > 0) == 1


@pytest.mark.parametrize("scale", [1e-12, 2.0**-80, 1e-4, 1e12, 2.0**80])
def test_tables_of_scaled_points_are_the_same(scale):
    points = [(0.0, 0.0, "steel"), (1234.0, 0.5, "steel"), (4000.0, 1.0, "copper")]
    one, other = (function(*((v * k, *look) for v, *look in points)) for k in (1.0, scale))
    here, there = one.bake(1.0), other.bake(1.0)
    assert there.domain == (0.0, 4000.0 * scale) and here.opacity.shape == (2001,)
    if scale not in (2.0**-80, 2.0**80):  # which are no decimals
        assert np.allclose(here.opacity, there.opacity, atol=1e-12)


def test_narrow_peaks_are_not_missed():
    peak = [(0, 0, "steel"), (1000, 0, "steel"), (1010, 1, "steel"), (1020, 0, "steel")]
    table = function(*peak, (65535, 0, "steel")).bake(1.0)
    assert table.opacity.max() > 0.8 and len(table.opacity) <= 65536
    needle = [(0, 0, "steel"), (1010, 0, "steel"), (1010.01, 1, "steel"), (1e6, 0, "steel")]
    with pytest.warns(VolspecWarning):
        function(*needle).bake(1)


def test_only_materials_in_use_are_rows():
    table = function((0, 0.5, "steel"), (1, 0.5, {"steel": 0.5, "copper": 0})).bake(1.0)
    assert table.material_weights.shape == (1024, 1) and table.channels.shape == (1, 7)
    assert np.allclose(table.channels[0], STEEL)


@settings(derandomize=True, deadline=None, max_examples=20)
@given(st.lists(st.lists(st.floats(0, 0.1), min_size=10, max_size=10), min_size=2, max_size=4))
def test_rows_are_never_more_than_channels_and_colours_are_the_mixes(shares):
    mixes = [dict(zip(MANY, row, strict=True)) if any(row) else {"CES/1": 0.1} for row in shares]
    points = [(value, 0.5, mix) for value, mix in enumerate(mixes)]
    table = TransferFunction(points, MANY, BASIS).bake(1.0, size=3 * (len(mixes) - 1) + 1)
    assert len(table.channels) <= 7 == table.size
    for i, mix in enumerate(mixes):
        expected = sum(share * BASIS.analyse(MANY[name]) for name, share in mix.items())
        assert np.allclose(table.coefficients[3 * i], expected)


def test_gradients_multiply_the_opacity():
    points = (0, 0.2, "steel"), (1, 0.8, "copper")
    gradients = [(10, 0.0), (20, 1.0), (40, 0.5)]
    plain = function(*points).bake(1.0, size=5)
    table = function(*points, gradient_opacity=gradients).bake(1.0, size=5, rows=9)
    assert table.gradient_top == 40 and table.opacity.shape == (9, 5)
    factors = np.array([0, 0, 0, 0.5, 1, 0.875, 0.75, 0.625, 0.5])  # at 0, 5, … 40
    assert np.allclose(table.opacity, factors[:, None] * plain.opacity)
    assert (table.material_weights == plain.material_weights).all()
    assert table.material_weights.flags.c_contiguous
    # The factor is of a reference step: half a step lets the root through.
    assert np.isclose(table.step_opacity(0.5)[3, 0], 1 - 0.9**0.5)


def test_tables_of_gradients_are_64_rows_or_more_for_close_points():
    def rows(*gradients: tuple) -> int:
        return len(function((0, 1, "steel"), gradient_opacity=gradients).bake(1.0).opacity)

    assert rows((0, 0), (50, 1)) == rows((5, 0.5)) == 64
    assert rows((0, 0), (40, 0), (41, 1)) == 165
    with pytest.warns(VolspecWarning):
        assert rows((0, 0), (400, 0), (401, 1)) == 256
    # Below its first point a curve is level: a kink, in any unit.
    assert rows((2, 0), (20, 1)) == rows((2 / 3e4, 0), (20 / 3e4, 1)) == 71


def test_filters_are_mixed_by_weights_and_free_of_opacity():
    points = (0, 0.1, "steel"), (1, 0.9, {"copper": 0.25, "steel": 0.25})
    table = function(*points, filters={"copper": AMBER}).bake(1.0, size=3)
    amber = BASIS.analyse(AMBER)
    assert amber.min() > 0 and amber.max() < 1
    # In the middle 0.125 of copper and 0.625 of steel: a sixth.
    assert np.allclose(table.filters, np.outer([0, 1 / 6, 1 / 2], amber))


def test_a_table_without_a_filter_in_use_has_none():
    for filters in ({}, {"copper": AMBER}):
        assert function((0, 0.5, "steel"), filters=filters).bake(1.0).filters is None


def test_filters_beyond_the_basis_are_clipped_with_a_warning():
    narrow = Spectrum([390, 549, 550, 560, 561, 710], [0, 0, 1, 1, 0, 0])
    signed = function((0, 0.5, "copper"), filters={"copper": narrow})
    assert BASIS.analyse(narrow).min() < -0.02
    with pytest.warns(VolspecWarning) as caught:
        filters = signed.bake(1.0).filters
    assert filters.min() == 0 and filters.max() <= 1 and caught[0].filename == __file__


def of_one_material(material: Any) -> TransferFunction:
    return TransferFunction([(0, 0.5, "m")], {"m": material}, BASIS)


def test_a_material_above_one_is_warned_about():
    with pytest.warns(VolspecWarning) as caught:
        of_one_material(Spectrum([390, 710], [5, 5]))
    assert caught[0].filename == __file__


def test_step_opacity_is_corrected_for_the_step():
    table = function((0, 0.5, "steel"), (1, 1.0, "steel"), reference_step_mm=2.0).bake(9.0)
    assert table.reference_step_mm == 2
    corrected = table.step_opacity(1.0)
    assert np.isclose(corrected[0], 1 - 0.5**0.5) and corrected[-1] == 1


@pytest.mark.parametrize("kind", ["curve", "labels", "regions"])
def test_the_reference_step_is_its_own_or_the_smallest_spacing(kind):
    assert KINDS[kind]().bake(0.7).reference_step_mm == 0.7
    assert KINDS[kind](reference_step_mm=2).bake(0.7).reference_step_mm == 2


@pytest.mark.parametrize("make", KINDS.values(), ids=KINDS)
def test_every_kind_names_itself_and_its_materials(make):
    made = make()
    assert repr(made).startswith(type(made).__name__) and all(m in repr(made) for m in MATERIALS)


def steel(**settings: Any) -> TransferFunction:
    return function((0, 0.5, "steel"), **settings)


def material(mix: Any) -> TransferFunction:
    return function((0, 0.5, mix))


def steps(*gradients: Any) -> TransferFunction:
    return steel(gradient_opacity=list(gradients))


def filtered(spectrum: Any, **settings: Any) -> TransferFunction:
    return steel(filters={"copper": spectrum}, **settings)


CHANNELS = MaterialBasis(MATERIALS)
REFUSED: list[tuple[Callable[[], object], str, str]] = [
    (lambda: steps(), "missing", "gradient_opacity"),
    (lambda: steps((0, 1)), "range", "gradient_opacity"),
    (lambda: steps((-1, 1)), "range", "gradient_opacity[0].gradient"),
    (lambda: steps((np.inf, 1)), "range", "gradient_opacity[0].gradient"),
    (lambda: steps((0, 0), (0, 1)), "range", "gradient_opacity[1].gradient"),
    (lambda: steps((5, 2)), "range", "gradient_opacity[0].factor"),
    (lambda: steel(filters={"coper": AMBER}), "unknown", "filters"),
    (lambda: filtered("amber"), "type", "filters['copper']"),
    (lambda: filtered(Spectrum([390, 710], [0, 2])), "range", "filters['copper']"),
    (lambda: filtered(AMBER, gradient_opacity=[(5, 1)]), "conflict", ""),
    (lambda: replace(filtered(AMBER), basis=CHANNELS), "conflict", "filters"),
    (lambda: steel(reference_step_mm=0), "range", "reference_step_mm"),
    (lambda: steel(reference_step_mm="long"), "type", "reference_step_mm"),
    (lambda: of_one_material(Spectrum([400, 700], [-1, 0.5])), "range", "materials['m']"),
    (lambda: of_one_material("copper"), "type", "materials['m']"),
    (lambda: function(), "missing", "points"),
    (lambda: function((0, 1.2, "steel")), "range", "points[0].opacity"),
    (lambda: function((0, np.nan, "steel")), "range", "points[0].opacity"),
    (lambda: function((0, "much", "steel")), "type", "points[0].opacity"),
    (lambda: function((0, True, "steel")), "type", "points[0].opacity"),
    (lambda: function((1e39, 0.5, "steel")), "range", "points[0].value"),
    (lambda: function((5, 0.5, "steel"), (4, 0.5, "steel")), "range", "points[1].value"),
    (lambda: function((0, 0.5)), "type", "points[0]"),
    (lambda: material("coper"), "unknown", "points[0].material"),
    (lambda: material({"steel": 0.9, "copper": 0.3}), "range", "points[0].material"),
    (lambda: material({"steel": -1}), "range", "points[0].material['steel']"),
    (lambda: material({"steel": "all"}), "type", "points[0].material['steel']"),
    (lambda: material({}), "range", "points[0].material"),
    (lambda: material(7), "type", "points[0].material"),
    *(
        (lambda make=make: replace(make(), basis="general-7"), "type", "basis")
        for make in KINDS.values()
    ),
]


@pytest.mark.parametrize(("make", "code", "field"), REFUSED)
def test_bad_functions_are_named(make, code, field):
    with raises(TransferError, code) as caught:
        make()
    assert (caught.value.field or "").partition(".")[2] == field
