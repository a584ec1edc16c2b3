"""Colour rendition in the background: tables of samples are read, or made, at the first call.

lights -> [rendition] -> panel
"""

from __future__ import annotations

from collections.abc import Callable, Iterator

from volspec.viewer.model.rendition import Figures, Measured, measure
from volspec.viewer.work.background import LatestWorker

# Longest wait on closing for tables that are being made.
_PATIENCE_S = 0.1

Done = tuple[Measured, Figures | None]


class _Worker(LatestWorker[Measured, Done]):
    _name = "volspec-rendition"

    def _results(self, job: Measured) -> Iterator[Done]:
        yield job, measure(job)


class RenditionService:
    """Measures the lights that are asked for; while they change, shows the last figures.

    The thread calls ``wake`` when there is something to take.
    """

    def __init__(self, wake: Callable[[], object]) -> None:
        self._worker = _Worker(wake)
        self._asked: Measured | None = None
        self.latest: Done | None = None

    @property
    def busy(self) -> bool:
        """True while a light is being measured."""
        return self._worker.busy

    def follow(self, lights: Measured | None) -> None:
        """Measure lights, unless they were the last ones."""
        if lights is not None and lights != self._asked:
            self._worker.request(lights)
        self._asked = lights

    def take(self) -> bool:
        """Take the newest figures; return True if there are any."""
        done = self._worker.take()
        if done:
            self.latest = done[-1]
        return bool(done)

    def close(self) -> None:
        """End the thread."""
        self._worker.close(_PATIENCE_S)
