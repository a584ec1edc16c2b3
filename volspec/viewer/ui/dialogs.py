"""Dialogs for a file's path: the system's, or our own."""

from __future__ import annotations

import os
import shutil
import sys
from dataclasses import replace
from functools import lru_cache
from pathlib import Path
from typing import Any

from imgui_bundle import imgui

from volspec.viewer.model.document import Document
from volspec.viewer.model.paths import Listing, PathRequest, list_paths
from volspec.viewer.ui.context import UiContext
from volspec.viewer.ui.widgets import wrap_text
from volspec.viewer.work.session import SUFFIX

_W = imgui.WindowFlags_
DIALOG_FLAGS = (
    _W.no_docking | _W.no_collapse | _W.no_saved_settings | _W.always_auto_resize | _W.no_move
)
_DIM = imgui.Col_.text_disabled
_INPUT = imgui.InputTextFlags_
# Rows of the list of files, and of the rest of its dialog.
_ROWS, _OTHER_ROWS = 9, 6
_BUTTON_WIDTH, _BUTTON_GAP = 84, 8


def begin_dialog(name: str, opens: bool, ui: UiContext, wide: float) -> bool:
    """Begin a dialog, if it is open or opens now; the picture is dimmed only a little."""
    if opens:
        imgui.open_popup(name)
    viewport = imgui.get_main_viewport()
    middle, room = viewport.get_work_center(), viewport.work_size
    width = min(ui.px(wide), room.x * 0.94)
    imgui.set_next_window_pos(middle, imgui.Cond_.always, (0.5, 0.5))
    imgui.set_next_window_size((width, 0))
    imgui.set_next_window_size_constraints((width, 0), (width, room.y * 0.98))
    imgui.push_style_color(imgui.Col_.modal_window_dim_bg, (0.0, 0.0, 0.0, 0.25))
    begun = bool(imgui.begin_popup_modal(name, True, DIALOG_FLAGS)[0])
    imgui.pop_style_color()
    return begun


def buttons_left(ui: UiContext) -> float:
    """Return the x that right-aligns `dialog_buttons` in the line."""
    right = imgui.get_cursor_pos_x() + imgui.get_content_region_avail().x
    return float(right - 2 * ui.px(_BUTTON_WIDTH) - ui.px(_BUTTON_GAP))


def dialog_buttons(label: str, name: str, ui: UiContext) -> tuple[bool, bool]:
    """Draw a button, recorded under a name, and Cancel; return whether each was pressed."""
    size = ui.px(_BUTTON_WIDTH), 0
    accepted = imgui.button(label, size)
    ui.note(name)
    imgui.same_line(0, ui.px(_BUTTON_GAP))
    return accepted, imgui.button("Cancel", size)


class PathDialog:
    """A field for a path, with the files of its folder below; Tab completes."""

    def __init__(self, request: PathRequest) -> None:
        self.request, self._text = request, request.start
        self._opens = self._focus = True
        self._replaces = ""  # the file that the next Enter replaces

    def draw(self, ui: UiContext) -> str | None:
        """Draw the dialog; return the path, empty if none was entered, None while it is open."""
        opens, self._opens = self._opens, False
        if not begin_dialog(f"{self.request.title}###path", opens, ui, 560):
            return ""
        path = self._body(self.request, ui)
        if path is None and imgui.is_key_pressed(imgui.Key.escape, False):
            path = ""
        if path is not None:
            imgui.close_current_popup()
        imgui.end_popup()
        return path

    def _body(self, request: PathRequest, ui: UiContext) -> str | None:
        now = int(imgui.get_time())
        found = _list_paths(self._text, request.suffixes, now)
        if self._focus:
            imgui.set_keyboard_focus_here()
            self._focus = False
        imgui.set_next_item_width(-1)
        hint = f"name{request.suffixes[0]}" if request.save else "scene.toml, volume.nrrd, …"
        flags = _INPUT.enter_returns_true | _INPUT.callback_completion

        def complete(data: Any) -> int:
            data.delete_chars(0, data.buf_text_len)
            data.insert_chars(0, found.common)
            return 0

        done, self._text = imgui.input_text_with_hint("##path", hint, self._text, flags, complete)
        ui.note("path")
        # To save a file, all files of the folder are listed.
        self._list(_list_paths(found.folder, request.suffixes, now) if request.save else found)
        path = request.complete(self._text)
        there = bool(path) and request.save and Path(path).is_file()
        sure = there and path == self._replaces
        if there:
            warning = f"{os.path.basename(path)} exists{'; Enter again replaces it' * sure}"
            wrap_text(warning, imgui.Col_.check_mark)
        left = buttons_left(ui)
        imgui.align_text_to_frame_padding()
        imgui.text_disabled("Tab completes")
        imgui.same_line(left)
        label = "Replace" if there else "Save" if request.save else "Open"
        accepted, cancelled = dialog_buttons(label, "path ok", ui)
        if cancelled:
            return ""
        if not (accepted or done):
            return None
        if there and not sure:
            self._replaces, self._focus = path, True
            return None
        return self._text.strip() or None

    def _list(self, found: Listing) -> None:
        line = imgui.get_text_line_height_with_spacing()
        others = _OTHER_ROWS * imgui.get_frame_height_with_spacing()
        room = imgui.get_main_viewport().work_size.y - others
        tall = max(min(line * _ROWS, room), 2 * line)
        if imgui.begin_child("files", (0, tall)):
            for row in found.rows:
                if imgui.selectable(row, False, imgui.SelectableFlags_.no_auto_close_popups)[0]:
                    self._text = found.folder + row
                    self._focus = True
            if not found.rows:
                imgui.text_disabled("No matching files")
        imgui.end_child()


