"""Dialogs for a file's path: the system's, or our own."""

from __future__ import annotations

import os
import shutil
import sys
import time
from collections.abc import Sequence
from dataclasses import replace
from functools import lru_cache
from pathlib import Path
from typing import Any

import psutil
from imgui_bundle import imgui

from volspec._files import plain_stem, require_writable
from volspec._gpu import asset
from volspec._triangles import MESHES
from volspec.errors import InputError, one_line
from volspec.viewer.model.document import Document
from volspec.viewer.model.paths import (
    FolderPlace,
    Listing,
    PathRequest,
    folder_places,
    list_paths,
    size_text,
)
from volspec.viewer.ui.context import UiContext
from volspec.viewer.ui.widgets import as_one_line, shown_rows, text_width, wrap_text
from volspec.viewer.work.session import SUFFIX
from volspec.viewer.work.session_store import RecentFile
from volspec.volume import JOINER, PATTERN, VOLUME_SUFFIXES

_W = imgui.WindowFlags_
DIALOG_FLAGS = (
    _W.no_docking | _W.no_collapse | _W.no_saved_settings | _W.always_auto_resize | _W.no_move
)
_DIM = imgui.Col_.text_disabled
_INPUT = imgui.InputTextFlags_
# Rows of the list of files, and of the rest of its dialog.
_ROWS, _OTHER_ROWS = 13, 9
_SELECT = imgui.SelectableFlags_
_STAYS = _SELECT.no_auto_close_popups
_BUTTON_WIDTH, _BUTTON_GAP = 84, 8


