"""Steps by quality: estimated errors, and what a user sees of them."""

import warnings
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.ndimage import gaussian_filter

import volspec as vs
from tests.support.errors import warns
from tests.support.fixtures import slow_each
from volspec.raycast.step_search import SHORTEST, TARGETS, ErrorTarget, Trial, choose_step

BASIS = vs.SpectralBasis.load("general-7")
COPPER = {"copper": vs.reflectance("copper")}


def transfer(opacity: float = 0.6) -> vs.TransferFunction:
    """Return a curve with corners in the ball's shell."""
    points = [(0.3, 0.0, "copper"), (0.5, opacity, "copper"), (0.9, 0.1, "copper")]
    return vs.TransferFunction(points, COPPER, BASIS)


@given(st.floats(1e-4, 1.0), st.floats(1.2, 2.5), st.floats(1e-3, 0.02))
def test_the_step_leaves_the_error_asked_for(factor, order, error):
    """Casts whose error is a power of the step, the same in all pixels: it falls as it does."""
    truth = np.full((40, 40, 3), 0.5)

    def cast(step: float, *_: object) -> Trial:
        return Trial(truth + factor * step**order, np.ones((40, 40), np.float32))

    step, left, _ = choose_step(cast, (40, 40), ErrorTarget(error, 1.0))
    assert factor * step**order <= 1.001 * error or step < 2 * SHORTEST
    assert step == 1.0 or step <= SHORTEST * 2 or left > 0.3 * error


@given(st.floats(1.0, 1.9), st.floats(0.1, 0.9))
def test_a_step_that_misses_a_wall_is_not_chosen(thick, part):
    """Steps beyond a wall's thickness lose some pixels at once: the error is no power of them."""

    def cast(step: float, size: tuple[int, int], _: bool) -> Trial:
        lost = np.arange(size[0] * size[1]).reshape(size[1], size[0]) < part * size[0] * size[1]
        colour = np.where(lost & (step > thick), 0.0, 0.5)
        return Trial(colour[..., None], np.ones(colour.shape, np.float32))

    assert choose_step(cast, (90, 60), TARGETS["fast"]).step <= thick


@given(st.floats(0.0, 1.0), st.floats(0.3, 6.0), st.sampled_from([0.02, 0.005]))
def test_a_slab_whose_rays_are_all_alike_is_not_right_by_chance(near, thick, error):
    """Sums of its samples: multiples of the step, often the same with half of it."""
    shifts = np.random.default_rng(1).random((48, 48))

    def cast(step: float, _: tuple[int, int], is_reference: bool) -> Trial:
        first = (0.5 + shifts * is_reference) * step
        count = np.ceil((near + thick - first) / step) - np.ceil((near - first) / step)
        return Trial(0.1 * step * count[..., None], np.ones((48, 48), np.float32))

    step, left, _ = choose_step(cast, (48, 48), ErrorTarget(error, 1.0))
    off = np.abs(cast(step, (48, 48), False).coefficients - 0.1 * thick).max()
    assert off <= 1.1 * error or left > error


def noise(smooth: float) -> vs.Volume:
    """Return smooth noise around 0.5."""
    values = gaussian_filter(np.random.default_rng(1).normal(size=(40,) * 3), smooth)
    return vs.Volume((0.5 + 0.15 * values / values.std()).astype(np.float32))


def pipe() -> vs.Volume:
    """Return a faint slab, and a small hard shell next to it."""
    z, y, x = np.mgrid[:40, :40, :40] - 19.5
    away = np.sqrt((x - 8) ** 2 + y**2 + z**2)
    slab = np.clip(0.4 - np.abs(x + 10) / 15, 0, 1)
    return vs.Volume(np.where((away > 4) & (away < 5.2), 1, slab).astype(np.float32))


def slab() -> vs.Volume:
    """Return a slab across y with soft faces."""
    values = np.clip(1.3 - 0.7 * np.abs(np.arange(24, dtype=np.float32) - 11.5), 0, 1)
    return vs.Volume(np.tile(values[:, None], (24, 1, 24)))


ALONG = {"azimuth_deg": 0.0, "elevation_deg": 0.0, "orthographic": True}
NEAR = {"zoom": 8.0, "target_mm": (27.5, 19.5, 19.5)}
LIT = vs.RaycastSpec(groups=(vs.LightGroup("aside", (vs.Directional((1, 0, 0)),)),), diffuse=1)
SCENES = {
    "whole": (lambda: vs.phantom.ball(48), {}, vs.RaycastSpec()),
    "detail": (pipe, NEAR, vs.RaycastSpec()),
    "along an axis": (slab, ALONG, vs.RaycastSpec()),
    "light from aside": (pipe, NEAR, LIT),
    "small in the picture": (lambda: noise(1.5), {"zoom": 0.3}, vs.RaycastSpec()),
    "cut": (lambda: noise(1.5), {}, vs.RaycastSpec(crop_voxels=((9, 30), (0, 40), (12, 19)))),
    "greatest value": (lambda: noise(2), {}, vs.RaycastSpec(mode="maximum")),
}


