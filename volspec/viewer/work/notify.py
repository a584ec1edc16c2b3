"""Messages to the user, warnings for the window, and the trace file.

The trace has lines of JSON, ``{"t", "event", "stage", "ms"}`` and more: ``t`` in seconds from the
start; ``stage`` is ``cast``, ``relight``, ``frame``, ``design`` or null.
"""

from __future__ import annotations

import json
import math
import time
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from pathlib import Path
from queue import SimpleQueue
from typing import Any, Literal, Self

from volspec.errors import VolspecWarning, one_line


class Trace:
    """Writes lines to a new file; does nothing without a path.

    Raises OSError if the file cannot be written to.
    """

    def __init__(self, path: Path | None = None) -> None:
        self._began = time.perf_counter()
        self._file = None if path is None else path.open("w", encoding="utf-8", buffering=1)
        # Unlike the time of day, it is never set while the viewer runs.
        self.note("start", perf_counter=self._began)

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


Kind = Literal["info", "warning", "error"]
SECONDS = 8.0
# Duration of a message whose effect is also visible.
SHORT_SECONDS = 2.0
# The most messages that are stored.
MAX_MESSAGES = 300


@dataclass(frozen=True, slots=True)
class Message:
    """A message to the user."""

    text: str
    kind: Kind = "info"
    epoch_s: float = 0.0  # seconds since the epoch
    count: int = 1  # how often it came in a row

    @property
    def time(self) -> str:
        """The local time, as ``14:05:09``."""
        return time.strftime("%H:%M:%S", time.localtime(self.epoch_s))

    def __str__(self) -> str:
        kind = "" if self.kind == "info" else f"{self.kind}: "
        return f"{self.time}  {kind}{self.text}"


@dataclass(slots=True)
class Notice:
    """The messages of this session, and the one that is shown over the picture."""

    trace: Trace = field(default_factory=Trace)
    messages: tuple[Message, ...] = ()  # the last is the newest
    current: Message | None = None
    until: float = 0.0

    @property
    def text(self) -> str:
        """The text that is shown; empty if there is none."""
        return "" if self.current is None else self.current.text

    def show(self, text: str, seconds: float = SECONDS, kind: Kind = "info") -> None:
        """Show a message instead of the current one; an error stays until `hide`."""
        last = self.messages[-1] if self.messages else None
        message = Message(one_line(text), kind, time.time())
        if last is not None and (last.text, last.kind) == (message.text, kind):
            message = replace(message, count=last.count + 1)
            self.messages = self.messages[:-1]
        self.messages = (*self.messages, message)[-MAX_MESSAGES:]
        self.current = message
        self.until = math.inf if kind == "error" else time.perf_counter() + seconds

    def show_warning(self, text: str) -> None:
        """Show a warning."""
        self.show(text, kind="warning")

    def show_error(self, error: str) -> None:
        """Show an error, and note it in the trace."""
        self.show(error, kind="error")
        self.trace.note("error", message=error)

    def hide(self, text: str | None = None) -> None:
        """Remove the message that is shown; with a ``text``, only if it is this one."""
        if text is None or text == self.text:
            self.current = None

    def clear(self) -> None:
        """Forget all messages."""
        self.messages, self.current = (), None

    def expire(self, now: float) -> bool:
        """Remove a message whose time is up; return True if there was one."""
        if self.current is None or now <= self.until:
            return False
        self.current = None
        return True


class WarningQueue(SimpleQueue[str]):
    """The package's warnings, each text once until `forget`."""

    def __init__(self) -> None:
        super().__init__()
        self._texts: set[str] = set()

    def add(self, text: str) -> bool:
        """Add a warning, from any thread; return False if it was there before."""
        new = text not in self._texts
        self._texts.add(text)
        if new:
            self.put(text)
        return new

    def take(self) -> list[str]:
        """Return the warnings since the last call."""
        return [self.get() for _ in range(self.qsize())]

    def forget(self) -> None:
        """Accept every text again: another file may have the same fault."""
        self._texts.clear()


@contextmanager
def collect_warnings() -> Iterator[WarningQueue]:
    """Queue the package's warnings of every thread for the window, and print them."""
    queue = WarningQueue()
    show = warnings.showwarning

    def collect(message: Warning | str, category: type[Warning], *args: Any, **named: Any) -> None:
        if not issubclass(category, VolspecWarning) or queue.add(str(message)):
            show(message, category, *args, **named)

    with warnings.catch_warnings():
        # Python's own memory of a warning would last as long as the process.
        warnings.simplefilter("always", VolspecWarning)
        warnings.showwarning = collect
        yield queue
