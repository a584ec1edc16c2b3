"""What the viewer did, as JSON lines: ``{"t", "event", "stage", "ms"}`` and what belongs to it.

``t`` counts seconds from the start; ``stage`` is ``cast``, ``relight``, ``frame`` or ``design``,
and null for all else.
"""

from __future__ import annotations

import json
import time
from pathlib import Path
from types import TracebackType
from typing import Any, Self


class Trace:
    """Writes the lines; does nothing without a file.

    Parameters
    ----------
    path : path, optional
        Begun anew.

    Raises
    ------
    OSError
        If it cannot be written to.
    """

    def __init__(self, path: Path | None = None) -> None:
        self._began = time.perf_counter()
        self._file = None if path is None else path.open("w", encoding="utf-8", buffering=1)
        self.note("start", unix=time.time())

    def note(
        self, event: str, stage: str | None = None, ms: float | None = None, **more: Any
    ) -> None:
        """Write a line."""
        if self._file is not None:
            t = round(time.perf_counter() - self._began, 6)
            row = {"t": t, "event": event, "stage": stage, "ms": ms and round(ms, 3), **more}
            self._file.write(json.dumps(row) + "\n")

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        if self._file is not None:
            self._file.close()
