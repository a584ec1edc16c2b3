"""Physical light: that of rays through the voxels, in pictures of scanned volumes."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from benchmarks.scenes import bench_scene
from tests.support import brute_force
from tests.support.fixtures import slow
from volspec.camera import Camera
from volspec.pipeline import Raycaster
from volspec.raycast import Ambient, Directional, LightGroup, RaycastSpec
from volspec.transfer import TransferTable
from volspec.volume import Volume

SIZE = 16, 16
KEY = Directional((-0.6, 0.5, 0.7), frame="camera", shadows=True)
SKY = Ambient(occlusion=True)


def specs_of(source: Ambient | Directional, **settings: Any) -> tuple[RaycastSpec, RaycastSpec]:
    """Return settings with a light, and with its shadows or occlusion left out."""
    kind = "occlusion" if isinstance(source, Ambient) else "shadows"
    usual = {"ambient": 1, "diffuse": 1, "alpha_stop": 0.99, "physical_light": True}
    shaded, bare = (
        RaycastSpec(groups=(LightGroup("light", (each,)),), **(usual | settings))
        for each in (source, replace(source, **{kind: False}))
    )
    return shaded, bare


@pytest.mark.slow
@pytest.mark.parametrize("source", [KEY, SKY], ids=["key", "sky"])
@pytest.mark.parametrize("name", ["engine", "mrbrain", "foot"])
def test_light_is_that_of_rays_through_the_voxels(name, source):
    """At half the resolution, for the time of the rays; the part of light that pixels get."""
    try:
        scene = bench_scene(name)
    except FileNotFoundError as missing:
        pytest.skip(str(missing))
    volume = scene.volume.downsampled(2)
    table = scene.transfer.bake(min(scene.volume.spacing_mm))
    white = np.ones((table.channels.shape[0], 1))
    table = replace(table, channels=white, white=np.ones(1))
    specs = specs_of(source, step_mm=min(volume.spacing_mm))
    truth, alpha = brute_force.cast(volume, table, scene.camera, SIZE, specs[0])
    caster = Raycaster(volume)
    ours, bare = (
        caster.cast(table, scene.camera, SIZE, spec).coefficients.reshape(len(alpha), -1)[:, 0]
        for spec in specs
    )
    seen = alpha > 0.5
    off = (ours[seen] - truth[seen, 0]) / bare[seen]
    mean = (truth[seen, 0] / bare[seen]).mean()
    assert abs(off.mean()) < 0.05 * mean
    assert np.sqrt((off**2).mean()) < 0.1


@pytest.mark.parametrize("slant", [slow(0.0), 0.3])
def test_no_light_leaks_through_a_wall_of_two_voxels(slant):
    values = np.zeros((48, 48, 48), np.float32)
    values[40:42] = 200  # a wall under the light, above the matter that is seen
    values[:20] = 100
    table = TransferTable((99.0, 200.0), np.array([0, 0.98, 0.98]), np.ones((3, 1)), 1.0)
    camera = Camera((24, -60, 12), (24, 24, 12), up=(0, 0, 1), height_mm=12)
    sun, caster = Directional((slant, 0, 1), shadows=True), Raycaster(Volume(values))
    specs = specs_of(sun, ambient=0, step_mm=1.0)
    lit, bare = (caster.cast(table, camera, SIZE, spec) for spec in specs)
    assert lit.alpha.min() > 0.5
    assert lit.coefficients.max() < 0.01 * bare.coefficients.max()
