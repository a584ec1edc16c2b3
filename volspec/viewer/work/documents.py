"""Opening of scenes, volumes and sessions, and the list of recent files.

    path -> [documents] -> threads -> Opened -> state

Of several requests, only the last is opened. The previous state is saved as a session.
"""

from __future__ import annotations

import threading
from dataclasses import dataclass, replace
from pathlib import Path

from volspec.errors import InputError, VolspecError
from volspec.scene import Scene
from volspec.spectra import reflectance_names
from volspec.viewer.model.document import Document, demo
from volspec.viewer.model.light_rows import brightest_row
from volspec.viewer.model.paths import check_name, dropped_path
from volspec.viewer.model.state import ViewState
from volspec.viewer.work.background import Outcome, Tasks
from volspec.viewer.work.casts import make_caster
from volspec.viewer.work.demonstrations import demonstration_at
from volspec.viewer.work.notify import Notice
from volspec.viewer.work.session import SUFFIX, BrokenSession, restore_state
from volspec.viewer.work.session_store import RecentFiles, SessionStore, state_folder
from volspec.volume import load_volume


def open_document(path: str | None, device: str | None = None) -> Document:
    """Open a scene file, or a volume with a scene made for it; None opens the bundled demo.

    Raises VolspecError if the file cannot be read, or a device is named that cannot cast.
    """
    if path is not None:
        check_name(path)
    if path is None or path.lower().endswith(".toml"):
        scene = Scene.load(demo() if path is None else path)
        volume = scene.volume()
    else:
        volume = load_volume(path)
        scene = Scene.from_volume(path, volume=volume)
    # Loaded ahead, as presets would have to wait for the names.
    threading.Thread(target=reflectance_names, daemon=True).start()
    caster, fault = make_caster(volume, device)
    return Document.of(scene, volume, caster, fault)


@dataclass(frozen=True, slots=True, eq=False)
class Opened:
    """A document, or a ``session`` file, that was opened.

    The path is as requested; None for the bundled demo, and for sessions saved automatically.
    """

    state: ViewState
    path: str | None = None
    session: Path | None = None

    def after(self, before: ViewState | None) -> Opened:
        """Return this for the current window; a session keeps its interface and chosen light."""
        if before is None:
            return self
        interface = self.state.interface
        if self.session is None:
            interface = replace(before.interface, light=brightest_row(self.state.lights))
        return replace(self, state=replace(self.state, size=before.size, interface=interface))


def open_path(path: str | None, device: str | None) -> Opened:
    """Open a scene or a volume with `open_document`, in its initial state."""
    return Opened(ViewState.first(open_document(path, device), (0, 0)), path)


class DocumentService:
    """Opens files in the background, and saves sessions."""

    def __init__(self, tasks: Tasks, notice: Notice, device: str | None) -> None:
        self._tasks, self._notice, self._device = tasks, notice, device
        folder = state_folder()
        self._recent, self._store = RecentFiles(folder), SessionStore(folder)
        # Opened at the start, in this order, if the last session cannot be restored.
        self._fallbacks: list[str | None] = []
        self._opening = ""  # the message while a file is being opened
        self.recent = self._recent.rows()

    def open(self, path: str | None, notify: bool = True) -> None:
        """Start reading a scene, a volume or a session; None for the bundled demo.

        `finish_open` returns it later. If ``notify`` is False, the current message stays.
        """
        if path is not None and path.lower().endswith(SUFFIX):
            self.resume(Path(path))
            return
        if notify:
            self._show_opening(f"Opening {path or 'the demo'} …")
        self._tasks.start("open", lambda: open_path(path, self._device))

    def drop(self, paths: tuple[str, ...]) -> None:
        """Open the scene or the volume that was dropped."""
        try:
            self.open(dropped_path(paths))
        except InputError as error:
            self._notice.show_error(str(error))

    def resume_last(self, path: str | None) -> None:
        """Restore the last session; without one, open the file, the most recent one or the demo."""
        recent = [row.path for row in self._recent.rows() if row.there]
        self._fallbacks = [path] if path is not None else [*recent[:1], None]
        session = self._store.last()
        if session is not None:
            self.resume(session)
        else:
            self._open_fallback("There is no session to restore")

    def finish_open(self, outcome: Outcome, first: bool) -> Opened | None:
        """Return the result of an ``open`` task; if it failed, show the error and return None.

        Raises InputError if nothing is open yet (``first``), and nothing can be opened instead.
        """
        if not outcome.error:
            opened: Opened = outcome.result
            return opened
        if first:
            self._open_fallback(outcome.error)
        else:
            self._notice.show_error(outcome.error)
        return None

    def begin(self, opened: Opened, before: ViewState | None) -> None:
        """Save the previous session, start the new document's, and list its file."""
        if before is not None:
            self.save(before)
        early = before is None and self._store.ended_early()
        self._store.begin(opened.state, opened.session)
        self._notice.hide(self._opening)
        if early and opened.session is None and not self._notice.text:
            self._notice.show_warning(
                "The last session ended early; File › Restore the last session brings it back"
            )
            self._notice.trace.note("ended-early")
        if (demonstration := demonstration_at(opened.path)) is not None:
            self._notice.show(demonstration.hint)
        elif opened.path is not None:
            self._recent.add(opened.path)
            self.recent = self._recent.rows()

    def tick(self, state: ViewState, now: float, moves: bool) -> None:
        """Save the session if it is due and nothing is moving that this could disturb."""
        if self._store.due(state, now) and not moves:
            self._tasks.start("session", self._store.saving(state, now))

    def close(self, state: ViewState | None, faulty: bool) -> None:
        """Save the session at the end; after a fault it is not marked as ended."""
        if state is not None:
            self.save(state)
        if not faulty:
            self._store.end()

    def save(self, state: ViewState) -> None:
        """Save the session now; an error is only shown as a message."""
        try:
            self._store.save(state)
        except (VolspecError, OSError) as error:
            self._notice.show_error(f"The session was not saved: {error}")

    def restore(self, state: ViewState) -> None:
        """Save this session, and restore the one before."""
        self.save(state)
        last = self._store.last()
        if last is None:
            self._notice.show_warning("There is no other session to restore")
        else:
            self.resume(last)

    def reload(self, state: ViewState) -> None:
        """Read the open file again; only the view and the window stay."""
        path = state.document.source
        self._show_opening("Reading the file again; only the view stays …")

        def again() -> Opened:
            found = open_path(path, self._device)
            return replace(found, state=replace(found.state, view=state.view))

        self._tasks.start("open", again)

    def clear_recent(self) -> None:
        """Clear the list of recent files."""
        self._recent.clear()
        self.recent = ()

    def resume(self, path: Path) -> None:
        """Start restoring the session in a file."""

        def restored() -> Opened:
            check_name(path)
            session = self._store.read(path)
            try:
                state = restore_state(session, self._device)
            except BrokenSession as error:
                raise self._store.broken(path, error) from error
            return Opened(state, None if self._store.holds(path) else str(path), path)

        self._show_opening("Restoring the session …")
        self._tasks.start("open", restored)

    def _open_fallback(self, error: str) -> None:
        """Open the next of `_fallbacks`, as nothing is open yet; without one, raise the error."""
        if not self._fallbacks:
            raise InputError(error, code="impossible")
        path = self._fallbacks.pop(0)
        name = "the demo" if path is None else Path(path).name
        self._notice.show_error(f"{error}; opening {name} instead")
        self.open(path, notify=False)

    def _show_opening(self, message: str) -> None:
        """Show a message until the file is open, or another message comes."""
        self._notice.show(message)
        self._opening = self._notice.text
