"""Files opened, and pictures cast for a file, beside the window: threads that end by themselves."""

from __future__ import annotations

import threading
import traceback
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from volspec.errors import VolspecError
from volspec.viewer.document import Document
from volspec.viewer.lighting import brightest
from volspec.viewer.state import ViewState


@dataclass(frozen=True, slots=True, eq=False)
class Opened:
    """What was opened.

    Parameters
    ----------
    state : ViewState
    path : str, optional
        As it was asked for; None of the bundled demo and of sessions kept without being asked.
    session : Path, optional
        The session that it goes on from, with its own window.
    """

    state: ViewState
    path: str | None = None
    session: Path | None = None

    @classmethod
    def at_first(cls, document: Document, path: str | None) -> Opened:
        """A document as its file has it."""
        return cls(ViewState.first(document, (0, 0)), path)

    def after(self, before: ViewState | None) -> Opened:
        """In the window as it was, with the light chosen that shines; a session has its own."""
        if before is None:
            return self
        interface = self.state.interface
        if self.session is None:
            interface = replace(before.interface, light=brightest(self.state.lights))
        return replace(self, state=replace(self.state, size=before.size, interface=interface))


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
            except Exception as error:
                # A fault of our own: what waits for the task must not wait for ever.
                traceback.print_exc()
                outcome = Outcome(kind, error=f"{kind} failed: {type(error).__name__}: {error}")
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
