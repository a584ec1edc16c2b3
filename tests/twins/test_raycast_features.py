"""Each feature of the ray loop against the float64 reference, pixel by pixel."""

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

import volspec as vs
from tests.support.fixtures import slow, slow_each
from tests.support.raycasts import FLAT, fog, metal_function, ramp, soft_ball, turned
from tests.twins.test_raycast import assert_alike
from volspec.raycast import reference
from volspec.raycast.launch.row_batches import Result
from volspec.transfer import SurfaceTable, TransferTable
from volspec.transfer.nan_voxels import transparent_below

SKY = vs.LightGroup("sky", (vs.Ambient(),))
SUN = vs.Directional((1, 0.5, 1), shadows=True)
METAL_RAMP = metal_function((0.5, 0.2, "copper"), (1.5, 0.9, "gold"))
KEY = vs.LightGroup("key", (vs.Directional((1, 2, 1), frame="camera"), vs.Headlight(0.2)))
POINTS = vs.Point((140, 10, 200), falloff_mm=150), vs.Point((-30, 20, 10), "camera")
TORCH = vs.Spot((-30, 20, 10), "camera", target_mm=(0, 0, -300), cone_deg=9, falloff_mm=300)
LAMP = vs.LightGroup("lamp", (*POINTS, TORCH))


@pytest.fixture(scope="session")
def tables(engine_table: TransferTable, three_channels: TransferTable) -> dict[int, TransferTable]:
    """Lanes: one ray with shares in vectors of eight, several with shares in vectors of four."""
    return {1: engine_table, 4: three_channels, 8: three_channels}


@pytest.fixture
def matches(engine: vs.Volume, tables: dict[int, TransferTable]) -> Callable[..., Result]:
    """Compare pictures of the engine with the reference's."""

    def check(spec: vs.RaycastSpec, lanes: int = 8, **how: Any) -> Result:
        table = how.pop("table", tables[lanes])
        camera = how.pop("camera", vs.Camera.orbit(engine))
        return assert_alike(engine, table, camera, spec, lanes=lanes, **how)

    return check


# Not every pair: each is a kernel of its own, which takes seconds to compile.
@pytest.mark.parametrize(
    ("lanes", "specular"), [slow(*own) for own in ((8, 0.4), (1, 0.4), (4, 0.0))]
)
def test_light_groups_match_reference(matches, lanes, specular):
    ours = matches(vs.RaycastSpec(groups=(SKY, KEY, LAMP), specular=specular), lanes)
    assert ours.coefficients.shape[2] == 3 * (7 if lanes == 1 else 3)


@pytest.mark.parametrize("orthographic", [False, slow(True)])
def test_jittered_steps_match_reference(matches, engine, orthographic):
    camera = vs.Camera.orbit(engine, orthographic=orthographic)
    for seed in (0, 4294967295):
        matches(vs.RaycastSpec(jitter=1, seed=seed, step_mm=1.5), camera=camera)


PLANE = vs.ClipPlane((128, 128, 55), (1, 1, 1))
CROPPED = vs.RaycastSpec(crop_voxels=((40.5, 180), (-5, 120.25), (30, 500)))
PLANES = tuple(replace(PLANE, normal=normal) for normal in ((1, 0, 0), (0, 1, 0)))
BOTH = vs.RaycastSpec(crop_voxels=((10, 240), (10, 240), (5, 100)), clip_planes=PLANES)


@pytest.mark.parametrize(
    ("spec", "view"),
    [
        (CROPPED, (30, 20)),
        (vs.RaycastSpec(clip_planes=(PLANE,)), (30, 20)),
        (BOTH, (0, 0)),
        *(slow(BOTH, view) for view in ((30, 20), (90, 0))),
    ],
)
def test_cut_volumes_match_reference(matches, engine, spec, view):
    matches(spec, camera=turned(engine, *view))


def steep_table(three_channels: TransferTable) -> TransferTable:
    """Opacity only where the value changes: a table of 16 gradients."""
    rows = np.linspace(0, 1, 16)[:, None]
    opacity = rows**0.5 * three_channels.opacity * 1.5
    weights = (0.4 + 0.6 * rows[..., None]) * three_channels.material_weights
    return replace(three_channels, opacity=opacity, material_weights=weights, gradient_top=60.0)


