"""Presets fitted to volumes, and the histograms that the editor shows."""

from __future__ import annotations

import gc
import weakref
from dataclasses import replace

import numpy as np
import pytest

from volspec.pipeline import raycast
from volspec.viewer.model import presets, transfer_edits
from volspec.viewer.model.commands import BY_NAME
from volspec.viewer.model.document import Document, histogram, joint_histogram
from volspec.viewer.model.edit import after
from volspec.viewer.model.state import ViewState
from volspec.viewer.model.transfer_parts import parts_of
from volspec.volume import Volume, phantom


def _volumes() -> dict[str, Volume]:
    rng = np.random.default_rng(5)
    body = np.where(phantom.ball(16).values > 0.5, 60.0, -1000.0)
    body[7:9, 7:9, 7:9] = 1400.0
    return {
        "floats": phantom.ball(12),
        "bytes": Volume(rng.integers(0, 256, (8, 9, 10), dtype=np.uint8)),
        "hounsfield": Volume((body + rng.normal(0, 10, body.shape)).astype(np.int16)),
        "two labels": Volume((body > 0).astype(np.uint8)),
        "constant": Volume(np.full((4, 4, 4), 7, np.uint8)),
        "tiny": Volume(np.array([0.0, 1e-6] * 4, np.float32).reshape(2, 2, 2)),
        "far": Volume(1e4 + phantom.ball(8).values.astype(np.float32)),
    }


@pytest.mark.parametrize("name", _volumes())
def test_every_preset_fits_every_volume(state: ViewState, name: str) -> None:
    volume = _volumes()[name]
    low, high = presets.value_span(volume)
    for preset in presets.PRESETS:
        made = presets.transfer_of(preset, volume, histogram(volume), state.transfer.basis)
        assert made.bake(1.0).opacity.max() > 0
        values = [value for part in parts_of(made) for value in part.values]
        assert low <= values[0] and values[-1] <= high and values == sorted(values)
        assert presets.preset_title(made) == preset.title


def test_presets_take_hounsfield_units_as_they_are() -> None:
    volume = _volumes()["hounsfield"]
    assert presets.in_hounsfield(volume)
    bone = presets.preset_points(presets.BY_NAME["bone"], volume, histogram(volume))
    assert [value for value, _, _ in bone] == [200, 380, 650, 1200]
    names = [preset.name for preset in presets.sorted_presets(volume)]
    assert names.index("bone") < names.index("metal")
    assert not presets.in_hounsfield(phantom.ball(8))


def test_a_preset_shows_the_ball_and_replaces_materials_and_basis(document: Document) -> None:
    state = ViewState.first(document, (32, 32))
    shifted = transfer_edits.shift(state, 0.2)
    change = BY_NAME["preset-skin"].change
    assert change is not None
    new = after(change, shifted).state
    assert list(new.transfer.materials) == ["skin"] and new.shift == 0
    assert new.transfer.basis.method == "materials"
    assert new.transfer.basis.grid == document.grid
    image = raycast(document.volume, new.transfer, new.view.camera(document.volume), (32, 32))
    assert image.alpha.max() > 0.9


def test_the_joint_histogram_knows_a_ramps_gradient() -> None:
    """0.25 per voxel of 0.5 mm."""
    ramp = np.broadcast_to(0.25 * np.arange(8, dtype=np.float32), (5, 6, 8))
    joint = joint_histogram(Volume(ramp, spacing_mm=(0.5, 1, 1)))
    assert joint.top == pytest.approx(0.5)
    assert joint.counts[:-1].sum() == 0 and joint.counts[-1].sum() > 0
    assert joint_histogram(Volume(np.zeros((2, 2, 2), np.uint8))).top == 1.0


def test_the_histogram_on_the_screen_keeps_no_closed_volume(document: Document) -> None:
    from volspec.viewer.ui import transfer_regions as regions

    opened = replace(document, volume=Volume(phantom.ball(8).values))
    closed = weakref.ref(opened.volume.values)
    assert regions.shades(opened.joint, True).max() == pytest.approx(1.0)
    del opened
    gc.collect()
    assert closed() is None
