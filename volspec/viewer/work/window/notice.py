"""One line told to the user, for a while."""

from __future__ import annotations

import time
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from queue import SimpleQueue
from typing import Any

from volspec.errors import VolspecWarning, one_line

SECONDS = 8.0
# Of what has been seen happen.
SHORT_SECONDS = 2.0


@dataclass(slots=True)
class Notice:
    """The line, and until when it stands."""

    text: str = ""
    until: float = 0.0

    def say(self, text: str, seconds: float = SECONDS) -> None:
        """Another line in place of the present one."""
        self.text, self.until = one_line(text), time.perf_counter() + seconds

    def ended(self, now: float) -> bool:
        """Whether its time was over, and it is gone now."""
        if not self.text or now <= self.until:
            return False
        self.text = ""
        return True


@contextmanager
def collected_warnings() -> Iterator[SimpleQueue[str]]:
    """Queue the package's warnings of every thread for the window, besides printing them.

    What a file's reader doubts is otherwise seen by those alone who started from a terminal.
    """
    queue: SimpleQueue[str] = SimpleQueue()
    show = warnings.showwarning

    def collect(message: Warning | str, category: type[Warning], *rest: Any, **named: Any) -> None:
        if issubclass(category, VolspecWarning):
            queue.put(str(message))
        show(message, category, *rest, **named)

    warnings.showwarning = collect
    try:
        yield queue
    finally:
        warnings.showwarning = show