def begin_dialog(name: str, opens: bool, ui: UiContext, size: float, aside: bool = False) -> bool:
    """Begin a dialog, if it is open or opens now; the picture is dimmed only a little.

    A dialog ``aside`` is at the window's right, and the picture is not dimmed.
    """
    if opens:
        imgui.open_popup(name)
    viewport = imgui.get_main_viewport()
    middle, room = viewport.get_work_center(), viewport.work_size
    width = min(ui.px(size), room.x * 0.94)
    place, pivot = (middle.x, middle.y), (0.5, 0.5)
    if aside:
        place, pivot = (viewport.work_pos.x + room.x - ui.px(6), middle.y), (1.0, 0.5)
    imgui.set_next_window_pos(place, imgui.Cond_.always, pivot)
    imgui.set_next_window_size((width, 0))
    imgui.set_next_window_size_constraints((width, 0), (width, room.y * 0.98))
    imgui.push_style_color(imgui.Col_.modal_window_dim_bg, (0.0, 0.0, 0.0, 0.0 if aside else 0.25))
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
    """A list of a folder's files, and a field for a name or a path, which Tab completes.

    Arrows, or a click, choose a row of the list; a double click opens it.
    """

    def __init__(self, request: PathRequest, places: tuple[FolderPlace, ...] = ()) -> None:
        self.request, self._places = request, places
        start = Path(os.path.abspath(os.path.expanduser(request.start)))
        inside = start if request.start.endswith("/") or not request.start else start.parent
        self._folder = str(inside)
        self._text = "" if inside == start else start.name
        self._typed = ""  # the text that the list completes
        self._row = -1  # the chosen row
        self._opens = self._focus = True
        self._follow = False  # scroll to the chosen row
        self._all = False  # list files with any ending
        self._replaces = ""  # the file that the next Enter replaces
        self._problem = "", ""  # a path, and why it cannot be written

    def draw(self, ui: UiContext) -> str | None:
        """Draw the dialog; return the path, empty if none was entered, None while it is open."""
        opens, self._opens = self._opens, False
        if not begin_dialog(f"{self.request.title}###path", opens, ui, 760):
            return ""
        path = self._body(ui)
        if path is None and imgui.is_key_pressed(imgui.Key.escape, False):
            path = ""
        if path is not None:
            imgui.close_current_popup()
        imgui.end_popup()
        return path

    def _body(self, ui: UiContext) -> str | None:
        request = self.request
        slices = request.folders and not self._all
        second = int(imgui.get_time())
        listing = _list_paths(self._typed, self._suffixes, self._folder, slices, second)
        self._bar(ui)
        height = self._list_height()
        if self._places:
            self._list_places(height, ui)
            imgui.same_line()
        picked, folder_picked = self._list(listing, height, ui)
        if folder_picked:
            return self._folder
        done = self._field(listing, ui)
        path = self._path()
        replaced = request.replaced(path)
        sure = path == self._replaces
        if self._problem[1] and self._problem[0] == path:
            wrap_text(self._problem[1], imgui.Col_.check_mark)
            ui.note("path problem")
        if replaced:
            names, one = " and ".join(map(os.path.basename, replaced)), len(replaced) == 1
            again = f"; Enter again replaces {'it' if one else 'them'}" if sure else ""
            wrap_text(f"{names} exist{'s' * one}{again}", imgui.Col_.check_mark)
        if request.suffixes:
            self._filter(listing, ui)
        left = buttons_left(ui)
        imgui.align_text_to_frame_padding()
        imgui.text_disabled("Tab completes")
        imgui.same_line(left)
        label = "Replace" if replaced else "Save" if request.save else "Open"
        accepted, cancelled = dialog_buttons(label, "path ok", ui)
        if cancelled:
            return ""
        if not (accepted or done or picked) or not self._text.strip():
            return None
        if os.path.isdir(path) and not (request.folders and path.rstrip("/").endswith(".zarr")):
            self._enter(path)
            return None
        if replaced and not sure:
            self._replaces, self._focus = path, True
            return None
        if request.save:
            try:
                require_writable(path)
            except InputError as error:
                self._problem, self._focus = (path, one_line(error)), True
                return None
        return path

    @property
    def _suffixes(self) -> tuple[str, ...]:
        """Endings of the files to list; none for all files."""
        return () if self._all else self.request.suffixes

    def _path(self) -> str:
        """Return the whole path of the text."""
        name = self.request.complete(self._text)
        return os.path.join(self._folder, name) if name else ""

    def _enter(self, folder: str) -> None:
        """Show another folder; a file name that is to be saved stays."""
        self._folder = os.path.normpath(folder)
        if not self.request.save or os.path.isdir(self._path()):
            self._text = ""
        self._typed, self._row, self._focus = "", -1, True

    def _bar(self, ui: UiContext) -> None:
        """Draw the folders that lead to this one, as buttons."""
        if imgui.arrow_button("##up", imgui.Dir.up):
            self._enter(os.path.dirname(self._folder))
        ui.note("path up", "The folder above")
        imgui.same_line()
        home, parent = os.path.expanduser("~"), self._folder
        steps: list[tuple[str, str]] = []
        while True:
            above = os.path.dirname(parent)
            if parent == home or above == parent:
                steps.append(("Home" if parent == home else parent, parent))
                break
            steps.append((os.path.basename(parent), parent))
            parent = above
        room, gap = imgui.get_content_region_avail().x, ui.px(2)
        pads = 2 * imgui.get_style().frame_padding.x
        width = 0.0
        for count, (name, _) in enumerate(steps):
            width += text_width(name) + pads + gap
            if width > room and count:
                steps = steps[:count]
                break
        for number, (name, folder) in enumerate(reversed(steps)):
            if number:
                imgui.same_line(0, gap)
            if imgui.button(f"{as_one_line(name)}##step{number}"):
                self._enter(folder)
        ui.note("path folder name")

    @staticmethod
    def _list_height() -> float:
        line = imgui.get_text_line_height_with_spacing()
        other_rows = _OTHER_ROWS * imgui.get_frame_height_with_spacing()
        room = imgui.get_main_viewport().work_size.y - other_rows
        return float(max(min(line * _ROWS, room), 3 * line))

    def _list_places(self, height: float, ui: UiContext) -> None:
        if imgui.begin_child("places", (ui.px(130), height)):
            for number, place in enumerate(self._places):
                here = place.folder == self._folder
                if imgui.selectable(f"{as_one_line(place.name)}##{number}", here, _STAYS)[0]:
                    self._enter(place.folder)
                ui.note(f"place {place.name}", place.folder)
        imgui.end_child()

    def _list(self, listing: Listing, height: float, ui: UiContext) -> tuple[bool, bool]:
        """Draw the table; return if a file was double-clicked, and if the folder was clicked."""
        T = imgui.TableFlags_
        flags = T.scroll_y | T.row_bg | T.sizing_fixed_fit | T.pad_outer_x
        if not imgui.begin_table("files", 3, flags, (0, height)):
            return False, False
        imgui.table_setup_scroll_freeze(0, 1)
        for name, column_flags in (
            ("Name", imgui.TableColumnFlags_.width_stretch),
            ("Size", 0),
            ("Changed", 0),
        ):
            imgui.table_setup_column(name, column_flags)
        imgui.table_headers_row()
        folder_picked = self.request.folders and self._folder_row(listing.dicom, ui)
        opened = False
        for number in shown_rows(len(listing.rows), always=self._row if self._row >= 0 else None):
            opened |= self._draw_row(number, listing, ui)
        if not listing.rows:
            imgui.table_next_row()
            imgui.table_next_column()
            files = (self.request.files or "files").lower()
            imgui.text_disabled(f"No {files} in this folder")
        imgui.end_table()
        return opened, folder_picked

    def _folder_row(self, dicom: int, ui: UiContext) -> bool:
        """Draw the row that opens the folder itself; return True if it was clicked."""
        imgui.table_next_row()
        imgui.table_next_column()
        contents = f"{dicom} DICOM file{'s' * (dicom > 1)}" if dicom else "slices or OME-Zarr"
        colour = imgui.Col_.check_mark if dicom else imgui.Col_.text
        imgui.push_style_color(imgui.Col_.text, imgui.get_style_color_vec4(colour))
        flags = _STAYS | _SELECT.span_all_columns
        pressed = bool(imgui.selectable(f"Open this folder ({contents})###folder", False, flags)[0])
        imgui.pop_style_color()
        ui.note("path folder", "As slices of DICOM, TIFF, PNG, BMP or JPEG, or an OME-Zarr")
        return pressed

    def _draw_row(self, number: int, listing: Listing, ui: UiContext) -> bool:
        row = listing.rows[number]
        imgui.table_next_row()
        imgui.table_next_column()
        label = f"{as_one_line(row.name)}##{number}"
        flags = _STAYS | _SELECT.span_all_columns | _SELECT.allow_double_click
        pressed = imgui.selectable(label, number == self._row, flags)[0]
        ui.note(f"file {row.name}")
        if number == self._row and self._follow:
            imgui.set_scroll_here_y(0.5)
            self._follow = False
        imgui.table_next_column()
        if not row.name.endswith("/"):
            right = imgui.get_cursor_pos_x() + imgui.get_content_region_avail().x
            text = size_text(row.size)
            imgui.set_cursor_pos_x(max(right - text_width(text), imgui.get_cursor_pos_x()))
            imgui.text_disabled(text)
        imgui.table_next_column()
        if row.changed_s:
            when = time.strftime("%Y-%m-%d %H:%M", time.localtime(row.changed_s))
            imgui.text_disabled(when)
        if not pressed:
            return False
        double = imgui.is_mouse_double_clicked(0)
        if double and row.name.endswith("/"):
            self._enter(os.path.join(self._folder, listing.folder, row.name))
            return False
        self._text, self._row = listing.folder + row.name, number
        self._focus = not double
        return double

    def _field(self, listing: Listing, ui: UiContext) -> bool:
        """Draw the field for the name; return True on Enter."""
        request = self.request
        if self._focus:
            imgui.set_keyboard_focus_here()
            self._focus = False
        imgui.set_next_item_width(-1)
        hint = f"name{request.suffixes[0]}" if request.save else "Name or path; Tab completes"
        flags = _INPUT.enter_returns_true | _INPUT.callback_completion | _INPUT.callback_history

        def change(data: Any) -> int:
            # Of the whole text: the list may hold other names, too.
            slices = request.folders and not self._all
            text = list_paths(self._text, self._suffixes, self._folder, slices).common
            if data.event_flag == _INPUT.callback_history:
                if not listing.rows:
                    return 0
                step = 1 if data.event_key == imgui.Key.down_arrow else -1
                self._row = min(max(self._row + step, 0), len(listing.rows) - 1)
                self._follow = True
                text = listing.folder + listing.rows[self._row].name
            data.delete_chars(0, data.buf_text_len)
            data.insert_chars(0, text)
            return 0

        before = self._text
        done, self._text = imgui.input_text_with_hint("##path", hint, before, flags, change)
        ui.note("path")
        rows = listing.rows
        listed = listing.folder + rows[self._row].name if 0 <= self._row < len(rows) else None
        if self._text not in (before, listed):
            # To save a file, all files of the folder are listed.
            self._typed = self._text[: self._text.rfind("/") + 1] if request.save else self._text
            self._row = -1
        return bool(done)

    def _filter(self, listing: Listing, ui: UiContext) -> None:
        """Draw the choice between the request's endings and all files."""
        imgui.set_next_item_width(ui.px(260))
        names = self.request.files or "Matching files", "All files"
        if imgui.begin_combo("##filter", names[self._all]):
            for number, name in enumerate(names):
                if imgui.selectable(name, number == self._all)[0]:
                    self._all, self._row = bool(number), -1
            imgui.end_combo()
        ui.note("path filter", " ".join(self.request.suffixes))
        if listing.other_files:
            imgui.same_line()
            kinds = f"{listing.other_files} file{'s' * (listing.other_files > 1)} of other kinds"
            imgui.text_disabled(kinds)


