"""Pictures cast straight into a Relighter are shown as after its update, or the old one stays."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from typing import Any

import numpy as np

import volspec as vs
from tests.support.errors import raises
from volspec.errors import CastCancelled, RaycastError, ShapeError
from volspec.volume import phantom

BASIS = vs.SpectralBasis.load("general-7")
COPPER = {"copper": vs.reflectance("copper")}
TRANSFER = vs.TransferFunction([(0.2, 0.0, "copper"), (0.6, 0.3, "copper")], COPPER, BASIS)
BALL = phantom.ball(32)
SIZE = (67, 150)
GROUPS = (
    vs.LightGroup("key", (vs.Directional((1, 1, 1)),)),
    vs.LightGroup("fill", (vs.Ambient(),)),
)


def view(azimuth_deg: float) -> vs.Camera:
    return vs.Camera.orbit(BALL, azimuth_deg=azimuth_deg)


def cast(azimuth_deg: float, **settings: Any) -> vs.CoefficientImage:
    """A picture of several bands, by a given step: no trial cast has bands of its own."""
    step_mm = 0.5 * min(BALL.spacing_mm)
    spec = vs.RaycastSpec(tile_ms=1, step_mm=step_mm, **settings.pop("spec", {}))
    return vs.raycast(BALL, TRANSFER, view(azimuth_deg), SIZE, spec, **settings)


def third() -> Callable[[], bool]:
    """Cancel at the third call."""
    return [True, False, False].pop


def frame(relighter: vs.Relighter, groups: Iterable[str] = ("",)) -> np.ndarray:
    """Each group under a light of its own."""
    groups = tuple(groups)
    lights = tuple(vs.light(name) for name in ("A", "D65")[: len(groups)])
    rig = vs.LightRig(lights, groups=groups)
    return relighter.frame(rig, dtype=np.float32)


def test_a_picture_cast_into_a_relighter_is_shown_as_after_an_update(backend: str) -> None:
    with vs.Relighter(cast(0), backend) as shown, vs.Relighter(cast(0), backend) as updated:
        before = frame(shown)
        image = cast(60, into=shown)
        updated.update(image)
        assert np.array_equal(frame(shown), frame(updated))
        assert not np.array_equal(frame(shown), before)
        assert np.array_equal(image.coefficients, cast(60).coefficients)


def test_a_picture_that_does_not_fit_is_refused_before_it_is_cast(backend: str) -> None:
    began: list[float] = []
    with vs.Relighter(cast(0), backend) as relighter:
        with raises(ShapeError, "shape"):
            vs.raycast(BALL, TRANSFER, view(0), (9, 8), into=relighter, progress=began.append)
        with raises(ShapeError, "shape"):
            cast(0, spec={"groups": GROUPS}, into=relighter, progress=began.append)
        with raises(RaycastError):
            vs.raycast(BALL, TRANSFER, view(0), "wide", into=relighter)
    with raises(vs.InputError, "state"):
        cast(0, into=relighter, progress=began.append)
    assert began == []


def test_a_cancelled_cast_leaves_the_picture_shown(backend: str) -> None:
    with vs.Relighter(cast(0), backend) as relighter:
        before = frame(relighter)
        with raises(CastCancelled):
            cast(60, into=relighter, cancel=third())
        assert np.array_equal(frame(relighter), before)


def test_the_last_of_ever_finer_pictures_goes_into_a_relighter(backend: str) -> None:
    with vs.Relighter(cast(0), backend) as relighter:
        before, shown = frame(relighter), []
        for _ in vs.refine(BALL, TRANSFER, view(60), SIZE, into=relighter):
            shown.append(not np.array_equal(frame(relighter), before))
        assert shown == [False, False, True]
