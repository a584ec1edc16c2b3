"""Pictures cast straight into a Relighter are shown as after its update, or the old one stays."""

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


def cast(azimuth_deg: float, size: Any = SIZE, **settings: Any) -> vs.CoefficientImage:
    """A picture of several bands, by a given step: no trial cast has bands of its own."""
    step_mm = 0.5 * min(BALL.spacing_mm)
    spec = vs.RaycastSpec(tile_ms=1, step_mm=step_mm, **settings.pop("spec", {}))
    return vs.raycast(BALL, TRANSFER, view(azimuth_deg), size, spec, **settings)


def third() -> Callable[[], bool]:
    """Cancel at the third call."""
    return [True, False, False].pop


def frame(relighter: vs.Relighter, groups: Iterable[str] = ("",)) -> np.ndarray:
    """Each group under a light of its own."""
    groups = tuple(groups)
    lights = tuple(vs.light(name) for name in ("A", "D65")[: len(groups)])
    return relighter.frame(vs.LightRig(lights, groups=groups), dtype=np.float32)


def test_a_picture_cast_into_a_relighter_is_shown_as_after_an_update(backend):
    with vs.Relighter(cast(0), backend) as shown, vs.Relighter(cast(0), backend) as updated:
        before = frame(shown)
        image = cast(60, into=shown)
        updated.update(image)
        assert np.array_equal(frame(shown), frame(updated))
        assert not np.array_equal(frame(shown), before)
        assert np.array_equal(image.coefficients, cast(60).coefficients)


def test_what_is_refused_or_cancelled_leaves_the_picture_shown(backend):
    began: list[float] = []
    relighter = vs.Relighter(cast(0), backend)
    before = frame(relighter)
    for size, spec, error in (
        ((9, 8), {}, ShapeError),
        (SIZE, {"groups": GROUPS}, ShapeError),
        ("wide", {}, RaycastError),
    ):
        with raises(error):
            cast(60, size=size, spec=spec, into=relighter, progress=began.append)
    with raises(CastCancelled):
        cast(60, into=relighter, cancel=third())
    assert np.array_equal(frame(relighter), before)
    relighter.close()
    with raises(vs.InputError, "state"):
        cast(60, into=relighter, progress=began.append)
    assert began == []


def test_the_last_of_ever_finer_pictures_goes_into_a_relighter(backend):
    with vs.Relighter(cast(0), backend) as relighter:
        before, refined = (
            frame(relighter),
            vs.refine(BALL, TRANSFER, view(60), SIZE, into=relighter),
        )
        shown = [not np.array_equal(frame(relighter), before) for _ in refined]
        assert shown == [False, False, True]
