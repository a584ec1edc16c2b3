"""Sessions and recent files in the user's folder, from one run to the next.

state, files opened -> [session_store] -> last session, menu
"""

from __future__ import annotations

import json
import os
import threading
import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

from volspec._files import clear_unfinished, keep_newest, lock, newest_first, write_whole
from volspec._parse import parse_json
from volspec.errors import InputError
from volspec.export.frames import file_stem
from volspec.viewer.model.document import Document
from volspec.viewer.model.state import ViewState
from volspec.viewer.work.session import SUFFIX, BrokenSession, Session, read_session, save_session

STATE_VARIABLE = "VOLSPEC_STATE"
MOST_FILES = 10


def state_folder() -> Path:
    """Where sessions and the list stand: ``VOLSPEC_STATE``, else the system's place for such."""
    from platformdirs import user_state_path

    return Path(os.environ.get(STATE_VARIABLE) or user_state_path("volspec", appauthor=False))


def address(path: str) -> str:
    """A file's name, with what follows a question mark, that holds in any folder."""
    file, mark, query = path.partition("?")
    return os.path.abspath(file) + mark + query


@dataclass(frozen=True, slots=True)
class RecentFile:
    """One row of the list.

    Parameters
    ----------
    path : str
    there : bool
        Whether there was a file when the list was last made.
    """

    path: str
    there: bool

    @property
    def label(self) -> str:
        """Name and folder."""
        file = Path(self.path.partition("?")[0])
        return f"{file.name}   {_short(file.parent)}"


class RecentFiles:
    """The list, the newest first.

    Parameters
    ----------
    folder : Path
        Where it is kept. What cannot be read or written there is done without.
    """

    def __init__(self, folder: Path) -> None:
        self._file = folder / "recent.json"

    def rows(self) -> tuple[RecentFile, ...]:
        """As it stands in the file, which other windows write too."""
        try:
            data = parse_json(self._file.read_text(encoding="utf-8"))
        except (OSError, ValueError):
            return ()
        paths = [path for path in data if isinstance(path, str)] if isinstance(data, list) else []
        return tuple(
            RecentFile(path, os.path.exists(path.partition("?")[0])) for path in paths[:MOST_FILES]
        )

    def add(self, path: str) -> None:
        """A file that has been opened."""
        path = address(path)
        paths = [path, *(row.path for row in self.rows() if row.path != path)]
        self._write(paths[:MOST_FILES])

    def clear(self) -> None:
        """Forget all."""
        self._write([])

    def _write(self, paths: list[str]) -> None:
        try:
            with write_whole(self._file) as temporary:
                temporary.write_text(json.dumps(paths, indent=1), encoding="utf-8")
        except (InputError, OSError):
            return


def _short(folder: Path) -> str:
    """With ``~`` for the user's own folder, and not too long a beginning."""
    try:
        text = f"~/{folder.relative_to(Path.home())}".removesuffix("/.")
    except (ValueError, RuntimeError):
        text = str(folder)
    return text if len(text) <= 48 else f"…{text[-47:]}"


MOST_SESSIONS = 10
# Saved when nothing has changed for the first; while there is no such rest, every so often.
REST_S = 2.5
EVERY_S = 30.0