def worst_error(volume: vs.Volume, transfer, spec: vs.RaycastSpec, **view) -> float:
    """Return the greatest error by what a quality promises, of those without a warning."""
    camera = vs.Camera.orbit(volume, **{"azimuth_deg": 40.0, "elevation_deg": 25.0, **view})
    caster = vs.Raycaster(volume)
    given = volume, transfer, camera, (120, 96)
    true = vs.raycast(*given, replace(spec, step_mm=1 / 32, alpha_stop=1.0), caster=caster)
    worst = 0.0
    for name, target in TARGETS.items():
        with warnings.catch_warnings(record=True) as said:
            warnings.simplefilter("always")
            image = vs.raycast(*given, replace(spec, quality=name), caster=caster)
        apart = (image.coefficients - true.coefficients)[true.alpha > 0.01]
        if not said:
            worst = max(worst, float(np.sqrt(np.mean(apart**2))) / target.error)
    return worst


@pytest.mark.parametrize("name", [*list(SCENES)[:3], *slow_each(*list(SCENES)[3:])])
def test_a_picture_has_the_error_of_its_quality(name):
    volume, view, spec = SCENES[name]
    assert 0.3 < worst_error(volume(), transfer(), spec, **view) < 1.2


@pytest.mark.parametrize("opacity", [1.0, 0.5])
def test_isosurfaces_need_no_short_steps(opacity):
    """A wall thinner than a step, at rest and aslant, and the rims of rough ones."""
    surface = vs.Isosurfaces([(0.6, opacity, "copper")], COPPER, BASIS)
    wall = np.zeros((40, 40, 40), np.float32)
    wall[:, :, 19] = 1.0
    for volume, view in ((vs.Volume(wall), {"zoom": 4}), (noise(0.8), {}), (pipe(), NEAR)):
        assert worst_error(volume, surface, vs.RaycastSpec(), **view) < 1.0


def stepped(
    spec: vs.RaycastSpec,
    opacity: float = 0.6,
    side: int = 16,
    size: tuple[int, int] = (64, 64),
    **view: float,
) -> vs.RaycastSpec:
    """Return settings with the step that a ball gets."""
    ball = vs.phantom.ball(side)
    caster = vs.Raycaster(ball)
    camera = vs.Camera.orbit(ball, **view)
    return caster.with_step(caster.bake(transfer(opacity)), camera, size, spec)


def test_a_step_that_is_given_is_used():
    spec = vs.RaycastSpec(step_mm=0.37, quality="fast")
    assert stepped(spec) == spec


@pytest.mark.slow
def test_the_step_depends_neither_on_the_strength_of_light_nor_on_earlier_pictures():
    ball = vs.phantom.ball(32)
    caster, camera = vs.Raycaster(ball), vs.Camera.orbit(ball, zoom=2)
    table, steps = caster.bake(transfer()), set()
    for intensity in (1.0, 0.1, 30.0):
        key = vs.LightGroup("key", (vs.Directional((1, 1, 1), shadows=True, intensity=intensity),))
        spec = vs.RaycastSpec(groups=(key,), quality=0.001)
        caster.with_step(table, vs.Camera.orbit(ball), (64, 64), spec)
        steps.add(caster.with_step(table, camera, (64, 64), spec).step_mm)
    assert len(steps) == 1


def test_steeper_curves_get_shorter_steps():
    spec = vs.RaycastSpec(quality=0.0003)
    assert stepped(spec, 0.02, side=32).step_mm > stepped(spec, 0.95, side=32).step_mm


def test_an_error_that_no_step_reaches_is_told_with_what_is_reached():
    ball = vs.phantom.ball(24)
    caster, view = vs.Raycaster(ball), (vs.Camera.orbit(ball), (64, 64))
    table = caster.bake(transfer())
    with warns("quality 1e-06", "leaves"):
        found = caster.with_step(table, *view, vs.RaycastSpec(quality=1e-6))
    assert found.step_mm < 0.2
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        caster.with_step(table, *view, vs.RaycastSpec(quality=1e-6, half=True))  # once


def test_an_empty_picture_needs_no_short_steps():
    assert stepped(vs.RaycastSpec(), 0.0).step_mm == TARGETS["balanced"].longest
