"""Commands that go beyond the state: files, pictures, dialogs, the clipboard.

command -> [file_commands] -> documents | tasks -> scene, script, session, PNG
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

from volspec.errors import VolspecError
from volspec.viewer.model import meshes
from volspec.viewer.model.film import AS_SHOWN
from volspec.viewer.model.history import History
from volspec.viewer.model.paths import PathRequest
from volspec.viewer.model.scene_file import (
    compared_lights,
    export_python,
    export_scene,
    left_out,
    script_lacks,
)
from volspec.viewer.model.state import ViewState
from volspec.viewer.ui.choice_dialog import ChoiceDialog, DropDialog
from volspec.viewer.ui.context import Request, Search, UiContext
from volspec.viewer.ui.dialogs import REQUESTS, FileDialogs
from volspec.viewer.ui.output_dialogs import (
    FilmDialog,
    PageDialog,
    PictureDialog,
    draw_progress,
)
from volspec.viewer.work.background import Tasks
from volspec.viewer.work.designs import PALETTES
from volspec.viewer.work.documents import DocumentService, OpenResult, ReadMeshes, read_meshes
from volspec.viewer.work.films import save_film, save_page
from volspec.viewer.work.notify import SHORT_SECONDS, Notice
from volspec.viewer.work.outputs import CUSTOM, PictureSize, Progress
from volspec.viewer.work.pictures import Pictures
from volspec.viewer.work.screenshot import Still, copy_shown, copy_values, save_picture
from volspec.viewer.work.session import save_session
from volspec.viewer.work.time_steps import TimeSteps


class FileCommands:
    """Runs commands that take time or use files.

    The ``size`` of saved pictures is (width, height), or None for the window's; ``palette`` reads
    or writes a palette's file, given the request's kind, the path and the state.
    """

    def __init__(
        self,
        tasks: Tasks,
        pictures: Pictures,
        ui: UiContext,
        notice: Notice,
        device: str | None,
        size: tuple[int, int] | None,
        palette: Callable[[str, str, ViewState], None],
        steps: TimeSteps,
    ) -> None:
        self._tasks, self._ui, self._palette = tasks, ui, palette
        self._notice, self._steps = notice, steps
        self.documents = DocumentService(tasks, notice, device)
        sides = PictureSize() if size is None else PictureSize(CUSTOM, size)
        self._dialogs, self._picture = FileDialogs(), PictureDialog(Still(sides))
        self._film, self._page = FilmDialog(replace(sides, even=True)), PageDialog(sides)
        self._progress: Progress | None = None
        self._state: ViewState | None = None
        self._left_out: dict[str, str] = {}  # of files that are being written, by kind, in words
        self._choice: ChoiceDialog | None = None
        self._drop: DropDialog | None = None
        self._meshes: list[ReadMeshes] = []  # to be added
        self._commands: dict[str, Callable[[ViewState], None]] = {
            "reload": self.documents.reload,
            "restore": self.documents.restore,
            "screenshot": self._save_picture,
            "picture": lambda _: self._picture.ask(),
            "film": lambda _: self._film.ask(),
            "page": lambda _: self._page.ask(),
            "next-step": lambda state: steps.go(state, 1),
            "previous-step": lambda state: steps.go(state, -1),
            "play": steps.toggle,
            "loop": lambda _: steps.toggle_loop(),
            "cancel": lambda _: self._cancel(),
            "clear-messages": lambda _: notice.clear(),
            "clear-recent": lambda _: self.documents.clear_recent(),
            "copy-picture": lambda state: self._copy(lambda: copy_shown(pictures, state)),
            "copy-values": lambda _: self._copy(lambda: copy_values(ui.results.under_mouse)),
            "commands": lambda _: self._toggle_palette(),
            "rename-light": self._rename_light,
            "demonstrations": lambda _: self._toggle_start(),
        }

    @property
    def busy(self) -> bool:
        """True while files or pictures are read, cast or written."""
        return self._tasks.busy

    def run(self, request: Request, state: ViewState | None) -> None:
        """Run a command, open a file, or show a message; commands need a state."""
        name, argument = request
        self._state = state
        if name == "message":
            self._notice.show(argument)
        elif name == "warning":
            self._notice.show_warning(argument)
        elif name == "open" and argument:
            self.documents.open(argument)
        elif name in REQUESTS:
            document = None if state is None else state.document
            self._dialogs.ask(REQUESTS[name], document, self.documents.recent)
        elif state is None:
            return
        elif name == "choose":
            self.documents.choose(state, *argument.split("=", 1))
        elif name == "step":
            self._steps.show(state, int(argument))
        else:
            self._commands[name](state)

    def drop(self, paths: tuple[str, ...], state: ViewState | None) -> None:
        """Add the meshes, or open the scenes or volumes, that were dropped."""
        if meshes := self.documents.drop(paths):
            self._read_meshes(meshes, state)

    def _read_meshes(self, paths: tuple[str, ...], state: ViewState | None) -> None:
        names = ", ".join(Path(path).name for path in paths)
        if state is None or state.document.image is not None:
            self._notice.show_error(
                f"{names}: a mesh is added to a scene or volume; open one first"
            )
            return
        self._notice.show(f"Reading {names} …")
        # A kind of their own, as those that were dropped before count, too.
        self._tasks.start(f"add-mesh {paths}", lambda: read_meshes(state, paths))

    def add_meshes(self, history: History) -> History:
        """Add the meshes that were read since the last call, as a step."""
        read, self._meshes = self._meshes, []
        for file in read:
            for error in file.errors:
                self._notice.show_error(error)
            if not file.rows or not file.document.is_of(history.present.document):
                continue
            history = history.step(meshes.add(history.present, file.rows))
            self._ui.front = meshes.PANEL
            if not file.errors:
                names = ", ".join(row.name for row in file.rows)
                self._notice.show(f"Added {names}", SHORT_SECONDS)
        return history

    def take(self, first: bool) -> tuple[bool, OpenResult | None]:
        """Take the threads' results; return True if there are any, and the opened document.

        ``first`` is True if nothing is open yet; see `DocumentService.finish_open`.
        """
        if answer := self._dialogs.take():
            self._use_path(*answer)
        outcomes = self._tasks.take()
        opened = None
        for outcome in outcomes:
            progress = self._progress
            if progress is not None and progress.kind != outcome.kind:
                progress = None
            if progress is not None:
                self._progress = None
            # A file that was cancelled too late is still written.
            if progress is not None and progress.ended and outcome.error:
                self._notice.show(f"The {progress.kind} was cancelled")
            elif outcome.kind == "open":
                opened = self.documents.finish_open(outcome, first)
                if opened is not None and (meshes := self.documents.take_meshes()):
                    self._read_meshes(meshes, opened.state)
            elif outcome.error:
                self._notice.show_error(outcome.error)
            elif isinstance(outcome.result, ReadMeshes):
                self._meshes.append(outcome.result)
            elif outcome.kind != "session":
                event = "screenshot" if outcome.kind == "picture" else outcome.kind
                self._notice.trace.note(event, path=str(outcome.result))
                omits = self._left_out.get(outcome.kind)
                self._notice.show(f"Saved {outcome.result}{f', without {omits}' if omits else ''}")
        return bool(outcomes), opened

    def close(self, state: ViewState | None, faulty: bool) -> None:
        """End casts and dialogs, save the session, and wait for files that are being written."""
        self._cancel()
        self._dialogs.close()
        self.documents.close(state, faulty)
        self._tasks.close()

    def draw(self, state: ViewState | None) -> None:
        """Draw the dialogs and the progress of a file."""
        if answer := self._dialogs.draw(self._ui):
            self._use_path(*answer)
        if (undecided := self.documents.undecided) is not None:
            self.documents.undecided = None
            self._choice = ChoiceDialog(undecided)
        if self._choice is not None and (address := self._choice.draw(self._ui)) is not None:
            self._choice = None
            self.documents.decide(address)
            if state is None and not address:
                self.documents.problem = "Nothing was chosen to open"
        if (dropped := self.documents.dropped) is not None:
            self.documents.dropped = None
            self._drop = DropDialog(dropped)
        if self._drop is not None and (use := self._drop.draw(self._ui)) is not None:
            if use:
                self.documents.use(self._drop.dropped, use)
            self._drop = None
        if state is not None:
            if self._picture.draw(state, self._ui):
                self._save_picture(state)
            if self._film.draw(state, self._ui):
                self._save_film(state)
            if self._page.draw(state, self._ui):
                self._save_page(state)
        if self._progress is not None and draw_progress(self._progress, self._ui):
            self._cancel()

    def _use_path(self, request: PathRequest, path: str) -> None:
        """Use the path that a dialog returned."""
        state = self._state
        if request.kind == "open":
            self.documents.open(path)
        elif request.kind == "resume":
            self.documents.resume(Path(path))
        elif request.kind == "add-mesh":
            self._read_meshes((path,), state)
        elif state is not None and request.kind in PALETTES:
            self._palette(request.kind, path, state)
        elif state is not None:
            write = {
                "export-scene": export_scene,
                "export-python": export_python,
                "save-session": save_session,
            }[request.kind]
            if request.kind != "save-session":
                lacks = script_lacks if request.kind == "export-python" else left_out
                self._left_out[request.kind] = lacks(state)
            self._tasks.start(request.kind, lambda: write(state, path), writes=True)

    def _save_picture(self, state: ViewState) -> None:
        shot = self._picture.shot
        width, height = shot.size.pixels(state.size)
        job = f"Casting {width} × {height}"
        self._make("picture", job, lambda progress: save_picture(state, shot, progress))

    def _save_film(self, state: ViewState) -> None:
        file = self._film.file
        job = f"Film of {file.film.frames} frames"
        omits = compared_lights(state) if file.film.lights == AS_SHOWN else ""
        self._make("film", job, lambda progress: save_film(state, file, progress), omits)

    def _save_page(self, state: ViewState) -> None:
        file = self._page.file
        job = f"Page of {file.views} views" if file.views > 1 else "Web page"
        omits = left_out(state)
        self._make("page", job, lambda progress: save_page(state, file, progress), omits)

    def _make(self, kind: str, job: str, make: Callable[[Progress], Path], omits: str = "") -> None:
        """Start making a file in the background, unless another one is being made."""
        if self._progress is not None:
            self._notice.show_warning(f"A {self._progress.kind} is being made; wait or cancel it")
            return
        progress = self._progress = Progress(job, kind)
        self._left_out[kind] = omits
        # `close` waits for it, too: a thread in native code must not outlive the interpreter.
        self._tasks.start(kind, lambda: make(progress), writes=True)

    def _cancel(self) -> None:
        if self._progress is not None:
            self._progress.ended = True

    def _copy(self, copy: Callable[[], str]) -> None:
        try:
            done = copy()
        except VolspecError as error:
            self._notice.show_error(str(error))
        else:
            self._notice.trace.note("copied", what=done)
            self._notice.show(done)

    def _toggle_palette(self) -> None:
        self._ui.commands = None if self._ui.commands else Search()

    def _toggle_start(self) -> None:
        self._ui.start = not self._ui.start

    def _rename_light(self, state: ViewState) -> None:
        if "Lights" in state.interface.panels:
            self._ui.lights.rename(state.interface.light, state.lights)
        else:
            self._notice.show_warning("Lights are renamed in the Lights panel; open it")