class SessionStore:
    """The sessions of a folder, and this program's own.

    Parameters
    ----------
    folder : Path
    """

    def __init__(self, folder: Path) -> None:
        self._folder = folder / "sessions"
        self._running = Running(folder / "running")
        self._document: Document | None = None
        self._own: Path | None = None
        self._saved: ViewState | None = None
        self._seen: ViewState | None = None  # in the last look, and when it became so
        self._changed_s = self._due = 0.0
        self._lock = threading.Lock()  # a thread saves, and the end may come meanwhile
        # States in the order in which they were to be saved, and the last that was.
        self._asked = self._written = 0

    def begin(self, state: ViewState, own: Path | None = None) -> None:
        """Another document is open.

        Parameters
        ----------
        state : ViewState
            As it was opened: nothing to be kept yet.
        own : Path, optional
            The file of this store that it was restored from, which goes on.
        """
        clear_unfinished(self._folder)
        with self._lock:
            self._document, self._saved = state.document, _without_window(state)
            self._seen, self._due = None, 0.0
            self._running.end()
            self._own = own if own is not None and self.holds(own) else None

    def holds(self, path: Path) -> bool:
        """Whether a session's file is one of this store."""
        return path.parent == self._folder

    def due(self, state: ViewState, now: float) -> bool:
        """Whether it is time to `save`: what has changed rests, or has been changing for long."""
        if state is not self._seen:
            if self._seen is None or _without_window(state) != _without_window(self._seen):
                self._changed_s = now
                self._due = self._due or now + EVERY_S
            self._seen = state
        if self._due == 0.0 or min(self._changed_s + REST_S, self._due) > now:
            return False
        if self._changed(state):
            return True
        self._due = 0.0
        return False

    def saving(self, state: ViewState, now: float) -> Callable[[], Path | None]:
        """What a thread is to call to `save` a state that is due.

        It writes nothing once a state that came later is written. Where it fails it is due again
        after a while.
        """
        self._changed_s = self._due = now + EVERY_S
        return self._ordered(state)

    def ended_early(self) -> bool:
        """Whether the last session is of a program that died; this is told once."""
        left, last = self._running.left(), self.last()
        return last is not None and last.name in left

    def end(self) -> None:
        """The program ends as it should."""
        self._running.end()

    def save(self, state: ViewState) -> Path | None:
        """Write what has changed since the last time; where to, or None where nothing has.

        Raises
        ------
        VolspecError
            If it cannot be written.
        """
        return self._ordered(state)()

    def _ordered(self, state: ViewState) -> Callable[[], Path | None]:
        """What writes a state, unless one that was to be saved after it is written by then."""
        self._asked += 1
        number = self._asked
        return lambda: self._write(state, number)

    def _write(self, state: ViewState, number: int) -> Path | None:
        with self._lock:
            if number < self._written or not self._changed(state):
                return None
            if self._own is None:
                stamp = time.strftime("%Y%m%d-%H%M%S")
                name = f"{stamp}-{os.getpid()}-{file_stem(state.document.title)[:40]}{SUFFIX}"
                self._own = self._folder / name
            self._running.begin(self._own.name)
            save_session(state, self._own)
            self._saved, self._written = _without_window(state), number
            keep_newest(self._own, f"*{SUFFIX}", MOST_SESSIONS)
            return self._own

    def last(self) -> Path | None:
        """The newest session that is not this program's own."""
        return next((path for path in self._files() if path != self._own), None)

    def read(self, path: Path) -> Session:
        """A session's file; one that is broken is put aside as ``.broken``, not deleted.

        Raises
        ------
        SessionError
            If it cannot be read; the message says where a broken one has gone.
        """
        try:
            return read_session(path)
        except BrokenSession as error:
            raise self.broken(path, error) from error

    def broken(self, path: Path, error: BrokenSession) -> BrokenSession:
        """Put a session's file of this store aside; what to say of it."""
        if not self.holds(path):
            return error
        aside = path.with_name(path.name + ".broken")
        try:
            path.replace(aside)
        except OSError:
            return error
        return BrokenSession(f"{error}; it is kept as {aside.name}")

    def _changed(self, state: ViewState) -> bool:
        own = state.document is self._document and state.document.file is not None
        return own and _without_window(state) != self._saved

    def _files(self) -> list[Path]:
        try:
            return newest_first(self._folder.glob(f"*{SUFFIX}"))
        except OSError:
            return []


def _without_window(state: ViewState) -> ViewState:
    """What is saved of a state: all but what follows from the window."""
    return replace(state, size=(0, 0))


class Running:
    """Sessions of running programs: a file for each in a folder, locked while it lives.

    The system frees the locks of a dead program, so what is not locked has ended early.

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
        """Mark a session as this program's, in place of another."""
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
        lock(handle)

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
        left = lock(handle) is True
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
