"""Presets fitted to volumes of every kind."""

import warnings
from dataclasses import replace

import numpy as np
import pytest

from tests.support.errors import raises
from volspec.errors import InputError
from volspec.spectra import DEFAULT_GRID
from volspec.transfer import presets
from volspec.transfer.nan_voxels import bake_for_volume
from volspec.transfer.presets import histogram
from volspec.volume import Metadata, Volume, phantom


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
    volume = replace(_volumes()["hounsfield"], metadata=Metadata("CT", "HU"))
    bone = presets.preset_points(presets.BY_NAME["bone"], volume, histogram(volume))
    assert [value for value, _, _ in bone] == [200, 380, 650, 1200]
    names = [preset.name for preset in presets.sorted_presets(volume)]
    assert names.index("bone") < names.index("metal")
    # Without the unit, the same values are as good as any others.
    names = [preset.name for preset in presets.sorted_presets(_volumes()["hounsfield"])]
    assert names.index("bone") > names.index("metal")


def _scan() -> tuple[np.ndarray, dict[str, np.ndarray]]:
    """A CT of tissue, bone and lung in air, noise included, and where each of them is."""
    _, y, x = np.meshgrid(*[np.linspace(-1, 1, 48)] * 3, indexing="ij")
    across = np.hypot(x, 1.3 * y)
    where = {
        "air": (across > 0.85) & (np.hypot(x, y) <= 1),
        "lung": (x + 0.35) ** 2 + y**2 < 0.06,
        "bone": (x - 0.2) ** 2 + (y + 0.1) ** 2 < 0.03,
        "outside": np.hypot(x, y) > 1,
    }
    hu = np.where(across < 0.8, 40.0, -1000.0)
    hu[where["bone"]], hu[where["lung"]] = 900.0, -850.0
    where["tissue"] = (across < 0.75) & (hu == 40)
    return hu + np.random.default_rng(1).normal(0, 15, hu.shape), where


# A factor of the values, and what fills the corners outside of the scanner's circle.
FILLS = {
    **{f"{value:g}": (1.0, value) for value in (-2000, -3024, -32768, 1e20, -1e30, np.nan)},
    **{f"times {factor:g}": (factor, -1000.0 * factor) for factor in (1e-20, 1e-15, 1e20, 1e27)},
}


@pytest.mark.parametrize("name", [*FILLS, "uint16", "uint16 from 31768", "HU"])
def test_a_scan_looks_the_same_however_it_is_stored(name):
    hu, where = _scan()
    if name in FILLS:
        factor, fill = FILLS[name]
        values = np.where(where["outside"], fill, hu * factor).astype(np.float32)
    else:
        offset = {"uint16": 1100, "uint16 from 31768": 32768}.get(name, 0)
        values = (hu + offset).astype(np.uint16 if offset else np.int16)
    with warnings.catch_warnings(action="ignore"):
        volume = Volume(values, metadata=Metadata(unit="HU" if name == "HU" else ""))
    counts = histogram(volume)
    made = presets.fit_preset(presets.BY_NAME["soft-hard"], volume, counts, DEFAULT_GRID)
    table = bake_for_volume(made, volume)
    low, high = table.domain
    at = np.rint((volume.values.astype(float) - low) / (high - low) * (len(table.opacity) - 1))
    opacity = table.opacity[np.clip(at, 0, len(table.opacity) - 1).astype(int)]
    shown = {tissue: float(opacity[mask].mean()) for tissue, mask in where.items()}
    assert max(shown[tissue] for tissue in ("air", "outside", "lung")) < 1e-4
    assert shown["tissue"] == pytest.approx(0.014, rel=0.01) and 0.8 < shown["bone"] < 0.95


def test_an_unknown_preset_is_named_with_the_nearest():
    with raises(InputError, "unknown", "preset") as refused:
        presets.preset_named("bones")
    assert "'bone'" in refused.value.remedy
