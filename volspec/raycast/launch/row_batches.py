"""Launch a cast in batches of rows: no launch takes long, and the cast can end between two.

    kernel -> [row_batches] -> result

A graphics driver kills launches that take too long, and a viewer must be able to drop a picture.
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

from volspec._gpu import Compute
from volspec.errors import CastCancelled, VolspecWarning

Progress = Callable[[float], object]
Cancel = Callable[[], bool]
# Takes a band's coefficients and alpha on the device, and its lines; returns the event.
Pack = Callable[[Any, Any, slice], Any]

_MAX_HALF = float(np.finfo(np.float16).max)


class Receiver(Protocol):
    """A second destination of a cast's rows, in the device's own memory."""

    def receiving(self, compute: Compute, half: bool) -> AbstractContextManager[Pack]:
        """Return the function that receives each band, valid while the cast runs."""


class Result(NamedTuple):
    """Buffers of a cast picture.

    ``coefficients`` (H, W, L·M) premultiplied by opacity, layer after layer; ``alpha`` (H, W);
    ``depth_mm`` (H, W) expected distance from the camera, and ``first_mm`` (H, W) distance of the
    first hit; both inf in empty pixels.
    """

    coefficients: NDArray[np.floating]
    alpha: NDArray[np.float32]
    depth_mm: NDArray[np.float32]
    first_mm: NDArray[np.float32]


@dataclass(frozen=True, slots=True)
class RowBand:
    """A range of rows of work-groups in progress, and the lines of the picture that they cover."""

    first: int
    last: int
    lines: slice
    done: Any
    outputs: list[tuple[Any, NDArray[np.float32]]]


class RowBatches:
    """Caster of a picture band by band: no launch takes long, and none waits for the host.

    Two batches are in progress at any time; a batch's height follows from recent times, and from
    ``rows`` of work-groups at first. ``layers`` (H, W, …), of a cast with layers, are filled, too.
    """

    def __init__(
        self,
        compute: Compute,
        result: Result,
        tile: tuple[int, int],
        group: tuple[int, int],
        tile_ms: float,
        pack: Pack | None = None,
        rows: int = 1,
        layers: NDArray[np.float32] | None = None,
    ) -> None:
        self._compute, self._result, self._pack = compute, result, pack
        # In the order of the kernel's arguments.
        self._arrays = [*result, *([] if layers is None else [layers])]
        self._tile, self._group, self._tile_ms = tile, group, tile_ms
        self._clipped, self._first_rows = False, rows
        height, width = result.alpha.shape
        self._columns = -(-width // (tile[0] * group[0])) * group[0]
        self._group_rows = -(-height // (tile[1] * group[1]))
        self._costs: deque[float] = deque(maxlen=3)  # ms per row of work-groups

    def run(
        self,
        kernel: Any,
        arguments: tuple[Any, ...],
        progress: Progress | None,
        cancel: Cancel | None,
    ) -> None:
        """Launch and fetch every band; see `volspec.raycast.gpu.Raycaster.cast`."""
        in_progress: deque[RowBand] = deque()
        row, rows = 0, self._first_rows
        began = time.perf_counter()
        try:
            while row < self._group_rows or in_progress:
                if cancel is not None and cancel():
                    raise CastCancelled("raycast: cancelled", code="state")
                while row < self._group_rows and len(in_progress) < 2:
                    last = min(row + rows, self._group_rows)
                    in_progress.append(self._launch(kernel, arguments, row, last))
                    row = last
                band = in_progress.popleft()
                band.done.wait()
                now = time.perf_counter()
                rows = self._next_rows(rows, band, 1e3 * (now - began))
                began = now
                self._fetch(band)
                if progress is not None:
                    progress(band.last / self._group_rows)
        finally:
            self._compute.queue.finish()  # batches in progress write into the result
        if self._clipped:
            warnings.warn(
                f"raycast: channels beyond {_MAX_HALF:g} overflow half-float and were clipped; "
                "lower the lights' intensity, or give half=False",
                VolspecWarning,
                stacklevel=4,
            )

    def _next_rows(self, rows: int, band: RowBand, took_ms: float) -> int:
        """Return the rows that the costliest recent batch allows, at most twice ``rows``."""
        self._costs.append(took_ms / (band.last - band.first))
        target_rows = self._tile_ms / max(*self._costs, 1e-3)
        return int(np.clip(target_rows, 1, 2 * rows))

    def _launch(self, kernel: Any, arguments: tuple[Any, ...], first: int, last: int) -> RowBand:
        height = self._group[1] * self._tile[1]
        lines = slice(first * height, min(last * height, len(self._result.alpha)))
        outputs = []
        for array in self._arrays:
            rows = array[lines]
            into = rows if rows.dtype == np.float32 else np.empty(rows.shape, np.float32)
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
        return RowBand(first, last, lines, done, outputs)

    def _fetch(self, band: RowBand) -> None:
        for (buffer, into), array in zip(band.outputs, self._arrays, strict=True):
            self._compute.download(buffer, into, band.done)
            if array.dtype != np.float32:
                self._clipped |= bool(into.max(initial=0.0) > _MAX_HALF)
                np.clip(into, -_MAX_HALF, _MAX_HALF, out=into)
                array[band.lines] = into


def part_of(progress: Progress | None, number: int, count: int) -> Progress | None:
    """Return the progress of one of several casts."""
    if progress is None or count == 1:
        return progress
    return lambda fraction: progress((number + fraction) / count)
