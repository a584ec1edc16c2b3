"""What slices look values up in: bounded, and every label that can be named apart."""

from __future__ import annotations

import numpy as np
import pytest

from volspec.transfer import MAX_LABEL
from volspec.viewer.model import slice_table
from volspec.volume import Volume


@pytest.mark.parametrize(
    ("dtype", "top"),
    [(np.uint16, 300), (np.uint16, 65535), *((np.float32, top) for top in (300, 65535, 2**31))],
)
def test_a_table_of_labels_is_bounded_and_tells_those_apart_that_can_be_named(
    dtype: type, top: int
) -> None:
    """Volumes of 32-bit integers are kept as floats: they had 4096 entries, evenly."""
    volume = Volume(np.array([0, 1, 2, top // 2, top - 1, top, 7, 8], dtype).reshape(2, 2, 2))
    entries = slice_table.entries_of(volume, labels=True)
    assert entries.count <= MAX_LABEL + 1 + slice_table.ENTRIES
    named = volume.values[volume.values <= MAX_LABEL]
    np.testing.assert_array_equal(entries.values[entries.codes(named)], named)
    # The others are grey by what they are.
    shades = slice_table.greys(entries, volume.range, (0.0, 1.0))
    np.testing.assert_allclose(
        shades[entries.codes(volume.values)], volume.values / top, atol=1 / slice_table.ENTRIES
    )


def test_slices_tell_labels_above_65535_apart() -> None:
    """70000 was 4464."""
    labels = np.array([[0, 4464, 65535, 70000]], np.int32)
    codes = slice_table.Entries(0.0, 65536, 70000.0, slice_table.ENTRIES).codes(labels)
    np.testing.assert_array_equal(codes, [[0, 4464, 65535, 65535 + slice_table.ENTRIES]])
