"""Scenes, volumes and sessions opened, and the list of recent files.

    path -> [documents] -> threads -> Opened -> state

Of several requests the last one is opened. What was open before is saved as a session.
"""

from __future__ import annotations

import threading
from dataclasses import dataclass, replace
from pathlib import Path

from volspec.errors import InputError, VolspecError
from volspec.scene import Scene
from volspec.spectra import reflectance_names
from volspec.viewer.model.camera import fitted
from volspec.viewer.model.document import Document, demo, plain_scene
from volspec.viewer.model.light_rows import brightest_row
from volspec.viewer.model.paths import check_name, path_of_drop
from volspec.viewer.model.state import ViewState
from volspec.viewer.model.view import View
from volspec.viewer.work.background import Outcome, Tasks
from volspec.viewer.work.casts import make_caster
from volspec.viewer.work.notify import Notice, Trace
from volspec.viewer.work.session import SUFFIX, BrokenSession, restore_state
from volspec.viewer.work.session_store import RecentFiles, SessionStore, state_folder
from volspec.volume import load_volume


def open_document(path: str | None, device: str | None = None) -> Document:
    """Open a scene file, or a volume with a scene made for it; None is the bundled demo.

    Raises
    ------
    VolspecError
        If it cannot be read, or the device that is named cannot cast.
    """
    view = None
    if path is not None:
        check_name(path)
    if path is None:
        scene = Scene.load(demo())
        volume = scene.volume()
    elif path.lower().endswith(".toml"):
        scene = Scene.load(path)
        volume = scene.volume()
    else:
        volume = load_volume(path)
        scene = Scene(plain_scene(path, volume), path.partition("?")[0])
        # No window is known yet: a square that has the picture's height.
        view = fitted(View(), volume, scene.transfer, scene.raycast, 1.0)
    # Presets take their materials from it, when somebody waits for them.
    threading.Thread(target=reflectance_names, daemon=True).start()
    caster, fault = make_caster(volume, device)
    return Document.of(scene, volume, caster, view, fault)


_EARLY = "The last session ended early; File › Restore the last session brings it back"


@dataclass(frozen=True, slots=True, eq=False)
class Opened:
    """What was opened.

    Parameters
    ----------
    state : ViewState
    path : str, optional
        As it was asked for; None of the bundled demo and of sessions kept without being asked.
    session : Path, optional
        The session that it goes on from, with its own window.
    """

    state: ViewState
    path: str | None = None
    session: Path | None = None

    @classmethod
    def at_first(cls, document: Document, path: str | None) -> Opened:
        """A document as its file has it."""
        return cls(ViewState.first(document, (0, 0)), path)

    def after(self, before: ViewState | None) -> Opened:
        """In the window as it was, with the light chosen that shines; a session has its own."""
        if before is None:
            return self
        interface = self.state.interface
        if self.session is None:
            interface = replace(before.interface, light=brightest_row(self.state.lights))
        return replace(self, state=replace(self.state, size=before.size, interface=interface))


