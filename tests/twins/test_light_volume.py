"""The light volume's kernels against their float64 reference, node by node."""

import dataclasses

import numpy as np
import pytest

import volspec as vs
from tests.support.fixtures import slow, slow_each
from tests.support.raycasts import labelled, oblique_world, turned
from volspec._gpu.opencl import Compute
from volspec._gpu.sources import Source, asset
from volspec.raycast import reference
from volspec.raycast.launch.kernel_arguments import LIGHT_MARGIN
from volspec.raycast.launch.light_volume import (
    LightGrid,
    LightVolume,
    light_layers,
    material_tables,
    split_width,
)
from volspec.raycast.lights import Source as LightSource
from volspec.transfer import SurfaceTable, TransferTable

# A layer's own rounding is half of 1/65535, and a way of 100 float32 steps adds as much.
TOLERANCE = 2 / 65535

SUN = vs.Directional((0.3, -1.0, 0.6), shadows=True)
LAMP = vs.Directional((1.0, 2.0, 1.0), frame="camera", shadows=True)
BULB = vs.Point((300.0, -80.0, 200.0), shadows=True)
SKY = vs.Ambient(occlusion=True)


def lit(*sources: LightSource, cells: int = 24, **settings: object) -> vs.RaycastSpec:
    groups = (vs.LightGroup("light", sources),)
    return vs.RaycastSpec(groups=groups, light_cells=cells, **settings)


def opened(volume: vs.Volume, lanes: int | None = None) -> LightVolume:
    compute = Compute.open()
    return LightVolume(compute, volume, compute.upload(volume.values), lanes=lanes)


def downloaded(
    ours: LightVolume, table: TransferTable | SurfaceTable, spec: vs.RaycastSpec, camera: vs.Camera
) -> np.ndarray:
    """(L, nz, ny, nx) 0…1."""
    buffer, grid, wanted = ours.layers(table, spec, camera)
    layers = np.empty((len(wanted), *grid.shape_xyz[::-1]), np.uint16)
    ours._compute.download(buffer, layers)
    return layers / 65535


def assert_alike(
    volume: vs.Volume,
    table: TransferTable | SurfaceTable,
    spec: vs.RaycastSpec,
    camera: vs.Camera | None = None,
    lanes: int | None = None,
    dark: float = 0.9,
) -> None:
    """Compare every node; the message shows the worst with both values."""
    camera = camera or vs.Camera.orbit(volume)
    ours = downloaded(opened(volume, lanes), table, spec, camera)
    true = reference.layers(volume, table, spec, camera)
    assert ours.shape == true.shape
    for layer in true:
        assert layer.min() < dark and layer.max() > 0.9, "nothing is shadowed, or everything"
    off = np.abs(ours - true)
    worst = np.unravel_index(off.argmax(), off.shape)
    assert off.max() <= TOLERANCE, f"{worst}: kernel {ours[worst]}, reference {true[worst]}"


def oblique() -> vs.Volume:
    """Shear, rotation and unequal spacing."""
    world = oblique_world()
    world[:3, 1] += 0.4 * world[:3, 0]
    values = vs.phantom.ball(24).values[:, 2:, 5:] * 200
    return vs.Volume(values.astype(np.int16) - 50, world_from_index=world)


def curve(low: float, high: float) -> TransferTable:
    at = np.linspace(0, 1, 1024)
    return TransferTable((low, high), 0.9 * at**2, np.full((1024, 2), 0.5), 1.0)


@pytest.mark.parametrize("lanes", [8, *slow_each(1, 4)])
def test_engine_matches_reference_at_every_packet_width(half_engine, three_channels, lanes):
    assert_alike(half_engine, three_channels, lit(SUN, LAMP, BULB, SKY, cells=29), lanes=lanes)


