"""Pictures with closed-form answers: rays, chords, lights, levels."""

from dataclasses import replace

import numpy as np
import pytest

import volspec as vs
from tests.support.fixtures import slow
from tests.support.raycasts import WHOLE, along_z, cube, fog, labelled, turned
from volspec.raycast.launch.sampling import world_rays
from volspec.transfer import SurfaceTable, TransferTable

Array = np.ndarray


def lattice() -> Array:
    """A rotated, mirrored, sheared and stretched lattice (its determinant is negative)."""
    turn = np.linalg.qr(np.random.default_rng(3).normal(size=(3, 3)))[0]
    turn[:, 0] *= -np.sign(np.linalg.det(turn))
    world = np.eye(4)
    world[:3, :3] = turn @ np.diag([0.8, 1.0, 1.2]) @ (np.eye(3) + np.triu(np.full((3, 3), 0.3), 1))
    world[:3, 3] = 7, -4, 11
    return world


def in_world(volume: vs.Volume) -> Array:
    """(Z, Y, X, 3) places of the voxels."""
    k, j, i = np.indices(volume.values.shape)
    world = volume.world_from_index
    return np.stack([i, j, k], axis=-1) @ world[:3, :3].T + world[:3, 3]


def linear_field(shape: tuple[int, ...], slope: Array) -> tuple[vs.Volume, float]:
    """Values slope · x on an oblique lattice, from 0, and what was taken off."""
    empty = vs.Volume(np.zeros(shape, np.float32), world_from_index=lattice())
    field = in_world(empty) @ slope
    low = field.min()
    return vs.Volume((field - low).astype(np.float32), world_from_index=lattice()), float(low)


def chord(origin: Array, way: Array, sides: list[tuple[Array, float]]) -> tuple[Array, Array]:
    """Return where rays enter and leave the body normal · x >= w for all (normal, w)."""
    near, far = np.zeros(len(way)), np.full(len(way), np.inf)
    for normal, w in sides:
        toward = way @ normal
        with np.errstate(divide="ignore", invalid="ignore"):
            meet = (w - origin @ normal) / toward
        near = np.where(toward > 0, np.maximum(near, meet), near)
        far = np.where(toward < 0, np.minimum(far, meet), far)
    return near, np.maximum(far, near)


def box(volume: vs.Volume, low: Array, high: Array) -> list[tuple[Array, float]]:
    """The six sides, in the world, of the box low…high in index space."""
    rows = volume.index_from_world
    sides = []
    for axis in range(3):
        normal, offset = rows[axis, :3], rows[axis, 3]
        sides += [(normal, low[axis] - offset), (-normal, offset - high[axis])]
    return sides


def test_a_cut_oblique_body_matches_beer_lambert_in_opacity_and_depth():
    """Crop and planes only shorten the chord, whatever the lattice, the step and the jitter.

    Opacity: as in test_beer_lambert. Depth: a step's weight counts at its middle, its centre of
    mass lies σ Δ² / 12 = 0.0018 mm before.
    """
    volume = vs.Volume(np.ones((20, 25, 30), np.float32), world_from_index=lattice())
    centre = (volume.world_from_index @ [13, 9, 10, 1])[:3]
    places = ([1, 2, 0], (1, 0.3, -0.4)), ([0, 0, -4], (0, -0.2, 1))
    planes = tuple(vs.ClipPlane(tuple(centre + away), normal) for away, normal in places)
    crop = ((3.25, 22.0), (-3.0, 17.5), (2.0, 18.75))
    spec = replace(WHOLE, jitter=1, seed=5, crop_voxels=crop, clip_planes=planes)
    table, camera = fog(0.2, share=0.5, reference_step_mm=1.7), turned(volume, 33, 12)
    coefficients, alpha, depth, _ = vs.Raycaster(volume).cast(table, camera, (40, 40), spec)

    origin, way = world_rays(camera, 40, 40)
    sides = box(volume, np.array([3.25, 0, 2]), np.array([22, 17.5, 18.75]))
    sides += [(np.array(p.normal), float(np.dot(p.normal, p.point_mm))) for p in planes]
    near, far = chord(origin, way, sides)
    sigma, length = -np.log(0.8) / 1.7, far - near
    expected = 1 - np.exp(-sigma * length)
    assert expected.max() > 0.9
    assert np.abs(alpha.ravel() - expected).max() < 1e-5
    assert np.abs(coefficients.ravel() - 0.5 * expected).max() < 1e-5
    seen = expected > 0.02
    passed = np.exp(-sigma * length[seen])
    centroid = near[seen] + 1 / sigma - length[seen] * passed / (1 - passed)
    assert np.abs(depth.ravel()[seen] - centroid).max() < 0.0025


