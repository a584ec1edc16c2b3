"""What files actions ask for, in the system's dialog or in our own.

    action -> [asking] -> path -> chores

Neither keeps the window waiting.
"""

from __future__ import annotations

import os
import shutil
import sys
from dataclasses import replace
from pathlib import Path
from typing import Any

from volspec.viewer.model.document import Document
from volspec.viewer.model.paths import PathRequest
from volspec.viewer.ui.context import UiContext
from volspec.viewer.ui.panels.dialogs import PathDialog
from volspec.viewer.work.files.session import SUFFIX

_PROGRAMS = ("zenity", "kdialog", "matedialog", "qarma")
_FILES = (
    *(".toml", SUFFIX, ".nrrd", ".nhdr", ".mhd", ".mha", ".nii", ".nii.gz", ".vti", ".vtk"),
    *(".npy", ".tif", ".tiff", ".dcm", ".dicom", ".ima"),
)
REQUESTS = {
    "open": PathRequest("open", "Open a scene or a volume", suffixes=_FILES),
    "open-session": PathRequest("resume", "Open a session", suffixes=(SUFFIX,)),
    "export-scene": PathRequest("export-scene", "Export as scene", True, (".toml",)),
    "export-python": PathRequest("export-python", "Export as Python", True, (".py",)),
    "palette-load": PathRequest("palette-load", "Load a palette", suffixes=(".toml",)),
    "palette-save": PathRequest("palette-save", "Save the palette as", True, (".toml",)),
    "save-session": PathRequest("save-session", "Save the session", True, (SUFFIX, ".json")),
}


class Asking:
    """One path at a time."""

    def __init__(self) -> None:
        self._own = PathDialog()
        self._native: NativeDialog | None = None

    def ask(self, request: PathRequest, document: Document) -> None:
        """Ask for a path; nothing where another is being asked for in the system's dialog."""
        asked = replace(request, start=proposed(request, document))
        if self._native is None and native():
            self._native = NativeDialog(asked)
        elif self._native is None:
            self._own.ask(asked)

    def take(self) -> tuple[PathRequest, str] | None:
        """What the system's dialog has answered by now."""
        if self._native is None or (path := self._native.answer()) is None:
            return None
        request, self._native = self._native.request, None
        return (request, request.named(path)) if path else None

    def close(self) -> None:
        """End the system's dialog, for which the program would wait."""
        if self._native is not None:
            self._native.close()

    def draw(self, ui: UiContext) -> tuple[PathRequest, str] | None:
        """Draw our own, where it is open; what it has answered."""
        request = self._own.request
        path = self._own.draw(ui)
        return (request, path) if request is not None and path else None


def proposed(request: PathRequest, document: Document) -> str:
    """Where a dialog begins: in the open file's folder, or where the program runs."""
    source = document.source
    path = Path("engine.toml" if source is None else source.partition("?")[0])
    if path.is_relative_to(Path.cwd()):
        path = path.relative_to(Path.cwd())
    if request.save:
        return os.fspath(path.with_name(f"{path.stem}-view{request.suffixes[0]}"))
    return "" if path.parent == Path() else f"{path.parent}/"


def native() -> bool:
    """Whether the system has dialogs for files."""
    if sys.platform in ("win32", "darwin"):
        return True
    return any(shutil.which(program) for program in _PROGRAMS)


class NativeDialog:
    """The system's own dialog, in a process of its own; `answer` is asked for, not waited for.

    A program that ends while it is open waits for it, unless it is closed.

    Parameters
    ----------
    request : PathRequest
    """

    def __init__(self, request: PathRequest) -> None:
        from imgui_bundle import portable_file_dialogs as dialogs

        self.request = request
        start = os.path.abspath(os.path.expanduser(request.start or "."))
        patterns = " ".join(f"*{suffix}" for suffix in request.suffixes)
        filters = [request.title, patterns, "All files", "*"] if patterns else ["All files", "*"]
        self._dialog: Any
        if request.save:
            self._dialog = dialogs.save_file(request.title, start, filters)
        else:
            self._dialog = dialogs.open_file(request.title, start, filters)

    def answer(self) -> str | None:
        """The path; empty where none was chosen, None while the dialog is open."""
        if not self._dialog.ready(0):
            return None
        result = self._dialog.result()
        return str(result[0] if result else "") if isinstance(result, list) else str(result)

    def close(self) -> None:
        """End it."""
        self._dialog.kill()
