"""Which sessions are under way: a file for each, locked as long as its program lives.

session_store -> [running] -> "ended early"

The system gives a dead program's locks back, so what is left unlocked has ended early.
"""

from __future__ import annotations

import os
from contextlib import suppress
from pathlib import Path

from volspec._files import try_lock


class Running:
    """Marks in a folder.

    Parameters
    ----------
    folder : Path
        What cannot be read or written there is done without.
    """

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        self._mark: Path | None = None
        self._handle = -1

    def begin(self, name: str) -> None:
        """Mark a session as under way, in place of another."""
        if self._mark is not None and self._mark.name == name:
            return
        self.end()
        path = self._folder / name
        try:
            self._folder.mkdir(parents=True, exist_ok=True)
            handle = os.open(path, os.O_RDWR | os.O_CREAT)
        except OSError:
            return
        self._mark, self._handle = path, handle
        with suppress(OSError):
            try_lock(handle)

    def end(self) -> None:
        """It has ended as it should."""
        if self._mark is None:
            return
        os.close(self._handle)
        _unlinked(self._mark)
        self._mark, self._handle = None, -1

    def left(self) -> set[str]:
        """The sessions whose programs have died; they are told of once."""
        try:
            marks = [path for path in self._folder.iterdir() if path != self._mark]
        except OSError:
            return set()
        return {path.name for path in marks if _is_left(path)}


def _is_left(path: Path) -> bool:
    try:
        handle = os.open(path, os.O_RDWR)
    except OSError:
        return False
    try:
        left = try_lock(handle)
    except OSError:
        return False
    finally:
        os.close(handle)
    if left:
        _unlinked(path)
    return left


def _unlinked(path: Path) -> None:
    try:
        path.unlink(missing_ok=True)
    except OSError:
        return
