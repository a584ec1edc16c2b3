"""Commands that go beyond the state: files, pictures, dialogs, the clipboard.

    command -> [chores] -> opening | tasks -> scene, script, session, PNG

Names are those of `volspec.viewer.model.commands`, and ``say``; a path, or a message, may follow
after a blank.
"""

from __future__ import annotations

from collections.abc import Callable

from volspec.errors import VolspecError
from volspec.viewer.model.paths import PathRequest
from volspec.viewer.model.scene_file import export_scene
from volspec.viewer.model.state import ViewState
from volspec.viewer.ui.context import Search, UiContext
from volspec.viewer.ui.dialogs import REQUESTS, FileDialogs, PictureDialog, progress
from volspec.viewer.work.background import Outcome, Tasks
from volspec.viewer.work.designs import PALETTES
from volspec.viewer.work.documents import DocumentService, Opened
from volspec.viewer.work.notify import Notice, Trace
from volspec.viewer.work.pictures import Pictures
from volspec.viewer.work.screenshot import (
    CUSTOM,
    Progress,
    Shot,
    copy_shown,
    copy_values,
    save_picture,
)
from volspec.viewer.work.script import export_python
from volspec.viewer.work.session import save_session


class FileCommands:
    """Does what takes time, and what touches files.

    Parameters
    ----------
    tasks : Tasks
    pictures : Pictures
        What is shown, to be copied.
    ui, notice, trace
        What came of it is told to them.
    device : str, optional
        For casts.
    size : (width, height), optional
        Of pictures; None is as shown.
    palette : callable
        Takes the kind of request, the path and the state, where a palette is to be read or written.

    Attributes
    ----------
    openings : DocumentService
    """

    def __init__(
        self,
        tasks: Tasks,
        pictures: Pictures,
        ui: UiContext,
        notice: Notice,
        trace: Trace,
        device: str | None,
        size: tuple[int, int] | None,
        palette: Callable[[str, str, ViewState], None],
    ) -> None:
        self._tasks, self._ui, self._palette = tasks, ui, palette
        self._notice, self._trace = notice, trace
        self.documents = DocumentService(tasks, notice, trace, device)
        self._dialogs, self._picture = FileDialogs(), PictureDialog()
        if size is not None:
            self._picture.shot = Shot(CUSTOM, size)
        self._progress: Progress | None = None
        self._state: ViewState | None = None
        self._done: dict[str, Callable[[ViewState, str], None]] = {
            **{name: self._ask(name) for name in REQUESTS},
            "reload": lambda state, _: self.documents.reload(state),
            "restore": lambda state, _: self.documents.restore(state),
            "screenshot": lambda state, _: self._cast(state),
            "picture": lambda *_: self._picture.ask(),
            "cancel": lambda *_: self._give_up(),
            "clear-recent": lambda *_: self.documents.clear_recent(),
            "copy-picture": lambda *_: self._copied(lambda: copy_shown(pictures)),
            "copy-values": lambda *_: self._copied(lambda: copy_values(ui.results.under_mouse)),
            "commands": self._commands,
            "rename-light": self._rename,
            "say": lambda _, text: notice.say(text),
        }

    @property
    def busy(self) -> bool:
        """Whether files or pictures are being read, cast or written."""
        return self._tasks.busy

    def do(self, name: str, state: ViewState) -> None:
        """Begin what an action asks for; ``open PATH`` opens a file, ``say TEXT`` is a notice."""
        word, _, path = name.partition(" ")
        self._state = state
        if word == "open" and path:
            self.documents.open(path)
        else:
            self._done[word](state, path)

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
        if answer := self._dialogs.take():
            self._answered(*answer)
        outcomes = self._tasks.take()
        found = None
        for outcome in outcomes:
            given_up = False
            if outcome.kind == "picture" and self._progress is not None:
                # What was ended too late is written all the same.
                given_up = self._progress.ended and bool(outcome.error)
                self._progress = None
            if given_up:
                self._notice.say("The picture was given up")
            elif outcome.kind == "open":
                found = self.documents.came(outcome, first)
            elif outcome.error:
                self._say_error(outcome.error)
            elif outcome.kind != "session":
                self._finish(outcome)
        return bool(outcomes), found

    def close(self, state: ViewState | None, faulty: bool) -> None:
        """The end, or a fault that ends it: no cast goes on, session and files are kept."""
        self._give_up()
        self._dialogs.close()
        self.documents.close(state, faulty)
        self._tasks.close()

    def draw(self, state: ViewState | None) -> None:
        """Dialogs, and how far a picture is."""
        if answer := self._dialogs.draw(self._ui):
            self._answered(*answer)
        if state is not None and self._picture.draw(state, self._ui):
            self._cast(state)
        if self._progress is not None and progress(self._progress, self._ui):
            self._give_up()

    def _ask(self, name: str) -> Callable[[ViewState, str], None]:
        return lambda state, _: self._dialogs.ask(REQUESTS[name], state.document)

    def _answered(self, request: PathRequest, path: str) -> None:
        """A path that was asked for is there."""
        state = self._state
        if request.kind == "open":
            self.documents.open(path)
        elif request.kind == "resume":
            self.documents.resume(path, last=False)
        elif state is not None and request.kind in PALETTES:
            self._palette(request.kind, path, state)
        elif state is not None:
            write = {
                "export-scene": export_scene,
                "export-python": export_python,
                "save-session": save_session,
            }[request.kind]
            self._tasks.start(request.kind, lambda: write(state, path), writes=True)

    def _cast(self, state: ViewState) -> None:
        if self._progress is not None:
            self._notice.say("A picture is being cast already")
            return
        shot = self._picture.shot
        width, height = shot.size(state.size)
        under_way = self._progress = Progress(f"Casting {width} × {height}")
        self._tasks.start("picture", lambda: save_picture(state, shot, under_way))

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
        self._ui.commands = None if self._ui.commands else Search()

    def _rename(self, state: ViewState, _: str) -> None:
        if "Lights" not in state.interface.panels:
            self._notice.say("Lights are renamed in their list: open the Lights panel")
            return
        self._ui.lights.rename(state.interface.light, state.lights)

    def _say_error(self, message: str) -> None:
        self._notice.say(message)
        self._trace.note("error", message=message)
