"""Light volumes with known answers."""

import math
from dataclasses import replace

import numpy as np
import pytest

import volspec as vs
from tests.support.fixtures import slow, slow_each
from tests.twins.test_light_volume import downloaded, lit, opened
from volspec.raycast import reference
from volspec.raycast.launch.kernel_arguments import LIGHT_MARGIN
from volspec.raycast.launch.light_volume import LightGrid, sphere_directions
from volspec.raycast.lights import Source
from volspec.transfer import SurfaceTable, TransferTable

SIGMA = 0.05  # 1/mm
DOWN = vs.Directional((0, 0, 1), shadows=True)
# A step of the layers' levels where the transmittance is above 0.1: of its logarithm, 1/6553.
LEVEL = 2 / 6553


def fog(sigma: float = SIGMA) -> TransferTable:
    opacity = np.full(1024, 1 - math.exp(-sigma))
    return TransferTable((0.0, 2.0), opacity, np.full((1024, 2), 0.5), 1.0)


def solid() -> TransferTable:
    """Opaque at 1, nothing at 0."""
    return TransferTable((0.0, 1.0), np.array([0.0, 1.0]), np.eye(2), 1.0)


def layer_of(
    volume: vs.Volume, table: TransferTable | SurfaceTable, source: Source, cells: int
) -> np.ndarray:
    """(nz, ny, nx) 0…1, without the nodes around the volume."""
    camera, inner = vs.Camera.orbit(volume), slice(LIGHT_MARGIN, -LIGHT_MARGIN)
    layer = downloaded(opened(volume), table, lit(source, cells=cells), camera)[0]
    return np.asarray(layer[inner, inner, inner])


def test_straight_light_through_a_slab_matches_beer_lambert():
    """−log T = σ (d − h/2) at depths of whole cells, h a cell.

    The first cell of the way is left out; beyond the face σ falls to 0 within a cell, which adds
    half of one. Middles are exact where σ is linear within steps. On the face itself T is 1.
    """
    layer = layer_of(vs.phantom.slab(32, 16), fog(), DOWN, 33)
    depth = np.arange(16, -1, -1)[:, None, None]
    expected = SIGMA * np.maximum(depth - 0.5, 0)
    assert np.abs(-np.log(layer) - expected).max() < LEVEL


@pytest.mark.parametrize("cells", [17, *slow_each(33, 65)])
@pytest.mark.parametrize("towards", [(1.2, 1, 1.1), (-1, 1, 1.2), (1, -1, -1)])
def test_slanting_light_through_a_slab_matches_beer_lambert(towards, cells):
    """Exact to σ h: the ray's first cell is left out, matter beyond the face adds at most one.

    Beyond a face met at the angle θ there is h / (2 cos θ), at most h here. Where steps straddle
    a kink of σ, once on either side of the face, their middles are wrong by up to h/8.
    """
    volume = vs.phantom.slab(32, 16)
    way = np.array(towards) / np.linalg.norm(towards)
    grid = LightGrid.of(volume, cells)
    top = np.array(volume.shape_xyz) - 1.0
    nodes = np.array(grid.shape_xyz) - 2 * LIGHT_MARGIN
    axes = [np.linspace(0, t, n) for t, n in zip(top, nodes, strict=True)]
    z, y, x = np.meshgrid(*axes[::-1], indexing="ij")
    node = np.stack([x, y, z], axis=-1)
    to_face = (np.where(way > 0, top - node, node) / np.abs(way)).min(axis=-1)
    layer = layer_of(volume, fog(), vs.Directional(towards, shadows=True), cells)
    off = -np.log(layer) / SIGMA - to_face
    slack = grid.cell_mm / 4 + LEVEL / SIGMA
    assert off.min() > -grid.cell_mm - slack and off.max() < slack


def test_light_from_within_a_slab_matches_beer_lambert():
    """−log T = σ (d − h): a way that ends at the light is cut exactly."""
    place = np.array((13.3, 17.2, 7.9))
    layer = layer_of(vs.phantom.slab(32, 16), fog(), vs.Point(tuple(place), shadows=True), 33)
    z, y, x = np.mgrid[0:17, 0:33, 0:33]
    away = np.linalg.norm(np.stack([x, y, z], axis=-1) - place, axis=-1)
    assert np.abs(-np.log(layer) - SIGMA * np.maximum(away - 1, 0)).max() < LEVEL