@pytest.mark.parametrize("cells", [9, *slow_each(24, 40)])
def test_oblique_anisotropic_volume_matches_reference(cells):
    """Few nodes to many voxels, and many to few: then nodes lie between voxels."""
    volume = oblique()
    bulb = vs.Point(tuple(volume.corners_mm[3] + 5), shadows=True)
    sky = vs.Ambient(occlusion=True, radius_mm=28.3)
    assert_alike(volume, curve(-40, 150), lit(SUN, LAMP, bulb, sky, cells=cells))


SIDES = (1, 0, 0), (-1, 0, 0), (0, 1, 0), (0, -1, 0), (0, 0, 1), (0, 0, -1)


@pytest.mark.parametrize("towards", [(0, 0, -1), (-3, 2, -1), *slow_each(*SIDES[:5])])
def test_light_from_every_side_matches_reference(half_engine, three_channels, towards):
    assert_alike(half_engine, three_channels, lit(vs.Directional(towards, shadows=True)))


def test_point_lights_inside_the_volume_and_of_the_camera_match_reference(
    half_engine, three_channels
):
    """Also on a node, where the way has no length."""
    x, y, z = np.array(half_engine.corners_mm[7]) / 2
    on_a_node = tuple(half_engine.corners_mm[7] * (8 / 23, 12 / 23, 0))
    inside = vs.Point((x + 3, y - 7, z), shadows=True)
    torch = vs.Point((40.0, 60.0, -300.0), frame="camera", shadows=True)
    wide = vs.Point((300.0, -80.0, 200.0), shadows=True, radius_mm=60.0)
    spec = lit(inside, vs.Point(on_a_node, shadows=True), torch, wide)
    assert_alike(half_engine, three_channels, spec, turned(half_engine, -70, 35))


def test_physical_light_matches_reference(half_engine, three_channels):
    """A node per voxel."""
    spec = lit(SUN, LAMP, BULB, SKY, physical_light=True)
    assert_alike(half_engine.downsampled(4), three_channels, spec)


@pytest.mark.slow
def test_physical_light_of_unequal_spacing_matches_reference():
    """A node per smallest spacing."""
    assert_alike(oblique(), curve(-40, 150), lit(SUN, BULB, SKY, physical_light=True))


@pytest.mark.parametrize("dtype", [np.uint16, *slow_each("uint8", "int16", "float32")])
def test_every_voxel_type_matches_reference(dtype):
    volume = vs.Volume((vs.phantom.ball(20).values * 120).astype(dtype))
    assert_alike(volume, curve(0, 120), lit(SUN, SKY))


@pytest.mark.slow
def test_cuts_match_reference(engine, three_channels):
    """The planes pass exactly through voxels, the crop through two faces of them."""
    planes = (vs.ClipPlane((100.0, 0, 0), (1, 0, 0)), vs.ClipPlane((0, 0, 20.0), (0, 1, 3)))
    crop = ((20.5, 240.0), (30.0, 200.2), (0.0, 90.0))
    assert_alike(engine, three_channels, lit(SUN, SKY, crop_voxels=crop, clip_planes=planes))
    volume = oblique()
    through = vs.ClipPlane(tuple(volume.corners_mm.mean(axis=0)), (1, 1, 1))
    assert_alike(volume, curve(-40, 150), lit(SUN, clip_planes=(through,)))
    beyond = ((-5.0, 100.0), (3.0, 12.0), (-1e9, 1e9))
    assert_alike(vs.phantom.ball(20), curve(0, 1), lit(SUN, crop_voxels=beyond))


@pytest.mark.parametrize("shape", [(2, 2, 2), (2, 9, 90), (17, 2, 3)])
@pytest.mark.parametrize("spacing_mm", [1e-6, *slow_each(1, 1e6)])
def test_thin_and_tiny_volumes_match_reference(shape, spacing_mm):
    """Whatever the unit, and with lights far outside; thin ones shadow next to nothing."""
    values = np.random.default_rng(6).integers(0, 2, shape).astype(np.uint8)
    volume = vs.Volume(values, spacing_mm=(spacing_mm,) * 3)
    table = TransferTable((0, 1), np.array([0.0, 0.7]), np.eye(2), spacing_mm)
    far = vs.Point((1e4 * spacing_mm, 3e3 * spacing_mm, 2e4 * spacing_mm), shadows=True)
    assert_alike(volume, table, lit(SUN, far, cells=8), dark=2)


