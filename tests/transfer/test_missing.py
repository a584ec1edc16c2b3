"""Missing voxels, NaN or infinite in the file, are transparent in casts and their twin."""

import warnings

import numpy as np
import pytest

import volspec as vs
from tests.support.fixtures import slow, slow_each
from tests.support.transfers import BASIS, MATERIALS
from volspec.transfer.nan_voxels import bake_for_volume, transparent_below
from volspec.transfer.table import TransferTable
from volspec.viewer.model.document import field_data
from volspec.volume.summary import summarise

NAME = next(iter(MATERIALS))


def half_missing() -> vs.Volume:
    """A ramp along x whose half beyond the middle of z is missing."""
    values = np.linspace(1, 3, 16, dtype=np.float32) * np.ones((16, 16, 1), np.float32)
    values[8:] = np.nan
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        return vs.Volume(values)


CURVE = vs.TransferFunction([(0.0, 0.9, NAME), (4.0, 0.9, NAME)], MATERIALS, BASIS)


@pytest.mark.not_quick
@pytest.mark.parametrize(
    "settings", [{}, {"preintegrated": True}, *slow_each({"mode": "maximum"}, {"mode": "average"})]
)
@pytest.mark.parametrize("first", [0.0, -1e4, slow(-1e8)])
def test_missing_voxels_are_transparent_whatever_the_curve(settings, first):
    """Also one that shows what they hold, which is below -1000."""
    volume = half_missing()
    curve = vs.TransferFunction([(first, 0.9, NAME), (4.0, 0.9, NAME)], MATERIALS, BASIS)
    camera = vs.Camera.orbit(volume, azimuth_deg=0, elevation_deg=0)
    whole = vs.Volume(volume.values.clip(1, 3))
    rows, all_rows = (
        vs.raycast(each, curve, camera, (64, 64), vs.RaycastSpec(**settings)).alpha.max(axis=1)
        for each in (volume, whole)
    )
    seen = np.flatnonzero(rows > 0.5)
    # The lower half, z below 7 of 15 voxels: up to the last whole cell.
    assert len(seen) and rows[: seen[0] - 1].max() < 1e-3
    assert len(seen) / np.count_nonzero(all_rows > 0.5) == pytest.approx(7 / 15, abs=0.05)


def test_a_table_is_transparent_below_a_value_and_the_same_above():
    table = TransferTable((2.0, 4.0), [0.5, 0.3, 0.1], [[1], [0.5], [0]], reference_step_mm=1)
    longer = transparent_below(table, 0.0)
    assert longer.domain == (-1, 4) and longer.opacity.tolist() == [0, 0.5, 0.5, 0.5, 0.3, 0.1]
    assert transparent_below(table, 3.0).opacity.tolist() == [0, 0.5, 0.3, 0.1]
    narrow = transparent_below(TransferTable((0.0, 1e-6), [0.5, 0.1], [[1], [1]], 1.0), -5.0)
    assert len(narrow.opacity) == 65536 and narrow.opacity[0] == 0 and narrow.opacity[1] == 0.5


def test_volumes_without_missing_voxels_keep_their_table():
    volume = vs.Volume(np.arange(27, dtype=np.float32).reshape(3, 3, 3))
    table = bake_for_volume(CURVE, volume)
    assert isinstance(table, TransferTable) and table.domain == CURVE.bake(1.0).domain


def test_statistics_leave_missing_voxels_out():
    volume = half_missing()
    summary = summarise(volume)
    assert summary.range == (1, 3) and summary.mean == pytest.approx(2, abs=1e-5)
    assert summary.missing == 8 * 16 * 16
    assert sum(count for _, _, count in summary.histogram) == 8 * 16 * 16
    joint = field_data((volume,))[""].joint
    assert joint.top < 3 and joint.counts.sum() > 0