def test_occlusion_in_even_fog_is_twice_its_transmittance():
    """open = 2 exp(−σ (r − h/2)) if the whole sphere lies within."""
    sky = vs.Ambient(occlusion=True, radius_mm=7.25)
    layer = layer_of(vs.phantom.slab(32, 32), fog(0.3), sky, 33)
    assert abs(layer[16, 16, 16] - 2 * math.exp(-0.3 * 6.75)) < 1 / 65535
    assert layer[0, 0, 0] > layer[16, 16, 16]


@pytest.mark.parametrize(
    "source",
    [
        vs.Directional((1, 2, 3), shadows=True),
        vs.Point((5.0, 6.0, 70.0), shadows=True),
        vs.Ambient(occlusion=True),
    ],
)
def test_all_light_arrives_in_an_empty_volume(source):
    empty = vs.Volume(np.zeros((9, 12, 15), np.uint8))
    assert (layer_of(empty, solid(), source, 20) == 1).all()


def plate() -> vs.Volume:
    """A square of 17 × 17 voxels at z = 20 in an empty cube of 33³."""
    values = np.zeros((33, 33, 33), np.uint8)
    values[20, 8:25, 8:25] = 1
    return vs.Volume(values)


def test_a_plate_casts_its_shadow_exactly_behind_it():
    """Opacity is held at 1 − 1e-4; within two cells its surface spreads."""
    layer = layer_of(plate(), solid(), DOWN, 33)
    square = np.zeros((33, 33), bool)
    square[8:25, 8:25] = True
    assert np.abs(layer[:17, square] - 1e-4).max() < 1 / 65535
    assert (layer[:17, ~square] == 1).all()
    assert (layer[23:] == 1).all()


def test_a_point_lights_shadow_widens_with_distance():
    """Similar triangles, to a cell: the plate's edge is a slope of a cell to each side."""
    layer = layer_of(plate(), solid(), vs.Point((16.0, 16.0, 60.0), shadows=True), 33)
    from_middle = np.abs(np.arange(33) - 16)
    for z in (2, 8, 14):
        half, row = 8 * (60 - z) / (60 - 20), layer[z, 16]
        assert (row[from_middle < half - 1] < 1e-3).all()
        assert (row[from_middle > half + 1.5] == 1).all()


@pytest.mark.parametrize("cells", [48, *slow_each(24, 96)])
@pytest.mark.parametrize(
    "source", [DOWN, slow(vs.Directional((4, 0, 1), shadows=True)), vs.Ambient(occlusion=True)]
)
def test_a_flat_wall_does_not_shadow_itself(cells, source):
    """Wherever it lies between nodes; you should see no bands on it: 4 % are hardly seen.

    Light is read two cells in front of the wall, where nodes are free of it but for its blur.
    Light that slants by 76 degrees stays in the blur longer, and counts a quarter.
    """
    z, _, x = np.mgrid[0:128, 0:128, 0:128].astype(np.float32)
    volume = vs.Volume(np.clip(70 + 0.1 * x - z, 0, 1) * 200)
    table = TransferTable((100.0, 200.0), np.array([0, 1.0]), np.ones((2, 1)), 0.5)
    view = vs.Camera.orbit(volume, azimuth_deg=20, elevation_deg=60, zoom=5)
    bare = replace(source, **{"occlusion" if isinstance(source, vs.Ambient) else "shadows": False})
    specs = (lit(each, cells=cells, ambient=1, diffuse=1) for each in (source, bare))
    caster = vs.Raycaster(volume)
    shaded, free = (caster.cast(table, view, (48, 48), spec)[0] for spec in specs)
    slanting = isinstance(source, vs.Directional) and source.towards[0] > 0
    assert (shaded / free).min() > (0.85 if slanting else 0.96)