def test_table_over_gradients_matches_reference():
    """Only the steep shell is opaque: shadows come from where rays see something."""
    opacity = np.linspace(0, 0.95, 16)[:, None] * np.linspace(0, 1, 64)
    table = TransferTable((-40, 150), opacity, np.full((16, 64, 2), 0.5), 1.0, gradient_top=12.0)
    assert_alike(oblique(), table, lit(SUN, SKY))


def test_labels_match_reference():
    """Labels 3 and -1 are not in the table and are not seen; label 0 is."""
    values = np.random.default_rng(3).choice(5, size=(12, 14, 16), p=[0.4, 0.1, 0.2, 0.2, 0.1]) - 1
    assert_alike(vs.Volume(values.astype(np.int16)), labelled([0.1, 0.9, 0.3]), lit(SUN, SKY))


@pytest.mark.parametrize("opacity", [0.7, slow(1.0)])
def test_surfaces_match_reference(opacity):
    table = SurfaceTable([0.0, 77.5], [0.4, opacity], np.eye(2))
    assert_alike(oblique(), table, lit(SUN, SKY))


def test_layers_follow_what_changes_and_only_that(half_engine, three_channels):
    """Cached layers equal new ones, whatever changed between."""
    ours, camera = opened(half_engine), vs.Camera.orbit(half_engine)
    turned = vs.Camera.orbit(half_engine, azimuth_deg=120)
    other = dataclasses.replace(three_channels, opacity=three_channels.opacity / 2)
    for table, spec, view in (
        (three_channels, lit(SUN, LAMP), camera),
        (three_channels, lit(SUN, LAMP), turned),
        (three_channels, lit(LAMP), turned),
        (three_channels, lit(LAMP, SUN, SKY), turned),
        (other, lit(LAMP, SUN, SKY), turned),
        (other, lit(LAMP, SUN, crop_voxels=((0, 99), (0, 99), (0, 99))), turned),
        (other, lit(LAMP, SUN, cells=13), turned),
        (other, lit(LAMP, SUN, cells=13, physical_light=True), turned),
        (other, lit(LAMP, SUN, cells=128), turned),
    ):
        cached = downloaded(ours, table, spec, view)
        assert np.array_equal(cached, downloaded(opened(half_engine), table, spec, view))


def test_occluders_reach_to_the_end_of_the_grid_and_no_farther():
    volume, table = vs.phantom.ball(16), curve(0, 1)
    specs = [lit(vs.Ambient(1, True, radius), cells=8) for radius in (100.0, 1e300)]
    camera = vs.Camera.orbit(volume)
    assert np.array_equal(*(reference.layers(volume, table, spec, camera) for spec in specs))
    assert_alike(volume, table, specs[1], dark=0.99)


def test_layers_come_in_order_of_groups_and_sources(engine):
    parts = {"a": (vs.Ambient(), SUN), "b": (SKY, vs.Point((0, 0, 0)), BULB)}
    spec = vs.RaycastSpec(groups=tuple(vs.LightGroup(*part) for part in parts.items()))
    found = light_layers(spec, engine, vs.Camera.orbit(engine))
    kinds = [(layer.source, layer.kind) for layer in found]
    assert kinds == [(1, "directional"), (2, "occlusion"), (4, "point")]


_SAMPLER = """
__kernel void sample(__global const ushort *layer, __global const floatN *at,
                     __global floatN *out) {
    const int p = get_global_id(0);
    out[p] = light_at(layer, NX, NY, NZ, at[3 * p], at[3 * p + 1], at[3 * p + 2]);
}
"""


