"""The window under Xvfb with a volume that is larger than memory."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from tests.support.pyramids import stored
from tests.support.window import Robot, Row
from volspec.volume import Volume

pytestmark = pytest.mark.not_quick


def is_fine(row: Row) -> bool:
    """Return True for a cast of the level asked for, False for one of the level in memory."""
    return row["event"] == "cast" and (row["divisor"], row["steps"]) == (1, "own")


@pytest.mark.slow
def test_coarse_at_once_and_finer_when_it_rests(window: Robot, tmp_path: Path) -> None:
    z, y, x = np.mgrid[-1:1:160j, -1:1:150j, -1:1:170j]
    values = np.clip(1 - np.sqrt(x**2 + y**2 + z**2), 0, 1)
    values[::4] *= 0.5  # slats, of which the coarse level shows none
    stored(Volume((255 * values).astype(np.uint8)), tmp_path)
    before = window.keys("ctrl+o", "ctrl+a")
    window.enter(f"{tmp_path}/v.zarr?memory=3MB")
    assert not is_fine(window.event("cast", window.event("open", before)["t"]))
    left, right = window.at("picture", 1 / 3), window.at("picture")
    window.do("mousemove", *left)  # the probe shows the same place before and after
    fine = window.pixels()
    assert [is_fine(row) for row in window.since(before, "cast")][-1]
    # There and back, each time until the finer level is cast: the same view.
    window.do("mousedown", "1")
    for place in (right, left):
        before = window.now()
        window.do("mousemove", *place)
        window.wait_for(is_fine, before)
        assert not is_fine(window.event("cast", before))
    window.do("mouseup", "1")
    assert np.abs(fine - window.pixels()).mean() < 0.5
    assert fine.std() > 5
    assert window.since(-1.0, "warning", "error") == []
