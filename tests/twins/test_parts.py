"""A cast part by part against the cast of the whole volume, pixel by pixel."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

import volspec as vs
from tests.support.fixtures import slow, slow_each
from tests.support.pyramids import in_parts_of, pyramid_of
from tests.support.raycasts import oblique_world, turned
from volspec.raycast.launch.bricks import brick_ranges, visible_by_table

# Measured 5e-5, where rays end a sample earlier or later; elsewhere 1e-6.
TOLERANCE = 2e-4
LIT = (
    vs.LightGroup("sky", (vs.Ambient(occlusion=True), vs.Headlight())),
    vs.LightGroup("lamp", (vs.Directional((1, 1, 1), shadows=True),)),
)
MATERIALS = {"skin": vs.reflectance("PMC/Caucasian"), "bone": vs.reflectance("PMC/White")}
BASIS = vs.MaterialBasis(MATERIALS)
STEP = vs.RaycastSpec(step_mm=0.8)


def curve(low: float, high: float) -> vs.TransferFunction:
    """Return a function that shows a veil from a value on, and something dense above another."""
    points = [(low, 0.0, "skin"), (low + 10, 0.02, "skin"), (high, 0.4, "bone")]
    return vs.TransferFunction(points=points, materials=MATERIALS, basis=BASIS)


VEIL = curve(40, 150)


@pytest.fixture(scope="module")
def engine() -> vs.Volume:
    return vs.load_volume("engine").downsampled(2)


def compare(
    volume: vs.Volume, transfer: Any, camera: vs.Camera, spec: vs.RaycastSpec, **how: Any
) -> vs.Volume:
    """Cast a volume whole and part by part; return the one of parts."""
    big, size = pyramid_of(volume, **how), (60, 48)
    whole = vs.raycast(volume, transfer, camera, size, spec)
    parts = vs.raycast(big, transfer, camera, size, replace(spec, level=0))
    if spec.half:
        assert np.abs(whole.coefficients.astype(float) - parts.coefficients).max() < 2e-3
    else:
        assert_same(whole, parts)
    return big


def assert_same(whole: vs.CoefficientImage, parts: vs.CoefficientImage) -> None:
    """Compare all pixels: channels, alpha, expected depth and first hit."""
    assert whole.alpha.max() > 0.2, "nothing is seen, so nothing is compared"
    assert np.abs(whole.coefficients - parts.coefficients).max() < TOLERANCE
    assert np.abs(whole.alpha - parts.alpha).max() < TOLERANCE
    seen = whole.alpha > 0.01
    assert np.allclose(whole.depth_mm[seen], parts.depth_mm[seen], atol=2e-2)
    assert np.array_equal(np.isfinite(whole.first_mm), np.isfinite(parts.first_mm))


@pytest.mark.parametrize("name", ["engine", slow("foot")])
@pytest.mark.parametrize("side", [32, *slow_each(64, 90)])
def test_parts_of_any_size_make_the_picture_of_the_whole(name, side, monkeypatch, request):
    own = name == "engine"
    volume = vs.load_volume(name if own else request.getfixturevalue("volumes") / f"{name}.nrrd")
    in_parts_of(monkeypatch, side)
    spec = vs.RaycastSpec(step_mm=0.7, specular=0.3)
    compare(volume, VEIL, vs.Camera.orbit(volume, zoom=1.4), spec, chunk=side)


@pytest.mark.parametrize("mode", ["composite", "maximum"])
def test_parts_that_begin_within_a_brick(mode, monkeypatch):
    in_parts_of(monkeypatch, 18)
    volume = vs.Volume(np.pad(np.full((20, 26, 2), 200, np.uint8), ((2, 2), (2, 2), (32, 0))))
    compare(volume, VEIL, turned(volume, 30, 20), replace(STEP, mode=mode), chunk=8)


SETTINGS = {
    "lit": replace(STEP, groups=LIT),
    "jitter": replace(STEP, jitter=1.0, seed=3),
    "half": replace(STEP, half=True),
    # Further kernels of the same features.
    "physical": replace(STEP, groups=LIT, physical_light=True),
    "flat": replace(STEP, ambient=1.0, diffuse=0.0, alpha_stop=1.0),
    "maximum": replace(STEP, mode="maximum"),
    "average": replace(STEP, mode="average"),
    "preintegrated": vs.RaycastSpec(step_mm=2.7, preintegrated=True),
}


@pytest.mark.slow
@pytest.mark.parametrize("ranges", [True, False], ids=["known ranges", "unknown ranges"])
@pytest.mark.parametrize("name", SETTINGS)
def test_settings(engine, name, ranges, monkeypatch):
    in_parts_of(monkeypatch, 32, 64, 64)
    compare(engine, VEIL, turned(engine, 200, -35), SETTINGS[name], ranges=ranges)


@pytest.mark.parametrize("orthographic", [True, False])
@pytest.mark.parametrize("azimuth", [90, *slow_each(0, 225)])
def test_cameras_along_planes_between_parts(engine, azimuth, orthographic, monkeypatch):
    # Rays that run in a plane between two parts are in one of them only.
    in_parts_of(monkeypatch, 32)
    camera = turned(engine, azimuth, 0, orthographic=orthographic, zoom=1.5)
    compare(engine, VEIL, camera, vs.RaycastSpec(step_mm=1.0))


def test_a_camera_within_the_volume(engine, monkeypatch):
    in_parts_of(monkeypatch, 32)
    middle = engine.corners_mm.mean(axis=0)
    camera = vs.Camera(tuple(middle), tuple(middle + [30, 20, 8]), fov_deg=80)
    compare(engine, VEIL, camera, vs.RaycastSpec(step_mm=0.9))


@pytest.mark.slow
def test_cuts_are_in_voxels_of_the_finest_level(engine, monkeypatch):
    in_parts_of(monkeypatch, 32, 64, 32)
    camera = vs.Camera.orbit(engine)
    plane = vs.ClipPlane(tuple(engine.corners_mm.mean(axis=0)), (1.0, 0.3, 0.2))
    crop = ((6, 101), (17.5, 90), (0, 50))
    spec = vs.RaycastSpec(step_mm=0.9, groups=LIT, crop_voxels=crop, clip_planes=(plane,))
    big = compare(engine, VEIL, camera, spec)
    # The level in memory is cut at about the same place.
    whole, coarse = (
        vs.raycast(each, VEIL, camera, (60, 48), replace(spec, level=level))
        for each, level in ((engine, None), (big, 1))
    )
    assert np.abs(whole.alpha - coarse.alpha).mean() < 0.03


@pytest.mark.slow
def test_oblique_floats_with_missing_voxels(monkeypatch):
    in_parts_of(monkeypatch, 32)
    z, y, x = np.mgrid[-1:1:70j, -1:1:66j, -1:1:75j]
    values = np.exp(-3 * (x**2 + y**2 + z**2)).astype(np.float32)
    values[20:40, 30:36, 30:50] = np.nan
    with pytest.warns(match="transparent"):
        volume = vs.Volume(values, world_from_index=oblique_world())
    points = [(0.3, 0.0, "skin"), (0.5, 0.1, "skin"), (0.9, 0.4, "bone")]
    transfer = replace(VEIL, points=points)
    compare(volume, transfer, vs.Camera.orbit(volume), vs.RaycastSpec(step_mm=0.6))


@pytest.mark.slow
@pytest.mark.parametrize("kind", ["surfaces", "labels"])
def test_surfaces_and_labels(engine, kind, monkeypatch):
    in_parts_of(monkeypatch, 32)
    volume: vs.Volume = engine
    transfer: Any = vs.Isosurfaces([(70, 0.4, "skin"), (180, 1.0, "bone")], MATERIALS, BASIS)
    if kind == "labels":
        volume = vs.Volume((engine.values // 80).astype(np.uint8), spacing_mm=engine.spacing_mm)
        transfer = vs.LabelFunction({1: (0.05, "skin"), 2: (0.6, "bone")}, MATERIALS, BASIS)
    compare(volume, transfer, vs.Camera.orbit(engine), replace(STEP, groups=LIT))


@pytest.mark.parametrize("table", ["shell", slow("surface")])
def test_only_blocks_that_samples_read_are_read(engine, table, monkeypatch):
    in_parts_of(monkeypatch, 32, 64, 64)
    points = [(140, 0.0, "skin"), (150, 0.4, "bone"), (160, 0.4, "bone"), (170, 0.0, "skin")]
    surface = vs.Isosurfaces([(150, 1.0, "skin")], MATERIALS, BASIS)
    transfer = replace(VEIL, points=points) if table == "shell" else surface
    camera = vs.Camera.orbit(engine, elevation_deg=50)
    big = compare(engine, transfer, camera, replace(STEP, specular=0.3))
    read = big.pyramid.counts.voxel_bytes / engine.values.nbytes
    cells = visible_by_table(*brick_ranges(engine.values), vs.Raycaster(engine).bake(transfer))
    assert cells.mean() < read < 0.75, "neither all blocks, nor only those that are visible"


def test_rays_end_before_what_is_hidden_is_read(monkeypatch):
    in_parts_of(monkeypatch, 32)
    values = np.full((32, 32, 129), 200, np.uint8)
    values[:, :, 100:] = 60
    volume = pyramid_of(vs.Volume(values), 32)
    spec = vs.RaycastSpec(step_mm=1.0, level=0)
    vs.raycast(volume, VEIL, turned(volume, 90, 0, zoom=9), (16, 16), spec)
    # The far end, behind 70 opaque voxels, is not read.
    assert 0 < volume.pyramid.counts.chunks < volume.pyramid.levels[0].grid[2]


def test_a_maximum_needs_only_parts_with_greater_values(monkeypatch):
    in_parts_of(monkeypatch, 32)
    values = np.full((33, 33, 289), 100, np.uint8)
    values[:, :, 140:150] = 220
    volume = pyramid_of(vs.Volume(values), 32)
    spec = vs.RaycastSpec(step_mm=1.0, mode="maximum", level=0)
    image = vs.raycast(volume, VEIL, turned(volume, 90, 0, zoom=9), (16, 16), spec)
    assert np.allclose(image.alpha, image.alpha.max())
    # Of nine parts, one is needed, and the next was read with it.
    assert volume.pyramid.counts.voxel_bytes < 0.6 * values.nbytes


def test_a_caster_casts_every_level(engine):
    big = pyramid_of(engine)
    caster, given = vs.Raycaster(big), (big, VEIL, vs.Camera.orbit(big), (40, 40))
    for level in (1, 0, 1):
        image = vs.raycast(*given, vs.RaycastSpec(level=level), caster=caster)
        assert image.alpha.max() > 0.3