@pytest.mark.parametrize("lanes", [8, *slow_each(1, 4)])
def test_samples_of_a_layer_match_reference(lanes):
    """Everywhere, on the outermost nodes too, where the last cell ends."""
    rng = np.random.default_rng(4)
    volume = vs.Volume(np.zeros((21, 33, 41), np.uint8), spacing_mm=(1, 1, 2))
    grid = LightGrid.of(volume, 11)
    layer = rng.integers(0, 65536, grid.shape_xyz[::-1]).astype(np.uint16)
    top = np.array(grid.shape_xyz) - 1
    at = np.concatenate([rng.uniform(0, top, (64, 3)), rng.integers(0, 2, (64, 3)) * top])
    packets = at.reshape(-1, lanes, 3).transpose(0, 2, 1).astype(np.float32)
    sizes = dict(zip(("NX", "NY", "NZ"), grid.shape_xyz, strict=True))
    defines = [f"#define {name} {value}" for name, value in {"LANES": lanes, **sizes}.items()]
    parts = [asset(f"kernels/include/{name}.clh").read_text() for name in ("lanes", "light")]
    parts[1] = parts[1].replace('#include "lanes.clh"', "")
    source = Source("\n".join([*defines, *parts, _SAMPLER]), ("<prelude>", "light.clh"))
    compute, out = Compute.open(), np.empty(len(at), np.float32)
    buffer = compute.output(out.nbytes)
    given = compute.upload(layer), compute.upload(np.ascontiguousarray(packets)), buffer
    compute.kernel(source, "sample")(compute.queue, (len(packets),), None, *given)
    compute.download(buffer, out)
    true = reference.light_at(layer / 65535, grid, (at - LIGHT_MARGIN) / np.array(grid.per_index))
    # Positions of up to 10 nodes in float32 are 1e-6 off, and nodes differ by up to 1.
    assert np.abs(out - true).max() < 5e-6


@pytest.mark.slow
@pytest.mark.parametrize("materials", [2, 4])
def test_materials_alone_match_reference(half_engine, three_channels, materials):
    """Without ``split`` as with it; each at half of its depth, and occlusion unclipped."""
    small, spec = half_engine.downsampled(2), lit(SUN, BULB, SKY)
    at = np.linspace(0, materials - 1, len(three_channels.opacity))
    weights = np.maximum(1 - np.abs(at[:, None] - np.arange(materials)), 0)
    camera, ours = vs.Camera.orbit(small), opened(small)
    channels = {"material_weights": weights, "channels": np.eye(materials), "white": None}
    whole = dataclasses.replace(three_channels, **channels)
    alone = downloaded(opened(small), whole, spec, camera)
    tables = [(whole, 0.5), (whole, 1.0), *((each, 0.5) for each in material_tables(whole))]
    width = split_width(whole)
    for _ in range(2):
        buffer, grid, _ = ours.layers(whole, spec, camera, split=True)
        layers = np.empty((3 + 3 * width, grid.nodes), np.uint16)
        ours._compute.download(buffer, layers)
        assert np.array_equal(layers[:3].ravel() / 65535, alone.ravel())
        split = layers[3:].reshape(3, *grid.shape_xyz[::-1], width) / 65535
        for number, (table, part) in enumerate(tables):
            true = reference.layers(small, table, spec, camera, part=part)
            assert np.abs(split[..., number] - true).max() <= TOLERANCE, number


def test_the_memory_of_materials_alone_is_asked_for(half_engine, monkeypatch):
    asked = []
    monkeypatch.setattr(Compute, "require", lambda _, nbytes, field, remedy: asked.append(nbytes))
    table = TransferTable((0.0, 255.0), np.full(8, 0.1), np.full((8, 2), 0.5), 1.0)
    small = half_engine.downsampled(4)
    _, grid, wanted = opened(small).layers(table, lit(SUN, SKY), vs.Camera.orbit(small), split=True)
    assert asked.count(2 * grid.nodes * (len(wanted) + len(wanted) * split_width(table))) == 1
    # Extinctions, and the layers.
    assert sum(nbytes >= 4 * grid.nodes for nbytes in asked) == 3 + 1