@pytest.mark.parametrize("diffuse", [slow(0.0), 0.7])
def test_tables_of_value_and_gradient_match_reference(matches, three_channels, diffuse):
    matches(vs.RaycastSpec(diffuse=diffuse), table=steep_table(three_channels))


def labelled(dtype: type) -> tuple[vs.Volume, TransferTable]:
    """Two nested balls and a slab of labels 3, 7 and 250; 9 is in the volume, not in the table."""
    z, y, x = np.mgrid[0:40, 0:40, 0:40]
    away = np.sqrt((x - 19.3) ** 2 + (y - 20.1) ** 2 + (z - 18.7) ** 2)
    values = np.select([away < 8, away < 15, z > 35, x > 37], [7, 3, 250, 9], 0)
    opacity, shares = np.zeros(251), np.zeros((251, 3))
    opacity[[3, 7, 250]], shares[[3, 7, 250]] = (0.1, 0.8, 0.3), np.eye(3)
    table = TransferTable((0.0, 250.0), opacity, shares, 1.0, labels=True)
    return vs.Volume(values.astype(dtype), spacing_mm=(1, 1, 1.4)), table


@pytest.mark.parametrize("dtype", [np.uint8, *slow_each(np.uint16, np.int16)])
def test_labels_match_reference(dtype):
    """If two labels cover equally within rounding, either may show: few pixels may differ."""
    volume, table = labelled(dtype)
    camera = vs.Camera.orbit(volume, azimuth_deg=37)
    assert_alike(volume, table, camera, vs.RaycastSpec(specular=0.2))


@pytest.mark.parametrize("axis", [0, *slow_each(1, 2)])
@pytest.mark.parametrize("dtype", [np.uint8, *slow_each(np.int16, np.float32)])
def test_gradients_at_the_faces_match_reference(axis, dtype):
    """The voxel beyond a face is the face's own: nothing is read outside the volume."""
    shape = [7, 9, 11]
    shape[axis] = 2
    rng = np.random.default_rng(axis)
    volume = vs.Volume((rng.uniform(0, 200, shape)).astype(dtype))
    table = ramp(0.3, 200.0)
    for view in ((30, 20), (0, 0), (90, 0), (0, 90)):
        camera = turned(volume, *view, zoom=1.5)
        assert_alike(volume, table, camera, vs.RaycastSpec(specular=0.3), size=(24, 24))


def test_first_hit_is_where_the_opacity_passes_its_threshold():
    volume, spec = vs.phantom.slab(24, 24), replace(FLAT, first_opacity=0.3)
    ours = assert_alike(volume, fog(0.2), turned(volume, 0, 0), spec)
    hit = np.isfinite(ours.first_mm)
    assert (ours.alpha[hit] >= 0.3 - 1e-6).all() and (ours.alpha[~hit] < 0.3).all()
    assert (ours.first_mm[hit] <= ours.depth_mm[hit] + 12).all()


@pytest.mark.parametrize("mode", ["maximum", slow("average")])
@pytest.mark.parametrize("lanes", [slow(1), 8])
def test_projections_match_reference(matches, tables, mode, lanes):
    table = replace(tables[lanes], domain=(0.0, 255.0))
    matches(vs.RaycastSpec(mode=mode, groups=(SKY, KEY)), lanes, table=table, plateaus=True)


@pytest.mark.parametrize("lanes", [8, slow(1)])
def test_an_eye_at_a_corner_or_on_a_cut_is_inside(lanes):
    """No light is read above the face or plane that the eye is on."""
    volume, groups = soft_ball(16), (replace(KEY, sources=(SUN, vs.Ambient(occlusion=True))),)
    cut = vs.ClipPlane((0, 0, 4), (0, 0, 1))
    for eye, planes in (((0, 0, 0), ()), ((15, 0, 7), ()), ((3, 3, 4), (cut,))):
        camera = vs.Camera(eye, (7.5, 7.5, 8), fov_deg=70)
        spec = vs.RaycastSpec(groups=groups, light_cells=16, step_mm=0.5, clip_planes=planes)
        assert_alike(volume, ramp(0.4), camera, spec, lanes=lanes, tolerance=3e-4)


