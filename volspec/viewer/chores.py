"""What actions ask of the app beyond the state: files opened and written, beside the window.

    action -> [chores] -> threads -> document, PNG

Names are those of `volspec.viewer.actions`.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from volspec.errors import InputError, VolspecError
from volspec.raycast import CoefficientImage
from volspec.viewer.document import Document, opened
from volspec.viewer.notice import Notice
from volspec.viewer.opening import Outcome, Tasks
from volspec.viewer.panels import overlay
from volspec.viewer.panels.desk import Desk
from volspec.viewer.pictures import Pictures
from volspec.viewer.screenshot import cast_for_file, save
from volspec.viewer.state import ViewState
from volspec.viewer.trace import Trace


class Chores:
    """Does what takes time, and what touches files.

    Parameters
    ----------
    tasks : Tasks
    pictures : Pictures
        Relights what is written.
    notice, trace
        What came of it is told to them.
    device : str, optional
        For casts.
    screenshot : (width, height), optional
        Of pictures; None is as shown.
    """

    def __init__(
        self,
        tasks: Tasks,
        pictures: Pictures,
        notice: Notice,
        trace: Trace,
        device: str | None,
        screenshot: tuple[int, int] | None,
    ) -> None:
        self._tasks, self._pictures, self._notice, self._trace = tasks, pictures, notice, trace
        self._device, self._size = device, screenshot
        self._asking = False
        self._done: dict[str, Callable[[ViewState], None]] = {
            "open": self._ask,
            "screenshot": self._screenshot,
        }

    def do(self, name: str, state: ViewState) -> None:
        """Begin what an action asks for."""
        self._done[name](state)

    def open(self, path: str) -> None:
        """Read a scene or a volume; `take` gives it when it is there."""
        self._notice.say(f"Opening {path} …")
        self._tasks.start("open", lambda: opened(path, self._device))

    def take(self, first: bool) -> tuple[bool, Document | None]:
        """What threads have brought: whether anything, and a document that was opened.

        Parameters
        ----------
        first : bool
            Whether nothing is open yet.

        Raises
        ------
        InputError
            If then nothing can be.
        """
        outcomes = self._tasks.take()
        document = None
        for outcome in outcomes:
            if outcome.error and outcome.kind == "open" and first:
                raise InputError(outcome.error)
            if outcome.error:
                self._notice.say(outcome.error)
                self._trace.note("error", message=outcome.error)
            elif outcome.kind == "open":
                document = outcome.result
            else:
                self._finish(outcome)
        return bool(outcomes), document

    def draw(self, desk: Desk) -> None:
        """Fields that ask for something."""
        path = overlay.ask_path(desk, self._asking)
        self._asking = False
        if path:
            self.open(path)

    def _ask(self, _: ViewState) -> None:
        self._asking = True

    def _screenshot(self, state: ViewState) -> None:
        size = self._size or state.size
        self._notice.say(f"Casting {size[0]} × {size[1]} …")
        self._tasks.start("screenshot", lambda: (cast_for_file(state, size), state))

    def _finish(self, outcome: Outcome) -> None:
        image, state = outcome.result
        path = self._saved(image, state)
        if path is not None:
            self._trace.note("screenshot", path=str(path))
            self._notice.say(f"Saved {path}")

    def _saved(self, image: CoefficientImage, state: ViewState) -> Path | None:
        try:
            return save(self._pictures, image, state)
        except (VolspecError, OSError) as error:
            self._notice.say(str(error))
            return None
