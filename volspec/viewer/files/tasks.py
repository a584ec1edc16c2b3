"""What is done once beside the window: files read and written, wizards, maps.

start -> [tasks] -> a thread -> take -> Outcome
"""

from __future__ import annotations

import traceback
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any

from volspec.errors import VolspecError, one_line
from volspec.viewer.latest import LatestWorker


@dataclass(frozen=True, slots=True, eq=False)
class Outcome:
    """What came of a task.

    Parameters
    ----------
    kind : str
    result : Any
        None where it failed.
    error : str
        Why.
    """

    kind: str
    result: Any = None
    error: str = ""


class Tasks:
    """Runs functions in threads; of one kind only the last one's outcome counts.

    What is given up for another of its kind runs to its end, as reading a file cannot be stopped,
    and keeps nobody waiting.

    Parameters
    ----------
    wake : callable
        Called from the thread when there is something to take.
    """

    def __init__(self, wake: Callable[[], object]) -> None:
        self._wake = wake
        self._last: dict[str, _Runner] = {}

    def start(self, kind: str, task: Callable[[], Any]) -> None:
        """Begin a task."""
        runner = self._last[kind] = _Runner(self._wake, kind)
        runner.request(task)

    def take(self) -> list[Outcome]:
        """What has come since the last call."""
        return [outcome for runner in self._last.values() for outcome in runner.take()]


class _Runner(LatestWorker[Callable[[], Any], Outcome]):
    """Of one task: a newer one has a runner of its own, and nobody asks this one any more."""

    def __init__(self, wake: Callable[[], object], kind: str) -> None:
        super().__init__(wake, f"volspec-{kind}")
        self._kind = kind

    def _answers(self, job: Callable[[], Any]) -> Iterator[Outcome]:
        try:
            yield Outcome(self._kind, job())
        except MemoryError:
            yield Outcome(self._kind, error="no memory left")
        except (VolspecError, OSError) as error:
            yield Outcome(self._kind, error=one_line(error))
        except Exception as error:
            # A fault of our own: what waits for the task must not wait for ever.
            traceback.print_exc()
            said = f"{self._kind} failed: {type(error).__name__}: {error}"
            yield Outcome(self._kind, error=said)
