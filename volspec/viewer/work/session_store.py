"""Sessions and recent files in the user's folder, from one run to the next.

state, opened files -> [session_store] -> last session, menu
"""

from __future__ import annotations

import json
import os
import threading
import time
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

from volspec._files import (
    clear_unfinished,
    is_remote,
    keep_newest,
    lock_file_handle,
    make_private,
    newest_first,
    write_whole,
)
from volspec._parse import parse_json
from volspec.errors import InputError
from volspec.export import file_stem
from volspec.viewer.model.state import ViewState
from volspec.viewer.work.session import SUFFIX, BrokenSession, Session, read_session, save_session
from volspec.volume import is_pattern

STATE_VARIABLE = "VOLSPEC_STATE"
MAX_FILES = 10


def state_folder() -> Path:
    """Return the folder for sessions and the list: ``VOLSPEC_STATE``, or the system's own."""
    from platformdirs import user_state_path

    return Path(os.environ.get(STATE_VARIABLE) or user_state_path("volspec", appauthor=False))


@dataclass(frozen=True, slots=True)
class RecentFile:
    """A row of the list of recent files; ``exists`` is False if the file was missing."""

    path: str
    exists: bool

    @property
    def label(self) -> str:
        """Name and folder, with ``~`` for the home folder, and a long beginning cut off."""
        file = Path(self.path.partition("?")[0])
        try:
            folder = f"~/{file.parent.relative_to(Path.home())}".removesuffix("/.")
        except (ValueError, RuntimeError):
            folder = str(file.parent)
        return f"{file.name}   {folder if len(folder) <= 48 else f'…{folder[-47:]}'}"


class RecentFiles:
    """The list of recent files in a folder; empty if the folder cannot be read or written."""

    def __init__(self, folder: Path) -> None:
        self._file = folder / "recent.json"

    def rows(self) -> tuple[RecentFile, ...]:
        """Read the list, newest first; other windows write it too."""
        try:
            data = parse_json(self._file.read_text(encoding="utf-8"))
        except (OSError, ValueError):
            return ()
        paths = [path for path in data if isinstance(path, str)] if isinstance(data, list) else []
        return tuple(
            RecentFile(
                path,
                is_remote(path) or is_pattern(path) or os.path.exists(path.partition("?")[0]),
            )
            for path in paths[:MAX_FILES]
        )

    def add(self, path: str) -> None:
        """Put an opened file first."""
        file, mark, query = path.partition("?")
        path = path if is_remote(path) else os.path.abspath(file) + mark + query
        paths = [path, *(row.path for row in self.rows() if row.path != path)]
        self._write(paths[:MAX_FILES])

    def clear(self) -> None:
        """Clear the list."""
        self._write([])

    def _write(self, paths: list[str]) -> None:
        with suppress(InputError, OSError):
            make_private(self._file.parent)
            with write_whole(self._file) as temporary:
                temporary.write_text(json.dumps(paths, indent=1), encoding="utf-8")


MAX_SESSIONS = 10
# A session is saved when nothing has changed for this long,
REST_S = 2.5
# and at this interval if something changes all the time.
EVERY_S = 30.0


