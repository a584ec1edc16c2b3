"""Times of frames and relights, for the status line and the trace."""

from __future__ import annotations

import math
import time

from volspec.viewer.work.notify import Trace
from volspec.viewer.work.pictures import Relit

# Frames further apart belong to no movement.
_APART_S = 0.25
# The window must look for input more often.
_UNANSWERED_MS = 40.0
# A whole relight that takes longer leaves no time for the rest of a frame.
SLOW_MS = 18.0
_MOST_BANDS = 4


class Meter:
    """Measures frames and relights."""

    def __init__(self, trace: Trace) -> None:
        self._trace = trace
        self.ms: dict[str, float] = {}  # last time of each stage
        self.fps = 0.0  # frames per second, while something moves
        self._last = 0.0
        # Frames that a whole picture is to be relit in, so that none takes long; more than one if
        # that is too slow while a light is dragged.
        self.bands = 1
        self._relit: Relit | None = None
        self._relit_ms = 0.0
        self._ended: bool | None = None  # if the picture ends here: whether it is whole
        self._areas: dict[str, tuple[int, int, int, int]] = {}

    def relights(self, relit: Relit | None, first: bool, ends: bool, whole: bool) -> None:
        """Take a picture, or a band of it, that is being relit; its time is known a frame later.

        The band may be the picture's ``first`` one, or its last (``ends``); a ``whole`` picture
        has all pixels.
        """
        self._relit = relit
        if first:
            self._relit_ms = 0.0
        self._ended = whole if ends else None

    def answered(self, late_s: float, busy_s: float) -> None:
        """Note if the wait for input ended too late, or what followed on it took too long."""
        if (ms := 1e3 * max(late_s, busy_s)) > _UNANSWERED_MS:
            self._trace.note("unanswered", None, ms)

    def frame(self, began: float, areas: dict[str, tuple[int, int, int, int]]) -> None:
        """Note a frame that is shown, and the (x, y, width, height) of its panels by name."""
        if self._relit is not None:
            self._relit_ms += self._relit.ms
            self._relit = None
            if self._ended:
                self.bands = min(max(math.ceil(self._relit_ms / SLOW_MS), 1), _MOST_BANDS)
            if self._ended is not None:
                self.ms["relight"] = self._relit_ms
                self._trace.note("relight", "relight", self._relit_ms, whole=self._ended)
        now = time.perf_counter()
        self.ms["frame"] = 1e3 * (now - began)
        self._trace.note("frame", "frame", self.ms["frame"])
        if now - self._last < _APART_S:
            self.fps += 0.1 * (1.0 / (now - self._last) - self.fps)
        self._last = now
        if self._areas != areas:
            self._areas = dict(areas)
            self._trace.note("layout", areas=self._areas)
