"""Presets fitted to volumes of every kind."""

import numpy as np
import pytest

from tests.support.errors import raises
from volspec.errors import InputError
from volspec.spectra import DEFAULT_GRID
from volspec.transfer import presets
from volspec.transfer.presets import histogram
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
def test_every_preset_fits_every_volume(name):
    volume = _volumes()[name]
    counts, (low, high) = histogram(volume), presets.value_span(volume)
    for preset in presets.PRESETS:
        made = presets.fit_preset(preset, volume, counts, DEFAULT_GRID)
        assert made.bake(1.0).opacity.max() > 0
        values = [value for value, *_ in getattr(made, "points", None) or made.surfaces]
        assert low <= values[0] and values[-1] <= high and values == sorted(values)
        assert presets.preset_of(made) is preset
        kept = [each for each in presets.PRESETS if presets.is_preset(made, each, volume, counts)]
        assert kept == [preset]


def test_presets_take_hounsfield_units_as_they_are():
    volume = _volumes()["hounsfield"]
    assert presets.in_hounsfield(volume)
    bone = presets.preset_points(presets.BY_NAME["bone"], volume, histogram(volume))
    assert [value for value, _, _ in bone] == [200, 380, 650, 1200]
    names = [preset.name for preset in presets.sorted_presets(volume)]
    assert names.index("bone") < names.index("metal")
    assert not presets.in_hounsfield(phantom.ball(8))


def test_an_unknown_preset_is_named_with_the_nearest():
    with raises(InputError, "unknown", "preset") as refused:
        presets.preset_named("bones")
    assert "'bone'" in refused.value.remedy
