"""Dialogs for files that the viewer makes, and the progress of those that take time."""

from __future__ import annotations

from dataclasses import replace

from imgui_bundle import imgui

from volspec.raycast.checks import MAX_SIDE
from volspec.viewer.model.state import ViewState
from volspec.viewer.ui.context import UiContext
from volspec.viewer.ui.dialogs import DIALOG_FLAGS, begin_dialog, buttons_left, dialog_buttons
from volspec.viewer.ui.widgets import pick, wrap_text
from volspec.viewer.work.screenshot import CUSTOM, PRESETS, Progress, Shot, megabytes

_DIM = imgui.Col_.text_disabled


class PictureDialog:
    """The dialog for a picture's size, name and folder, which it keeps for the next time."""

    def __init__(self, shot: Shot) -> None:
        self.shot = shot
        self._opens = False

    def ask(self) -> None:
        """Open the dialog."""
        self._opens = True

    def draw(self, state: ViewState, ui: UiContext) -> bool:
        """Draw the dialog; return True if the picture is to be saved now."""
        opens, self._opens = self._opens, False
        if not begin_dialog("Save the picture", opens, ui, 420):
            return False
        imgui.push_item_width(-ui.px(64))
        self._fields(state, ui)
        imgui.pop_item_width()
        imgui.spacing()
        imgui.set_cursor_pos_x(buttons_left(ui))
        accepted, cancelled = dialog_buttons("Save", "picture ok", ui)
        saved = accepted or imgui.is_key_pressed(imgui.Key.enter, False)
        if cancelled or saved or imgui.is_key_pressed(imgui.Key.escape, False):
            imgui.close_current_popup()
        imgui.end_popup()
        return saved

    def _fields(self, state: ViewState, ui: UiContext) -> None:
        shot = self.shot
        shot = replace(shot, preset=pick("Size", shot.preset, PRESETS) or shot.preset)
        ui.note("picture size")
        imgui.begin_disabled(shot.preset != CUSTOM)
        changed, sides = imgui.input_int2("Pixels", list(shot.size(state.size)))
        imgui.end_disabled()
        if changed and shot.preset == CUSTOM:
            shot = replace(shot, custom=(sides[0], sides[1]))
        channels = state.transfer.basis.size * len(state.shading.groups)
        room = megabytes(shot.size(state.size), channels)
        imgui.text_disabled(f"Up to {MAX_SIDE} a side; this takes about {room:,.0f} MB")
        _, name = imgui.input_text_with_hint("Name", "from the title", shot.name)
        _, folder = imgui.input_text_with_hint("Folder", "current folder", shot.folder)
        shot = replace(shot, name=name, folder=folder)
        wrap_text(f"Saves as {shot.path(state.document.title)}", _DIM)
        self.shot = shot


def draw_progress(progress: Progress, ui: UiContext) -> bool:
    """Draw a bar at the picture's bottom; return True if the cast is to be cancelled."""
    x, y, width, height = ui.areas["picture"]
    imgui.set_next_window_pos(
        (x + width / 2, y + height - ui.px(18)), imgui.Cond_.always, (0.5, 1.0)
    )
    imgui.set_next_window_bg_alpha(0.92)
    imgui.push_style_var(imgui.StyleVar_.window_rounding, ui.px(6))
    flags = (
        DIALOG_FLAGS | imgui.WindowFlags_.no_decoration | imgui.WindowFlags_.no_focus_on_appearing
    )
    imgui.begin("##progress", None, flags)
    imgui.align_text_to_frame_padding()
    imgui.text(progress.what)
    imgui.same_line()
    imgui.push_style_color(imgui.Col_.plot_histogram, imgui.get_style_color_vec4(_DIM))
    imgui.progress_bar(progress.share, (ui.px(140), 0), "")
    imgui.pop_style_color()
    imgui.same_line()
    imgui.text(f"{100 * progress.share:3.0f} %" if progress.share < 1 else "relighting")
    imgui.same_line()
    ended = bool(imgui.button("Cancel"))
    ui.note("cancel")
    imgui.end()
    imgui.pop_style_var()
    return ended
