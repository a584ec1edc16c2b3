"""Launch a cast in bands of rows: no launch takes long, and between two it can end.

    kernel -> [bands] -> result

A graphics driver kills what takes it too long, and a viewer must be able to give up a picture.
"""

from __future__ import annotations

import time
import warnings
from collections import deque
from collections.abc import Callable
from contextlib import AbstractContextManager
from dataclasses import dataclass
from typing import Any, NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from volspec._gpu.opencl import Compute
from volspec.errors import CastCancelled, VolspecWarning

Progress = Callable[[float], object]
Cancel = Callable[[], bool]
# Of a band's coefficients and alpha on the device, and its lines; gives the launch's event.
Pack = Callable[[Any, Any, slice], Any]

_LARGEST_HALF = float(np.finfo(np.float16).max)


class Receiver(Protocol):
    """Where the bands of a cast also go, from the device's memory to the device's memory."""

    def receiving(self, compute: Compute, half: bool) -> AbstractContextManager[Pack]:
        """What takes each band, for as long as the cast runs."""


class Result(NamedTuple):
    """What a cast gathers.

    ``coefficients`` (H, W, L·M) premultiplied by opacity, layer after layer; ``alpha`` (H, W);
    ``depth_mm`` (H, W) expected distance from the camera of what is seen, and ``first_mm`` (H, W)
    where it is first hit; both inf where nothing is.
    """

    coefficients: NDArray[np.floating]
    alpha: NDArray[np.float32]
    depth_mm: NDArray[np.float32]
    first_mm: NDArray[np.float32]


@dataclass(frozen=True, slots=True)
class Band:
    """Rows of work-groups first…last under way, which are lines of the picture."""

    first: int
    last: int
    lines: slice
    done: Any
    outputs: list[tuple[Any, NDArray[np.float32]]]


class Bands:
    """A picture cast band by band: no launch takes long, and none waits for the host.

    Two bands are under way at any time; each one's height follows from how long the last took.
    """

    def __init__(
        self,
        compute: Compute,
        result: Result,
        tile: tuple[int, int],
        group: tuple[int, int],
        tile_ms: float,
        pack: Pack | None = None,
    ) -> None:
        self._compute = compute
        self._result = result
        self._tile = tile
        self._group = group
        self._tile_ms = tile_ms
        self._pack = pack
        self._beyond = False
        height, width = result.alpha.shape
        self._columns = -(-width // (tile[0] * group[0])) * group[0]
        self._group_rows = -(-height // (tile[1] * group[1]))
        self._costs: deque[float] = deque(maxlen=3)  # ms a row of work-groups

    def run(
        self,
        kernel: Any,
        arguments: tuple[Any, ...],
        progress: Progress | None,
        cancel: Cancel | None,
    ) -> None:
        """Launch and fetch every band; see `volspec.raycast.gpu.Raycaster.cast`."""
        under_way: deque[Band] = deque()
        row, rows = 0, 1
        began = time.perf_counter()
        try:
            while row < self._group_rows or under_way:
                if cancel is not None and cancel():
                    raise CastCancelled("raycast: cancelled")
                while row < self._group_rows and len(under_way) < 2:
                    last = min(row + rows, self._group_rows)
                    under_way.append(self._launch(kernel, arguments, row, last))
                    row = last
                band = under_way.popleft()
                band.done.wait()
                now = time.perf_counter()
                rows = self._next_rows(rows, band, 1e3 * (now - began))
                began = now
                self._fetch(band)
                if progress is not None:
                    progress(band.last / self._group_rows)
        finally:
            self._compute.queue.finish()  # what is under way writes into the result
        if self._beyond:
            warnings.warn(
                f"raycast: channels beyond {_LARGEST_HALF:g} do not fit half-float and were cut; "
                "lower the lights' intensity, or give half=False",
                VolspecWarning,
                stacklevel=4,
            )

    def _next_rows(self, rows: int, band: Band, took_ms: float) -> int:
        """As many as the costliest of the last bands allows; at most twice as many as before."""
        self._costs.append(took_ms / (band.last - band.first))
        wanted = self._tile_ms / max(*self._costs, 1e-3)
        return int(np.clip(wanted, 1, 2 * rows))

    def _launch(self, kernel: Any, arguments: tuple[Any, ...], first: int, last: int) -> Band:
        height = self._group[1] * self._tile[1]
        lines = slice(first * height, min(last * height, len(self._result.alpha)))
        outputs = []
        for array in self._result:
            part = array[lines]
            into = part if part.dtype == np.float32 else np.empty(part.shape, np.float32)
            outputs.append((self._compute.output(into.nbytes, into), into))
        done = kernel(
            self._compute.queue,
            (self._columns, (last - first) * self._group[1]),
            self._group,
            *arguments,
            *(buffer for buffer, _ in outputs),
            np.int32(first * self._group[1]),
        )
        if self._pack is not None:
            done = self._pack(outputs[0][0], outputs[1][0], lines)
        self._compute.queue.flush()
        return Band(first, last, lines, done, outputs)

    def _fetch(self, band: Band) -> None:
        for (buffer, into), array in zip(band.outputs, self._result, strict=True):
            self._compute.download(buffer, into, band.done)
            if array.dtype != np.float32:
                self._beyond |= bool(into.max(initial=0.0) > _LARGEST_HALF)
                np.clip(into, -_LARGEST_HALF, _LARGEST_HALF, out=into)
                array[band.lines] = into
