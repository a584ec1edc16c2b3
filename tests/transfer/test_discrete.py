"""Labels and isosurfaces: what their tables hold, and what is refused."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.support.errors import refuses
from tests.support.transfers import BASIS, COPPER, GOLD, MATERIALS, STEEL, labels, surfaces
from volspec.basis import MaterialBasis
from volspec.errors import TransferError
from volspec.transfer import Isosurfaces, LabelFunction


@settings(derandomize=True, deadline=None, max_examples=20)
@given(
    st.dictionaries(
        st.integers(0, 300) | st.just(65535),
        st.tuples(st.floats(0, 1), st.sampled_from(sorted(MATERIALS))),
        min_size=1,
        max_size=6,
    )
)
def test_entry_i_is_of_label_i_and_all_others_are_transparent(given_labels):
    table = labels(given_labels).bake(1.0)
    last = max(1, *given_labels)
    assert table.labels and table.domain == (0, last) and len(table.opacity) == last + 1
    others = np.setdiff1d(np.arange(last + 1), list(given_labels))
    assert not table.opacity[others].any() and not table.material_weights[others].any()
    for label, (opacity, name) in given_labels.items():
        assert table.opacity[label] == opacity
        expected = BASIS.analyse(MATERIALS[name]) if opacity else np.zeros(7)
        assert np.allclose(table.material_weights[label] @ table.channels, expected)


def test_labels_may_be_mixes_and_numpy_numbers():
    table = labels({np.uint8(2): (0.5, {"copper": 0.5, "gold": 0.25})}).bake(1.0)
    assert np.allclose(table.coefficients[2], 0.5 * COPPER + 0.25 * GOLD)


def test_materials_of_transparent_labels_are_no_rows():
    table = labels({1: (0.0, "gold"), 2: (0.5, "steel")}).bake(1.0)
    assert table.channels.shape == (1, 7) and np.allclose(table.channels, STEEL)
    assert labels({3: (0.0, "gold")}).bake(1.0).material_weights.shape == (4, 1)


def test_materials_as_channels_serve_labels_and_surfaces():
    basis = MaterialBasis(MATERIALS)
    table = LabelFunction({1: (1, "gold")}, MATERIALS, basis).bake(1.0)
    assert table.coefficients[1].tolist() == [0, 0, 1, 0] and table.white.tolist() == [0, 0, 0, 1]
    walls = Isosurfaces([(1, 1, "gold")], MATERIALS, basis).bake(1.0)
    assert (walls.material_weights @ walls.channels).tolist() == [[0, 0, 1, 0]]


def test_surfaces_are_sorted_by_value():
    table = surfaces((9, 1.0, "gold"), (-3, 0.25, {"copper": 0.5, "steel": 0.5})).bake(1.0)
    assert table.values.tolist() == [-3, 9] and table.opacity.tolist() == [0.25, 1]
    mixed = (COPPER + STEEL) / 2
    assert np.allclose(table.material_weights @ table.channels, [mixed, GOLD])


@pytest.mark.parametrize(
    ("make", "expected"),
    [
        (lambda: labels({}), "missing LabelFunction.labels"),
        (lambda: labels({-1: (1, "gold")}), "range LabelFunction.labels"),
        (lambda: labels({1.5: (1, "gold")}), "type LabelFunction.labels"),
        (lambda: labels({True: (1, "gold")}), "type LabelFunction.labels"),
        (lambda: labels({1: (2, "gold")}), "range LabelFunction.labels[1].opacity"),
        (lambda: labels({1: (1, "glod")}), "unknown LabelFunction.labels[1].material"),
        (lambda: labels({1: "gold"}), "type LabelFunction.labels[1]"),
        (lambda: surfaces(), "missing Isosurfaces.surfaces"),
        (lambda: surfaces((1, 1, "gold"), (1, 0.5, "steel")), "duplicate Isosurfaces.surfaces"),
        (lambda: surfaces(*((i, 1, "gold") for i in range(9))), "size Isosurfaces.surfaces"),
        (lambda: surfaces((math.nan, 1, "gold")), "range Isosurfaces.surfaces[0].value"),
    ],
)
def test_bad_labels_and_surfaces_are_named(make, expected):
    refuses(make, expected, TransferError)
