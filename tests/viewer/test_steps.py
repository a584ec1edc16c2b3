"""Time steps of the viewer: wanted ones are shown in order, they play, and faults are reported."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest

from tests.support.patience import wait_until
from tests.support.viewer import opened
from volspec.errors import VolumeError
from volspec.pipeline import Raycaster
from volspec.viewer.model.document import Document
from volspec.viewer.model.film import Film, film_steps
from volspec.viewer.model.history import History
from volspec.viewer.model.state import ViewState
from volspec.viewer.work.notify import Notice
from volspec.viewer.work.steps import Steps
from volspec.volume import Series, Volume, phantom

pytestmark = pytest.mark.not_quick


def of_series(tmp_path: Path, series: Series) -> ViewState:
    """Return the state of a document at the first step."""
    state = opened(tmp_path)
    document = replace(state.document, volume=series[0], series=series, caster=Raycaster(series[0]))
    return replace(state, document=document)


def balls(count: int) -> Series:
    return Series([Volume(phantom.ball(8).values * k) for k in range(1, count + 1)])


def ready(steps: Steps, document: Document) -> Document:
    """Wait for a step."""
    found: list[Document] = []

    def taken() -> bool:
        if (each := steps.take(document)) is not None:
            found.append(each)
        return bool(found)

    wait_until(taken)
    return found[0]


def test_steps_pressed_while_one_is_read_are_counted(tmp_path: Path) -> None:
    series, steps = balls(7), Steps(lambda: None, Notice())
    state = of_series(tmp_path, series)
    document = state.document
    for _ in range(3):
        steps.go(state, 1)
    assert steps.wanted(document) == 3
    shown = ready(steps, document)
    while shown.step != 3:
        shown = ready(steps, document)
    steps.go(replace(state, document=shown), -4)
    assert steps.wanted(document) == 6  # around the first
    shown = ready(steps, shown)
    assert shown.step == 6 and shown.is_of(document) and shown.caster is not None
    assert shown.volume.values.max() == series[6].values.max()
    assert shown.volume.range == series[0].range
    assert shown.data[""].volume is shown.volume and shown.saved()[0].volume.step == 6
    assert document.saved()[0].volume.step == 0
    steps.close()


def test_steps_play_in_a_loop_or_once(tmp_path: Path) -> None:
    steps = Steps(lambda: None, Notice())
    state = of_series(tmp_path, balls(3))
    shown = [state.document]
    steps.toggle(state)

    def tick(now: float) -> None:
        steps.tick(replace(state, document=shown[-1]), shown[-1], now)

    for k in range(5):
        wait_until(lambda: not steps._worker.busy)
        tick(0.1 * k)  # makes the next one ready,
        wait_until(lambda: not steps._worker.busy)
        tick(0.1 * k)  # and shows it
        if k < 4:
            shown.append(ready(steps, shown[-1]))
    assert [each.step for each in shown] == [0, 1, 2, 0, 1]
    assert steps.patience(0.6) == float("inf")  # it waits for the present one to be shown
    assert steps.patience(0.41) == pytest.approx(0.09)
    last = ready(steps, shown[-1])
    wait_until(lambda: not steps._worker.busy)
    of_last = replace(state, document=last)
    steps.tick(of_last, shown[-1], 2.0)  # the picture of the last step is still cast
    assert steps.wanted(last) == last.step == 2
    steps.toggle_loop()
    steps.tick(of_last, last, 3.0)
    wait_until(lambda: not steps._worker.busy)
    steps.tick(of_last, last, 3.0)
    assert not steps.playing
    steps.close()


def test_a_step_that_is_gone_is_reported(tmp_path: Path) -> None:
    read: list[int] = []

    def load() -> Volume:
        read.append(1)
        if len(read) > 1:
            raise VolumeError("b.nrrd: no such file", code="not-found")
        return Volume(phantom.ball(8).values * 2)

    series = Series([lambda: Volume(phantom.ball(8).values), load], kept_bytes=1)
    assert series[0].values.max()  # takes the room of the other
    notice = Notice()
    state, steps = of_series(tmp_path, balls(2)), Steps(lambda: None, notice)
    document = state.document
    object.__setattr__(document, "series", series)
    steps.toggle(state)
    steps.show(state, 1)
    wait_until(lambda: steps.take(document) is None and not steps.playing)
    assert "b.nrrd" in notice.text
    steps.close()


def test_another_document_is_shown_at_its_own_step_and_does_not_play(tmp_path: Path) -> None:
    state, steps = of_series(tmp_path, balls(3)), Steps(lambda: None, Notice())
    steps.go(state, 2)
    assert steps.wanted(state.document) == 2
    steps.toggle(state)
    assert steps.wanted(replace(state.document, opening=object(), step=1)) == 1
    steps.forget()
    assert not steps.playing and steps.wanted(state.document) == 0
    steps.close()


def test_without_steps_there_is_a_message(tmp_path: Path) -> None:
    state, notice = opened(tmp_path), Notice()
    steps = Steps(lambda: None, notice)
    steps.go(state, 1)
    assert "no time steps" in notice.text
    steps.toggle(state)
    assert not steps.playing and not steps.busy


def test_undo_leaves_the_step_as_it_is(tmp_path: Path) -> None:
    state = of_series(tmp_path, balls(2))
    history = History(state).step(replace(state, thickness=2.0))
    later = state.document.at_step(1, state.document.series[1], None)
    history = history.amend(replace(history.present, document=later))
    assert history.difference.stage == "cast"
    assert {id(each.document) for each in history.past} == {id(later)}
    undone = history.undo().present
    assert undone.thickness == 1.0 and undone.document is later


def test_a_film_plays_the_steps_at_their_own_rate(tmp_path: Path) -> None:
    document = of_series(tmp_path, balls(3)).document
    assert document.step_rate == 10.0
    assert film_steps(document, Film(seconds=0.5, fps=20.0)) == [0, 0, 1, 1, 2, 2, 0, 0, 1, 1]
    assert film_steps(document, Film(seconds=0.1, fps=20.0, steps=False)) == [None, None]
