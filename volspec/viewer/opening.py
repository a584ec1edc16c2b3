"""Files opened, and pictures cast for a file, beside the window: threads that end by themselves."""

from __future__ import annotations

import threading
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from volspec.errors import VolspecError


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

    Parameters
    ----------
    wake : callable
        Called from the thread when there is something to take.
    """

    def __init__(self, wake: Callable[[], object]) -> None:
        self._wake = wake
        self._last: dict[str, int] = {}
        self._done: deque[tuple[int, Outcome]] = deque()

    def start(self, kind: str, task: Callable[[], Any]) -> None:
        """Begin a task."""
        number = self._last[kind] = self._last.get(kind, 0) + 1

        def run() -> None:
            try:
                outcome = Outcome(kind, task())
            except (VolspecError, OSError, MemoryError) as error:
                outcome = Outcome(kind, error=" ".join(str(error).split()) or "no memory left")
            self._done.append((number, outcome))
            self._wake()

        threading.Thread(target=run, name=f"volspec-{kind}", daemon=True).start()

    def take(self) -> list[Outcome]:
        """What has come since the last call."""
        taken = []
        while self._done:
            number, outcome = self._done.popleft()
            if number == self._last[outcome.kind]:
                taken.append(outcome)
        return taken
