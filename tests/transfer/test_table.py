"""Tables are valid at birth: what belongs together, and what is refused."""

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from tests.support.errors import refuses
from volspec.errors import TransferError
from volspec.transfer import SurfaceTable, TransferTable

CURVE = {"domain": (0.0, 1.0), "opacity": np.zeros(8), "material_weights": np.zeros((8, 2))}
GRADIENTS = {
    "opacity": np.zeros((3, 8)),
    "material_weights": np.zeros((3, 8, 2)),
    "gradient_top": 5.0,
}
LABELS = {"labels": True, "domain": (0, 7)}
SURFACES = {"values": [1.0, 2.0], "opacity": [0.5, 1.0], "material_weights": np.ones((2, 3))}


@pytest.mark.parametrize("kind", [{}, GRADIENTS, LABELS, {"filters": np.zeros((8, 2))}])
def test_every_kind_of_table_can_be_made(kind):
    made = table(**kind)
    assert made.size == 2 and made.coefficients.shape == made.material_weights.shape
    assert np.array_equal(made.channels, np.eye(2)) and np.array_equal(made.white, [1, 1])


def test_channels_are_mixed_by_weights():
    weights, channels = np.full((8, 2), [0.25, 0.5]), np.array([[4.0, 0, 8], [0, 2, 2]])
    made = table(material_weights=weights, channels=channels, white=np.ones(3))
    assert made.size == 3 and np.allclose(made.coefficients, [1, 1, 3])


def test_surface_tables_fill_in_channels_and_white():
    made = SurfaceTable(**SURFACES)
    assert made.size == 3 and np.array_equal(made.channels, np.eye(3))
    assert np.array_equal(made.white, np.ones(3))


def table(**change: Any) -> TransferTable:
    return TransferTable(**{**CURVE, "reference_step_mm": 1.0, **change})


def gradients(**change: Any) -> TransferTable:
    return table(**{**GRADIENTS, **change})


def surfaces(**change: Any) -> SurfaceTable:
    return SurfaceTable(**{**SURFACES, **change})


FILTERS = {"filters": np.zeros((8, 2))}
REFUSED: list[tuple[Callable[[], object], str]] = [
    (lambda: table(domain=(5.0, 5.0)), "range TransferTable.domain"),
    (lambda: table(domain=(0.0, np.inf)), "range TransferTable.domain"),
    (lambda: table(opacity=np.full(8, 2.0)), "range TransferTable.opacity"),
    (lambda: table(opacity=np.full(8, np.nan)), "range TransferTable.opacity"),
    (lambda: table(opacity=[0.0], material_weights=[[0.0, 0.0]]), "shape TransferTable.opacity"),
    (lambda: gradients(gradient_top=None), "shape TransferTable.opacity"),
    (lambda: table(gradient_top=5.0), "shape TransferTable.opacity"),
    (lambda: gradients(gradient_top=0.0), "range TransferTable.gradient_top"),
    (lambda: table(material_weights=np.zeros((7, 2))), "shape TransferTable.material_weights"),
    (lambda: table(channels=np.zeros((3, 7))), "shape TransferTable.channels"),
    (lambda: table(channels=np.full((2, 7), np.inf)), "range TransferTable.channels"),
    (lambda: table(white=np.ones(3)), "shape TransferTable.white"),
    (lambda: table(reference_step_mm=0.0), "range TransferTable.reference_step_mm"),
    (lambda: table(filters=np.zeros((8, 3))), "shape TransferTable.filters"),
    (lambda: table(filters=np.full((8, 2), 1.5)), "range TransferTable.filters"),
    (lambda: gradients(**FILTERS), "shape TransferTable.filters"),
    (lambda: table(**LABELS, **FILTERS), "shape TransferTable.filters"),
    (lambda: table(labels=True), "shape TransferTable.labels"),
    (lambda: gradients(**LABELS), "shape TransferTable.labels"),
    *(
        (lambda values=values: surfaces(values=values), "range SurfaceTable.values")
        for values in ([2.0, 1.0], [1.0, 1.0], 1.0, [], list(range(9)), [1.0, np.nan])
    ),
    (lambda: surfaces(opacity=[0.5, 1.5]), "range SurfaceTable.opacity"),
    (lambda: surfaces(opacity=[0.5]), "shape SurfaceTable.opacity"),
    (lambda: surfaces(material_weights=np.ones((3, 3))), "shape SurfaceTable.material_weights"),
    (lambda: surfaces(channels=np.ones((2, 3))), "shape SurfaceTable.channels"),
    (lambda: surfaces(white=np.ones(2)), "shape SurfaceTable.white"),
]


@pytest.mark.parametrize(("make", "expected"), REFUSED)
def test_tables_are_valid_at_birth(make, expected):
    refuses(make, expected, TransferError)
