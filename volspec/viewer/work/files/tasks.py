"""What is done once beside the window: files read and written, wizards, maps.

start -> [tasks] -> a thread -> take -> Outcome
"""

from __future__ import annotations

import time
import traceback
import warnings
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any

from volspec.errors import VolspecError, VolspecWarning, one_line
from volspec.viewer.work.latest import LatestWorker

# The longest that files which are being written are waited for at the end.
_PATIENCE_S = 5.0


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
        self._writing: list[_Runner] = []

    @property
    def busy(self) -> bool:
        """Whether something is under way, or has not been taken."""
        return any(runner.busy for runner in self._last.values())

    def start(self, kind: str, task: Callable[[], Any], writes: bool = False) -> None:
        """Begin a task.

        Parameters
        ----------
        kind : str
        task : callable
        writes : bool
            Whether it writes a file that was asked for: at the end it is waited for.
        """
        runner = self._last[kind] = _Runner(self._wake, kind)
        runner.request(task)
        if writes:
            self._writing = [*(each for each in self._writing if each.busy), runner]

    def take(self) -> list[Outcome]:
        """What has come since the last call."""
        return [outcome for runner in self._last.values() for outcome in runner.take()]

    def close(self) -> None:
        """Wait for files that are being written, `_PATIENCE_S` for all together.

        Warns
        -----
        VolspecWarning
            If one is not written: the window that would tell it is closing.
        """
        end = time.monotonic() + _PATIENCE_S
        for runner in self._writing:
            if error := runner.ended(max(end - time.monotonic(), 0.0)):
                warnings.warn(error, VolspecWarning, stacklevel=2)


class _Runner(LatestWorker[Callable[[], Any], Outcome]):
    """Of one task: a newer one has a runner of its own, and nobody asks this one any more."""

    def __init__(self, wake: Callable[[], object], kind: str) -> None:
        super().__init__(wake, f"volspec-{kind}")
        self._kind = kind

    def ended(self, patience_s: float) -> str:
        """Wait for the end; what then must be told, if anything."""
        thread = self._thread
        if thread is not None:
            thread.join(patience_s)
        if thread is not None and thread.is_alive():
            return f"{self._kind}: not written when the window closed; the file is as it was"
        return next((outcome.error for outcome in self.take()), "")

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