@pytest.mark.parametrize("threshold", [0.05, 0.3, 0.6])
def test_the_first_hit_in_fog_is_where_its_opacity_says(threshold):
    """Opacity θ is reached −log(1 − θ) / σ behind the face; a step's middle is within half of it.

    Step k holds the place, or its end lies on it: |middle − place| <= Δ / 2 = 0.25, and rounding.
    """
    volume = cube(17)
    camera = vs.Camera((8, 8, 60.3), (8, 8, 8), up=(0, 1, 0), height_mm=16)
    spec = replace(WHOLE, first_opacity=threshold)
    first = vs.Raycaster(volume).cast(fog(0.1), camera, (9, 9), spec).first_mm
    place = 60.3 - 16 - np.log(1 - threshold) / -np.log(0.9)
    assert np.abs(first - place).max() < 0.25 + 1e-4


@pytest.mark.parametrize("step_mm", [0.3, 1.0, 3.7])
def test_preintegrated_opacity_of_a_ramp_is_an_integral_over_values(step_mm):
    """Along a ramp dv = ds: 1 − exp(−∫ τ(v) dv), of a spike half a value wide, at any step.

    τ is linear between 4096 entries of float32: the sum of some 100 roundings, 1e-5.
    """
    values = np.broadcast_to(np.arange(33.0)[:, None, None], (33, 9, 9))
    volume = vs.Volume(values.astype(np.float32))
    at = np.linspace(0, 32, 4097)
    opacity = np.interp(at, [12, 12.25, 12.5, 20, 25, 26], [0, 0.9, 0, 0, 0.2, 0])
    table = TransferTable((0.0, 32.0), opacity, np.full((4097, 1), 0.4), 1.0)
    spec = replace(WHOLE, preintegrated=True, step_mm=step_mm)
    given = table, along_z(volume, height_mm=6), (5, 5), spec
    coefficients, alpha, *_ = vs.Raycaster(volume).cast(*given)
    expected = 1 - np.exp(-np.trapezoid(-np.log(1 - opacity), at))
    assert expected > 0.4
    assert np.abs(alpha - expected).max() < 1e-5
    assert np.abs(coefficients - 0.4 * expected).max() < 1e-5


@pytest.mark.parametrize("mode", ["average", slow("maximum")])
def test_projections_of_a_linear_field_are_known(mode):
    """The mean is the value in the chord's middle; the greatest, that of the greater end.

    The last sample lies up to half a step before the end: slope · Δ / 2 of value. Table and
    shares are the value itself, 0…1; float32 leaves 1e-5.
    """
    slope = np.array([0.011, -0.007, 0.014])
    volume, low = linear_field((20, 25, 30), slope)
    assert volume.range[1] < 1
    table = TransferTable((0.0, 1.0), np.ones(256), np.linspace(0, 1, 256)[:, None], 1.0)
    camera, spec = turned(volume, -25, 40), replace(WHOLE, mode=mode)
    coefficients, alpha, *_ = vs.Raycaster(volume).cast(table, camera, (32, 32), spec)
    origin, way = world_rays(camera, 32, 32)
    near, far = chord(origin, way, box(volume, np.zeros(3), np.array(volume.shape_xyz) - 1.0))
    seen = far - near > 1e-3
    assert (alpha.ravel()[seen] == 1).all() and (alpha.ravel()[far == near] == 0).all()
    ends = [(origin + t[:, None] * way) @ slope - low for t in (near, far)]
    got = coefficients.ravel()[seen]
    if mode == "average":
        assert np.abs(got - 0.5 * (ends[0] + ends[1])[seen]).max() < 1e-5
    else:
        under = np.maximum(*ends)[seen] - got
        assert under.min() > -1e-5
        assert under.max() < np.linalg.norm(slope) * spec.step_of(volume) / 2 + 1e-5


