"""The kernel's layers of opacity against the NumPy stream, as the pictures they recompose."""

import itertools
from dataclasses import replace

import numpy as np
import pytest

from tests.support.raycasts import labelled, oblique_world, turned
from volspec.image.layers import OpacityLayers
from volspec.large import Raycaster
from volspec.raycast import RaycastSpec, reference
from volspec.raycast.launch.layer_stream import empty_rows, shadow_slots
from volspec.raycast.launch.light_volume import Visibility
from volspec.raycast.lights import Ambient, Directional, Headlight, LightGroup, Point
from volspec.transfer import TransferTable
from volspec.volume import Volume

# Where a mass is so close to the limit that float32 passes it a sample sooner or later, layers
# differ, and pictures by as much as layers err; else as `tests/twins/test_raycast.py`, measured
# 8e-6.
TOLERANCE, MOVED = 1e-4, 2
SIZE = 16, 16
TWO = (
    LightGroup("key", (Directional((1.0, 1.0, 1.0), shadows=True),)),
    LightGroup("fill", (Ambient(), Headlight())),
)


def noise(side: int = 12, **more: object) -> Volume:
    values = np.random.default_rng(7).random((side, side, side)).astype(np.float32)
    return Volume(values, **more)


def blend(top: float, materials: int = 3) -> TransferTable:
    """Opacity that rises to ``top``; each material gives way to the next."""
    at = np.linspace(0, materials - 1, 128)
    weights = np.maximum(1 - np.abs(at[:, None] - np.arange(materials)), 0)
    return TransferTable((0.0, 1.0), np.linspace(0, top, 128), weights, 1.0)


def assert_layers_alike(
    volume: Volume,
    table: TransferTable,
    spec: RaycastSpec,
    clear: Visibility | None = None,
    **settings: int,
) -> None:
    given = table, turned(volume, 30, 20), SIZE, spec
    picture, true = reference.cast_layers(volume, *given, clear=clear)
    rows = empty_rows(table, SIZE, spec)
    ours = Raycaster(volume, **settings).cast(*given, clear=clear, layers=rows)
    assert np.abs(ours.coefficients - picture[0]).max() < TOLERANCE
    assert picture[1].max() > 0.05
    K = len(table.channels)
    own = range(K), K, len(spec.groups), shadow_slots(spec)
    both = [OpacityLayers.of_rows(each.astype(np.float32), *own) for each in (rows, true)]
    for scales in itertools.product((0.0, 0.3, 4.0), repeat=K):
        one, other = (layers.recompose(scales) for layers in both)
        off = np.abs(one.channels - other.channels).reshape(*SIZE, -1).max(axis=2)
        off = np.maximum(off, np.abs(one.alpha - other.alpha))
        assert np.sort(off, axis=None)[-1 - MOVED] < TOLERANCE, scales
        # The worst pixels differ by no more than what another layer may.
        assert off.max() < 0.02, scales
    used = [np.isfinite(layers.depth_mm) for layers in both]
    assert (used[0] != used[1]).any(axis=2).sum() <= MOVED
    there = used[0] & used[1]
    apart = both[0].depth_mm[there] - both[1].depth_mm[there]
    assert np.median(np.abs(apart)) < 1e-3


@pytest.mark.slow
@pytest.mark.parametrize("lanes", [8, 1, 4])
def test_every_packet_finds_the_stream_s_layers(lanes):
    spec = RaycastSpec(layers=4, step_mm=0.25, specular=0.3, alpha_stop=1.0)
    assert_layers_alike(noise(), blend(0.4), spec, lanes=lanes)


@pytest.mark.slow
# Each number is a kernel of its own.
@pytest.mark.parametrize("layers", [4, 1, 2, 16])
def test_any_number_of_layers_is_that_of_the_stream(layers):
    spec = RaycastSpec(layers=layers, step_mm=0.25, specular=0.3)
    assert_layers_alike(noise(world_from_index=oblique_world()), blend(0.4), spec)


@pytest.mark.slow
def test_shadows_and_two_light_groups_of_four_materials():
    spec = RaycastSpec(layers=8, step_mm=0.5, groups=TWO, specular=0.2, light_cells=8)
    assert_layers_alike(noise(8), blend(0.3, 4), spec)


@pytest.mark.slow
@pytest.mark.parametrize("lanes", [1, 8])
def test_every_shadow_and_occlusion_in_one_group(lanes):
    near = Point((20.0, 30.0, 25.0), shadows=True, falloff_mm=30.0)
    lights = (*TWO[0].sources, Ambient(occlusion=True, radius_mm=5.0), near, Headlight(0.2))
    groups = LightGroup("key", lights), LightGroup("sky", (Ambient(occlusion=True),))
    spec = RaycastSpec(layers=6, step_mm=0.5, groups=groups, specular=0.2, light_cells=8)
    assert_layers_alike(noise(8), blend(0.4, 2), spec, lanes=lanes)


@pytest.mark.slow
@pytest.mark.parametrize("kind", ["opaque", "labels"])
def test_opaque_samples_and_labels(kind):
    volume, spec = noise(), RaycastSpec(layers=4, step_mm=0.5)
    table = replace(blend(1.0), opacity=np.where(np.arange(128) < 90, 0.02, 1.0))
    if kind == "labels":
        values = np.random.default_rng(3).integers(0, 3, (8, 8, 8)).astype(np.uint8)
        volume, table = Volume(values), labelled([0.0, 0.1, 0.4])
    assert_layers_alike(volume, table, spec)


@pytest.mark.slow
def test_the_picture_is_that_without_layers():
    """Its rays end where they would; layers go on."""
    volume, table, spec = noise(), blend(0.9), RaycastSpec(step_mm=0.5, specular=0.3, layers=4)
    given, caster = (table, turned(volume, 30, 20), SIZE), Raycaster(volume)
    layered = caster.cast(*given, spec, layers=empty_rows(table, SIZE, spec))
    plain = caster.cast(*given, replace(spec, layers=0))
    for one, other in zip(layered, plain, strict=True):
        finite = np.isfinite(other)
        assert np.array_equal(np.isfinite(one), finite)
        assert np.abs(one[finite] - other[finite]).max() < 1e-4
