"""Times of frames and relights: for the status line and the trace."""

from __future__ import annotations

import math
import time

from volspec.viewer.work.notify import Trace
from volspec.viewer.work.pictures import Relit

# Frames further apart belong to no movement.
_APART_S = 0.25
# The window not looking for input so long is noted down.
_UNANSWERED_MS = 40.0
# A whole relight that takes longer leaves a frame no time for the rest.
SLOW_MS = 18.0
_MOST_BANDS = 4


class Meter:
    """Measures what is drawn.

    Parameters
    ----------
    trace : Trace
        Written there.

    Attributes
    ----------
    bands : int
        In how many frames a whole picture is to be relit, so that none takes long.
    ms : {stage: float}
        What each stage took last.
    fps : float
        Frames per second, while something moves.
    """

    def __init__(self, trace: Trace) -> None:
        self._trace = trace
        self.ms: dict[str, float] = {}
        self.fps = 0.0
        self._last = 0.0
        self.bands = 1
        self._under_way: Relit | None = None
        self._relit_ms = 0.0
        self._ended: bool | None = None
        self._areas: dict[str, tuple[int, int, int, int]] = {}

    @property
    def slow(self) -> bool:
        """Whether a whole picture takes too long to relight for lights that are dragged."""
        return self.bands > 1

    def relights(self, relit: Relit | None, first: bool, ends: bool, whole: bool) -> None:
        """A picture, or a band of it, is being relit; in the next frame its time is known.

        Parameters
        ----------
        relit : Relit or None
        first, ends : bool
            Whether the picture begins with this, and whether it is all there then.
        whole : bool
            Whether it has all pixels.
        """
        self._under_way = relit
        if first:
            self._relit_ms = 0.0
        self._ended = whole if ends else None

    def answered(self, late_s: float, busy_s: float) -> None:
        """A turn of the loop is over.

        Parameters
        ----------
        late_s : float
            By how much the wait for input outlasted what it was given.
        busy_s : float
            From input to the next wait for it.
        """
        if (ms := 1e3 * max(late_s, busy_s)) > _UNANSWERED_MS:
            self._trace.note("unanswered", None, ms)

    def frame(self, began: float, areas: dict[str, tuple[int, int, int, int]]) -> None:
        """Note a frame that has been shown.

        Parameters
        ----------
        began : float
            A time of `time.perf_counter`.
        areas : {name: (x, y, width, height)}
            Where things are in it.
        """
        if self._under_way is not None:
            self._relit_ms += self._under_way.ms
            self._under_way = None
            if self._ended is not None:
                self._tell(self._relit_ms, self._ended)
        now = time.perf_counter()
        self.ms["frame"] = 1e3 * (now - began)
        self._trace.note("frame", "frame", self.ms["frame"])
        if now - self._last < _APART_S:
            self.fps += 0.1 * (1.0 / (now - self._last) - self.fps)
        self._last = now
        if self._areas != areas:
            self._areas = dict(areas)
            self._trace.note("layout", areas=self._areas)

    def _tell(self, ms: float, whole: bool) -> None:
        """A picture has been relit."""
        if whole:
            self.bands = min(max(math.ceil(ms / SLOW_MS), 1), _MOST_BANDS)
        self.ms["relight"] = ms
        self._trace.note("relight", "relight", ms, whole=whole)
