"""Background threads: a worker that answers only the newest request, and tasks by kind.

    request -> [background] -> thread -> take

A request replaces the waiting one; nothing queues up.
"""

from __future__ import annotations

import os
import sys
import threading
import time
import traceback
import warnings
from abc import ABC, abstractmethod
from collections import deque
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any, Generic, TypeVar

from volspec.errors import VolspecError, VolspecWarning, one_line

Job = TypeVar("Job")
Done = TypeVar("Done")


# Nice value: a thread that shares a core with the window's gets a tenth of it.
_NICE = 10


def lower_priority() -> None:
    """Lower this thread's priority, on Linux also that of threads that it starts."""
    if sys.platform == "linux":
        os.setpriority(os.PRIO_PROCESS, threading.get_native_id(), _NICE)


class LatestWorker(ABC, Generic[Job, Done]):
    """Answers requests in a thread, one at a time, always the newest next.

    The thread starts with a request and ends when none is waiting. It calls ``wake`` when there
    is something to take.
    """

    _name: str  # of the thread

    def __init__(self, wake: Callable[[], object]) -> None:
        self._wake = wake
        self._next: Job | None = None
        self._closed = False
        self._changed = threading.Condition()
        self._done: deque[Done] = deque()
        self._thread: threading.Thread | None = None

    @property
    def busy(self) -> bool:
        """True while a request is in progress or waiting, or a result has not been taken."""
        with self._changed:
            return self._thread is not None or bool(self._done)

    def request(self, job: Job) -> None:
        """Set the next job, which replaces the waiting one."""
        with self._changed:
            self._next = job
            self._changed.notify()
            if self._thread is None and not self._closed:
                self._start()

    def take(self) -> list[Done]:
        """Return the results since the last call, in order."""
        return [self._done.popleft() for _ in range(len(self._done))]

    def close(self, patience_s: float | None = None) -> None:
        """Start no more jobs; wait this long for the current one to end (None: indefinitely)."""
        with self._changed:
            self._closed = True
            self._changed.notify()
            thread = self._thread
        if thread is not None:
            thread.join(patience_s)

    @abstractmethod
    def _results(self, job: Job) -> Iterator[Done]:
        """Yield a job's results, in the thread; errors are results, too."""

    def _is_superseded(self) -> bool:
        """Return True if the current job's results are no longer needed."""
        return self._closed or self._next is not None

    def _wait_idle(self, seconds: float) -> bool:
        """Wait this long for another request; return True if none has come."""
        with self._changed:
            return not self._changed.wait_for(self._is_superseded, seconds)

    def _run(self) -> None:
        try:
            while (job := self._next_job()) is not None:
                for done in self._results(job):
                    self._done.append(done)
                    self._wake()
        except BaseException:
            # An internal error ends this thread; the next job starts another.
            with self._changed:
                self._thread = None
                if self._next is not None and not self._closed:
                    self._start()
            raise

    def _start(self) -> None:
        self._thread = threading.Thread(target=self._run, name=self._name, daemon=True)
        self._thread.start()

    def _next_job(self) -> Job | None:
        """Return the waiting job; None if there is none, which ends the thread."""
        with self._changed:
            job, self._next = self._next, None
            if job is None or self._closed:
                self._thread = None
                return None
            return job


# The longest wait on closing for files that are being written.
_PATIENCE_S = 5.0


@dataclass(frozen=True, slots=True, eq=False)
class Outcome:
    """Result of a task, or the error's message if it failed."""

    kind: str
    result: Any = None
    error: str = ""


class Tasks:
    """Runs functions in threads; for each kind, only the outcome of the last one counts.

    A task that is replaced by another of its kind runs to its end, as reading a file cannot be
    stopped, but nothing waits for it. Threads call ``wake`` when there is something to take.
    """

    def __init__(self, wake: Callable[[], object]) -> None:
        self._wake = wake
        self._last: dict[str, _Runner] = {}
        self._writing: list[_Runner] = []

    @property
    def busy(self) -> bool:
        """True while a task is in progress, or its outcome has not been taken."""
        return any(runner.busy for runner in self._last.values())

    def start(self, kind: str, task: Callable[[], Any], writes: bool = False) -> None:
        """Start a task; `close` waits for it if it ``writes`` a file."""
        runner = self._last[kind] = _Runner(self._wake, kind)
        runner.request(task)
        if writes:
            self._writing = [*(running for running in self._writing if running.busy), runner]

    def take(self) -> list[Outcome]:
        """Return the outcomes since the last call."""
        return [outcome for runner in self._last.values() for outcome in runner.take()]

    def close(self) -> None:
        """Wait for files that are being written, `_PATIENCE_S` for all together.

        Errors become warnings, as the window that showed them is closing.
        """
        end = time.monotonic() + _PATIENCE_S
        for runner in self._writing:
            if error := runner.wait_error(max(end - time.monotonic(), 0.0)):
                warnings.warn(error, VolspecWarning, stacklevel=2)


class _Runner(LatestWorker[Callable[[], Any], Outcome]):
    """Thread of one task."""

    def __init__(self, wake: Callable[[], object], kind: str) -> None:
        super().__init__(wake)
        self._kind, self._name = kind, f"volspec-{kind}"

    def wait_error(self, patience_s: float) -> str:
        """Wait for the end; return the error's message, if there is one."""
        thread = self._thread
        if thread is not None:
            thread.join(patience_s)
            if thread.is_alive():
                return f"{self._kind}: not finished when the window closed; the file is unchanged"
        return next((outcome.error for outcome in self.take()), "")

    def _results(self, job: Callable[[], Any]) -> Iterator[Outcome]:
        try:
            yield Outcome(self._kind, job())
        except MemoryError:
            yield Outcome(self._kind, error="no memory left")
        except (VolspecError, OSError) as error:
            yield Outcome(self._kind, error=one_line(error))
        except Exception as error:
            # An internal error: the window waits for an outcome in any case.
            traceback.print_exc()
            message = f"{self._kind} failed: {type(error).__name__}: {error}"
            yield Outcome(self._kind, error=message)
