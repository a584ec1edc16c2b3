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
        ({"domain": (5.0, 5.0)}, "range", "domain"),
        ({"domain": (0.0, np.inf)}, "range", "domain"),
        ({"opacity": np.full(8, 2.0)}, "range", "opacity"),
        ({"opacity": np.full(8, np.nan)}, "range", "opacity"),
        ({"opacity": np.zeros(1), "material_weights": np.zeros((1, 2))}, "shape", "opacity"),
        (
            {"opacity": np.zeros((3, 8)), "material_weights": np.zeros((3, 8, 2))},
            "shape",
            "opacity",
        ),
        ({"gradient_top": 5.0}, "shape", "opacity"),
        ({**GRADIENTS, "gradient_top": 0.0}, "range", "gradient_top"),
        ({"material_weights": np.zeros((7, 2))}, "shape", "material_weights"),
        ({"channels": np.zeros((3, 7))}, "shape", "channels"),
        ({"channels": np.full((2, 7), np.inf)}, "range", "channels"),
        ({"white": np.ones(3)}, "shape", "white"),
        ({"reference_step_mm": 0.0}, "range", "reference_step_mm"),
        ({"filters": np.zeros((8, 3))}, "shape", "filters"),
        ({"filters": np.full((8, 2), 1.5)}, "range", "filters"),
        ({**GRADIENTS, "filters": np.zeros((8, 2))}, "shape", "filters"),
        ({**LABELS, "filters": np.zeros((8, 2))}, "shape", "filters"),
        ({"labels": True}, "shape", "labels"),
        ({**GRADIENTS, **LABELS}, "shape", "labels"),
    ],
)
def test_tables_are_valid_at_birth(change: dict, code: str, field: str) -> None:
    with raises(TransferError, code, f"TransferTable.{field}"):
        TransferTable(**{**CURVE, "reference_step_mm": 1.0, **change})


def test_surface_tables_fill_in_channels_and_white() -> None:
    table = SurfaceTable(**SURFACES)
    assert table.size == 3 and np.array_equal(table.channels, np.eye(3))
    assert np.array_equal(table.white, np.ones(3))


@pytest.mark.parametrize(
    ("change", "code", "field"),
    [
        ({"values": [2.0, 1.0]}, "range", "values"),
        ({"values": [1.0, 1.0]}, "range", "values"),
        ({"values": 1.0}, "range", "values"),
        ({"values": []}, "range", "values"),
        ({"values": list(range(9))}, "range", "values"),
        ({"values": [1.0, np.nan]}, "range", "values"),
        ({"opacity": [0.5, 1.5]}, "range", "opacity"),
        ({"opacity": [0.5]}, "shape", "opacity"),
        ({"material_weights": np.ones((3, 3))}, "shape", "material_weights"),
        ({"channels": np.ones((2, 3))}, "shape", "channels"),
        ({"white": np.ones(2)}, "shape", "white"),
    ],
)
def test_surface_tables_are_valid_at_birth(change: dict, code: str, field: str) -> None:
    with raises(TransferError, code, f"SurfaceTable.{field}"):
        SurfaceTable(**{**SURFACES, **change})
