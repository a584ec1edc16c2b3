"""Focus, fog, cuts and a surface at its depth, from layers of opacity."""

import math
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from tests.support.errors import refuses, warns
from tests.support.raycasts import METAL_BASIS, METALS, WHOLE, cube, even_gold
from volspec.basis import SpectralBasis
from volspec.camera import Camera
from volspec.image import CoefficientImage
from volspec.image.depth import DepthEffects, axis_cosine, extents, mean_position
from volspec.image.layers import OpacityLayers
from volspec.mesh import shapes
from volspec.mesh.caster import MeshCaster
from volspec.pipeline import raycast
from volspec.raycast import ClipPlane

GROUPS = {"key": 0.75, "fill": 0.25}
FOV = 30.0
GOLD = even_gold(0.05)


def layered(
    tau: np.ndarray, depth: np.ndarray, fov_deg: float | None = FOV, shade: float = 0.5
) -> CoefficientImage:
    """Return an image of layers (H, W, L, 2) at depths (H, W, L), in two light groups."""
    shape = tau.shape[:3]
    shades = np.full((*shape, 2, 2), shade, np.float32)
    gloss = np.zeros((*shape, 2), np.float32)
    depth = np.where(tau.sum(axis=3) > 0, depth, np.inf).astype(np.float32)
    layers = OpacityLayers(tau.astype(np.float32), shades, gloss, depth)
    channels, alpha, weighted = layers.recompose([1, 1])
    depth = np.where(alpha > 0, weighted / np.maximum(alpha, 1e-9), np.inf)
    own = {"groups": GROUPS, "fov_deg": fov_deg, "opacity_layers": layers}
    return CoefficientImage(channels.reshape(*shape[:2], 6), alpha, depth, METAL_BASIS, **own)


def slab_layers(
    begin: float, end: float, tau: float, count: int = 8, size: tuple[int, int] = (1, 1)
) -> CoefficientImage:
    """Return a homogeneous slab of copper, cut into layers of unequal depth."""
    parts = np.linspace(0, 1, count + 1) ** 1.5
    taus = tau * np.diff(parts)
    edges = begin + (end - begin) * parts
    depth = edges[:-1] + np.diff(edges) * mean_position(taus)
    shape = (*size, count)
    both = np.stack([np.broadcast_to(taus, shape), np.zeros(shape)], axis=3)
    return layered(both, np.broadcast_to(depth, shape), None)


@pytest.fixture(scope="module")
def solid() -> CoefficientImage:
    """A homogeneous cube of gold, cast."""
    volume = cube(21)
    with warns("no opacity of copper"):
        return raycast(volume, GOLD, camera_of(volume), (40, 30), replace(WHOLE, layers=8))


def camera_of(volume: Any) -> Camera:
    return Camera.orbit(volume, azimuth_deg=30, elevation_deg=20)


@pytest.mark.slow
def test_without_effects_the_picture_is_the_same_bit_for_bit(solid):
    for scales in ({}, {"gold": 0.5}):
        plain, same = solid.recompose(scales), solid.recompose(scales, DepthEffects())
        for name in ("coefficients", "alpha", "depth_mm"):
            assert np.array_equal(getattr(plain, name), getattr(same, name))
    cut_nothing = solid.recompose({}, DepthEffects(near_mm=1.0))
    assert np.abs(cut_nothing.coefficients - solid.coefficients).max() < 1e-4


def test_shadows_fade_with_their_materials_in_depth_as_well():
    image = layered(np.ones((2, 2, 3, 2)), np.array([100.0, 101.0, 102.0]) * np.ones((2, 2, 1)))
    shadow = np.full((2, 2, 3, 2, 5), 0.5, np.float32)
    shaded = replace(image, opacity_layers=replace(image.opacity_layers, shadow=shadow))
    scales = {"gold": 0.0, "copper": 4.0}  # the difference from the cast is not added to these
    plain = shaded.recompose(scales)
    assert np.abs(plain.coefficients - image.recompose(scales).coefficients).max() > 0.01
    deep = shaded.recompose(scales, DepthEffects(near_mm=1.0))
    np.testing.assert_allclose(deep.coefficients, plain.coefficients, atol=1e-5)


