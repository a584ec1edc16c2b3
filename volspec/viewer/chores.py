"""What actions ask of the app beyond the state: files opened and written, beside the window.

    action -> [chores] -> threads -> state, scene, script, session, PNG

Names are those of `volspec.viewer.actions`; a path may follow after a blank.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

from volspec.errors import InputError, VolspecError
from volspec.viewer.as_python import export_python
from volspec.viewer.as_scene import export_scene
from volspec.viewer.asking import WISHES, Asking
from volspec.viewer.clipboard import copy_shown, copy_values
from volspec.viewer.designing import PALETTES
from volspec.viewer.desk import Desk, Search
from volspec.viewer.document import opened
from volspec.viewer.notice import Notice
from volspec.viewer.opening import Opened, Outcome, Tasks
from volspec.viewer.panels.dialogs import PictureDialog, progress
from volspec.viewer.paths import Wish, dropped
from volspec.viewer.pictures import Pictures
from volspec.viewer.recent import RecentFiles, state_folder
from volspec.viewer.screenshot import CUSTOM, Progress, Shot, taken
from volspec.viewer.session import SUFFIX, BrokenSession, resumed, save_session
from volspec.viewer.session_store import SessionStore
from volspec.viewer.state import ViewState
from volspec.viewer.trace import Trace

_EARLY = "The last session ended early; File › Restore the last session brings it back"


class Chores:
    """Does what takes time, and what touches files.

    Parameters
    ----------
    tasks : Tasks
    pictures : Pictures
        What is shown, to be copied.
    desk, notice, trace
        What came of it is told to them.
    device : str, optional
        For casts.
    size : (width, height), optional
        Of pictures; None is as shown.
    palette : callable
        Takes the kind of wish, the path and the state, where a palette is to be read or written.
    """

    def __init__(
        self,
        tasks: Tasks,
        pictures: Pictures,
        desk: Desk,
        notice: Notice,
        trace: Trace,
        device: str | None,
        size: tuple[int, int] | None,
        palette: Callable[[str, str, ViewState], None],
    ) -> None:
        self._tasks, self._desk, self._palette = tasks, desk, palette
        self._notice, self._trace, self._device = notice, trace, device
        folder = state_folder()
        self._recent, self._store = RecentFiles(folder), SessionStore(folder)
        self._asking, self._picture = Asking(), PictureDialog()
        if size is not None:
            self._picture.shot = Shot(CUSTOM, size)
        self._progress: Progress | None = None
        self._state: ViewState | None = None
        # What is opened at the start where the last session cannot be restored.
        self._besides: list[str | None] = []
        self._done: dict[str, Callable[[ViewState, str], None]] = {
            **{name: self._ask(name) for name in WISHES},
            "reload": self._reload,
            "restore": self._restore,
            "screenshot": lambda state, _: self._cast(state),
            "picture": lambda *_: self._picture.ask(),
            "cancel": lambda *_: self._give_up(),
            "clear-recent": self._clear,
            "copy-picture": lambda *_: self._copied(lambda: copy_shown(pictures)),
            "copy-values": lambda *_: self._copied(lambda: copy_values(desk.under_mouse)),
            "commands": self._commands,
            "rename-light": self._rename,
            "say": lambda _, text: notice.say(text),
        }
        self._desk.recent = self._recent.rows()

    def do(self, name: str, state: ViewState) -> None:
        """Begin what an action asks for; ``open PATH`` opens a file."""
        word, _, path = name.partition(" ")
        self._state = state
        if word == "open" and path:
            self.open(path)
        else:
            self._done[word](state, path)

    def open(self, path: str | None, say: bool = True) -> None:
        """Read a scene, a volume or a session; `take` gives it when it is there.

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
            self._notice.say(f"Opening {path or 'the demo'} …")
        self._tasks.start("open", lambda: Opened.at_first(opened(path, self._device), path))

    def drop(self, paths: tuple[str, ...]) -> None:
        """Open what was dropped."""
        try:
            self.open(dropped(paths))
        except InputError as error:
            self._notice.say(str(error))

    def resume(self, path: str | None, last: bool) -> None:
        """At the start: go on from the last session, or from the one in a file.

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

    def take(self, first: bool) -> tuple[bool, Opened | None]:
        """What threads have brought: whether anything, and what was opened.

        Parameters
        ----------
        first : bool
            Whether nothing is open yet.

        Raises
        ------
        InputError
            If then nothing can be.
        """
        if answer := self._asking.take():
            self._answered(*answer)
        outcomes = self._tasks.take()
        found = None
        for outcome in outcomes:
            given_up = False
            if outcome.kind == "picture" and self._progress is not None:
                given_up, self._progress = self._progress.ended, None
            if given_up:
                self._notice.say("The picture was given up")
            elif outcome.error and first and outcome.kind in ("open", "resume"):
                self._instead(outcome.error)
            elif outcome.error:
                self._say_error(outcome.error)
            elif outcome.kind in ("open", "resume"):
                found = outcome.result
            elif outcome.kind != "session":
                self._finish(outcome)
        return bool(outcomes), found

    def begin(self, opened: Opened, before: ViewState | None) -> None:
        """Something is open now: what was before is kept, and the list of files grows."""
        if before is not None:
            self.keep(before)
        early = before is None and self._store.ended_early()
        self._store.begin(opened.state, opened.session)
        if self._notice.text.endswith("…"):  # what was under way is done
            self._notice.say("")
        if early and opened.session is None and not self._notice.text:
            self._notice.say(_EARLY)
            self._trace.note("ended-early")
        if opened.path is not None:
            self._recent.add(opened.path)
            self._desk.recent = self._recent.rows()

    def tick(self, state: ViewState, now: float, moves: bool) -> None:
        """Keep the session where it is time to, and nothing moves that it could disturb."""
        if self._store.due(state, now) and not moves:
            self._store.asked(now)
            self._tasks.start("session", lambda: self._store.save(state))

    def close(self, state: ViewState | None, faulty: bool) -> None:
        """The end, or a fault that ends it: nothing is cast any more, and the session is kept."""
        self._give_up()
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

    def draw(self, state: ViewState | None) -> None:
        """Dialogs, and how far a picture is."""
        if answer := self._asking.draw(self._desk):
            self._answered(*answer)
        if state is not None and self._picture.draw(state, self._desk):
            self._cast(state)
        if self._progress is not None and progress(self._progress, self._desk):
            self._give_up()

    def _ask(self, name: str) -> Callable[[ViewState, str], None]:
        return lambda state, _: self._asking.ask(WISHES[name], state.document)

    def _answered(self, wish: Wish, path: str) -> None:
        """A path that was asked for is there."""
        state = self._state
        if wish.kind == "open":
            self.open(path)
        elif wish.kind == "resume":
            self._resume(Path(path))
        elif state is not None and wish.kind in PALETTES:
            self._palette(wish.kind, path, state)
        elif state is not None:
            write = {
                "export-scene": export_scene,
                "export-python": export_python,
                "save-session": save_session,
            }[wish.kind]
            self._tasks.start(wish.kind, lambda: write(state, path))

    def _resume(self, path: Path) -> None:
        self._notice.say("Restoring the session …")
        self._tasks.start("resume", lambda: self._resumed(path))

    def _resumed(self, path: Path) -> Opened:
        session = self._store.read(path)
        try:
            state = resumed(session, self._device)
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

    def _restore(self, state: ViewState, _: str) -> None:
        """Go on from the last session that is not this one, which is kept."""
        self.keep(state)
        last = self._store.last()
        if last is None:
            self._notice.say("There is no other session to restore")
        else:
            self._resume(last)

    def _reload(self, state: ViewState, _: str) -> None:
        """Read the open file again; the view and the window stay, edits and A | B do not."""
        path = state.document.source
        self._notice.say("Reading the file again; only the view stays …")

        def again() -> Opened:
            found = Opened.at_first(opened(path, self._device), path)
            return replace(found, state=replace(found.state, view=state.view))

        self._tasks.start("open", again)

    def _cast(self, state: ViewState) -> None:
        if self._progress is not None:
            self._notice.say("A picture is being cast already")
            return
        shot = self._picture.shot
        width, height = shot.size(state.size)
        under_way = self._progress = Progress(f"Casting {width} × {height}")
        self._tasks.start("picture", lambda: taken(state, shot, under_way))

    def _give_up(self) -> None:
        if self._progress is not None:
            self._progress.end()

    def _finish(self, outcome: Outcome) -> None:
        event = "screenshot" if outcome.kind == "picture" else outcome.kind
        self._trace.note(event, path=str(outcome.result))
        self._notice.say(f"Saved {outcome.result}")

    def _copied(self, copy: Callable[[], str]) -> None:
        try:
            done = copy()
        except VolspecError as error:
            self._say_error(str(error))
        else:
            self._trace.note("copied", what=done)
            self._notice.say(done)

    def _commands(self, *_: object) -> None:
        self._desk.commands = None if self._desk.commands else Search()

    def _rename(self, state: ViewState, _: str) -> None:
        if "Lights" not in state.interface.panels:
            self._notice.say("Lights are renamed in their list: open the Lights panel")
            return
        self._desk.lights.rename(state.interface.light, state.lights)

    def _clear(self, *_: object) -> None:
        self._recent.clear()
        self._desk.recent = ()

    def _say_error(self, message: str) -> None:
        self._notice.say(message)
        self._trace.note("error", message=message)
