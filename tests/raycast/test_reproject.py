"""Nearby views and stereo pairs of layers of opacity, against casts; the camera in the file."""

from dataclasses import replace

import numpy as np
import pytest

from tests.raycast.test_layered import function
from tests.support.errors import refuses, warns
from tests.support.fixtures import slow
from tests.support.raycasts import along_z, cube, edit_exr, even_gold, turned
from volspec.camera import Camera
from volspec.image import CoefficientImage
from volspec.image.depth import DepthEffects, fog_behind, layers_in_depth
from volspec.image.reproject import Reprojector
from volspec.pipeline import Raycaster, raycast
from volspec.raycast import Ambient, LightGroup, RaycastSpec
from volspec.relight import relight
from volspec.relight.look import Look
from volspec.relight.stereo import Stereo, expected_depth_mm
from volspec.spectra import light
from volspec.volume import Volume

SIZE = 96, 72
SKY = LightGroup("sky", (Ambient(),))
FLAT = RaycastSpec(step_mm=0.25, alpha_stop=1.0, layers=8, groups=(SKY,))


def balls() -> Volume:
    """A ball before a larger one, which it hides in part."""
    z, y, x = np.mgrid[-1:1:32j, -1:1:32j, -1:1:32j]
    small = 0.7 - np.sqrt((x - 0.2) ** 2 + (y + 0.6) ** 2 + z**2) / 0.6
    large = 1 - np.sqrt((x + 0.2) ** 2 + (y - 0.2) ** 2 + z**2)
    return Volume(np.clip(np.maximum(small, large), 0, 1).astype(np.float32))


@pytest.fixture(scope="module")
def caster() -> Raycaster:
    return Raycaster(balls())


def cast(
    caster: Raycaster, camera: Camera, size: tuple[int, int] = SIZE, layers: int = 0
) -> CoefficientImage:
    spec = replace(FLAT, layers=layers)
    return raycast(caster.volume, function(), camera, size, spec, caster=caster)


@pytest.fixture(scope="module")
def image(caster: Raycaster) -> CoefficientImage:
    return cast(caster, turned(caster.volume, 30, 10), layers=8)


@pytest.fixture(scope="module")
def reprojector(image: CoefficientImage) -> Reprojector:
    return Reprojector(image)


def rms(one: CoefficientImage, other: CoefficientImage) -> float:
    return float(np.sqrt(np.mean((one.coefficients - other.coefficients) ** 2)))


VIEWS = {
    "turned": (turned(balls(), 35, 13), SIZE),
    "nearer": (turned(balls(), 32, 10, zoom=1.5), SIZE),
    "farther": (turned(balls(), 32, 10, zoom=0.6), SIZE),
    "parallel": (turned(balls(), 30, 10, orthographic=True), SIZE),
    "half the size": (turned(balls(), 35, 13), (48, 36)),
}


@pytest.mark.parametrize("view", VIEWS)
def test_a_nearby_view_is_that_of_a_cast(caster, image, reprojector, view):
    """Measured: an RMS of 0.001 to 0.002 of white; of the picture left as it was 0.004 and more."""
    camera, size = VIEWS[view]
    shown, new = reprojector.view(camera, size=size), cast(caster, camera, size)
    assert rms(shown, new) < 0.004
    seen = new.alpha > 0.3
    assert np.abs(shown.alpha - new.alpha)[seen].mean() < 0.02
    assert np.abs(shown.depth_mm[seen] - new.depth_mm[seen]).max() < 3.0
    assert shown.camera == camera and shown.opacity_layers is None and shown.first_mm is None
    if size == SIZE:
        assert rms(shown, new) < 0.4 * rms(image, new)