@pytest.mark.parametrize("tau", [0.01, 1.0, 12.0])
def test_the_extents_of_homogeneous_layers_are_found(tau):
    layers = slab_layers(100, 140, tau).opacity_layers
    begin, width = extents(layers.tau[0].sum(axis=2), layers.depth_mm[0])
    edges = 100 + 40 * np.linspace(0, 1, 9) ** 1.5
    assert begin[0] == pytest.approx(edges[:-1], abs=0.02)
    assert width[0] == pytest.approx(np.diff(edges), abs=0.02)


@pytest.mark.parametrize("at", [90.0, 100.5, 104.0, 121.7, 133.0, 150.0])
def test_a_cut_takes_its_part_of_a_homogeneous_slab(at):
    image, beyond = slab_layers(100, 140, 2.0), np.clip((140 - at) / 40, 0, 1)
    for effects, part in (
        (DepthEffects(near_mm=at), beyond),
        (DepthEffects(far_mm=at), 1 - beyond),
    ):
        found = image.recompose({}, effects).alpha[0, 0]
        assert found == pytest.approx(-math.expm1(-2 * part), abs=1e-3)


def test_a_cut_is_that_of_a_cast_with_a_clip_plane(solid):
    """Measured: 0.027 at most, where a layer is longest."""
    volume, camera = cube(21), camera_of(cube(21))
    forward, at = camera.frame()[2], camera.distance_mm - 3
    plane = ClipPlane(tuple(np.add(camera.position_mm, at * forward)), tuple(forward))
    new = raycast(volume, GOLD, camera, (40, 30), replace(WHOLE, clip_planes=(plane,)))
    cut = solid.recompose({}, DepthEffects(near_mm=at))
    assert np.abs(cut.alpha - new.alpha).max() < 0.04
    assert np.sqrt(np.mean((cut.alpha - new.alpha) ** 2)) < 0.01
    both = (cut.alpha > 0.1) & (new.alpha > 0.1)
    assert np.abs(cut.depth_mm[both] - new.depth_mm[both]).max() < 0.5


def test_fog_in_front_of_an_opaque_surface():
    image = layered(np.array([[[[64.0, 0.0]], [[0.0, 0.0]]]]), np.full((1, 2, 1), 200.0), None)
    effects = DepthEffects(fog_mm=300, fog_from_mm=50, fog_white=0.4)
    foggy = image.recompose({}, effects)
    left = 0.05 ** (150 / 300)
    assert foggy.alpha[0] == pytest.approx([1, 1], abs=1e-5)
    for group, share in GROUPS.items():
        surface, nothing = foggy.layer(group)[0]
        expected = [0.5 * left, 0, 0.4 * share * (1 - left)]
        assert surface == pytest.approx(expected, abs=1e-5)
        assert nothing == pytest.approx([0, 0, 0.4 * share], abs=1e-5)
    assert foggy.depth_mm[0, 0] == pytest.approx(200) and np.isinf(foggy.depth_mm[0, 1])
    ended = image.recompose({}, replace(effects, far_mm=350))
    assert ended.alpha[0] == pytest.approx([1, 1 - 0.05], abs=1e-5)


def test_fog_within_a_homogeneous_slab_is_that_of_a_march():
    image = slab_layers(100, 140, 3.0)
    foggy = image.recompose({}, DepthEffects(fog_mm=120, fog_white=1.0))
    at = np.linspace(100, 140, 20001)
    at = 0.5 * (at[1:] + at[:-1])
    through = np.exp(-3.0 * (at - 100) / 40)
    seen = float((through * 0.05 ** (at / 120)).sum() * 3.0 / len(at))
    copper, _, white = foggy.layer("key")[0, 0]
    assert copper == pytest.approx(0.5 * seen, rel=2e-3)
    assert white == pytest.approx(0.75 * (1 - seen), abs=2e-3)