@lru_cache(maxsize=8)
def _list_paths(
    text: str, suffixes: tuple[str, ...], folder: str, slices: bool, _second: int
) -> Listing:
    """List paths once a second, not once a frame."""
    return list_paths(text, suffixes, folder, slices)


_PROGRAMS = ("zenity", "kdialog", "matedialog", "qarma")
_OPENED = (".toml", SUFFIX, *VOLUME_SUFFIXES, ".exr")


def _open(title: str, *suffixes: str, files: str, kind: str = "open") -> PathRequest:
    return PathRequest(kind, title, False, suffixes, files=files, folders=kind == "open")


def _save(kind: str, title: str, *suffixes: str, files: str, also: str = "") -> PathRequest:
    return PathRequest(kind, title, True, suffixes, files=files, also=also)


REQUESTS = {
    "open": _open("Open a scene or a volume", *_OPENED, files="Scenes and volumes"),
    "open-folder": _open("Open a folder of slices", files=""),
    "add-mesh": _open("Add a mesh", *MESHES, files="Meshes", kind="add-mesh"),
    "open-session": _open("Open a session", SUFFIX, files="Sessions", kind="resume"),
    "export-scene": _save("export-scene", "Save as a scene", ".toml", files="Scenes"),
    "export-python": _save(
        "export-python", "Export as Python", ".py", files="Python", also=".toml"
    ),
    "palette-load": _open("Load a palette", ".toml", files="Palettes", kind="palette-load"),
    "palette-save": _save("palette-save", "Save the palette as", ".toml", files="Palettes"),
    "save-session": _save("save-session", "Save the session", SUFFIX, ".json", files="Sessions"),
}


