"""Work beside the window: what waits is replaced, what was given up for another is not heard."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any, cast

import pytest

from tests.viewer.test_files_scene import opened
from volspec.errors import CastCancelled
from volspec.pipeline import Raycaster
from volspec.viewer.model.state import ViewState
from volspec.viewer.ui import file_commands
from volspec.viewer.ui.context import UiContext
from volspec.viewer.work import documents
from volspec.viewer.work.background import LatestWorker, Tasks
from volspec.viewer.work.documents import DocumentService, Opened
from volspec.viewer.work.notify import Notice, Trace
from volspec.viewer.work.screenshot import Progress, frame_of
from volspec.viewer.work.session import SUFFIX, save_session
from volspec.viewer.work.session_store import STATE_VARIABLE


class Slow(LatestWorker[str, str]):
    """Gives each letter of a word, the first as soon as it may."""

    _name = "slow"

    def __init__(self, wake: Callable[[], object] = lambda: None) -> None:
        super().__init__(wake)
        self.go_on = threading.Event()
        self.begun: list[str] = []

    def _answers(self, job: str) -> Iterator[str]:
        self.begun.append(job)
        assert self.go_on.wait(20)
        if job == "fault":
            raise ZeroDivisionError
        for letter in job:
            yield letter
            if self._superseded():
                return


def until(true: Callable[[], object]) -> None:
    end = time.time() + 20
    while not true() and time.time() < end:
        time.sleep(0.002)
    assert true()


def all_of(worker: Slow) -> list[str]:
    """What comes until it has nothing more to do."""
    taken: list[str] = []

    def ended() -> bool:
        taken.extend(worker.take())
        return not worker.busy

    until(ended)
    return taken


def test_what_waits_is_replaced_by_what_is_asked_for_next() -> None:
    worker = Slow()
    worker.request("ab")
    until(lambda: worker.begun)
    for word in ("cd", "ef", "gh"):
        worker.request(word)
    assert worker.busy
    worker.go_on.set()
    assert all_of(worker) == ["a", "g", "h"] and worker.begun == ["ab", "gh"]
    # Its thread has ended, and another begins.
    worker.request("i")
    assert all_of(worker) == ["i"]


def test_a_closed_worker_begins_nothing_more() -> None:
    worker = Slow()
    worker.request("ab")
    until(lambda: worker.begun)
    worker.request("cd")
    started = time.perf_counter()
    worker.close(0.05)
    assert time.perf_counter() - started < 5
    worker.go_on.set()
    assert all_of(worker) == ["a"]
    worker.request("ef")
    assert worker.begun == ["ab"] and not worker.busy


def test_a_fault_ends_the_thread_and_not_the_work(monkeypatch: pytest.MonkeyPatch) -> None:
    faults: list[object] = []
    monkeypatch.setattr(threading, "excepthook", faults.append)
    worker = Slow()
    worker.go_on.set()
    worker.request("fault")
    assert all_of(worker) == []
    worker.request("a")
    assert all_of(worker) == ["a"]
    # Neither what waited during the fault.
    worker.go_on.clear()
    worker.request("fault")
    until(lambda: len(worker.begun) == 3)
    worker.request("b")
    worker.go_on.set()
    assert all_of(worker) == ["b"]
    until(lambda: len(faults) == 2)


@pytest.mark.parametrize("first_ends_first", [True, False])
def test_of_two_files_the_one_asked_for_last_is_opened(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, first_ends_first: bool
) -> None:
    """A scene and a session: they were two kinds of task, of which each brought its own."""
    monkeypatch.setenv(STATE_VARIABLE, str(tmp_path / "state"))
    state = opened(tmp_path)
    session = save_session(state, tmp_path / f"one{SUFFIX}")
    may_end = {name: threading.Event() for name in ("scene", "session")}

    def slow(name: str, result: object) -> Callable[..., Any]:
        return lambda *_: (may_end[name].wait(20), result)[1]

    monkeypatch.setattr(documents, "open_document", slow("scene", state.document))
    resumed = replace(state, document=replace(state.document, title="resumed"))
    monkeypatch.setattr(documents, "restore_state", slow("session", resumed))
    tasks = Tasks(lambda: None)
    each = DocumentService(tasks, Notice(), Trace(), None)
    found: list[Opened] = []

    def taken() -> bool:
        came = [each.came(outcome, first=False) for outcome in tasks.take()]
        found.extend(opened for opened in came if opened)
        return bool(found)

    each.open(str(session))
    each.open("a.toml")
    first, last = ("session", "scene") if first_ends_first else ("scene", "session")
    may_end[first].set()
    if first_ends_first:
        time.sleep(0.1)
        assert not taken()
    else:
        until(taken)
    may_end[last].set()
    until(taken)
    time.sleep(0.1)
    assert taken() and [each.state.document.title for each in found] == ["ball"]


def test_only_what_was_said_of_the_opening_goes_with_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv(STATE_VARIABLE, str(tmp_path / "state"))
    state, notice = opened(tmp_path), Notice()
    monkeypatch.setattr(documents, "open_document", lambda *_: state.document)
    each = DocumentService(Tasks(lambda: None), notice, Trace(), None)
    each.open("a.toml")
    assert notice.text == "Opening a.toml …"
    each.begin(Opened(state), state)
    assert notice.text == ""
    each.open("a.toml")
    notice.say("Hunt: working out its table …")
    each.begin(Opened(state), state)
    assert notice.text == "Hunt: working out its table …"


@pytest.mark.parametrize("written", [True, False])
def test_a_picture_that_is_written_is_said_to_be_saved_though_it_was_given_up(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, written: bool
) -> None:
    def taken(_: ViewState, __: object, progress: Progress) -> Path:
        progress.ended = True
        if not written:
            raise CastCancelled("the picture was given up")
        return tmp_path / "late.png"

    monkeypatch.setenv(STATE_VARIABLE, str(tmp_path / "state"))
    monkeypatch.setattr(file_commands, "save_picture", taken)
    notice, came = Notice(), threading.Event()
    rest: tuple[Any, ...] = (UiContext(), notice, Trace(), None, None, lambda *_: None)
    each = file_commands.FileCommands(Tasks(came.set), cast(Any, None), *rest)
    each.do("screenshot", opened(tmp_path))
    assert came.wait(20) and each.take(first=False)[0]
    said = f"Saved {tmp_path / 'late.png'}" if written else "The picture was given up"
    assert notice.text == said


def test_the_window_casts_while_a_picture_is_cast_for_a_file(tmp_path: Path) -> None:
    """A picture held the document's caster for its whole cast."""
    state = opened(tmp_path)
    document, caster = state.document, Raycaster(state.document.volume)
    state = replace(state, document=replace(document, caster=caster))
    under_way, may_end = threading.Event(), threading.Event()

    class Held(Progress):
        def report(self, share: float) -> None:
            under_way.set()
            assert may_end.wait(20)

    def picture() -> None:
        frames.append(frame_of(state, (64, 48), Held("")))

    frames: list[Any] = []
    saving = threading.Thread(target=picture)
    saving.start()
    assert under_way.wait(20)
    camera = state.view.camera(document.volume)
    casts = []
    window = threading.Thread(
        target=lambda: casts.append(
            caster.cast(caster.bake(state.transfer), camera, (32, 24), state.shading)
        ),
        daemon=True,
    )
    window.start()
    window.join(20)
    assert casts and not frames
    may_end.set()
    saving.join(20)
    assert frames[0].shape == (48, 64, 3)