@pytest.mark.parametrize("mode", ["average", slow("maximum")])
def test_projections_leave_out_rays_that_touch_an_edge(mode):
    """The first and last columns are the box's edges, seen along its diagonal."""
    volume = vs.Volume(np.random.default_rng(0).uniform(0.3, 1, (9, 9, 9)).astype(np.float32))
    for azimuth_deg in (45, 135):
        camera = turned(volume, azimuth_deg, 0, orthographic=True)
        camera = replace(camera, height_mm=8 * np.sqrt(2) * 17 / 16)
        spec = vs.RaycastSpec(mode=mode, step_mm=0.5)
        ours = assert_alike(volume, ramp(0.9), camera, spec, (17, 17), plateaus=True)
        assert not ours.alpha[:, [0, -1]].any() and ours.alpha[4:-4, 1:-1].all()


@pytest.mark.parametrize("mode", ["average", slow("maximum")])
def test_projections_leave_out_missing_voxels(mode):
    """Inner and outer ones; a ray that meets only cells with them is empty."""
    _, y, x = np.mgrid[:16, :16, :16] - 7.5
    values = np.where(x**2 + y**2 < 49, 1 + 0.05 * x, np.nan).astype(np.float32)
    values[8, 5:8, 6] = np.nan
    with pytest.warns(match="transparent"):
        volume = vs.Volume(values)
    table = vs.Raycaster(volume).bake(METAL_RAMP)
    camera = turned(volume, 40, 25, zoom=1.5)
    spec = vs.RaycastSpec(mode=mode, step_mm=0.3)
    ours = assert_alike(volume, table, camera, spec, plateaus=True)
    seen = ours.alpha > 0
    assert seen.any() and not seen.all() and ours.alpha[seen].min() > 0.3


SURFACES = SurfaceTable(
    values=np.array([90.0, 150.5, 200.0]),
    opacity=np.array([0.3, 0.5, 1.0]),
    material_weights=np.eye(3),
    channels=np.array([[0.9, 0.2, 0.4, 0.1], [0.1, 0.8, 0.3, 0.2], [0.3, 0.3, 0.9, 1.0]]),
)


@pytest.mark.parametrize("lanes", [slow(1), 8])
def test_isosurfaces_match_reference(matches, lanes):
    """A ray that grazes a surface may meet it in one precision and not in the other."""
    spec = vs.RaycastSpec(specular=0.3, groups=(SKY, KEY), step_mm=3.0)
    matches(spec, lanes, table=SURFACES, grazing=2)


@pytest.mark.parametrize("dtype", [np.uint8, *slow_each(np.int16, np.float32)])
def test_isosurfaces_are_the_same_at_any_step(dtype):
    """Walls thinner than a voxel, also along the rays, and a plateau that just reaches a level."""
    values = np.random.default_rng(6).integers(0, 200, (14, 13, 12))
    values[4:7, 4:7, 4:7], values[9, :, :] = 200, 0
    volume = vs.Volume(values.astype(dtype))
    table = replace(SURFACES, values=np.array([60.0, 120.5, 200.0]))
    caster = vs.Raycaster(volume)
    for camera in (turned(volume, 30, 20), turned(volume, 90, 0, orthographic=True)):
        given = table, camera, (96, 96)
        whole = reference.cast(volume, *given, replace(FLAT, step_mm=4.0, alpha_stop=1))
        for step_mm in (4.0, 0.05):
            ours = caster.cast(*given, replace(FLAT, step_mm=step_mm, alpha_stop=1))
            assert (np.abs(ours.alpha - whole[1]) > 1e-4).sum() <= 2  # grazed


def steep(three_channels: TransferTable) -> TransferTable:
    """Thin opaque shells."""
    at = np.linspace(*three_channels.domain, 1024)
    opacity = np.interp(at, [79, 80, 81, 149, 150, 151], [0, 0.4, 0, 0, 0.9, 0])
    return replace(three_channels, opacity=opacity)


@pytest.mark.parametrize(("lanes", "kind"), [slow(1, "surfaces"), (8, "surfaces"), (8, "curve")])
def test_voxels_next_to_missing_ones_match_reference(half_engine, three_channels, lanes, kind):
    values = half_engine.values.astype(np.float32)
    values[::9, ::7, ::5] = values[20:30, 40:] = np.nan
    with pytest.warns(match="NaN"):
        holes = vs.Volume(values, spacing_mm=(1, 1.2, 1.7))
    table = SURFACES if kind == "surfaces" else transparent_below(three_channels, holes.range[0])
    grazing = 2 if kind == "surfaces" else 0
    spec = vs.RaycastSpec(step_mm=0.7)
    assert_alike(holes, table, vs.Camera.orbit(holes), spec, lanes=lanes, grazing=grazing)