class FileDialogs:
    """The dialog for a path, the system's or our own."""

    def __init__(self) -> None:
        self._dialog: PathDialog | NativeDialog | None = None

    def ask(
        self, request: PathRequest, document: Document | None, recent: Sequence[RecentFile]
    ) -> None:
        """Open a dialog for a path; ignored while the system's dialog is open."""
        if isinstance(self._dialog, NativeDialog):
            return
        files = [row.path.partition("?")[0] for row in recent]
        request = replace(request, start=initial_path(request, document, files))
        if has_native_dialogs():
            self._dialog = NativeDialog(request)
        else:
            source = None if document is None else document.source
            opened = os.path.dirname(source.partition("?")[0]) if source else None
            places = folder_places(opened, files, os.fspath(asset("data/scenes")))
            self._dialog = PathDialog(request, places)

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
        request, is_native = self._dialog.request, isinstance(self._dialog, NativeDialog)
        whole = request.complete(path)
        # The system has asked about the very file that was chosen only.
        unasked = is_native and {*request.replaced(whole)} - {path}
        self._dialog = PathDialog(replace(request, start=whole)) if unasked else None
        return (request, whole) if whole and not unasked else None

    def close(self) -> None:
        """End the system's dialog, which would keep the program from ending."""
        if isinstance(self._dialog, NativeDialog):
            self._dialog.close()