@pytest.mark.slow
@pytest.mark.parametrize("opaque", [True, False])
def test_an_isosurface_does_not_shadow_itself(opaque):
    """A ball lit from the camera's side is as bright with shadows as without."""
    volume = vs.phantom.ball(64)
    table = SurfaceTable(np.array([0.5]), np.array([1.0 if opaque else 0.6]), np.ones((1, 1)))
    camera, caster = vs.Camera.orbit(volume, zoom=3), vs.Raycaster(volume)

    def middle(shadows: bool) -> np.ndarray:
        lamp = vs.LightGroup("k", vs.Directional((0, 0, 1), "camera", shadows=shadows))
        spec = vs.RaycastSpec(ambient=0, diffuse=1, groups=lamp)
        return caster.cast(table, camera, (48, 48), spec).coefficients[18:30, 18:30]

    least = 0.97 if opaque else 0.6  # the far side of a glass ball lies in its shadow
    assert (middle(True) / middle(False)).min() > least


def test_cut_away_voxels_cast_no_shadow():
    volume, camera = plate(), vs.Camera.orbit(plate())
    spec = lit(DOWN, cells=33, crop_voxels=((0, 32), (0, 32), (0, 19)))
    assert (downloaded(opened(volume), solid(), spec, camera) == 1).all()


def test_a_surface_counts_by_its_area():
    """∫ σ dV = −log(1 − opacity) · 4πr² of a sphere, whatever its slope to the lattice."""
    volume = vs.phantom.ball(64, spacing_mm=(1.0, 1.3, 1.6))
    table = SurfaceTable(np.array([0.5]), np.array([0.6]), np.ones((1, 1)))
    total = reference._surface_extinction(volume, table).sum() * math.prod(volume.spacing_mm)
    assert total == pytest.approx(-math.log(0.4) * 4 * math.pi * (0.5 * 31.5) ** 2, rel=0.02)


def test_light_of_the_camera_comes_from_behind_it():
    volume = plate()
    camera = vs.Camera.orbit(volume, azimuth_deg=40, elevation_deg=30)
    back = tuple(np.subtract(camera.position_mm, camera.target_mm))
    one, other = (
        downloaded(opened(volume), solid(), lit(source), camera)
        for source in (replace(DOWN, frame="camera"), replace(DOWN, towards=back))
    )
    assert np.abs(one - other).max() <= 1 / 65535


def test_directions_of_occlusion_balance():
    """Their mean is 0 and their spread alike in all axes, to a few hundredths."""
    directions = sphere_directions()
    assert np.allclose(np.linalg.norm(directions, axis=1), 1)
    assert np.abs(directions.mean(axis=0)).max() < 0.02
    assert np.abs(directions.T @ directions / len(directions) - np.eye(3) / 3).max() < 0.02


CUTS = {
    "the volume's border": (),
    "a plane": (vs.ClipPlane((0.0, 0.0, 22.0), (0.0, 0.0, -1.0)),),
    "a slanting plane": (vs.ClipPlane((15.5, 15.5, 20.0), (0.3, 0.2, -1.0)),),
}


@pytest.mark.slow
# The reference takes a minute for 96 cells.
@pytest.mark.parametrize("cells", [24, 96])
@pytest.mark.parametrize("cut", CUTS)
def test_a_cut_through_opaque_matter_is_open_to_the_sky_and_lit(cut, cells):
    """Without a gradient at the cut; from a point on a plane, half of the sphere is all light.

    Rays from within the first step, which is inside, are the rest: a tenth. And it is as by the
    reference.
    """
    body, table = vs.Volume(np.ones((32, 32, 32), np.uint8)), solid()
    sky = vs.LightGroup("sky", (vs.Ambient(occlusion=True, radius_mm=10.0),))
    settings = {"ambient": 1, "diffuse": 1, "light_cells": cells, "clip_planes": CUTS[cut]}
    spec = vs.RaycastSpec(groups=(sky, vs.LightGroup("sun", (DOWN,))), **settings)
    camera = vs.Camera((15.5, 12.0, 100.0), (15.5, 15.5, 15.5), (0, 1, 0), height_mm=10.0)
    image = vs.Raycaster(body).cast(table, camera, (12, 12), spec)
    assert image.alpha.min() > 0.99
    assert image.coefficients[..., 1::2].min() > 0.9
    true = reference.cast(body, table, camera, (12, 12), spec)
    assert np.abs(image.coefficients - true[0]).max() < 1e-4
