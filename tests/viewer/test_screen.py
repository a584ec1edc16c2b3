"""A picture that takes long to relight: a band in each frame, and what is told of it meanwhile."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from tests.viewer.test_tabling import SIZE, done, pixels
from volspec.viewer.model import light_rows
from volspec.viewer.model.state import ViewState
from volspec.viewer.work.meter import Meter
from volspec.viewer.work.notify import Notice, Trace
from volspec.viewer.work.screen import Screen

BANDS = 3
AREA = (0, 0, 200, 100)


@pytest.fixture
def slow(context: Any, state: ViewState, monkeypatch: pytest.MonkeyPatch) -> Iterator[Screen]:
    """A screen that shows a picture; the next one is to be relit in bands."""
    trace = Trace()
    meter = Meter(trace)
    screen = Screen(context, lambda: None, meter, trace, Notice())
    screen.take(done(state, 0), state)
    screen.relight(under(state, 0), held=False)
    screen.relight(under(state, 0), held=False)
    meter.bands = BANDS
    yield screen
    screen.close()


def under(state: ViewState, light: int) -> ViewState:
    return replace(state, lights=light_rows.only_row(state.lights, light))


def lit(screen: Screen, state: ViewState) -> NDArray[np.uint8]:
    """The whole picture of a state."""
    screen.stale()
    while screen.relight(state, held=False):
        pass
    return pixels(screen)


def test_each_frame_draws_a_band_and_the_last_one_makes_it_whole(
    slow: Screen, state: ViewState
) -> None:
    day, lamp = lit(slow, under(state, 0)), lit(slow, under(state, 1))
    slow.stale()
    rows = SIZE[1] // BANDS
    for band in range(1, BANDS + 1):
        assert slow.relight(under(state, 0), held=False)
        drawn = pixels(slow)
        np.testing.assert_array_equal(drawn[: band * rows], day[: band * rows])
        np.testing.assert_array_equal(drawn[band * rows :], lamp[band * rows :])
        assert slow.ready == (band == BANDS)
    assert not slow.relight(under(state, 0), held=False)


def test_of_lights_that_change_in_every_frame_each_second_one_is_drawn_whole(
    slow: Screen, state: ViewState
) -> None:
    wanted = [lit(slow, under(state, light)) for light in (0, 1)]
    for light in (0, 1, 0, 1):
        slow.stale()
        slow.relight(under(state, light), held=False)
        assert slow.ready == (light == 1)
    np.testing.assert_array_equal(pixels(slow), wanted[1])
    # One that is left alone has its bands again.
    slow.stale()
    slow.relight(under(state, 0), held=False)
    assert not slow.ready


def test_values_under_the_mouse_stay_while_bands_are_drawn(slow: Screen, state: ViewState) -> None:
    slow.probe(under(state, 0), (0.5, 0.5), held=False)
    before = slow.under_mouse
    assert before is not None
    slow.stale()
    for _ in range(BANDS):
        slow.relight(under(state, 1), held=False)
        slow.probe(under(state, 1), (0.5, 0.5), held=False)
        assert slow.under_mouse is before
    slow.relight(under(state, 1), held=False)
    slow.probe(under(state, 1), (0.5, 0.5), held=False)
    after = slow.under_mouse
    assert after is not None and str(after) != str(before)


def test_a_picture_keeps_its_shape_until_one_of_another_is_drawn(
    slow: Screen, state: ViewState
) -> None:
    cast = done(state, 1)
    wide = replace(state, size=AREA[2:])
    taken = replace(cast, job=replace(cast.job, size=wide.size))
    before = slow.painted(AREA, wide)
    slow.take(taken, wide)
    for _ in range(BANDS):
        assert slow.painted(AREA, wide) == before
        slow.relight(under(wide, 0), held=False)
    now = slow.painted(AREA, wide)
    assert before is not None and now is not None
    width = AREA[3] * SIZE[0] / SIZE[1]
    assert before.to == pytest.approx(((AREA[2] - width) / 2, 0, (AREA[2] + width) / 2, AREA[3]))
    assert now.to == AREA
