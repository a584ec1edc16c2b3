"""Meshes in a cast with layers: they stay while materials fade, and shadows go with these."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

import volspec as vs
from tests.support.errors import raises
from tests.support.fixtures import slow, slow_each
from tests.support.raycasts import soft_ball
from tests.twins.test_layers import assert_layers_alike, blend, noise
from volspec.errors import CastCancelled, RaycastError
from volspec.export.deep import DeepSamples
from volspec.image.depth import extents
from volspec.image.reproject import Reprojector
from volspec.mesh import shapes
from volspec.relight import error_map

pytest.importorskip("embreex")

# In another order than the function has them.
MATERIALS = {name: vs.reflectance(name) for name in ("silver", "gold", "copper")}
BASIS = vs.MaterialBasis(MATERIALS)
SIZE = 48, 36
POINTS = [(0.1, 0.0, "copper"), (0.2, 0.08, "copper"), (0.5, 0.08, "copper")]
POINTS += [(0.6, 0.15, "gold"), (1.0, 0.15, "gold")]
FUNCTION = vs.TransferFunction(POINTS, MATERIALS, BASIS, reference_step_mm=1.0)
PLAIN = (vs.LightGroup("key", (vs.Headlight(), vs.Ambient(0.3))),)
LIT = (
    vs.LightGroup("key", (vs.Headlight(0.2), vs.Directional((1.0, 0.6, 0.4), shadows=True))),
    vs.LightGroup("sky", (vs.Ambient(occlusion=True, radius_mm=8.0),)),
)


@pytest.fixture(scope="module")
def caster() -> vs.Raycaster:
    return vs.Raycaster(soft_ball(24))


CAMERA = vs.Camera.orbit(soft_ball(24), azimuth_deg=30, elevation_deg=20)


def balls(*, opacity: float = 1.0) -> vs.MeshCaster:
    """A silver ball in the volume, towards the eye, and a copper one next to it."""
    one = shapes.shape_mesh("sphere", material="silver").placed((11.5, 6.0, 15.0), scale=8.0)
    other = shapes.shape_mesh("sphere", material="copper").placed((20.0, 10.0, 6.0), scale=5.0)
    return vs.MeshCaster([replace(one, opacity=opacity), other], MATERIALS, BASIS)


def cast(
    caster: vs.Raycaster, groups: Any, *, opacity: float = 1.0, how: Any = None, **settings: Any
) -> vs.CoefficientImage:
    """Cast the ball with `balls` of an opacity; ``how`` goes to raycast, the rest to its spec."""
    usual = {"step_mm": 0.25, "specular": 0.2, "alpha_stop": 1.0, "light_cells": 24, "layers": 8}
    spec = vs.RaycastSpec(groups=groups, **(usual | settings))
    given = {"transfer": FUNCTION, "behind": [balls(opacity=opacity)], **(how or {})}
    return vs.raycast(caster.volume, camera=CAMERA, size=SIZE, spec=spec, caster=caster, **given)


def whole(image: vs.CoefficientImage) -> Any:
    """Return where meshes cover none or all of a pixel; behind their edges, layers have nothing."""
    layers = image.opacity_layers
    assert layers.solid
    covered = 1.0 - np.exp(-layers.tau[:, :, -1].sum(axis=2))
    return (covered == 0.0) | (covered > 0.999)


@pytest.fixture(scope="module", params=[slow(PLAIN), LIT], ids=["plain", "shadows"])
def groups(request: pytest.FixtureRequest) -> Any:
    return request.param


@pytest.fixture(scope="module")
def image(caster: vs.Raycaster, groups: Any) -> vs.CoefficientImage:
    """A material of a mesh alone is not missing: nothing is warned of."""
    return cast(caster, groups)


@pytest.mark.slow
def test_scale_1_is_the_cast_without_layers(caster, image, groups):
    layers = image.opacity_layers
    assert (layers.solid, layers.count, layers.fades) == (True, 8, [False, True, True])
    without = cast(caster, groups, layers=0)
    np.testing.assert_allclose(image.coefficients, without.coefficients, atol=1e-5)
    assert np.array_equal(image.recompose({}).coefficients, image.coefficients)
    own = layers.recompose([1.0, 1.0, 1.0])
    off = np.abs(own.channels.reshape(image.coefficients.shape) - image.coefficients)[whole(image)]
    assert off.max() < 0.05 and off.mean() < 1e-3
    np.testing.assert_allclose(own.alpha[whole(image)], image.alpha[whole(image)], atol=1e-5)


@pytest.mark.parametrize(
    "scales", [(0.0, 1.0), *slow_each((0.3, 1), (1, 0), (0, 0.25), (4, 0.5))], ids=str
)
def test_meshes_are_seen_as_in_a_new_cast(caster, image, groups, scales):
    """Measured: channels are off by 1.4e-4 on average, 0.027 at most, on meshes by 6e-4."""
    opacities = dict(zip(("copper", "gold"), scales, strict=True))
    shown = image.recompose(opacities)
    new = cast(caster, groups, layers=0, opacities=opacities)
    assert np.abs(shown.alpha - new.alpha)[whole(image)].max() < 1e-4
    off = np.abs(shown.coefficients - new.coefficients)
    assert off[whole(image)].max() < 0.04 and off[whole(image)].mean() < 2e-4
    assert off[image.opacity_layers.tau[:, :, -1].any(axis=2) & whole(image)].mean() < 8e-4
    assert off.mean() < 8e-4  # with edges


def test_without_the_volume_meshes_alone_are_left(image, groups):
    """Also the shadows of what has faded are gone; those of the other mesh stay."""
    bare = image.recompose({"copper": 0, "gold": 0})
    with pytest.warns(vs.VolspecWarning, match="'silver' is scaled, which only meshes have"):
        alike = image.recompose({"copper": 0, "gold": 0, "silver": 0})
    assert np.array_equal(alike.coefficients, bare.coefficients)
    alone = balls().alone(CAMERA, SIZE, vs.RaycastSpec(specular=0.2, groups=groups))
    np.testing.assert_allclose(bare.alpha, alone.alpha, atol=1e-6)
    np.testing.assert_allclose(bare.coefficients, alone.coefficients, atol=2e-4)
    seen = np.isfinite(alone.depth_mm) & whole(image)
    np.testing.assert_allclose(bare.depth_mm[seen], alone.depth_mm[seen], rtol=1e-5)
    assert np.isfinite(bare.depth_mm[bare.alpha > 0]).all()


def test_a_file_holds_them_as_its_third_version(image, tmp_path):
    image.save(tmp_path / "image.exr")
    again = vs.CoefficientImage.load(tmp_path / "image.exr")
    assert again.opacity_layers.solid
    for scales in ({"copper": 0.0}, {"copper": 0.0, "gold": 0.0}, {"gold": 3.0}):
        one, other = (each.recompose(scales) for each in (again, image))
        assert np.abs(one.coefficients - other.coefficients).max() < 4e-3


def test_cuts_fog_views_and_deep_files_have_them(image):
    none = {"copper": 0.0, "gold": 0.0}
    bare = image.recompose(none)
    at = np.unravel_index(bare.alpha.argmax(), bare.alpha.shape)
    ball_mm = float(bare.depth_mm[at])
    cut, far = vs.DepthEffects(near_mm=ball_mm + 8), vs.DepthEffects(far_mm=1e4)
    left = [image.recompose(none, effects).alpha[at] for effects in (cut, far)]
    assert left == pytest.approx([0, 1], abs=1e-6)
    fog = image.recompose(none, vs.DepthEffects(fog_mm=ball_mm, fog_white=1.0))
    assert fog.coefficients[at][-1] > bare.coefficients[at][-1]
    samples = DeepSamples.of(image, none)
    assert samples.counts[at] == 1 and samples.alpha.max() == pytest.approx(1, abs=1e-6)
    same = Reprojector(image).view(image.camera, none)
    assert np.abs(same.alpha - bare.alpha).max() < 1e-4


@pytest.mark.slow
def test_an_opaque_body_in_front_uncovers_a_mesh(caster):
    """Rays of the picture end in it; what is behind is seen once it is gone."""
    transfer = replace(FUNCTION, points=[(0.1, 0.0, "gold"), (0.2, 1.0, "gold")])
    made = cast(caster, PLAIN, how={"transfer": transfer}, alpha_stop=0.99)
    bare = made.recompose({"gold": 0})
    alone = balls().alone(CAMERA, SIZE, vs.RaycastSpec(specular=0.2, groups=PLAIN))
    np.testing.assert_allclose(bare.coefficients, alone.coefficients, atol=2e-4)


def test_extents_and_deep_samples_of_a_mesh_are_at_its_surface(image):
    """Also behind unused layers, and next to a layer of the volume."""
    layers = image.opacity_layers
    total, depth_mm = layers.tau.sum(axis=3).reshape(-1, 8), layers.depth_mm.reshape(-1, 8)
    begin, width = extents(total, depth_mm, solid=True)
    seen = total[:, -1] > 0
    assert not width[seen, -1].any()
    np.testing.assert_allclose(begin[seen, -1], depth_mm[seen, -1])
    own, wide = extents(total[:, :7], depth_mm[:, :7])
    np.testing.assert_array_equal(begin[:, :7], own)
    np.testing.assert_array_equal(width[:, :7], wide)
    samples, bare = DeepSamples.of(image), image.recompose({"copper": 0.0, "gold": 0.0})
    last = np.cumsum(samples.counts.ravel()) - 1
    opaque = (bare.alpha == 1).ravel() & (samples.counts.ravel() > 0)
    np.testing.assert_array_equal(samples.back_mm[last[opaque]], samples.depth_mm[last[opaque]])


def test_an_edge_of_a_mesh_is_behind_the_volume(image):
    layers, missed = image.opacity_layers, np.isinf(balls().depths_mm(image.camera, SIZE)[0])
    used = np.where(np.isfinite(layers.depth_mm), layers.depth_mm, 0)
    edge = (layers.tau[:, :, -1].sum(axis=2) > 0) & missed
    assert edge.sum() > 5
    assert (used[edge][:, -1] >= used[edge][:, :-1].max(axis=1)).all()


@pytest.mark.slow
def test_light_of_other_lamps_is_not_used_again(caster):
    """More lamps without layers move what the light volume has of those with them."""
    first = cast(caster, LIT)
    more = (*LIT, vs.LightGroup("rim", (vs.Directional((-1.0, 0.2, 0.1), shadows=True),)))
    cast(caster, more, layers=0)
    again = cast(caster, LIT)
    for name in ("tau", "shadow", "occlusion"):
        one, other = (getattr(each.opacity_layers, name) for each in (first, again))
        np.testing.assert_array_equal(one, other)


def test_an_error_is_estimated_of_what_fades_alone(image):
    """Nothing is lost where the volume is hidden."""
    groups = tuple(image.groups) if len(image.groups) > 1 else ("",)
    rig = vs.LightRig((vs.light("D65"),) * len(groups), groups=groups)
    none = error_map(image, rig, against="cast", opacities={"copper": 0.0, "gold": 0.0})
    half = error_map(image, rig, against="cast", opacities={"copper": 0.25})
    assert none.delta_e.max() < 0.04 < half.delta_e.max()


@pytest.mark.slow
def test_what_layers_cannot_show_is_refused_and_lighting_meshes_is_cancelled(caster):
    done: list[float] = []
    how = {"progress": done.append, "cancel": lambda: done[-1:] == [1.0]}
    for given in ({"opacity": 0.5}, {"layers": 1}):
        with raises(RaycastError, "conflict", "raycast: layers"):
            cast(caster, LIT, how=how, **given)
    assert done == []
    with raises(CastCancelled):
        cast(caster, LIT, how=how)


@pytest.mark.slow
@pytest.mark.parametrize(("lanes", "materials"), [(1, 2), (8, 3)])
def test_the_kernel_lights_what_meshes_shade_as_its_twin(lanes, materials):
    mesh = shapes.shape_mesh("sphere", material="silver").placed((5.0, 9.0, 8.0), scale=4.0)
    clear = vs.MeshCaster([mesh], MATERIALS, BASIS).clear
    spec = vs.RaycastSpec(layers=6, step_mm=0.5, groups=LIT, specular=0.2, light_cells=8)
    assert_layers_alike(noise(8), blend(0.3, materials), spec, clear=clear, lanes=lanes)
