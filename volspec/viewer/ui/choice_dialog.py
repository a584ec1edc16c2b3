"""The dialog for what an address leaves open: series, channel, time step, layout of raw bytes.

Undecided -> [choice_dialog] -> address
"""

from __future__ import annotations

import os
from contextlib import suppress
from dataclasses import replace

from imgui_bundle import imgui

from volspec.viewer.model.choices import (
    DTYPES,
    ORDERS,
    TITLES,
    USES,
    Dropped,
    NeedsChoice,
    RawLayout,
    address_with,
    guess_layouts,
    value_text,
)
from volspec.viewer.ui.context import UiContext
from volspec.viewer.ui.dialogs import begin_dialog, buttons_left, dialog_buttons
from volspec.viewer.ui.widgets import as_one_line, pick, shown_rows, wrap_text
from volspec.volume import Choice

_ROWS = 8
_SAMPLE_BYTES = 1 << 16
_SELECT = imgui.SelectableFlags_
_ROW = _SELECT.no_auto_close_popups | _SELECT.allow_double_click


class ChoiceDialog:
    """Lists of what there is in a file; for raw bytes, fields for their layout."""

    def __init__(self, undecided: NeedsChoice) -> None:
        self._path = undecided.path
        self._lists = [choice for choice in undecided.choices if choice.values]
        self._picked = {entry.key: entry.chosen or entry.values[0] for entry in self._lists}
        self._raw = _RawPart(undecided.path) if len(self._lists) < len(undecided.choices) else None
        self._opens = True

    def draw(self, ui: UiContext) -> str | None:
        """Draw the dialog; return the chosen address, empty if none, None while it is open."""
        opens, self._opens = self._opens, False
        name = as_one_line(os.path.basename(self._path.partition("?")[0].rstrip("/")))
        if not begin_dialog(f"{name}: choose what to open###choice", opens, ui, 560):
            return ""
        done = False
        for choice in self._lists:
            done |= self._list(choice, opens, ui)
        if self._raw is not None:
            self._raw.draw(ui)
        imgui.spacing()
        imgui.set_cursor_pos_x(buttons_left(ui))
        imgui.begin_disabled(self._raw is not None and not self._raw.fits)
        accepted, cancelled = dialog_buttons("Open", "choice ok", ui)
        imgui.end_disabled()
        entered = imgui.is_key_pressed(imgui.Key.enter, False)
        done |= accepted or (entered and (self._raw is None or self._raw.fits))
        address: str | None = None
        if done:
            options = self._picked if self._raw is None else self._raw.layout.options
            address = address_with(self._path, options)
        elif cancelled or imgui.is_key_pressed(imgui.Key.escape, False):
            address = ""
        if address is not None:
            imgui.close_current_popup()
        imgui.end_popup()
        return address

    def _list(self, choice: Choice, opens: bool, ui: UiContext) -> bool:
        """Draw a choice's values; return True if one was double-clicked."""
        imgui.text_disabled(TITLES.get(choice.key, choice.key))
        line = imgui.get_text_line_height_with_spacing()
        height = min(len(choice.values), _ROWS) * line
        double = False
        picked = choice.values.index(self._picked[choice.key])
        if imgui.begin_child(f"list {choice.key}", (0, height), imgui.ChildFlags_.nav_flattened):
            for number in shown_rows(len(choice.values), always=picked):
                value = choice.values[number]
                label = f"{as_one_line(value_text(choice, number))}##{number}"
                pressed = imgui.selectable(label, number == picked, _ROW)[0]
                ui.note(f"choice {choice.key} {value}")
                if opens and number == picked:
                    imgui.set_item_default_focus()
                    imgui.set_scroll_here_y(0.5)
                # By keyboard, the choice follows the focus.
                if pressed or (imgui.is_item_focused() and imgui.get_io().nav_visible):
                    self._picked[choice.key] = value
                double |= pressed and imgui.is_mouse_double_clicked(0)
        imgui.end_child()
        return double


