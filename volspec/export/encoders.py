"""Frames encoded on all cores, while the next ones are cast and relit.

    pixels -> [encoders] -> files

Only encoding is done by others: files appear one after the other, in the order they were given.
"""

from __future__ import annotations

import os
from collections import deque
from collections.abc import Callable
from concurrent.futures import Future, ThreadPoolExecutor
from pathlib import Path
from types import TracebackType

from volspec._files import write_whole

# Cores beyond these wait for the frames; and what may wait for cores, bytes.
_MOST_WORKERS = 16
_WAITING_BYTES = 2**29


def workers() -> int:
    """Threads that encode."""
    return min(os.cpu_count() or 1, _MOST_WORKERS)


class Encoders:
    """Turns frames into files; a context manager that ends when all are there.

    Parameters
    ----------
    frame_bytes : int
        Of one frame's pixels: how many may wait follows from it.

    Raises
    ------
    InputError
        By `put` and at the end, if a file cannot be written; what is done stays.
    """

    def __init__(self, frame_bytes: int) -> None:
        count = workers()
        self._room = max(1, min(2 * count, _WAITING_BYTES // max(frame_bytes, 1)))
        self._pool = ThreadPoolExecutor(count)
        self._waiting: deque[tuple[Path, Future[bytes]]] = deque()

    def put(self, path: Path, encode: Callable[[], bytes]) -> None:
        """Encode a frame soon; it is written when a later one needs its room, or at the end."""
        while len(self._waiting) >= self._room or (self._waiting and self._waiting[0][1].done()):
            self._write()
        self._waiting.append((path, self._pool.submit(encode)))

    def _write(self) -> None:
        path, encoded = self._waiting.popleft()
        data = encoded.result()
        with write_whole(path) as temporary:
            temporary.write_bytes(data)

    def __enter__(self) -> Encoders:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        try:
            while self._waiting and error is None:
                self._write()
        finally:
            self._pool.shutdown(cancel_futures=True)