def point_at(distance: float, side: int = 65) -> CoefficientImage:
    tau, depth = np.zeros((side, side, 1, 2)), np.full((side, side, 1), np.inf)
    tau[side // 2, side // 2, 0, 0], depth[side // 2, side // 2] = 0.02, distance
    return layered(tau, depth)


@pytest.mark.parametrize("distance", [150.0, 260.0, 700.0])
def test_a_point_out_of_focus_is_a_disc_as_wide_as_a_lens_makes_it(distance):
    """The variance of a disc of diameter D is D²/16 along each axis."""
    blurred = point_at(distance).recompose({}, DepthEffects(focus_mm=200, aperture_mm=25))
    pixels_per_slope = 65 / (2 * math.tan(math.radians(FOV) / 2))
    wide = 25 * pixels_per_slope * abs(1 / 200 - 1 / distance)
    assert blurred.alpha.sum() == pytest.approx(1 - math.exp(-0.02), rel=0.02)
    for axis in np.mgrid[-32:33, -32:33]:
        variance = (blurred.alpha * axis**2).sum() / blurred.alpha.sum()
        assert 4 * math.sqrt(variance) == pytest.approx(wide, abs=1.0)
    assert blurred.coefficients[..., 0] == pytest.approx(0.5 * blurred.alpha, abs=1e-5)


def test_what_is_in_focus_stays_as_it_is():
    image = point_at(200.0)
    sharp = image.recompose({}, DepthEffects(focus_mm=200, aperture_mm=25))
    assert np.abs(sharp.alpha - image.alpha).max() < 1e-4


def test_an_opaque_slope_stays_opaque_out_of_focus():
    """A blur slice by slice would let light through between slices: 0.75 of it at an edge."""
    side = 96
    depth = np.broadcast_to(np.linspace(250, 600, side)[:, None, None], (side, side, 1))
    tau = np.zeros((side, side, 1, 2))
    tau[..., 0] = 64
    blurred = layered(tau, depth).recompose({}, DepthEffects(focus_mm=300, aperture_mm=40))
    assert blurred.alpha.min() > 0.99


def test_a_lens_sees_around_an_edge():
    """Half a plane out of focus is in front of a plane in focus: at its edge both are seen."""
    side = 64
    tau, depth = np.zeros((side, side, 3, 2)), np.zeros((side, side, 3))
    tau[:, : side // 2, :2, 0], tau[:, :, 2, 1] = 64, 64
    depth[..., 0], depth[..., 1], depth[..., 2] = 200, 200.1, 400
    blurred = layered(tau, depth).recompose({}, DepthEffects(focus_mm=400, aperture_mm=60))
    assert blurred.alpha.min() > 0.999
    copper, gold = blurred.layer("key")[side // 2, :, 0], blurred.layer("key")[side // 2, :, 1]
    assert copper + gold == pytest.approx(0.5, abs=2e-3)
    assert 0.5 * (copper[side // 2 - 1] + copper[side // 2]) == pytest.approx(0.25, abs=0.02)
    assert copper[2] > 0.49 and gold[-3] > 0.49
    assert (np.diff(copper) <= 1e-5).all()


def test_fog_out_of_focus_is_that_in_focus():
    """A homogeneous slab fills the picture."""
    image = replace(slab_layers(100, 140, 3.0, size=(16, 16)), fov_deg=2.0)
    fog = DepthEffects(fog_mm=120, fog_white=1.0)
    one, other = (
        image.recompose({}, each).coefficients
        for each in (fog, replace(fog, focus_mm=100, aperture_mm=5))
    )
    assert other == pytest.approx(one, abs=5e-3)


def surface_at(distance: float, image: CoefficientImage, alpha: float = 1.0) -> CoefficientImage:
    """Return a white surface across the picture."""
    channels = np.zeros_like(image.coefficients)
    channels[..., 2::3] = alpha * np.array([*GROUPS.values()])
    flat = np.full_like(image.alpha, alpha)
    depth = np.full_like(flat, distance)
    return replace(image, coefficients=channels, alpha=flat, depth_mm=depth, opacity_layers=None)


def test_a_surface_is_between_two_slabs():
    """Two layers each, which are 0.2 mm apart."""
    tau = np.zeros((1, 1, 4, 2))
    tau[0, 0, :2, 0] = tau[0, 0, 2:, 1] = math.log(2) / 2
    image = layered(tau, np.array([[[99.9, 100.1, 199.9, 200.1]]]), None)
    made = image.recompose({}, surface=surface_at(150, image))
    assert made.layer("key")[0, 0] == pytest.approx([0.25, 0, 0.5 * 0.75], abs=1e-5)
    assert made.alpha[0, 0] == pytest.approx(1)
    assert made.depth_mm[0, 0] == pytest.approx(125, abs=0.1)
    for surface, gold in ((surface_at(300, image), 0.125), (surface_at(150, image, 0.5), 0.0625)):
        found = image.recompose({}, surface=surface).layer("key")[0, 0]
        assert found == pytest.approx([0.25, gold, 0.25 * 0.75], abs=1e-5)
    cut = image.recompose({}, DepthEffects(far_mm=140), surface_at(150, image))
    assert cut.alpha[0, 0] == pytest.approx(0.5, abs=1e-5)


def test_a_surface_within_a_slab_hides_what_is_behind_it():
    image = slab_layers(100, 140, 2.0)
    made = image.recompose({}, surface=surface_at(110, image))
    through = math.exp(-2.0 * 10 / 40)
    expected = [0.5 * (1 - through), 0, through * 0.75]
    assert made.layer("key")[0, 0] == pytest.approx(expected, abs=1e-3)


def test_a_mesh_is_put_at_its_depth(solid):
    """You should see a copper ball inside a gold cube, as a cast with both shows it."""
    pytest.importorskip("embreex")
    volume = cube(21)
    mesh = shapes.shape_mesh("sphere", material="copper").placed((14.0, 8.0, 10.0), scale=8.0)
    caster, camera = MeshCaster([mesh], METALS, METAL_BASIS), camera_of(volume)
    alone = caster.alone(camera, (40, 30), WHOLE)
    made = solid.recompose({}, surface=alone)
    new = raycast(volume, GOLD, camera, (40, 30), WHOLE, behind=[caster])
    inside = alone.alpha == 1
    assert inside.sum() > 20
    assert np.abs(made.coefficients - new.coefficients)[inside].max() < 0.002
    around = inside | (alone.alpha == 0)
    assert np.abs(made.alpha - new.alpha)[around].max() < 0.002


def test_distances_along_the_axis_are_those_of_planes():
    cosine = axis_cosine((3, 301), 90.0)
    assert cosine[150, 1] == 1 and cosine[0, 1] == pytest.approx(math.sqrt(0.5), abs=2e-3)
    assert (axis_cosine((2, 2), None) == 1).all()


SLAB = slab_layers(100, 140, 2.0, size=(2, 2))
BARE, SURFACE = replace(SLAB, opacity_layers=None), surface_at(120, SLAB)
OF_ANOTHER_BASIS = {
    "basis": SpectralBasis.load("general-7"),
    "coefficients": np.zeros((2, 2, 14), "f4"),
}


def before(surface: Any) -> Callable[[], object]:
    return lambda: SLAB.recompose({}, surface=surface)


@pytest.mark.parametrize(
    ("make", "fault"),
    [
        (lambda: DepthEffects(focus_mm=0.0), "range DepthEffects.focus_mm"),
        (lambda: DepthEffects(fog_mm=math.inf), "range DepthEffects.fog_mm"),
        (lambda: DepthEffects(near_mm=10.0, far_mm=10.0), "range DepthEffects.near_mm"),
        (lambda: SLAB.recompose({}, DepthEffects(focus_mm=100)), "conflict recompose: focus_mm"),
        (lambda: BARE.recompose({}, DepthEffects(near_mm=100)), "unsupported "),
        (before(surface_at(120, slab_layers(100, 140, 2.0))), "shape recompose: surface"),
        (before(replace(SURFACE, fov_deg=20.0)), "conflict recompose: surface"),
        (before(replace(SURFACE, groups={"a": 0.5, "b": 0.5})), "conflict recompose: surface"),
        (before(replace(SURFACE, **OF_ANOTHER_BASIS)), "conflict recompose: surface"),
    ],
)
def test_effects_and_surfaces_that_cannot_be_are_refused(make, fault):
    refuses(make, fault)


def test_a_picture_of_nothing_stays_one():
    image = layered(np.zeros((4, 5, 2, 2)), np.zeros((4, 5, 2)))
    for effects in (DepthEffects(near_mm=10.0), DepthEffects(focus_mm=20.0)):
        assert not image.recompose({}, effects).alpha.any()
    fogged = image.recompose({}, DepthEffects(fog_mm=100.0))
    assert np.isfinite(fogged.coefficients).all()