class DropDialog:
    """The files that were dropped together, and what they may be."""

    def __init__(self, dropped: Dropped) -> None:
        self.dropped = dropped
        self._problems = {use: dropped.problem(use) for use in USES}
        uses = sorted(USES, key=lambda use: use != "steps" or not dropped.numbered)
        self._use = next(use for use in uses if not self._problems[use])
        self._opens = True

    def draw(self, ui: UiContext) -> str | None:
        """Draw the dialog; return the chosen use, empty if none, None while it is open."""
        opens, self._opens = self._opens, False
        paths = self.dropped.ordered(self._use)
        title = f"{len(paths)} files were dropped: choose what they are###dropped"
        if not begin_dialog(title, opens, ui, 560):
            return ""
        height = min(len(paths), _ROWS) * imgui.get_text_line_height_with_spacing()
        if imgui.begin_child("dropped files", (0, height)):
            for number in shown_rows(len(paths)):
                name = as_one_line(os.path.basename(paths[number]))
                if imgui.selectable(f"  {number + 1}  {name}##{number}", False, _ROW)[0]:
                    self.dropped = self.dropped.moved_up(paths[number])
                ui.note(f"dropped {number}", paths[number])
        imgui.end_child()
        by_number = self._use == "steps" and self.dropped.numbered
        order = "In the order of the numbers in their names"
        imgui.text_disabled(order if by_number else "A click on a file moves it up")
        imgui.separator()
        for use, (name, remark) in USES.items():
            problem = self._problems[use]
            imgui.begin_disabled(bool(problem))
            pressed = imgui.radio_button(name, use == self._use)
            ui.note(f"use {use}")
            if opens and use == self._use:
                imgui.set_item_default_focus()
            # By keyboard, the choice follows the focus.
            if pressed or (imgui.is_item_focused() and imgui.get_io().nav_visible):
                self._use = use
            imgui.end_disabled()
            imgui.indent(imgui.get_frame_height_with_spacing())
            wrap_text(problem or remark, imgui.Col_.text_disabled)
            imgui.unindent(imgui.get_frame_height_with_spacing())
        imgui.spacing()
        imgui.set_cursor_pos_x(buttons_left(ui))
        accepted, cancelled = dialog_buttons("Open", "use ok", ui)
        answer: str | None = None
        if cancelled or imgui.is_key_pressed(imgui.Key.escape, False):
            answer = ""
        elif accepted or imgui.is_key_pressed(imgui.Key.enter, False):
            answer = self._use
        if answer is not None:
            imgui.close_current_popup()
        imgui.end_popup()
        return answer


class _RawPart:
    """Fields for the layout of raw bytes, with guesses and a check of their number."""

    def __init__(self, path: str) -> None:
        name, self._nbytes, sample = path.partition("?")[0], 0, b""
        with suppress(OSError):  # it is reported when it is opened
            self._nbytes = os.path.getsize(name)
            with open(name, "rb") as file:
                file.seek(self._nbytes // 2 // 8 * 8)
                sample = file.read(_SAMPLE_BYTES)
        self._guesses = guess_layouts(os.path.basename(name), self._nbytes, sample)
        self.layout = self._guesses[0] if self._guesses else RawLayout()

    @property
    def fits(self) -> bool:
        """True if the file has enough bytes for the layout."""
        return self.layout.check(self._nbytes)[0]

    def draw(self, ui: UiContext) -> None:
        """Draw the guesses, the fields and the check."""
        if self._guesses:
            imgui.text_disabled("Plausible layouts of the bytes")
            for number, guess in enumerate(self._guesses):
                same = replace(guess, spacing_mm=self.layout.spacing_mm) == self.layout
                if imgui.selectable(f"{guess}##{number}", same, _ROW)[0]:
                    self.layout = replace(guess, spacing_mm=self.layout.spacing_mm)
                ui.note(f"guess {number}")
            imgui.separator()
        imgui.push_item_width(-ui.px(110))
        layout = self.layout
        changed, shape = imgui.input_int3("Voxels x, y, z", list(layout.shape))
        ui.note("raw shape")
        if changed:
            x, y, z = shape
            layout = replace(layout, shape=(x, y, z))
        layout = replace(layout, dtype=pick("Type", layout.dtype, DTYPES) or layout.dtype)
        imgui.begin_disabled(layout.dtype.endswith("int8"))
        layout = replace(layout, order=pick("Byte order", layout.order, ORDERS) or layout.order)
        imgui.end_disabled()
        changed, offset = imgui.input_int("Header bytes", layout.offset, 0)
        if changed:
            layout = replace(layout, offset=offset)
        changed, mm = imgui.input_float3("Spacing, mm", list(layout.spacing_mm), "%.4g")
        if changed and min(mm) > 0:
            x_mm, y_mm, z_mm = mm
            layout = replace(layout, spacing_mm=(x_mm, y_mm, z_mm))
        imgui.pop_item_width()
        self.layout = layout
        fits, text = layout.check(self._nbytes)
        wrap_text(text, imgui.Col_.text_disabled if fits else imgui.Col_.check_mark)