@pytest.mark.parametrize("lanes", [slow(1), 8])
def test_preintegrated_steps_match_reference(matches, tables, lanes):
    """A shell one value thick turns the positions' rounding into some 4e-4 of opacity."""
    spec = vs.RaycastSpec(preintegrated=True)
    matches(spec, lanes)
    matches(spec, lanes, table=steep(tables[lanes]), tolerance=1e-3)


@pytest.mark.parametrize(("lanes", "specular"), [slow(1, 0.5), (8, 0.0)])
def test_spectral_absorption_matches_reference(matches, tables, specular, lanes):
    rng = np.random.default_rng(4)
    knots = rng.uniform(0, 1, (tables[lanes].size, 5))
    filters = np.stack([np.interp(np.linspace(0, 4, 1024), range(5), row) for row in knots], axis=1)
    spec = vs.RaycastSpec(specular=specular, groups=(SKY, KEY))
    matches(spec, lanes, table=replace(tables[lanes], filters=filters))


@pytest.mark.slow
@pytest.mark.parametrize("preintegrated", [False, True])
def test_adaptive_steps_stay_near_the_whole_truth(engine, three_channels, preintegrated):
    caster, given = vs.Raycaster(engine), (three_channels, vs.Camera.orbit(engine), (128, 128))
    whole = replace(FLAT, preintegrated=preintegrated)
    true, ours = (caster.cast(*given, replace(whole, adaptive=a)).coefficients for a in (0, 0.02))
    assert not np.array_equal(ours, true) and np.abs(ours - true).mean() < 2e-3


@pytest.mark.parametrize("physical", [False, slow(True)])
def test_shadows_and_occlusion_match_reference(half_engine, three_channels, physical):
    groups = (
        vs.LightGroup("sky", (vs.Ambient(occlusion=True),)),
        vs.LightGroup("sun", (vs.Directional((1, -1, 2), shadows=True), vs.Headlight(0.1))),
        vs.LightGroup("lamp", (vs.Point((128, -60, 160), shadows=True),)),
    )
    spec = vs.RaycastSpec(specular=0.3, groups=groups, light_cells=40, physical_light=physical)
    volume = half_engine.downsampled(3) if physical else half_engine
    assert_alike(volume, three_channels, vs.Camera.orbit(volume), spec)


@pytest.mark.slow
# Each is a kernel of its own, which takes seconds to compile.
@pytest.mark.parametrize("mode", ["composite", "surfaces", "maximum", "average", "preintegrated"])
def test_rays_are_cast_within_their_spans(engine, three_channels, mode):
    """A half ends in the middle of the volume, a corner before it; the last rows begin there."""
    table: TransferTable | SurfaceTable = three_channels
    spec = vs.RaycastSpec(jitter=0.5)
    if mode == "surfaces":
        table = SurfaceTable(np.array([150.5]), np.array([0.4]), np.ones((1, three_channels.size)))
    elif mode == "preintegrated":
        spec = vs.RaycastSpec(preintegrated=True)
    else:
        spec = replace(spec, mode=mode)
    camera, size = vs.Camera.orbit(engine, azimuth_deg=30), (40, 32)
    span_mm = np.full((*size[::-1], 2), (0.0, np.inf), np.float32)
    span_mm[:, 20:, 1] = camera.distance_mm + np.linspace(-20, 20, 20)
    span_mm[:8, :8, 1] = 1.0
    span_mm[24:, :, 0] = camera.distance_mm - 5.0
    ours = vs.Raycaster(engine).cast(table, camera, size, spec, span_mm=span_mm)
    whole = vs.Raycaster(engine).cast(table, camera, size, spec)
    true = reference.cast(engine, table, camera, size, spec, span_mm)
    for a, b in zip(ours[:2], true[:2], strict=True):
        assert a == pytest.approx(b, abs=1e-3)
    assert not ours.alpha[:8, :8].any()
    assert np.array_equal(ours.alpha[8:24, :20], whole.alpha[8:24, :20])
    # A mean over less of a ray may be greater.
    assert mode == "average" or ours.alpha[:, 20:].sum() < 0.95 * whole.alpha[:, 20:].sum()