@pytest.mark.slow
@pytest.mark.parametrize("mm", [2.0**-40, 2.0**40])
def test_views_and_lenses_do_not_depend_on_the_unit_of_length(mm):
    pictures = []
    for unit in (1.0, mm):
        volume = Volume(balls().values, (unit,) * 3)
        spec = replace(FLAT, step_mm=0.25 * unit)
        curve = replace(function(), reference_step_mm=unit)
        made = raycast(volume, curve, turned(volume, 30, 10), SIZE, spec)
        lens = DepthEffects(focus_mm=80 * unit, aperture_mm=20 * unit, near_mm=70 * unit)
        views = Reprojector(made).view(turned(volume, 35, 13)), made.recompose({}, lens)
        pictures.append(np.array([each.coefficients for each in views]))
    assert np.abs(np.subtract(*pictures)).max() < 1e-5


def test_a_slab_keeps_its_opacity_at_any_distance_and_turn():
    """Depths add to what the medium has along the new rays, as Beer and Lambert say."""
    volume = cube(9)
    with warns("no opacity of copper"):
        made = raycast(volume, even_gold(0.05), along_z(volume), (64, 64), FLAT)
    x, y, z = along_z(volume).target_mm
    for height_mm, turn in ((4.0, 0.0), (2.5, 0.0), (7.0, 0.0), (4.0, 0.2)):
        position = x + 60 * np.sin(turn), y, z + 60 * np.cos(turn)
        other = Camera(position, (x, y, z), up=(0, 1, 0), height_mm=height_mm)
        tau = -np.log1p(-Reprojector(made).view(other).alpha[24:40, 24:40])
        expected = -8 * np.log(0.95) / np.cos(turn)
        assert tau.mean() == pytest.approx(expected, rel=1e-3)


def test_nothing_is_seen_of_hidden_materials_and_from_elsewhere(image, reprojector):
    right, _, forward = image.camera.frame()
    away_mm = np.add(image.camera.position_mm, 100 * (forward + 2 * right))
    away = replace(image.camera, target_mm=tuple(away_mm))
    hidden = reprojector.view(image.camera, {"copper": 0, "gold": 0})
    for made in (hidden, reprojector.view(away)):
        assert not made.alpha.any() and not made.coefficients.any()
        assert np.isinf(made.depth_mm).all()


@pytest.mark.parametrize(
    ("make", "fault"),
    [
        (lambda image, _: Reprojector(replace(image, opacity_layers=None)), "unsupported "),
        (lambda image, _: Reprojector(replace(image, camera=None)), "missing "),
        (lambda image, _: Stereo().cameras(replace(image, camera=None)), "missing "),
        (lambda image, own: own.view(opposite(image)), "range reproject: camera"),
        (lambda image, own: own.view(image.camera, {"silver": 1}), "unknown opacities"),
        (lambda image, own: own.view(image.camera, size=(0, 4)), "range "),
        (lambda *_: Stereo(eyes_mm=3, eyes_deg=2), "conflict Stereo.eyes_mm"),
        (lambda *_: Stereo(convergence_mm=0), "range Stereo.convergence_mm"),
    ],
)
def test_what_cannot_be_reprojected_is_refused(image, reprojector, make, fault):
    refuses(lambda: make(image, reprojector), fault)


def opposite(image: CoefficientImage) -> Camera:
    behind = 2 * np.array(image.camera.target_mm) - image.camera.position_mm
    return replace(image.camera, position_mm=tuple(behind))


def test_a_file_holds_the_camera(image, tmp_path):
    image.save(tmp_path / "image.exr")
    assert CoefficientImage.load(tmp_path / "image.exr").camera == image.camera
    parallel = Camera((0.5, -60, 1 / 3), (0, 0, 0), height_mm=20.0)
    replace(image, camera=parallel).save(tmp_path / "parallel.exr")
    assert CoefficientImage.load(tmp_path / "parallel.exr").camera == parallel
    edit_exr(tmp_path / "image.exr", lambda h, c: h.pop("volspec:camera"))
    assert CoefficientImage.load(tmp_path / "image.exr").camera is None  # an older file


