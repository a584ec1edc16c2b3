"""Steps by quality: estimated errors, and what a user sees of them."""

import warnings

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import volspec as vs
from volspec.raycast.quality import SHORTEST, TARGETS, Picture, Target, choose_step

BASIS = vs.SpectralBasis.load("general-7")
COPPER = {"copper": vs.reflectance("copper")}
CAMERA = {"azimuth_deg": 40.0, "elevation_deg": 25.0}


def transfer(opacity: float = 0.6) -> vs.TransferFunction:
    """Return a curve with corners in the ball's shell."""
    points = [(0.3, 0.0, "copper"), (0.5, opacity, "copper"), (0.9, 0.1, "copper")]
    return vs.TransferFunction(points, COPPER, BASIS)


@given(st.floats(1e-4, 1.0), st.floats(1.2, 2.5), st.floats(1e-3, 0.02))
def test_the_step_leaves_the_error_asked_for(factor: float, order: float, error: float) -> None:
    """Casts whose error is a power of the step."""
    truth = np.full((4, 4, 3), 0.5)

    def probe(step: float) -> Picture:
        return Picture(truth + factor * step**order, np.ones((4, 4), np.float32))

    step, left = choose_step(probe, Target(error, 1.0))
    # Two casts differ by less than the error of the longer, by the shorter's.
    assert factor * step**order <= error / (1.0 - 0.5**order) or step < 2 * SHORTEST
    assert step == 1.0 or step <= SHORTEST * 2 or left > 0.3 * error


@pytest.mark.parametrize("name", TARGETS)
def test_a_picture_has_about_the_error_of_its_quality(name: str) -> None:
    ball, camera = vs.phantom.ball(48), vs.Camera.orbit(vs.phantom.ball(48), **CAMERA)
    caster = vs.Raycaster(ball)

    def cast(spec: vs.RaycastSpec) -> vs.CoefficientImage:
        return vs.raycast(ball, transfer(), camera, (96, 96), spec, caster=caster)

    truth = cast(vs.RaycastSpec(step_mm=1 / 32, alpha_stop=1.0))
    apart = cast(vs.RaycastSpec(quality=name)).coefficients - truth.coefficients
    error = np.sqrt(np.mean(apart[truth.alpha > 0.01] ** 2))
    assert error <= 1.5 * TARGETS[name].error


def test_a_step_that_is_given_is_used() -> None:
    ball = vs.phantom.ball(16)
    caster = vs.Raycaster(ball)
    spec = vs.RaycastSpec(step_mm=0.37, quality="fast")
    assert caster.with_step(caster.bake(transfer()), spec) == spec


@pytest.mark.slow
def test_the_step_is_the_same_from_every_side_and_under_other_lights() -> None:
    ball = vs.phantom.ball(32)
    caster = vs.Raycaster(ball)
    key = vs.LightGroup("key", (vs.Directional((1, 1, 1), shadows=True),))
    notes = [
        vs.raycast(
            *(ball, transfer(), vs.Camera.orbit(ball, azimuth_deg=turn), (32, 32)),
            vs.RaycastSpec(groups=groups),
            caster=caster,
        ).notes["raycast"]
        for turn, groups in ((0.0, vs.RaycastSpec().groups), (70.0, (key,)))
    ]
    steps = {note[note.index("step_mm=") :].split(",")[0] for note in notes}
    assert len(steps) == 1 and "None" not in steps.pop()


def test_steeper_curves_get_shorter_steps() -> None:
    ball = vs.phantom.ball(32)
    caster = vs.Raycaster(ball)
    steps = [
        caster.with_step(caster.bake(transfer(opacity)), vs.RaycastSpec(quality=0.0003)).step_mm
        for opacity in (0.02, 0.95)
    ]
    assert steps[0] > steps[1]


def test_an_error_that_no_step_reaches_is_told_with_what_is_reached() -> None:
    ball = vs.phantom.ball(24)
    caster = vs.Raycaster(ball)
    table = caster.bake(transfer())
    with pytest.warns(vs.VolspecWarning) as caught:
        found = caster.with_step(table, vs.RaycastSpec(quality=1e-6))
    message = str(caught[0].message)
    assert "quality 1e-06" in message and "leaves" in message
    assert found.step_mm is not None and found.step_mm < 0.2
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        caster.with_step(table, vs.RaycastSpec(quality=1e-6, jitter=0.5))  # once


def test_an_empty_picture_needs_no_short_steps() -> None:
    ball = vs.phantom.ball(16)
    caster = vs.Raycaster(ball)
    found = caster.with_step(caster.bake(transfer(0.0)), vs.RaycastSpec())
    assert found.step_mm == TARGETS["balanced"].longest