def test_a_mean_projection_is_that_of_the_cells_without_missing_voxels():
    """Along z: three cells of 1 to 4, then two of 5 to 7; a voxel alone has no cell."""
    values = np.array([1, 2, 3, 4, np.nan, np.inf, 5, 6, 7, np.nan, 2, np.nan])
    with pytest.warns(match="transparent"):
        volume = vs.Volume(np.tile(values[:, None, None], (1, 5, 5)))
    table = TransferTable((0.0, 8.0), np.linspace(0, 1, 256), np.ones((256, 1)), 1.0)
    spec = replace(WHOLE, mode="average", step_mm=1 / 64)
    alpha = vs.Raycaster(volume).cast(table, along_z(volume), (5, 5), spec).alpha
    # A step at either end of both runs counts as a whole, or not.
    assert np.abs(8 * alpha - (3 * 2.5 + 2 * 6) / 5).max() < 0.03


@pytest.mark.slow
def test_a_table_of_gradients_reads_the_gradient_of_the_world():
    """A linear field has one gradient, on any lattice: a body of one opacity.

    One voxel within the faces, where central differences have both neighbours.
    """
    volume, _ = linear_field((16, 18, 20), np.array([2.0, -1.0, 2.0]))  # 3 per mm
    rows = np.linspace(0, 0.4, 9)[:, None] * np.ones(16)
    table = TransferTable(volume.range, rows, np.full((9, 16, 1), 0.5), 1.0, gradient_top=8.0)
    last = np.array(volume.shape_xyz) - 2.0
    spec = replace(WHOLE, crop_voxels=tuple((1.0, n) for n in last.tolist()))
    camera = turned(volume, 70, -20)
    alpha = vs.Raycaster(volume).cast(table, camera, (32, 32), spec).alpha
    origin, way = world_rays(camera, 32, 32)
    near, far = chord(origin, way, box(volume, np.ones(3), last))
    expected = 1 - (1 - 0.4 * 3 / 8) ** (far - near)
    assert expected.max() > 0.8
    # Values to 60 rounded to float32 move gradients by 4e-6 / 3 and opacity by less.
    assert np.abs(alpha.ravel() - expected).max() < 2e-5


def distances(size: int, world: Array) -> tuple[vs.Volume, Array]:
    """Distance from the middle of a lattice, and that place."""
    empty = vs.Volume(np.zeros((size,) * 3, np.float32), world_from_index=world)
    centre = (world @ [*(3 * [(size - 1) / 2]), 1])[:3]
    away = np.linalg.norm(in_world(empty) - centre, axis=-1)
    return vs.Volume(away.astype(np.float32), world_from_index=world), centre


def test_nested_shells_cover_each_other_in_the_order_of_the_ray():
    """The ray meets outer a, inner b, then inner b, outer a; every shell has its own channel."""
    volume, centre = distances(49, lattice())
    a, b = 0.3, 0.6
    table = SurfaceTable(np.array([8.0, 14.0]), np.array([b, a]), np.eye(2))
    camera = vs.Camera(tuple(centre + [0, -90, 20]), tuple(centre), height_mm=8)
    coefficients, alpha, *_ = vs.Raycaster(volume).cast(table, camera, (9, 9), WHOLE)
    outer = a + (1 - a) * (1 - b) ** 2 * a
    inner = (1 - a) * b + (1 - a) * (1 - b) * b
    assert np.abs(alpha - (1 - ((1 - a) * (1 - b)) ** 2)).max() < 1e-6
    assert np.abs(coefficients - [inner, outer]).max() < 1e-6


