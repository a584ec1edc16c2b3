"""Tables are valid at birth: what belongs together, and what is refused."""

from __future__ import annotations

import numpy as np
import pytest

from volspec.errors import TransferError
from volspec.transfer import MAX_SURFACES, SurfaceTable, TransferTable

CURVE = {"domain": (0.0, 1.0), "opacity": np.zeros(8), "shares": np.zeros((8, 2))}
GRADIENTS = {"opacity": np.zeros((3, 8)), "shares": np.zeros((3, 8, 2)), "gradient_top": 5.0}
LABELS = {"labels": True, "domain": (0, 7)}
SURFACES = {"values": [1.0, 2.0], "opacity": [0.5, 1.0], "shares": np.ones((2, 3))}


@pytest.mark.parametrize("kind", [{}, GRADIENTS, LABELS, {"filters": np.zeros((8, 2))}])
def test_every_kind_of_table_can_be_made(kind: dict) -> None:
    table = TransferTable(**{**CURVE, "reference_step_mm": 1.0, **kind})
    assert table.size == 2 and table.coefficients.shape == table.shares.shape
    assert np.array_equal(table.channels, np.eye(2)) and np.array_equal(table.white, [1, 1])


def test_channels_are_mixed_by_shares() -> None:
    shares, channels = np.full((8, 2), [0.25, 0.5]), [[4.0, 0, 8], [0, 2, 2]]
    table = TransferTable(
        (0, 1), np.zeros(8), shares, 1.0, channels=np.array(channels), white=np.ones(3)
    )
    assert table.size == 3 and np.allclose(table.coefficients, [1, 1, 3])


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"domain": (5.0, 5.0)}, "the domain is"),
        ({"domain": (0.0, np.inf)}, "the domain is"),
        ({"opacity": np.full(8, 2.0)}, "opacity must be 0…1"),
        ({"opacity": np.full(8, np.nan)}, "opacity holds NaN"),
        ({"opacity": np.zeros(1), "shares": np.zeros((1, 2))}, "of 2 or more"),
        ({"opacity": np.zeros((3, 8)), "shares": np.zeros((3, 8, 2))}, "with gradient_top"),
        ({"gradient_top": 5.0}, "with gradient_top"),
        ({**GRADIENTS, "gradient_top": 0.0}, "gradient_top is 0"),
        ({"shares": np.zeros((7, 2))}, r"expected \(8, 'K'\)"),
        ({"channels": np.zeros((3, 7))}, r"expected \(2, M\)"),
        ({"channels": np.full((2, 7), np.inf)}, "channels holds NaN or infinite"),
        ({"white": np.ones(3)}, r"expected \(2,\)"),
        ({"reference_step_mm": 0.0}, "reference step 0"),
        ({"filters": np.zeros((8, 3))}, r"expected \(8, 2\)"),
        ({"filters": np.full((8, 2), 1.5)}, "filters must be 0…1"),
        ({**GRADIENTS, "filters": np.zeros((8, 2))}, "over values alone"),
        ({**LABELS, "filters": np.zeros((8, 2))}, "over values alone"),
        ({"labels": True}, r"labels have domain .* expected \(0, N - 1\)"),
        ({**GRADIENTS, **LABELS}, "labels have domain"),
    ],
)
def test_tables_are_valid_at_birth(change: dict, message: str) -> None:
    with pytest.raises(TransferError, match=message) as caught:
        TransferTable(**{**CURVE, "reference_step_mm": 1.0, **change})
    assert str(caught.value).startswith("transfer table: ")


def test_surface_tables_fill_in_channels_and_white() -> None:
    table = SurfaceTable(**SURFACES)
    assert table.size == 3 and np.array_equal(table.channels, np.eye(3))
    assert np.array_equal(table.white, np.ones(3))


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"values": [2.0, 1.0]}, f"give 1 to {MAX_SURFACES} that rise"),
        ({"values": [1.0, 1.0]}, "that rise"),
        ({"values": 1.0}, "that rise"),
        ({"values": []}, "that rise"),
        ({"values": list(range(9))}, "that rise"),
        ({"values": [1.0, np.nan]}, "values holds NaN"),
        ({"opacity": [0.5, 1.5]}, "opacity must be 0…1"),
        ({"opacity": [0.5]}, r"expected \(2,\) and \(2, K\)"),
        ({"shares": np.ones((3, 3))}, r"expected \(2,\) and \(2, K\)"),
        ({"channels": np.ones((2, 3))}, r"expected \(3, M\)"),
        ({"white": np.ones(2)}, r"expected \(3,\)"),
    ],
)
def test_surface_tables_are_valid_at_birth(change: dict, message: str) -> None:
    with pytest.raises(TransferError, match=message) as caught:
        SurfaceTable(**{**SURFACES, **change})
    assert str(caught.value).startswith("surface table: ")
