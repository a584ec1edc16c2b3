"""The thread that casts: the latest request wins, a coarse first pass is let through."""

from __future__ import annotations

import threading
import time
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from volspec.basis import SpectralBasis
from volspec.errors import CastCancelled, RaycastError
from volspec.raycast import CoefficientImage
from volspec.viewer.model.state import ViewState
from volspec.viewer.work.casts import CastDone, CastJob, CastWorker


def job(state: ViewState, *divisors: int, zoom: float = 1.0) -> CastJob:
    view = replace(state.view, zoom=zoom)
    camera = view.camera(state.document.volume)
    document, transfer, shading = state.document, state.transfer, state.shading
    return CastJob(document, transfer, camera, shading, (80, 60), divisors)


class SlowCasts:
    """Stands in for `volspec.raycast`: asks ``cancel`` for as long as it is held up."""

    def __init__(self) -> None:
        self.begun: list[tuple[int, int]] = []
        self.go_on = threading.Event()
        flat = np.ones((2, 3), np.float32)
        basis = SpectralBasis.load("general-7")
        self.image = CoefficientImage(np.ones((2, 3, 7), np.float32), flat, flat, basis)

    def __call__(self, *what: Any, cancel: Any, caster: Any) -> CoefficientImage:
        self.begun.append(what[3])
        while not self.go_on.wait(0.002):
            if cancel():
                raise CastCancelled("ended")
        return self.image

    def wait(self, count: int) -> None:
        end = time.time() + 5
        while len(self.begun) < count and time.time() < end:
            time.sleep(0.002)
        assert len(self.begun) == count


@pytest.fixture
def casts(monkeypatch: pytest.MonkeyPatch) -> SlowCasts:
    slow = SlowCasts()
    monkeypatch.setattr("volspec.viewer.work.casts.raycast", slow)
    return slow


def drained(scheduler: CastWorker, count: int) -> list[CastDone]:
    done: list[CastDone] = []
    end = time.time() + 5
    while len(done) < count and time.time() < end:
        done += scheduler.take()
        time.sleep(0.002)
    assert len(done) == count
    return done


def test_a_newer_request_ends_a_whole_cast_and_replaces_what_waits(
    state: ViewState, casts: SlowCasts
) -> None:
    scheduler = CastWorker(lambda: None)
    scheduler.request(job(state, 1))
    casts.wait(1)
    scheduler.request(job(state, 4))
    casts.wait(2)  # coarse, and let through: the next ones wait
    scheduler.request(job(state, 2))
    scheduler.request(last := job(state, 8))
    time.sleep(0.05)
    assert len(casts.begun) == 2
    casts.go_on.set()
    done = drained(scheduler, 3)
    assert [each.divisor for each in done] == [1, 4, 8]
    assert [each.image for each in done] == [None, casts.image, casts.image]
    # Packed where it was cast: the window's thread only uploads it.
    assert [each.packed is None for each in done] == [True, False, False]
    assert done[-1].job is last and casts.begun[-1] == (10, 8)
    scheduler.close()


def test_closing_ends_even_a_coarse_cast(state: ViewState, casts: SlowCasts) -> None:
    scheduler = CastWorker(lambda: None)
    scheduler.request(job(state, 8, 1))
    casts.wait(1)
    scheduler.close()
    assert not casts.go_on.is_set() and len(casts.begun) == 1


@pytest.mark.parametrize(
    ("error", "told"),
    [
        (RaycastError("no\nsuch thing"), "no such thing"),
        (MemoryError(), "no memory for the picture; make the window smaller"),
        # What a driver may raise when its device is gone.
        (RuntimeError("clFinish failed: OUT_OF_RESOURCES"), "clFinish failed: OUT_OF_RESOURCES"),
    ],
)
def test_an_error_is_told_and_the_thread_goes_on(
    state: ViewState, monkeypatch: pytest.MonkeyPatch, error: Exception, told: str
) -> None:
    def refuse(*what: Any, **more: Any) -> None:
        raise error

    monkeypatch.setattr("volspec.viewer.work.casts.raycast", refuse)
    woken = threading.Event()
    scheduler = CastWorker(woken.set)
    for _ in range(2):
        scheduler.request(job(state, 4, 1))
        (done,) = drained(scheduler, 1)
        assert told in done.error
    assert woken.is_set()
    scheduler.close()