class SessionStore:
    """The sessions of a folder, and this program's own."""

    def __init__(self, folder: Path) -> None:
        self._folder = folder / "sessions"
        self._running = Running(folder / "running")
        self._opening: object = None  # of the document
        self._file: Path | None = None
        self._saved: ViewState | None = None
        self._latest: ViewState | None = None  # the last state given to `due`
        self._changed_s = self._due = 0.0
        self._lock = threading.Lock()  # a thread may be saving when the program ends
        # Numbers of the last requested and the last written state.
        self._requested = self._written = 0

    def begin(self, state: ViewState, session_file: Path | None = None) -> None:
        """Start the session of an opened state; a ``session_file`` of this store is continued."""
        clear_unfinished(self._folder)
        with self._lock:
            self._opening, self._saved = state.document.opening, _without_window(state)
            self._latest, self._due = None, 0.0
            self._running.end()
            self._file = session_file if session_file and self.holds(session_file) else None

    def holds(self, path: Path) -> bool:
        """Return True if a session's file belongs to this store."""
        return path.parent == self._folder

    def due(self, state: ViewState, now: float) -> bool:
        """Return True if a state is to be saved: it has changed, and is at rest or overdue."""
        if state is not self._latest:
            if self._latest is None or _without_window(state) != _without_window(self._latest):
                self._changed_s = now
                self._due = self._due or now + EVERY_S
            self._latest = state
        if self._due == 0.0 or min(self._changed_s + REST_S, self._due) > now:
            return False
        if self._changed(state):
            return True
        self._due = 0.0
        return False

    def saving(self, state: ViewState, now: float) -> Callable[[], Path | None]:
        """Return a function for a thread that saves a state that is due.

        It writes nothing if a later state has been written. If it fails, the state is due again.
        """
        self._changed_s = self._due = now + EVERY_S
        return self._ordered(state)

    def ended_early(self) -> bool:
        """Return True, only once, if the last session belongs to a program that died."""
        left, last = self._running.left(), self.last()
        return last is not None and last.name in left

    def end(self) -> None:
        """Mark the session as ended normally."""
        self._running.end()

    def save(self, state: ViewState) -> Path | None:
        """Write a state to this program's file; return None if nothing has changed.

        Raises VolspecError if it cannot be written.
        """
        return self._ordered(state)()

    def _ordered(self, state: ViewState) -> Callable[[], Path | None]:
        """Return a function that writes a state, unless a later one has been written."""
        self._requested += 1
        return partial(self._write, state, self._requested)

    def _write(self, state: ViewState, number: int) -> Path | None:
        with self._lock:
            if number < self._written or not self._changed(state):
                return None
            if self._file is None:
                stamp = time.strftime("%Y%m%d-%H%M%S")
                name = f"{stamp}-{os.getpid()}-{file_stem(state.document.title)[:40]}{SUFFIX}"
                self._file = self._folder / name
            self._running.begin(self._file.name)
            with suppress(OSError):  # which saving reports
                make_private(self._folder)
            save_session(state, self._file)
            self._saved, self._written = _without_window(state), number
            keep_newest(self._file, f"*{SUFFIX}", MAX_SESSIONS)
            return self._file

    def last(self) -> Path | None:
        """Return the newest session that is not this program's own."""
        try:
            files = newest_first(self._folder.glob(f"*{SUFFIX}"))
        except OSError:
            return None
        return next((path for path in files if path != self._file), None)

    def read(self, path: Path) -> Session:
        """Read a session's file; a broken one is renamed to ``.broken``, not deleted."""
        try:
            return read_session(path)
        except BrokenSession as error:
            raise self.broken(path, error) from error

    def broken(self, path: Path, error: BrokenSession) -> BrokenSession:
        """Rename a broken session of this store; return the error to raise."""
        if not self.holds(path):
            return error
        aside = path.with_name(path.name + ".broken")
        try:
            path.replace(aside)
        except OSError:
            return error
        return BrokenSession(f"{error}; it was renamed to {aside.name}")

    def _changed(self, state: ViewState) -> bool:
        is_current = state.document.opening is self._opening and state.document.file is not None
        return is_current and _without_window(state) != self._saved


def _without_window(state: ViewState) -> ViewState:
    """Return a state without the window's size, which is not saved."""
    return replace(state, size=(0, 0))


class Running:
    """Sessions of running programs: a file per session, locked while its program lives.

    The system frees the locks of a dead program, so a file without a lock is one that ended early.
    Without a folder that can be read and written, there are none.
    """

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        self._mark: Path | None = None
        self._handle = -1

    def begin(self, name: str) -> None:
        """Mark a session as this program's, instead of the previous one."""
        if self._mark is not None and self._mark.name == name:
            return
        self.end()
        path = self._folder / name
        try:
            make_private(self._folder)
            handle = os.open(path, os.O_RDWR | os.O_CREAT)
        except OSError:
            return
        self._mark, self._handle = path, handle
        lock_file_handle(handle)

    def end(self) -> None:
        """Remove the mark."""
        if self._mark is None:
            return
        os.close(self._handle)
        with suppress(OSError):
            self._mark.unlink(missing_ok=True)
        self._mark, self._handle = None, -1

    def left(self) -> set[str]:
        """Return the sessions whose programs have died, and remove their marks."""
        try:
            marks = [path for path in self._folder.iterdir() if path != self._mark]
        except OSError:
            return set()
        return {path.name for path in marks if _is_left(path)}


def _is_left(path: Path) -> bool:
    """Return True, and delete the mark, if its program has died."""
    try:
        handle = os.open(path, os.O_RDWR)
    except OSError:
        return False
    try:
        left = lock_file_handle(handle) is True
    finally:
        os.close(handle)
    if left:
        with suppress(OSError):
            path.unlink(missing_ok=True)
    return left
