"""Wait for a condition; the limit only ends a hang."""

import multiprocessing
import os
import time
import warnings
from collections.abc import Callable
from typing import Any

import pytest

from volspec.errors import VolspecError

# No machine, however busy, needs so long.
PATIENCE_S = 300.0


def wait_until(
    holds: Callable[[], object], what: object = "", pause: Callable[[], object] | None = None
) -> Any:
    """Wait for a condition, assert and return it; ``pause`` comes between two looks."""
    end = time.monotonic() + PATIENCE_S
    while not (done := holds()) and time.monotonic() < end:
        time.sleep(0.002) if pause is None else pause()
    assert done, what
    return done


def in_fork(call: Callable[[], Any]) -> Any:
    """Return what a call returns, or the volspec error that it raises, in a forked process."""
    if not hasattr(os, "fork"):
        pytest.skip("this system does not fork")
    fork = multiprocessing.get_context("fork")
    receiver, sender = fork.Pipe(duplex=False)

    def run() -> None:
        try:
            sender.send(call())
        except VolspecError as error:
            sender.send(error)

    process = fork.Process(target=run, daemon=True)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", DeprecationWarning)  # Python 3.12 warns of threads
        process.start()
    assert receiver.poll(PATIENCE_S), "the process neither answers nor ends"
    process.join()
    return receiver.recv()
