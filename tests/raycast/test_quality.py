"""Steps by quality: estimated errors, and what a user sees of them."""

import warnings

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import volspec as vs
from tests.support.errors import warns
from tests.support.raycasts import turned
from volspec.raycast.quality import SHORTEST, TARGETS, Picture, Target, choose_step

BASIS = vs.SpectralBasis.load("general-7")
COPPER = {"copper": vs.reflectance("copper")}


def transfer(opacity: float = 0.6) -> vs.TransferFunction:
    """Return a curve with corners in the ball's shell."""
    points = [(0.3, 0.0, "copper"), (0.5, opacity, "copper"), (0.9, 0.1, "copper")]
    return vs.TransferFunction(points, COPPER, BASIS)


@given(st.floats(1e-4, 1.0), st.floats(1.2, 2.5), st.floats(1e-3, 0.02))
def test_the_step_leaves_the_error_asked_for(factor, order, error):
    """Casts whose error is a power of the step."""
    truth = np.full((4, 4, 3), 0.5)

    def probe(step: float) -> Picture:
        return Picture(truth + factor * step**order, np.ones((4, 4), np.float32))

    step, left = choose_step(probe, Target(error, 1.0))
    # Two casts differ by less than the error of the longer, by the shorter's.
    assert factor * step**order <= error / (1.0 - 0.5**order) or step < 2 * SHORTEST
    assert step == 1.0 or step <= SHORTEST * 2 or left > 0.3 * error


@pytest.mark.parametrize("name", TARGETS)
def test_a_picture_has_about_the_error_of_its_quality(name):
    ball = vs.phantom.ball(48)
    camera = turned(ball, 40.0, 25.0)
    caster = vs.Raycaster(ball)

    def cast(spec: vs.RaycastSpec) -> vs.CoefficientImage:
        return vs.raycast(ball, transfer(), camera, (96, 96), spec, caster=caster)

    truth = cast(vs.RaycastSpec(step_mm=1 / 32, alpha_stop=1.0))
    apart = cast(vs.RaycastSpec(quality=name)).coefficients - truth.coefficients
    error = np.sqrt(np.mean(apart[truth.alpha > 0.01] ** 2))
    assert error <= 1.5 * TARGETS[name].error


def stepped(spec: vs.RaycastSpec, opacity: float = 0.6, side: int = 16) -> vs.RaycastSpec:
    """Return settings with the step that a ball gets."""
    caster = vs.Raycaster(vs.phantom.ball(side))
    return caster.with_step(caster.bake(transfer(opacity)), spec)


def test_a_step_that_is_given_is_used():
    spec = vs.RaycastSpec(step_mm=0.37, quality="fast")
    assert stepped(spec) == spec


@pytest.mark.slow
def test_the_step_is_the_same_from_every_side_and_under_other_lights():
    ball = vs.phantom.ball(32)
    caster, steps = vs.Raycaster(ball), set()
    key = vs.LightGroup("key", (vs.Directional((1, 1, 1), shadows=True),))
    for turn, spec in ((0.0, vs.RaycastSpec()), (70.0, vs.RaycastSpec(groups=(key,)))):
        camera = vs.Camera.orbit(ball, azimuth_deg=turn)
        image = vs.raycast(ball, transfer(), camera, (32, 32), spec, caster=caster)
        steps.add(image.notes["raycast"].partition("step_mm=")[2].split(",")[0])
    assert len(steps) == 1 and "None" not in steps.pop()


def test_steeper_curves_get_shorter_steps():
    spec = vs.RaycastSpec(quality=0.0003)
    assert stepped(spec, 0.02, side=32).step_mm > stepped(spec, 0.95, side=32).step_mm


def test_an_error_that_no_step_reaches_is_told_with_what_is_reached():
    caster = vs.Raycaster(vs.phantom.ball(24))
    table = caster.bake(transfer())
    with warns("quality 1e-06", "leaves"):
        found = caster.with_step(table, vs.RaycastSpec(quality=1e-6))
    assert found.step_mm < 0.2
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        caster.with_step(table, vs.RaycastSpec(quality=1e-6, jitter=0.5))  # once


def test_an_empty_picture_needs_no_short_steps():
    assert stepped(vs.RaycastSpec(), 0.0).step_mm == TARGETS["balanced"].longest
