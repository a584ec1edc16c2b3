"""Two-byte voxels, whose gradients are made of whole numbers, are shaded as all others."""

from __future__ import annotations

import numpy as np
import pytest

import volspec as vs
from volspec.raycast import reference
from volspec.transfer import TransferTable

RANGES = {"int16": (-32768, 32767), "uint16": (0, 65535)}


def table(low: float, high: float) -> TransferTable:
    at = np.linspace(0.0, 1.0, 256)
    return TransferTable(
        (low, high), np.full(256, 0.2), np.stack([0.1 + 0.8 * at, 0.8 - 0.5 * at], 1), 1.0
    )


def worst(volume: vs.Volume, spec: vs.RaycastSpec, lanes: int) -> float:
    """Greatest difference over the greatest coefficient."""
    camera, baked = vs.Camera.orbit(volume), table(*volume.range)
    ours = vs.Raycaster(volume, lanes=lanes).cast(baked, camera, (40, 40), spec).coefficients
    truth = reference.cast(volume, baked, camera, (40, 40), spec)[0]
    return float(np.abs(ours - truth).max() / truth.max())


@pytest.mark.parametrize("dtype", RANGES)
@pytest.mark.parametrize("flat", [0.0, 1e-4, 0.02])
@pytest.mark.parametrize("lanes", [1, 8])
def test_stripes_along_x_have_no_gradient_across(dtype: str, flat: float, lanes: int) -> None:
    """With flat_gradient=0 all that does not cancel is seen; rounded weights alone made .3."""
    values = np.full((12, 12, 12), RANGES[dtype][0] // 2, dtype)
    values[:, :, ::2] = RANGES[dtype][1] // 2
    spec = vs.RaycastSpec(specular=0.5, flat_gradient=flat)
    assert worst(vs.Volume(values), spec, lanes) < 5e-5


@pytest.mark.parametrize("dtype", RANGES)
@pytest.mark.parametrize("shininess", [24, 63, 64, pytest.param(1024, marks=pytest.mark.slow)])
def test_noise_of_the_whole_range_is_as_glossy(dtype: str, shininess: int) -> None:
    for seed in range(3):
        rng = np.random.default_rng(seed)
        low, high = RANGES[dtype]
        values = rng.integers(low, high, (3, 5, 7), dtype, endpoint=True)
        spec = vs.RaycastSpec(specular=1.0, shininess=shininess)
        assert worst(vs.Volume(values), spec, 8) < 2e-4
