"""Opacities on the GPU: shaders/recompose.frag and its NumPy twin make the same picture."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from tests.support.errors import raises
from tests.support.fixtures import slow, slow_each
from tests.support.relighting import gl_or_skip
from volspec.basis import MaterialBasis
from volspec.errors import ImageError, OpenGLError
from volspec.image import CoefficientImage, DepthEffects
from volspec.image.layers import OpacityLayers
from volspec.relight import LightRig, Relighter, recompose
from volspec.relight.look import Look
from volspec.relight.recompose import PackedOpacity
from volspec.spectra import light, reflectance

NAMES = ("copper", "gold", "brass", "silver")
SIZE = 7, 5
MORE = (1, 1), (4, 1), (3, 2), (2, 5)


def layered(
    materials: int,
    groups: int,
    count: int = 5,
    seed: int = 0,
    shadows: str = "",
    solid: bool = False,
) -> CoefficientImage:
    """Random layers, some without opacity, and a picture that differs from them a little.

    ``shadows`` has a letter for each group: shadow, occlusion, both or neither. If ``solid``, the
    last layer is of surfaces.
    """
    rng = np.random.default_rng(seed)
    pixels = SIZE[1], SIZE[0], count
    tau = rng.random((*pixels, materials)) ** 4 * 6
    tau *= rng.random((*pixels, 1)) < 0.7
    tau[0, :3] = 0
    layers = OpacityLayers(
        tau.astype(np.float16),
        (rng.random((*pixels, groups, materials)) / groups).astype(np.float16),
        (0.2 * rng.random((*pixels, groups)) / groups).astype(np.float16),
        np.sort(rng.random(pixels), axis=-1).astype(np.float16),
        *(casts(rng, (*pixels, groups, 3 + materials), shadows, kinds) for kinds in ("sb", "ob")),
        solid=solid,
    )
    channels, alpha, weighted = layers.recompose([1.0] * materials)
    channels += 0.02 * rng.standard_normal(channels.shape).astype(np.float32)
    channels = np.maximum(channels, 0).reshape(*pixels[:2], -1)
    depth = np.where(alpha > 0, weighted / np.maximum(alpha, 1e-6), np.inf).astype(np.float32)
    basis = MaterialBasis({name: reflectance(name) for name in NAMES[:materials]})
    shares = {f"group {g}": 1 / groups for g in range(groups)} if groups > 1 else {"light": 1.0}
    return CoefficientImage(channels, alpha, depth, basis, groups=shares, opacity_layers=layers)


def casts(
    rng: np.random.Generator, shape: tuple[int, ...], shadows: str, kinds: str
) -> NDArray[np.float16] | None:
    """Random shadows of the groups whose letter is one of ``kinds``; None if there are none."""
    has = [kind in kinds for kind in shadows]
    if not any(has):
        return None
    found = rng.random(shape)
    found[..., :2] *= 0.5  # two of them take no more than there is
    found[..., 2] = 10 ** (3 * found[..., 2] - 3)
    found[..., 3:] = 10 ** (5 * found[..., 3:] - 4)
    return (found * np.array(has)[:, None]).astype(np.float16)


def rig(image: CoefficientImage) -> LightRig:
    lamps = ("A", "D65", "FL2", "HP1", "C", "D50", "LED-B1", "FL11")
    groups = tuple(image.groups) if len(image.groups) > 1 else ("",)
    return LightRig(tuple(map(light, lamps[: len(groups)])), groups=groups)


def relighter_of(image: CoefficientImage, backend: str) -> Relighter:
    return gl_or_skip(image) if backend == "gl" else Relighter(image, backend)


def twin_frame(image: CoefficientImage, lamp: Any = None) -> NDArray[np.float32]:
    """The picture by NumPy, under a light for each group."""
    with Relighter(image, "numpy") as relighter:
        return relighter.frame(lamp or rig(image), dtype=np.float32)


def both_frames(
    image: CoefficientImage, scales: dict[str, float], **how: Any
) -> list[NDArray[np.float32]]:
    """Frames of other opacities on the device, and by its twin."""
    frames = []
    for relighter in (gl_or_skip(image), Relighter(image, "numpy")):
        with relighter:
            frames.append(relighter.frame(rig(image), Look(opacities=scales, **how), np.float32))
    return frames


@pytest.mark.parametrize(("materials", "groups"), [(3, 1), (4, 8), *(slow(*n) for n in MORE)])
@pytest.mark.parametrize(
    "scales", [(0.0, 1.0, 4.0, 0.5), *slow_each((0.7, 1.3, 1.0, 0.9), (3.9, 0, 0, 1))]
)
def test_frames_of_other_opacities_match(materials, groups, scales):
    image = layered(materials, groups)
    wanted = dict(zip(NAMES[:materials], scales, strict=False))
    frames = both_frames(image, wanted)
    np.testing.assert_allclose(*frames, atol=2e-4)
    np.testing.assert_array_equal(twin_frame(image.recompose(wanted)), frames[1])


@pytest.mark.parametrize(
    ("materials", "shadows"), [(3, "s"), (3, "o"), (2, "-b"), (4, "b-s"), (1, "os")]
)
@pytest.mark.parametrize("scales", [(0.3, 1.0, 4.0, 0.0), slow((0.7, 1.3, 1.0, 0.9))])
def test_shadows_fade_alike(materials, shadows, scales):
    image = layered(materials, len(shadows), shadows=shadows)
    wanted = dict(zip(NAMES[:materials], scales, strict=False))
    with gl_or_skip(image) as drawn:
        found = drawn.frame(rig(image), Look(opacities=wanted), np.float32)
    plain = replace(image.opacity_layers, shadow=None, occlusion=None)
    bare = replace(image, opacity_layers=plain)
    shaded, unshaded = (twin_frame(each.recompose(wanted)) for each in (image, bare))
    np.testing.assert_allclose(found, shaded, atol=3e-4)
    assert np.abs(shaded - unshaded).max() > 0.01


@pytest.mark.parametrize("solid", [False, True])
def test_layers_from_the_first_on_match_where_pixels_have_none(solid):
    image = layered(3, 2, solid=solid)
    layers = image.opacity_layers
    assert not PackedOpacity.of(layers).filled
    tau = layers.tau + np.float16(0.02)
    tau[1, :, : 4 if solid else 5] = 0
    tau[2], tau[3, :, 2:] = 0, 0
    own = replace(layers, tau=tau)
    assert PackedOpacity.of(own).filled
    image = replace(image, opacity_layers=own)
    np.testing.assert_allclose(*both_frames(image, {"gold": 0.4}), atol=2e-4)


def test_a_first_layer_too_faint_for_half_floats_hides_no_others():
    image = layered(3, 1)
    tau = image.opacity_layers.tau.astype(np.float32) + 0.02
    tau[1, :, 0] = 1e-9
    image = replace(image, opacity_layers=replace(image.opacity_layers, tau=tau))
    np.testing.assert_allclose(*both_frames(image, {"gold": 0.4}), atol=1e-3)


@pytest.mark.parametrize("shadows", ["--", "b-"])
def test_surfaces_do_not_fade(shadows):
    image = layered(3, 2, shadows=shadows, solid=True)
    none = dict.fromkeys(NAMES[:3], 0.0)
    np.testing.assert_allclose(*both_frames(image, none), atol=3e-4)
    last = image.opacity_layers.tau[:, :, -1].astype(np.float32).sum(axis=-1)
    np.testing.assert_allclose(image.recompose(none).alpha, 1 - np.exp(-last), atol=1e-6)


def test_scales_of_1_draw_the_cast_s_picture_bit_for_bit(backend):
    image = layered(3, 2)
    with relighter_of(image, backend) as relighter:
        before = relighter.frame(rig(image), dtype=np.float32)
        other = relighter.frame(rig(image), Look(opacities={"gold": 0.2}), np.float32)
        after = relighter.frame(rig(image), Look(), np.float32)
    assert np.abs(other - before).max() > 0.01
    np.testing.assert_array_equal(after, before)


def test_opacities_outlast_another_cast_of_the_same_size(backend):
    first, second = layered(3, 1), layered(3, 1, seed=1)
    scales = {"gold": 0.3, "copper": 2.0}
    with relighter_of(first, backend) as relighter:
        relighter.frame(light("A"), Look(opacities=scales))
        relighter.update(second)
        kept = relighter.frame(light("A"), dtype=np.float32)
        relighter.update(second.recompose({}))  # without layers
        without = relighter.frame(light("A"), dtype=np.float32)
    for image, frame in ((second.recompose(scales), kept), (second, without)):
        np.testing.assert_allclose(frame, twin_frame(image, light("A")), atol=2e-4)


@pytest.mark.parametrize(
    "depth",
    [
        DepthEffects(near_mm=100.2),
        DepthEffects(far_mm=100.6),
        DepthEffects(fog_mm=0.8, fog_from_mm=99.9, fog_white=0.7),
        DepthEffects(fog_mm=0.5, fog_from_mm=99.9, near_mm=100.1, far_mm=100.7),
        DepthEffects(focus_mm=99.0, aperture_mm=20.0),
    ],
    ids=["near", "far", "fog", "all", "focus"],
)
@pytest.mark.parametrize(("groups", "solid"), [(2, True), *(slow(n, False) for n in (1, 5))])
def test_frames_in_depth_match(depth, groups, solid):
    """Extents are half floats on the device: half a µm of 1 mm, a hundredth of a thin layer."""
    image = deep(groups, solid)
    frames, before = both_frames(image, {"gold": 0.6}, depth=depth), twin_frame(image)
    with gl_or_skip(image) as drawn:
        drawn.frame(rig(image), Look(opacities={"gold": 0.6}, depth=depth))
        after = drawn.frame(rig(image), Look(), np.float32)
    np.testing.assert_allclose(*frames, atol=1e-2)
    assert np.abs(frames[0] - frames[1]).mean() < 5e-4
    np.testing.assert_allclose(after, before, atol=2e-4)
    assert np.abs(frames[0] - before).max() > 0.02


def deep(groups: int, solid: bool) -> CoefficientImage:
    """Return layers of 1 mm, 100 mm from a camera."""
    image = layered(3, groups, solid=solid)
    own = image.opacity_layers
    tau, depth_mm = np.maximum(own.tau, np.float16(0.01)), own.depth_mm.astype(np.float32) + 100
    layers = replace(own, tau=tau, depth_mm=depth_mm)
    return replace(image, opacity_layers=layers, fov_deg=30.0)


def test_layers_packed_beforehand_are_taken_and_other_numbers_of_them_too():
    image, fewer = layered(3, 1), layered(3, 1, count=2)
    with gl_or_skip(image) as relighter:
        list(relighter.load_opacities(PackedOpacity.of(image.opacity_layers)))
        relighter.frame(light("A"), Look(opacities={"gold": 0}))
        relighter.update(fewer)
        frame = relighter.frame(light("A"), dtype=np.float32)
    expected = twin_frame(fewer.recompose({"gold": 0}), light("A"))
    np.testing.assert_allclose(frame, expected, atol=2e-4)


@pytest.mark.parametrize("calls", ["", "l", "s", "ls", "sl", "lsl", "lfs"])
@pytest.mark.parametrize("depth", [DepthEffects(), DepthEffects(far_mm=100.6)], ids=["", "cut"])
def test_the_next_picture_has_the_opacities_and_depth_of_the_one_before(calls, depth):
    """Whatever is called after `update`: load layers, set the same, draw a frame."""
    first = deep(1, True)
    layers = replace(first.opacity_layers, tau=np.float16(0.3) * first.opacity_layers.tau)
    second = replace(first, opacity_layers=layers)
    look = Look(opacities={"gold": 0.6}, depth=depth)
    with gl_or_skip(first) as relighter:
        relighter.frame(rig(first), look)
        relighter.update(second)
        for call in calls:
            if call == "l":
                list(relighter.load_opacities(PackedOpacity.of(second.opacity_layers)))
            elif call == "s":
                relighter.missing_lut(rig(second), look)
            else:
                relighter.frame(rig(second))
        found = relighter.frame(rig(second), dtype=np.float32)
    expected = twin_frame(second.recompose({"gold": 0.6}, depth))
    np.testing.assert_allclose(found, expected, atol=1e-2)


def test_what_a_device_does_not_take_is_refused_and_the_picture_stays(backend, monkeypatch):
    image = layered(4, 1)
    with relighter_of(image, backend) as relighter:
        before = relighter.frame(light("A"), Look(opacities={"gold": 0.5}))
        for scales in ({"gold": -1}, {"skin": 1}, {"gold": float("nan")}):
            with raises(ImageError):
                relighter.frame(light("A"), Look(opacities=scales))
        np.testing.assert_array_equal(relighter.frame(light("A")), before)
    describe: Any = recompose.describe
    monkeypatch.setattr(recompose, "describe", lambda gl: describe(gl) | {"max_layers": 4})
    if backend == "gl":
        with relighter_of(image, backend) as relighter, raises(OpenGLError, "size"):
            relighter.frame(light("A"), Look(opacities={"gold": 0}))