@lru_cache(maxsize=8)
def _list_paths(text: str, suffixes: tuple[str, ...], _second: int) -> Listing:
    """List paths once a second, not once a frame."""
    return list_paths(text, suffixes)


_PROGRAMS = ("zenity", "kdialog", "matedialog", "qarma")
_FILES = (
    f".toml {SUFFIX} .nrrd .nhdr .mhd .mha .nii .nii.gz .vti .vtk .npy .tif .tiff .dcm .dicom .ima"
)
REQUESTS = {
    "open": PathRequest("open", "Open a scene or a volume", suffixes=tuple(_FILES.split())),
    "open-session": PathRequest("resume", "Open a session", suffixes=(SUFFIX,)),
    "export-scene": PathRequest("export-scene", "Export as scene", True, (".toml",)),
    "export-python": PathRequest("export-python", "Export as Python", True, (".py",)),
    "palette-load": PathRequest("palette-load", "Load a palette", suffixes=(".toml",)),
    "palette-save": PathRequest("palette-save", "Save the palette as", True, (".toml",)),
    "save-session": PathRequest("save-session", "Save the session", True, (SUFFIX, ".json")),
}


class FileDialogs:
    """The dialog for a path, the system's or our own."""

    def __init__(self) -> None:
        self._dialog: PathDialog | NativeDialog | None = None

    def ask(self, request: PathRequest, document: Document) -> None:
        """Open a dialog for a path; ignored while the system's dialog is open."""
        if not isinstance(self._dialog, NativeDialog):
            request = replace(request, start=initial_path(request, document))
            self._dialog = (NativeDialog if has_native_dialogs() else PathDialog)(request)

    def take(self) -> tuple[PathRequest, str] | None:
        """Return the system dialog's answer, once there is one."""
        dialog = self._dialog
        return self._answer(dialog.answer()) if isinstance(dialog, NativeDialog) else None

    def draw(self, ui: UiContext) -> tuple[PathRequest, str] | None:
        """Draw our own dialog, if it is open; return its answer, once there is one."""
        dialog = self._dialog
        return self._answer(dialog.draw(ui)) if isinstance(dialog, PathDialog) else None

    def _answer(self, path: str | None) -> tuple[PathRequest, str] | None:
        if path is None or self._dialog is None:
            return None
        request, self._dialog = self._dialog.request, None
        return (request, request.complete(path)) if path else None

    def close(self) -> None:
        """End the system's dialog, which would keep the program from ending."""
        if isinstance(self._dialog, NativeDialog):
            self._dialog.close()


def initial_path(request: PathRequest, document: Document) -> str:
    """Return a path in the open file's folder, or in the current one."""
    source = document.source
    path = Path("engine.toml" if source is None else source.partition("?")[0])
    if path.is_relative_to(Path.cwd()):
        path = path.relative_to(Path.cwd())
    if request.save:
        return os.fspath(path.with_name(f"{path.stem}-view{request.suffixes[0]}"))
    return "" if path.parent == Path() else f"{path.parent}/"


def has_native_dialogs() -> bool:
    """Return True if the system has dialogs for files."""
    if sys.platform in ("win32", "darwin"):
        return True
    return any(shutil.which(program) for program in _PROGRAMS)


class NativeDialog:
    """The system's dialog in a process of its own, which keeps the program from ending."""

    def __init__(self, request: PathRequest) -> None:
        from imgui_bundle import portable_file_dialogs as dialogs

        self.request = request
        start = os.path.abspath(os.path.expanduser(request.start or "."))
        patterns = " ".join(f"*{suffix}" for suffix in request.suffixes)
        filters = [request.title, patterns, "All files", "*"] if patterns else ["All files", "*"]
        make: Any = dialogs.save_file if request.save else dialogs.open_file
        self._dialog = make(request.title, start, filters)

    def answer(self) -> str | None:
        """Return the path; empty if none was chosen, None while the dialog is open."""
        if not self._dialog.ready(0):
            return None
        result = self._dialog.result()
        return str(result[0] if result else "") if isinstance(result, list) else str(result)

    def close(self) -> None:
        """End the dialog's process."""
        self._dialog.kill()
