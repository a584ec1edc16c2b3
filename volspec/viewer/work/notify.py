"""Messages to the user, warnings for the window, and the trace file.

The trace has lines of JSON, ``{"t", "event", "stage", "ms"}`` and more: ``t`` in seconds from the
start; ``stage`` is ``cast``, ``relight``, ``frame``, ``design`` or null.
"""

from __future__ import annotations

import json
import time
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from queue import SimpleQueue
from typing import Any, Self

from volspec.errors import VolspecWarning, one_line


class Trace:
    """Writes lines to a new file; does nothing without a path.

    Raises OSError if the file cannot be written to.
    """

    def __init__(self, path: Path | None = None) -> None:
        self._began = time.perf_counter()
        self._file = None if path is None else path.open("w", encoding="utf-8", buffering=1)
        self.note("start", unix=time.time())

    def note(
        self, event: str, stage: str | None = None, ms: float | None = None, **more: Any
    ) -> None:
        """Write a line about an event."""
        if self._file is not None:
            t = round(time.perf_counter() - self._began, 6)
            row = {"t": t, "event": event, "stage": stage, "ms": ms and round(ms, 3), **more}
            self._file.write(json.dumps(row) + "\n")

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        if self._file is not None:
            self._file.close()


SECONDS = 8.0
# Duration of a message whose effect is also visible.
SHORT_SECONDS = 2.0


@dataclass(slots=True)
class Notice:
    """The message line, and the time until which it is shown."""

    trace: Trace = field(default_factory=Trace)
    text: str = ""
    until: float = 0.0

    def show(self, text: str, seconds: float = SECONDS) -> None:
        """Replace the line."""
        self.text, self.until = one_line(text), time.perf_counter() + seconds

    def show_error(self, error: str) -> None:
        """Replace the line with an error, and note it in the trace."""
        self.show(error)
        self.trace.note("error", message=error)

    def expire(self, now: float) -> bool:
        """Remove a line whose time is up; return True if there was one."""
        if not self.text or now <= self.until:
            return False
        self.text = ""
        return True


@contextmanager
def collect_warnings() -> Iterator[SimpleQueue[str]]:
    """Queue the package's warnings of every thread for the window, and print them."""
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