class DocumentService:
    """Has files opened beside the window, and sessions kept.

    Parameters
    ----------
    tasks : Tasks
    notice, trace
        What came of it is told to them.
    device : str, optional
        For casts.

    Attributes
    ----------
    recent : tuple of RecentFile
        Files opened lately.
    """

    def __init__(self, tasks: Tasks, notice: Notice, trace: Trace, device: str | None) -> None:
        self._tasks, self._device = tasks, device
        self._notice, self._trace = notice, trace
        folder = state_folder()
        self._recent, self._store = RecentFiles(folder), SessionStore(folder)
        # What is opened at the start where the last session cannot be restored.
        self._besides: list[str | None] = []
        self._under_way = ""  # as it was told
        self.recent = self._recent.rows()

    def open(self, path: str | None, say: bool = True) -> None:
        """Read a scene, a volume or a session; `came` gives it when it is there.

        Parameters
        ----------
        path : str, optional
            None is the bundled demo.
        say : bool
            Whether a message that stands there may go.
        """
        if path is not None and path.lower().endswith(SUFFIX):
            self._resume(Path(path))
            return
        if say:
            self._say_under_way(f"Opening {path or 'the demo'} …")
        self._tasks.start("open", lambda: Opened.at_first(open_document(path, self._device), path))

    def drop(self, paths: tuple[str, ...]) -> None:
        """Open what was dropped."""
        try:
            self.open(path_of_drop(paths))
        except InputError as error:
            self._say_error(str(error))

    def resume(self, path: str | None, last: bool) -> None:
        """Go on from the last session, or from the one in a file.

        Parameters
        ----------
        path : str, optional
            A session; or what is opened where there is no last session. Without one that is the
            file opened last, else the demo.
        last : bool
        """
        if not last:
            self._resume(Path(path or ""))
            return
        lately = [row.path for row in self._recent.rows() if row.there]
        self._besides = [path] if path is not None else [*lately[:1], None]
        found = self._store.last()
        if found is not None:
            self._resume(found)
        else:
            self._instead("There is no session to restore")

    def came(self, outcome: Outcome, first: bool) -> Opened | None:
        """What was opened; None where it could not be, which is told.

        Parameters
        ----------
        outcome : Outcome
            Of the kind ``open``.
        first : bool
            Whether nothing is open yet.

        Raises
        ------
        InputError
            If then nothing can be.
        """
        if not outcome.error:
            found: Opened = outcome.result
            return found
        if first:
            self._instead(outcome.error)
        else:
            self._say_error(outcome.error)
        return None

    def begin(self, opened: Opened, before: ViewState | None) -> None:
        """Something is open now: what was before is kept, and the list of files grows."""
        if before is not None:
            self.keep(before)
        early = before is None and self._store.ended_early()
        self._store.begin(opened.state, opened.session)
        if self._notice.text == self._under_way:
            self._notice.say("")
        if early and opened.session is None and not self._notice.text:
            self._notice.say(_EARLY)
            self._trace.note("ended-early")
        if opened.path is not None:
            self._recent.add(opened.path)
            self.recent = self._recent.rows()

    def tick(self, state: ViewState, now: float, moves: bool) -> None:
        """Keep the session where it is time to, and nothing moves that it could disturb."""
        if self._store.due(state, now) and not moves:
            self._tasks.start("session", self._store.saving(state, now))

    def close(self, state: ViewState | None, faulty: bool) -> None:
        """The end, or a fault that ends it: the session is kept."""
        if state is not None:
            self.keep(state)
        if not faulty:
            self._store.end()

    def keep(self, state: ViewState) -> None:
        """Keep the session now; that it cannot be stops nothing."""
        try:
            self._store.save(state)
        except (VolspecError, OSError) as error:
            self._say_error(f"The session is not kept: {error}")

    def restore(self, state: ViewState) -> None:
        """Go on from the last session that is not this one, which is kept."""
        self.keep(state)
        last = self._store.last()
        if last is None:
            self._notice.say("There is no other session to restore")
        else:
            self._resume(last)

    def reload(self, state: ViewState) -> None:
        """Read the open file again; the view and the window stay, edits and A | B do not."""
        path = state.document.source
        self._say_under_way("Reading the file again; only the view stays …")

        def again() -> Opened:
            found = Opened.at_first(open_document(path, self._device), path)
            return replace(found, state=replace(found.state, view=state.view))

        self._tasks.start("open", again)

    def clear_recent(self) -> None:
        """Forget the files that were opened lately."""
        self._recent.clear()
        self.recent = ()

    def _resume(self, path: Path) -> None:
        self._say_under_way("Restoring the session …")
        self._tasks.start("open", lambda: self._resumed(path))

    def _resumed(self, path: Path) -> Opened:
        check_name(path)
        session = self._store.read(path)
        try:
            state = restore_state(session, self._device)
        except BrokenSession as error:
            raise self._store.broken(path, error) from error
        return Opened(state, None if self._store.holds(path) else str(path), path)

    def _instead(self, error: str) -> None:
        """Nothing is open yet, and what was asked for cannot be: what comes next, if anything."""
        if not self._besides:
            raise InputError(error)
        path = self._besides.pop(0)
        self._say_error(f"{error}; this is {'the demo' if path is None else Path(path).name}")
        self.open(path, say=False)

    def _say_under_way(self, message: str) -> None:
        """Until it is open, or something else is said."""
        self._notice.say(message)
        self._under_way = self._notice.text

    def _say_error(self, message: str) -> None:
        self._notice.say(message)
        self._trace.note("error", message=message)