def test_a_ball_is_lit_as_its_normals_say_on_any_lattice():
    """Lambert and Blinn-Phong of a lamp near by, one far away and the camera's, on a sphere.

    The trilinear distance is wrong by up to h² / 8r = 0.04 mm at the cell's diagonal h = 2.1, and
    its slope by h / 4r: 0.04 of a normal, which turns shades by less than that; measured 0.0032.
    """
    volume, centre = distances(61, lattice())
    radius, lamp, reach = 14.0, centre + [5, -25, 20], 20.0
    torch = vs.Spot(tuple(lamp), target_mm=tuple(centre + [2, 0, 1]), cone_deg=22, edge_deg=8)
    groups = (
        vs.LightGroup("lamp", (vs.Point(tuple(lamp), falloff_mm=reach),)),
        vs.LightGroup("sun", (vs.Directional((1, -2, 0.5)),)),
        vs.LightGroup("camera", (vs.Headlight(0.7),)),
        vs.LightGroup("sky", (vs.Ambient(0.5),)),
        vs.LightGroup("torch", (torch,)),
    )
    spec = vs.RaycastSpec(
        ambient=0.2, diffuse=0.6, specular=0.3, shininess=9, flat_gradient=0, groups=groups
    )
    table = SurfaceTable(np.array([radius]), np.ones(1), np.full((1, 1), 0.8))
    camera = vs.Camera(tuple(centre + [10, -60, 15]), tuple(centre), fov_deg=35)
    coefficients, _, depth, first = vs.Raycaster(volume).cast(table, camera, (41, 41), spec)

    origin, way = world_rays(camera, 41, 41)
    b = ((origin - centre) * way).sum(axis=1)
    inside = b**2 - ((origin - centre) ** 2).sum(axis=1) + radius**2
    hit = inside > radius**2 - 12.5**2  # not the rim
    along = -b - np.sqrt(np.maximum(inside, 0))
    point = origin + along[:, None] * way
    normal = (point - centre) / radius

    def shed(towards: Array) -> Array:
        half = towards - way
        half /= np.linalg.norm(half, axis=1, keepdims=True)
        facing, middling = (np.abs((normal * v).sum(axis=1)) for v in (towards, half))
        return 0.6 * 0.8 * facing + 0.3 * middling**9

    to_lamp = lamp - point
    away = np.linalg.norm(to_lamp, axis=1, keepdims=True)
    sun = np.broadcast_to(np.array([1, -2, 0.5]) / np.linalg.norm([1, -2, 0.5]), way.shape)
    lamplight, sky = shed(to_lamp / away) * (reach / away[:, 0]) ** 2, 0.5 * 0.2 * 0.8
    aim = centre + [2, 0, 1] - lamp
    cosine = -(to_lamp / away) @ (aim / np.linalg.norm(aim))
    rim, whole = np.cos(np.radians([22, 14]))
    t = np.clip((cosine - rim) / (whole - rim), 0, 1)
    torchlight = shed(to_lamp / away) * t * t * (3 - 2 * t)
    expected = np.stack(
        [lamplight, shed(sun), 0.7 * shed(-way), np.full(len(way), sky), torchlight], axis=1
    )
    off = np.abs(coefficients.reshape(-1, 5) - expected)[hit]
    assert off.max() < 0.01 and np.ptp(torchlight[hit]) > 0.4
    # Seen at 12.5 of 14 mm the surface leans by 63 degrees: 0.04 mm of radius are 0.09 of depth.
    assert np.abs(depth.ravel() - along)[hit].max() < 0.09
    assert np.array_equal(depth.ravel()[hit], first.ravel()[hit])


@pytest.mark.slow
def test_the_colour_of_labels_changes_half_way_and_is_never_mixed():
    """Along the border of labels 1 and 3, of one opacity; 2 lies between them and is opaque.

    Rays run along the border plane x = 7.5: what they see is one label or the other, and as dense.
    """
    values = np.full((9, 9, 16), 1, np.uint8)
    values[..., 8:] = 3
    table = labelled([0, 0.2, 1, 0.2], np.eye(4)[:, 1:])
    camera = vs.Camera((7.5, 4, 40), (7.5, 4, 4), up=(0, 1, 0), height_mm=4)
    coefficients, alpha, *_ = vs.Raycaster(vs.Volume(values)).cast(table, camera, (12, 12), WHOLE)
    # The pixels' middles, at ±1/6, ±1/2 … of the border: none on it.
    expected = 1 - 0.8**8
    assert np.abs(alpha - expected).max() < 1e-5
    assert np.abs(coefficients[:, :6] - expected * np.eye(3)[0]).max() < 1e-5
    assert np.abs(coefficients[:, 6:] - expected * np.eye(3)[2]).max() < 1e-5


@pytest.mark.slow
def test_the_border_of_a_label_is_as_smooth_as_its_opacity():
    """Across a cell from nothing to a label opacity is linear: a ray next to it sees it all."""
    values = np.zeros((9, 9, 16), np.uint8)
    values[..., 8:] = 2
    camera = vs.Camera((7.5, 4, 40), (7.5, 4, 4), up=(0, 1, 0), height_mm=1)
    given = labelled([0, 0, 0.5]), camera, (10, 10), replace(WHOLE, step_mm=1.0)
    alpha = vs.Raycaster(vs.Volume(values)).cast(*given).alpha
    share = (np.arange(10) + 0.5) / 10
    assert np.abs(alpha - (1 - (1 - 0.5 * share) ** 8)).max() < 1e-5
