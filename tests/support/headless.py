"""The viewer as it is, without a display: its loop, panels, threads and GL, in this process.

In place of the window are a headless context, and inputs that a test gives.
"""

import time
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any, Self

import moderngl
import numpy as np
import pytest
from imgui_bundle import imgui, implot
from numpy.typing import NDArray

from tests.support.patience import wait_until
from volspec._gpu.opengl import headless_context
from volspec.viewer.app import App, ViewerOptions
from volspec.viewer.model.history import History
from volspec.viewer.model.state import ViewState
from volspec.viewer.ui import widgets
from volspec.viewer.ui.inputs import Input
from volspec.viewer.ui.window import Window
from volspec.viewer.work.background import Tasks
from volspec.viewer.work.notify import Trace, collect_warnings
from volspec.viewer.work.precompile import ProgramBuilder

Size = tuple[int, int]


class _Context(moderngl.Context):  # type: ignore[misc]
    """A context that stays current, as a window's does."""

    def __exit__(self, *error: Any) -> None:
        super().__exit__(*error)
        self.__enter__()


class _NoWindow:
    """Substitute for a `volspec.viewer.ui.window.Window`."""

    note, error = "", ""
    scale = pixel_ratio = 1.0
    usable, closing = True, False

    def __init__(self, size: Size) -> None:
        self.context: Any = headless_context()
        self.context.__class__ = _Context
        self.size, self.inputs = size, list[Input]()
        imgui.create_context()
        implot.create_context()
        io = imgui.get_io()
        io.set_ini_filename("")
        io.config_flags |= imgui.ConfigFlags_.docking_enable
        io.backend_flags |= imgui.BackendFlags_.renderer_has_textures
        io.delta_time = 1 / 60
        widgets.load_font(imgui)
        widgets.set_sizes(imgui, implot)
        widgets.set_scale(imgui, implot, 1.0, 1.0)

    def wait(self, seconds: float) -> list[Input]:
        """Return the inputs given since the last call."""
        time.sleep(min(seconds, 0.002))
        self.context.__enter__()  # another one may have been made on this thread
        inputs, self.inputs = self.inputs, []
        return inputs

    def begin(self) -> None:
        """Start a frame."""
        imgui.get_io().display_size = imgui.ImVec2(*self.size)
        imgui.new_frame()

    @property
    def lags(self) -> bool:
        """True while imgui has inputs that it leaves to further frames."""
        return len(imgui.get_current_context().input_events_queue) > 0

    def end(self, *_: Any) -> None:
        """End a frame; what a window would show is what `HeadlessViewer.pixels` returns."""
        imgui.render()
        for texture in imgui.get_platform_io().textures:
            texture.set_status(imgui.ImTextureStatus.ok)

    def name(self, title: str) -> None:
        """Take a title."""

    def close(self) -> None:
        """Release everything."""
        implot.destroy_context()
        imgui.destroy_context()
        self.context.release()


class HeadlessViewer:
    """The viewer with a document, at rest; a context manager.

    Its sessions and recent files are in ``folder``.
    """

    def __init__(self, path: Path, folder: Path, size: Size = (400, 300)) -> None:
        self._patched = pytest.MonkeyPatch()
        self._patched.setenv("XDG_STATE_HOME", str(folder))
        self._patched.setattr(Window, "wake", lambda: None)
        self._patched.setattr(ProgramBuilder, "request", lambda *_: None)
        self.window, self._edits = _NoWindow(size), list[Callable[[ViewState], ViewState]]()
        self._warnings = collect_warnings()
        options, trace = ViewerOptions(str(path), size=size), Trace(None)
        window: Any = self.window
        self.app = App(options, trace, Tasks(Window.wake), window, self._warnings.__enter__())
        self._patched.setattr(self.app, "_next", partial(self._next, self.app._next))
        self.open(path)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.app.close(faulty=False)
        self._warnings.__exit__(None, None, None)
        self.window.close()
        self._patched.undo()

    @property
    def history(self) -> History:
        """The states; to be compared at rest."""
        assert self.app._history is not None
        return self.app._history

    @property
    def state(self) -> ViewState:
        """The present state."""
        return self.history.present

    @property
    def message(self) -> str:
        """The last message of the window."""
        messages = self.app._notice.messages
        return messages[-1].text if messages else ""

    def open(self, path: Path) -> None:
        """Open a document, and wait for its picture."""
        before = self.app._history
        self.app._file_commands.documents.open(str(path))
        wait_until(lambda: self.cycle() is not None and self.app._history is not before, path)
        self.rest()

    def cycle(self) -> bool:
        """Let the viewer's loop run once; return True if it rests."""
        try:
            self.app.cycle()
        except BaseException:
            imgui.end_frame()
            raise
        return self.app._rested

    def _next(self, own: Callable[..., ViewState], state: ViewState, *rest: Any) -> ViewState:
        """Edit the state where the panels do."""
        state, edits = own(state, *rest), self._edits
        self._edits = []
        for change in edits:
            state = change(state)
        return state

    def edit(self, change: Callable[[ViewState], ViewState]) -> None:
        """Change the state as a panel does, in the next cycle: a step of undo."""
        self._edits.append(change)
        self.app._mouse.gestures.number += 1
        self.app._settle = max(self.app._settle, 3)

    def run(self, command: str) -> None:
        """Run a command by its name, as a menu does."""
        self.edit(lambda state: self.app._ui.run(state, command))

    def request(self, name: str) -> None:
        """Ask the viewer for what is no command, as a bar of its own does."""

        def ask(state: ViewState) -> ViewState:
            self.app._ui.request(name)
            return state

        self.edit(ask)

    def step(self, back: bool) -> None:
        """Undo or redo a step."""
        self.run("undo" if back else "redo")

    def give(self, *inputs: Input) -> None:
        """Give the viewer inputs, which it takes in its next cycle."""
        self.window.inputs += inputs

    def resize(self, size: Size) -> None:
        """Give the window another size."""
        self.window.size = size
        self.give(Input("resize"))

    def rest(self) -> None:
        """Wait until everything is done and drawn, and nothing moves."""
        self.cycle()
        self.app._rested = False
        wait_until(self.cycle, "the viewer rests", lambda: None)

    def pixels(self) -> NDArray[np.int_] | None:
        """Return the codes of the picture in the window; None if a message is in its place."""
        self.window.context.__enter__()
        pictures = self.app._screen.pictures
        return pictures.pixels().astype(int) if pictures.framebuffer else None
