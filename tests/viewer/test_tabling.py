"""Models with tables: what is shown stays while one is worked out, and the newest light wins."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from volspec.errors import ViewingError
from volspec.raycast import CoefficientImage
from volspec.relight import tables
from volspec.viewer.model import light_rows
from volspec.viewer.model.state import ViewState
from volspec.viewer.ui.window import Window
from volspec.viewer.work.casts import CastDone, CastJob
from volspec.viewer.work.meter import Meter
from volspec.viewer.work.notify import Notice, Trace
from volspec.viewer.work.screen import Screen

SIZE = (8, 6)


@pytest.fixture
def screen(context: Any, state: ViewState, monkeypatch: pytest.MonkeyPatch) -> Iterator[Screen]:
    """Without a window, with a picture of all colours in it."""
    monkeypatch.setattr(Window, "wake", lambda: None)
    trace = Trace()
    shown = Screen(context, lambda: None, Meter(trace), trace, Notice())
    shown.take(done(state, 0), state)
    yield shown
    shown.close()


def done(state: ViewState, seed: int) -> CastDone:
    width, height = SIZE
    ones = np.ones((height, width), np.float32)
    rng = np.random.default_rng(seed)
    coefficients = rng.random((height, width, state.transfer.basis.size)).astype(np.float32)
    image = CoefficientImage(coefficients, ones, ones, state.transfer.basis)
    document, camera = state.document, state.view.camera(state.document.volume)
    job = CastJob(document, state.transfer, camera, state.shading, SIZE, (1,))
    return CastDone(job, 1, 1.0, image)


def seen_by(state: ViewState, model: str, light: int) -> ViewState:
    viewing = replace(state.relight.viewing, model=model)
    rows = light_rows.only_row(state.lights, light)
    return replace(state, relight=replace(state.relight, viewing=viewing), lights=rows)


def pixels(screen: Screen) -> NDArray[np.uint8]:
    with screen.pictures._context:  # a window's stays current
        return screen.pictures.pixels().copy()


def until_told(screen: Screen) -> None:
    end = time.time() + 20
    while not screen.tabled() and time.time() < end:
        time.sleep(0.005)


def test_the_picture_stays_while_a_table_is_worked_out_and_the_newest_light_wins(
    screen: Screen, state: ViewState, monkeypatch: pytest.MonkeyPatch
) -> None:
    screen.relight(seen_by(state, "CIECAM02", 0), held=False)
    before = pixels(screen)
    made: list[tables.TableKey] = []
    work_out = tables._texels
    monkeypatch.setattr(
        tables, "_texels", lambda key, end: (made.append(key), work_out(key, end))[1]
    )
    for light in (0, 1, 2, 1):
        screen.stale()
        screen.relight(seen_by(state, "Nayatani95", light), held=True)
        assert np.array_equal(pixels(screen), before)
        assert screen._notice.text == "Nayatani95: working out its table …"
        # Values under the mouse would be of another light than its pixel.
        assert screen.probe(seen_by(state, "Nayatani95", light), (0.5, 0.5), held=False) is None
    # A cast that comes meanwhile waits for the light, too.
    screen.take(done(state, 1), state)
    screen.relight(seen_by(state, "Nayatani95", 1), held=False)
    assert np.array_equal(pixels(screen), before) and not screen.pictures.current
    until_told(screen)
    screen.relight(seen_by(state, "Nayatani95", 1), held=False)
    after = pixels(screen)
    assert not np.array_equal(after, before) and screen.pictures.current
    # Of lights that went by none was worked out, and the notice has gone.
    assert len(made) == 1 and screen._notice.text == ""
    screen.stale()
    screen.relight(seen_by(state, "Nayatani95", 1), held=False)
    assert len(made) == 1 and np.array_equal(pixels(screen), after)


def test_a_table_under_way_is_given_up_for_the_next_light(
    screen: Screen, state: ViewState, monkeypatch: pytest.MonkeyPatch
) -> None:
    begun: list[tables.TableKey] = []
    work_out = tables._texels

    def without_end(key: tables.TableKey, cancel: Callable[[], bool]) -> NDArray[np.float32]:
        begun.append(key)
        end = time.time() + 20
        while len(begun) == 1 and time.time() < end and not cancel():
            time.sleep(0.002)
        return work_out(key, cancel)

    monkeypatch.setattr(tables, "_texels", without_end)
    screen.relight(seen_by(state, "Nayatani95", 0), held=False)
    end = time.time() + 20
    while not begun and time.time() < end:
        time.sleep(0.002)
    screen.stale()
    screen.relight(seen_by(state, "Nayatani95", 1), held=False)
    until_told(screen)
    assert len(begun) == 2
    assert begun[0] not in screen.pictures.tables and begun[1] in screen.pictures.tables


def test_both_sides_of_the_divide_have_tables_of_their_own(
    screen: Screen, state: ViewState
) -> None:
    both = replace(
        seen_by(state, "Nayatani95", 0), other=light_rows.only_row(state.lights, 1), divide=0.5
    )
    screen.relight(both, held=False)
    until_told(screen)
    screen.relight(both, held=False)
    assert screen.pictures.current
    split = pixels(screen)
    for light, columns in ((0, slice(0, 4)), (1, slice(4, 8))):
        screen.stale()
        screen.relight(seen_by(state, "Nayatani95", light), held=False)
        np.testing.assert_array_equal(pixels(screen)[:, columns], split[:, columns])


def test_a_table_that_cannot_be_is_told_and_asked_for_once(
    screen: Screen, state: ViewState, monkeypatch: pytest.MonkeyPatch
) -> None:
    def refused(key: tables.TableKey, cancel: object) -> None:
        raise ViewingError("no colour at\nsome node")

    monkeypatch.setattr(tables, "_texels", refused)
    hunt = seen_by(state, "Hunt", 0)
    screen.relight(hunt, held=False)
    until_told(screen)
    assert screen._notice.text == "no colour at some node"
    screen.relight(hunt, held=False)
    assert screen._notice.text == "no colour at some node"
    # Another model is drawn at once.
    screen.stale()
    screen.relight(seen_by(state, "CAM16", 0), held=False)
    assert screen.pictures.current
