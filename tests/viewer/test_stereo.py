"""Both eyes' pictures in the window, of the layers of the last cast."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from tests.support.patience import wait_until
from tests.viewer.test_opacities import SIZE, ball, drawn, layered, screen
from volspec.pipeline import relight
from volspec.raycast import CoefficientImage
from volspec.relight.stereo import Stereo, StereoViews
from volspec.viewer.model import depth, opacities
from volspec.viewer.model.edit import after, with_interface
from volspec.viewer.model.light_rows import light_rig
from volspec.viewer.model.quality import opacity_scales
from volspec.viewer.model.state import ViewState
from volspec.viewer.work.casts import CastDone
from volspec.viewer.work.screen import Screen

pytestmark = pytest.mark.not_quick

__all__ = ["ball", "layered", "screen"]


def in_stereo(state: ViewState, layout: str) -> ViewState:
    return after(lambda given: depth.set_stereo(given, layout), state).state


def expected(image: CoefficientImage, state: ViewState, size: tuple[int, int]) -> NDArray[Any]:
    rig, stereo = light_rig(state.lights), Stereo(state.interface.stereo)
    found = stereo.views(image, opacity_scales(state), depth.shown_depth(state))
    assert found[0].size == SIZE
    if size != SIZE:
        found = StereoViews(image).views(stereo, opacity_scales(state), None, size)
    return stereo.combine(*(relight(eye, rig, state.relight, backend="numpy") for eye in found))


def taken(screen: Screen, state: ViewState) -> NDArray[np.int_]:
    drawn(screen, state)
    screen.tick(state, 0.0, held=False)
    wait_until(screen.take_rest)
    return drawn(screen, state).astype(int)


def test_the_window_shows_both_eyes_with_lights_opacities_and_fog(
    screen: Screen, ball: ViewState, layered: CastDone
) -> None:
    image = layered.image
    screen.take(layered, ball)
    plain = drawn(screen, ball)
    state = in_stereo(ball, "anaglyph")
    assert np.array_equal(drawn(screen, state), plain)  # until they are there
    both = taken(screen, state)
    assert np.abs(both - expected(image, state, SIZE)).max() <= 2
    assert np.abs(both - plain).max() > 5
    other = replace(state, lights=state.lights[::-1])
    assert np.abs(drawn(screen, other) - expected(image, other, SIZE)).max() <= 2
    faded = depth.set_fog(opacities.set_opacity(state, "grey", 0.3), 1.0)
    assert np.abs(taken(screen, faded) - expected(image, faded, SIZE)).max() <= 2
    assert not screen.side_by_side
    # Other opacities are shown at once, in one picture until the mouse is released.
    more = opacities.set_opacity(ball, "grey", 0.2)
    assert np.array_equal(drawn(screen, in_stereo(more, "anaglyph"), True), drawn(screen, more))
    screen.tick(in_stereo(more, "anaglyph"), 0.0, held=True)
    assert not screen._resting.busy
    taken(screen, state)
    screen.probe(state, (0.5, 0.5), held=False)
    assert screen.under_mouse is None
    assert np.array_equal(drawn(screen, ball), plain)


def test_pictures_next_to_each_other_fit_the_window(
    screen: Screen, ball: ViewState, layered: CastDone
) -> None:
    screen.take(layered, ball)
    state = in_stereo(ball, "side-by-side")
    drawn(screen, state)
    both = taken(screen, state)
    assert both.shape == (SIZE[1] // 2, SIZE[0], 3) and screen.side_by_side
    wanted = expected(layered.image, state, (SIZE[0] // 2, SIZE[1] // 2))
    assert np.abs(both - wanted).max() <= 1
    painted = screen.painted_picture((10, 20, 4 * SIZE[0], 4 * SIZE[1]), state)
    assert painted.to == (10, 20 + SIZE[1], 10 + 4 * SIZE[0], 20 + 3 * SIZE[1])
    assert screen.point_mm((0.5, 0.5)) is None
    # A new cast shows its own picture first.
    screen.forget_layers()
    assert drawn(screen, state).shape[:2] == SIZE[::-1] and not screen.side_by_side


def test_stereo_is_switched(state: ViewState) -> None:
    on = in_stereo(state, "anaglyph")
    assert opacities.can_layer(on) and depth.shown_stereo(on) == "anaglyph"
    assert in_stereo(on, "side-by-side").interface.stereo == "side-by-side"
    assert in_stereo(on, "anaglyph").interface.stereo == ""
    assert depth.shown_stereo(with_interface(on, error_map=True)) == ""


def test_images_of_other_spaces_are_mixed_as_by_the_library(
    screen: Screen, ball: ViewState, layered: CastDone
) -> None:
    screen.take(layered, ball)
    viewing = ball.relight.viewing
    p3 = replace(viewing, display=replace(viewing.display, space="Display P3"))
    state = in_stereo(replace(ball, relight=replace(ball.relight, viewing=p3)), "half-colour")
    drawn(screen, state)
    found = taken(screen, state)
    rig = light_rig(state.lights)
    eyes = [
        relight(eye, rig, state.relight, backend="numpy")
        for eye in Stereo("half-colour").views(layered.image)
    ]
    wanted = Stereo("half-colour").combine(eyes[0], eyes[1], "Display P3").astype(int)
    assert np.abs(found - wanted).max() <= 2