@pytest.mark.parametrize("height_mm", [None, slow(60.0)], ids=["perspective", "parallel"])
def test_eyes_see_what_casts_of_their_cameras_do(caster, height_mm):
    here = replace(turned(caster.volume, 30, 10), height_mm=height_mm)
    made = cast(caster, here, layers=8)
    stereo = Stereo(eyes_deg=3.0)
    left, right = stereo.cameras(made)
    for view, eye in zip(Look(stereo=stereo).views(made), (left, right), strict=True):
        assert rms(view, cast(caster, eye)) < 0.002
    assert np.subtract(right.position_mm, left.position_mm) @ here.frame()[0] > 0
    # Zero disparity at the convergence distance.
    at = np.array(here.position_mm) + expected_depth_mm(made) * here.frame()[2]
    for eye in (left, right):
        field = eye.ray_field(*SIZE)
        ahead = (at - eye.position_mm) @ eye.frame()[2]
        scale = field.distance / ahead if field.perspective else 1.0
        offset = (at - eye.position_mm) @ field.across / (field.across @ field.across) * scale
        assert field.middle[0] + offset == pytest.approx((SIZE[0] - 1) / 2, abs=1e-6)


def test_eyes_by_distance_or_angle_are_the_same(image):
    depth_mm, angle_deg = expected_depth_mm(image), float(np.degrees(2 * np.arctan(1 / 60)))
    by_angle = Stereo(eyes_deg=angle_deg, convergence_mm=depth_mm)
    for eyes in (Stereo(), Stereo(eyes_mm=depth_mm / 30), by_angle):
        left, right = eyes.cameras(image)
        apart = np.linalg.norm(np.subtract(left.position_mm, right.position_mm))
        assert apart == pytest.approx(depth_mm / 30)


def test_anaglyphs_are_mixed_in_linear_light(image):
    rng = np.random.default_rng(1)
    left, right = rng.integers(0, 256, (2, 4, 5, 3), dtype=np.uint8)
    assert np.array_equal(Stereo().combine(left, right), np.hstack([left, right]))
    assert np.array_equal(Stereo("crossed").combine(left, right), np.hstack([right, left]))
    half = Stereo("half-colour").combine(left, right)
    assert np.array_equal(half[..., 1:], right[..., 1:])
    grey = np.repeat(left[..., :1], 3, axis=2)
    assert np.abs(Stereo("half-colour").combine(grey, right)[..., 0] - left[..., 0]).max() <= 1
    # White stays white within the rounding of the published numbers; black stays black.
    for level in (0, 255):
        same = np.full((2, 2, 3), level, np.uint8)
        assert np.abs(Stereo("anaglyph").combine(same, same).astype(int) - level).max() <= 1
    # A red surface is dark through cyan, whichever eye sees it.
    red = np.array([[[255, 0, 0]]], np.uint8)
    assert Stereo("anaglyph").combine(red, 0 * red)[0, 0].tolist() == [177, 0, 0]
    assert relight(image, light("D65"), Look(stereo=Stereo("anaglyph"))).shape == (*SIZE[::-1], 3)


@pytest.mark.parametrize("scale", [0.3, slow(1.0)])
def test_cuts_and_fog_of_views_are_those_of_the_picture(image, scale):
    """Layers that are cut and in fog are composited to what `recompose` makes of them."""
    middle = expected_depth_mm(image)
    effects = DepthEffects(near_mm=middle - 2, far_mm=middle + 9, fog_mm=3 * middle, fog_white=0.7)
    changed = layers_in_depth(image, [scale, 1.0], effects)
    channels, alpha, _ = changed.opacity_layers.recompose([scale, 1.0])
    coefficients = channels.reshape(image.coefficients.shape).astype(np.float32)
    bare = replace(image, coefficients=coefficients, alpha=alpha.astype(np.float32))
    made, wanted = fog_behind(bare, effects), image.recompose({"copper": scale}, effects)
    assert np.abs(made.alpha - wanted.alpha).max() < 2e-3
    assert np.abs(made.coefficients - wanted.coefficients).max() < 2e-3
    assert rms(made, replace(image, coefficients=wanted.coefficients)) < 1e-4
    look = Look(opacities={"copper": scale}, depth=effects, stereo=Stereo(eyes_deg=0.01))
    for view in look.views(image):
        assert rms(view, wanted) < 1e-4