def initial_path(
    request: PathRequest, document: Document | None, recent: Sequence[str] = ()
) -> str:
    """Return a path in the folder of the open file, the last one, the current or the home folder.

    A file to be saved is named as the open one; a scene is not to replace the one it came from.
    """
    source = None if document is None else document.source
    opened = Path(source.partition("?")[0]) if source else None
    files = [opened] if opened is not None else [Path(path) for path in recent]
    current = Path.cwd()
    usual = current if current != Path(current.anchor) else Path.home()
    folder = next((file.parent for file in files if file.parent.is_dir()), usual)
    if not request.save:
        return f"{folder}/"
    if document is not None and document.own_folder is None:
        folder = usual
    name = opened.name if opened is not None else "engine.toml"
    stem = plain_stem(name.partition(JOINER)[0].replace(PATTERN, "")) or "series"
    if name.lower().endswith(".toml") or request.replaced(f"{folder / stem}{request.suffixes[0]}"):
        stem += "-view"
    return os.fspath(folder / f"{stem}{request.suffixes[0]}")


def has_native_dialogs() -> bool:
    """Return True if the system has dialogs for files."""
    if sys.platform in ("win32", "darwin"):
        return True
    return any(shutil.which(program) for program in _PROGRAMS)


def _runs(program: psutil.Process) -> bool:
    try:
        return bool(program.status() != psutil.STATUS_ZOMBIE)
    except psutil.NoSuchProcess:
        return False


class NativeDialog:
    """The system's dialog in a process of its own, which keeps the program from ending."""

    def __init__(self, request: PathRequest) -> None:
        from imgui_bundle import portable_file_dialogs as dialogs

        self.request = request
        before = set(psutil.Process().children())
        start = os.path.abspath(os.path.expanduser(request.start or "."))
        patterns = " ".join(f"*{suffix}" for suffix in request.suffixes)
        filters = ["All files", "*"]
        if patterns:
            filters = [request.files or request.title, patterns, *filters]
        if request.folders and not patterns:
            self._dialog: Any = dialogs.select_folder(request.title, start)
        else:
            make: Any = dialogs.save_file if request.save else dialogs.open_file
            self._dialog = make(request.title, start, filters)
        # The library reads, then asks whether its program has ended, and loses what the program
        # writes in between: it is asked after the end only.
        self._programs = set(psutil.Process().children()) - before

    def answer(self) -> str | None:
        """Return the path; empty if none was chosen, None while the dialog is open."""
        if any(_runs(program) for program in self._programs) or not self._dialog.ready(0):
            return None
        result = self._dialog.result()
        return str(result[0] if result else "") if isinstance(result, list) else str(result)

    def close(self) -> None:
        """End the dialog's process."""
        self._dialog.kill()
