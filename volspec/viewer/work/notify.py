"""Messages to the user, warnings collected for the window, and the trace of what was done.

The trace has lines of JSON, ``{"t", "event", "stage", "ms"}`` and more: ``t`` in seconds from the
start; ``stage`` is ``cast``, ``relight``, ``frame`` or ``design``, and null for all else.
"""

from __future__ import annotations

import json
import time
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from queue import SimpleQueue
from types import TracebackType
from typing import Any, Self

from volspec.errors import VolspecWarning, one_line


class Trace:
    """Writes the lines; does nothing without a file.

    Parameters
    ----------
    path : path, optional
        Begun anew.

    Raises
    ------
    OSError
        If it cannot be written to.
    """

    def __init__(self, path: Path | None = None) -> None:
        self._began = time.perf_counter()
        self._file = None if path is None else path.open("w", encoding="utf-8", buffering=1)
        self.note("start", unix=time.time())

    def note(
        self, event: str, stage: str | None = None, ms: float | None = None, **more: Any
    ) -> None:
        """Write a line."""
        if self._file is not None:
            t = round(time.perf_counter() - self._began, 6)
            row = {"t": t, "event": event, "stage": stage, "ms": ms and round(ms, 3), **more}
            self._file.write(json.dumps(row) + "\n")

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        if self._file is not None:
            self._file.close()


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
def collect_warnings() -> Iterator[SimpleQueue[str]]:
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
