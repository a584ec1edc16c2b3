"""Tables are valid at birth: what belongs together, and what is refused."""

from __future__ import annotations

import numpy as np
import pytest

from tests.support.errors import raises
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
def test_every_kind_of_table_can_be_made(kind: dict) -> None:
    table = TransferTable(**{**CURVE, "reference_step_mm": 1.0, **kind})
    assert table.size == 2 and table.coefficients.shape == table.material_weights.shape
    assert np.array_equal(table.channels, np.eye(2)) and np.array_equal(table.white, [1, 1])


def test_channels_are_mixed_by_weights() -> None:
    weights, channels = np.full((8, 2), [0.25, 0.5]), [[4.0, 0, 8], [0, 2, 2]]
    table = TransferTable(
        (0, 1), np.zeros(8), weights, 1.0, channels=np.array(channels), white=np.ones(3)
    )
    assert table.size == 3 and np.allclose(table.coefficients, [1, 1, 3])


@pytest.mark.parametrize(
    ("change", "code", "field"),
    [
        ({"domain": (5.0, 5.0)}, "range", "TransferTable.domain"),
        ({"domain": (0.0, np.inf)}, "range", "TransferTable.domain"),
        ({"opacity": np.full(8, 2.0)}, "range", "TransferTable.opacity"),
        ({"opacity": np.full(8, np.nan)}, "range", "TransferTable.opacity"),
        (
            {"opacity": np.zeros(1), "material_weights": np.zeros((1, 2))},
            "shape",
            "TransferTable.opacity",
        ),
        (
            {"opacity": np.zeros((3, 8)), "material_weights": np.zeros((3, 8, 2))},
            "shape",
            "TransferTable.opacity",
        ),
        ({"gradient_top": 5.0}, "shape", "TransferTable.opacity"),
        ({**GRADIENTS, "gradient_top": 0.0}, "range", "TransferTable.gradient_top"),
        ({"material_weights": np.zeros((7, 2))}, "shape", "TransferTable.material_weights"),
        ({"channels": np.zeros((3, 7))}, "shape", "TransferTable.channels"),
        ({"channels": np.full((2, 7), np.inf)}, "range", "TransferTable.channels"),
        ({"white": np.ones(3)}, "shape", "TransferTable.white"),
        ({"reference_step_mm": 0.0}, "range", "TransferTable.reference_step_mm"),
        ({"filters": np.zeros((8, 3))}, "shape", "TransferTable.filters"),
        ({"filters": np.full((8, 2), 1.5)}, "range", "TransferTable.filters"),
        ({**GRADIENTS, "filters": np.zeros((8, 2))}, "shape", "TransferTable.filters"),
        ({**LABELS, "filters": np.zeros((8, 2))}, "shape", "TransferTable.filters"),
        ({"labels": True}, "shape", "TransferTable.labels"),
        ({**GRADIENTS, **LABELS}, "shape", "TransferTable.labels"),
    ],
)
def test_tables_are_valid_at_birth(change: dict, code: str, field: str) -> None:
    with raises(TransferError, code, field):
        TransferTable(**{**CURVE, "reference_step_mm": 1.0, **change})


def test_surface_tables_fill_in_channels_and_white() -> None:
    table = SurfaceTable(**SURFACES)
    assert table.size == 3 and np.array_equal(table.channels, np.eye(3))
    assert np.array_equal(table.white, np.ones(3))


@pytest.mark.parametrize(
    ("change", "code", "field"),
    [
        ({"values": [2.0, 1.0]}, "range", "SurfaceTable.values"),
        ({"values": [1.0, 1.0]}, "range", "SurfaceTable.values"),
        ({"values": 1.0}, "range", "SurfaceTable.values"),
        ({"values": []}, "range", "SurfaceTable.values"),
        ({"values": list(range(9))}, "range", "SurfaceTable.values"),
        ({"values": [1.0, np.nan]}, "range", "SurfaceTable.values"),
        ({"opacity": [0.5, 1.5]}, "range", "SurfaceTable.opacity"),
        ({"opacity": [0.5]}, "shape", "SurfaceTable.opacity"),
        ({"material_weights": np.ones((3, 3))}, "shape", "SurfaceTable.material_weights"),
        ({"channels": np.ones((2, 3))}, "shape", "SurfaceTable.channels"),
        ({"white": np.ones(2)}, "shape", "SurfaceTable.white"),
    ],
)
def test_surface_tables_are_valid_at_birth(change: dict, code: str, field: str) -> None:
    with raises(TransferError, code, field):
        SurfaceTable(**{**SURFACES, **change})
