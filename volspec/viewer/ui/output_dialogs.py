"""Dialogs for pictures, films and web pages, and the progress of those that take time."""

from __future__ import annotations

from dataclasses import replace
from functools import lru_cache
from pathlib import Path

from imgui_bundle import imgui

from volspec._checks import MAX_SIDE
from volspec._extras import install_command
from volspec.errors import InputError, one_line
from volspec.export.page import MAX_VIEWS
from volspec.scene.tables import Mark
from volspec.viewer.model.document import Document
from volspec.viewer.model.film import (
    AS_SHOWN,
    RATES,
    SECONDS,
    Film,
    frame_state,
    light_changes,
    with_frames,
)
from volspec.viewer.model.state import ViewState
from volspec.viewer.ui.context import UiContext
from volspec.viewer.ui.dialogs import DIALOG_FLAGS, begin_dialog, buttons_left, dialog_buttons
from volspec.viewer.ui.widgets import BLACK, over_picture, pack_colour, pick, text_width, wrap_text
from volspec.viewer.work.films import FILM_KINDS, FilmFile, PageFile, possible_kinds
from volspec.viewer.work.outputs import (
    CUSTOM,
    PRESETS,
    Destination,
    PictureSize,
    Progress,
    output_folder,
    short_title,
)
from volspec.viewer.work.screenshot import Still, megabytes

_DIM = imgui.Col_.text_disabled
# Width of the labels at the right of the fields, at 96 dpi.
_LABELS = 72
# Views that the slider offers; and bytes of a channel of a pixel in a page, at most.
_MAX_SLIDER_VIEWS, _PAGE_BYTES = 72, 0.5


class _OutputDialog:
    """A dialog that stays open, and says why, while its file cannot be written."""

    def __init__(self) -> None:
        self._opens = False
        self._problem: tuple[Destination, str] | None = None

    def ask(self) -> None:
        """Open the dialog."""
        self._opens, self._problem = True, None

    def _end(
        self, name: str, state: ViewState, to: Destination, suffix: str, ui: UiContext
    ) -> tuple[bool, bool]:
        """Draw the buttons and end it; return whether its file is wanted, and if it closed."""
        if self._problem is not None and self._problem[0] == to:
            wrap_text(self._problem[1], imgui.Col_.check_mark)
            ui.note("file problem")
        imgui.spacing()
        imgui.set_cursor_pos_x(buttons_left(ui))
        accepted, cancelled = dialog_buttons("Save", name, ui)
        # A list that is open over the dialog has the focus, and takes both keys.
        child = imgui.FocusedFlags_.child_windows | imgui.FocusedFlags_.no_popup_hierarchy
        keyed = imgui.is_window_focused(child)
        saved = accepted or (keyed and imgui.is_key_pressed(imgui.Key.enter, False))
        if saved:
            try:
                to.new_path(state.document, suffix)
            except InputError as error:
                self._problem, saved = (to, one_line(error)), False
        closed = cancelled or saved or (keyed and imgui.is_key_pressed(imgui.Key.escape, False))
        if closed:
            imgui.close_current_popup()
        imgui.end_popup()
        return saved, closed


class PictureDialog(_OutputDialog):
    """The dialog for a picture's size, name and folder, which it keeps for the next time."""

    def __init__(self, shot: Still) -> None:
        super().__init__()
        self.shot = shot

    def draw(self, state: ViewState, ui: UiContext) -> bool:
        """Draw the dialog; return True if the picture is to be saved now."""
        opens, self._opens = self._opens, False
        if not begin_dialog("Save the picture", opens, ui, 420):
            return False
        shot = self.shot
        imgui.push_item_width(-ui.px(_LABELS))
        size = _size_fields(shot.size, state, ui)
        channels = state.transfer.basis.size * len(state.shading.groups)
        room = megabytes(size.pixels(state.size), channels)
        imgui.text_disabled(f"Up to {MAX_SIDE} a side; this takes about {room:,.0f} MB")
        old_marks = shot.marks_for(state)
        marks, title = _mark_fields(old_marks, shot.title, state.document, ui)
        to = _destination_fields(shot.to, state.document, ".png", ui)
        imgui.pop_item_width()
        self.shot = Still(size, to, shot.marks if marks == old_marks else marks, title)
        return self._end("picture ok", state, to, ".png", ui)[0]


class FilmDialog(_OutputDialog):
    """The dialog for a film, previewed in the picture; it keeps its settings."""

    def __init__(self, size: PictureSize) -> None:
        super().__init__()
        self.file = FilmFile(size=size)
        self._time_s = 0.0  # position of the preview, in seconds
        self._plays = False
        self._kinds: tuple[str, ...] = ()
        self._cached: tuple[tuple[ViewState, Film, int], ViewState] | None = None

    def ask(self) -> None:
        """Open the dialog."""
        super().ask()
        self._time_s, self._plays = 0.0, False
        self._kinds = possible_kinds()
        if self.file.kind not in self._kinds:
            self.file = replace(self.file, kind=self._kinds[0])

    def draw(self, state: ViewState, ui: UiContext) -> bool:
        """Draw the dialog; return True if the film is to be saved now."""
        opens, self._opens = self._opens, False
        series = state.document.series
        if opens and series is not None and self.file.film == Film():
            seconds = len(series) / state.document.step_rate
            self.file = replace(self.file, film=Film(degrees=0.0, seconds=max(seconds, SECONDS[0])))
        ui.preview, ui.plays = None, False
        if not begin_dialog("Save a film", opens, ui, 340, aside=True):
            self._cached = None
            return False
        imgui.push_item_width(-ui.px(_LABELS))
        film = self._film_fields(self.file.film, state, ui)
        imgui.separator()
        kind = pick("Format", self.file.kind, self._kinds) or self.file.kind
        ui.note("film format")
        size = _size_fields(self.file.size, state, ui)
        marks, title = _mark_fields(self.file.marks, self.file.title, state.document, ui)
        self.file = replace(self.file, film=film, kind=kind, size=size, marks=marks, title=title)
        to = _destination_fields(self.file.to, state.document, self.file.suffix, ui)
        self.file = replace(self.file, to=to)
        imgui.pop_item_width()
        if len(self._kinds) < len(FILM_KINDS):
            wrap_text(f"Other films need ffmpeg: {install_command('video')}", _DIM)
        saved, closed = self._end("film ok", state, to, self.file.suffix, ui)
        if not closed:
            ui.preview, ui.plays = self._preview, self._plays
            _shade_outside(self.file.size.pixels(state.size), ui)
        return saved

    def _preview(self, state: ViewState) -> ViewState:
        """Return the state of the frame to show, the same object while nothing changes."""
        film = self.file.film
        key = state, film, min(int(self._time_s * film.fps), film.frames - 1)
        if self._cached is None or self._cached[0] != key:
            self._cached = key, frame_state(*key)
        return self._cached[1]

    def _film_fields(self, film: Film, state: ViewState, ui: UiContext) -> Film:
        _, degrees = imgui.slider_float("Turn", film.degrees, -360.0, 360.0, "%.0f°")
        ui.note("film turn", "By which the camera turns around the volume; 0 for none")
        changes = light_changes(state)
        lights = film.lights if film.lights in changes else changes[0]
        lights = pick("Lights", lights, changes) or lights
        ui.note("film lights")
        loops = film.loops
        if lights != AS_SHOWN:
            _, loops = imgui.checkbox("The last fades back to the first", loops)
            ui.note("film loops")
        steps = film.steps
        if state.document.series is not None:
            _, steps = imgui.checkbox("Play the time steps", steps)
            ui.note("film steps", f"{state.document.step_rate:g} per second, again from the first")
        log = imgui.SliderFlags_.logarithmic
        changed, seconds = imgui.slider_float("Length", film.seconds, *SECONDS, "%.2f s", log)
        ui.note("film length")
        seconds = round(seconds, 1) if changed else film.seconds
        _, fps = imgui.slider_float("Rate", film.fps, *RATES, "%.0f fps")
        ui.note("film rate")
        film = Film(float(round(degrees)), lights, loops, seconds, float(round(fps)), steps)
        typed, frames = imgui.input_int("Frames", film.frames, 0)
        ui.note("film frames", "Length times rate; a turntable of 36 turns by 10° each")
        if typed:
            film = with_frames(film, frames)
        if imgui.button("Stop" if self._plays else "Play", (ui.px(56), 0)):
            self._plays = not self._plays
        ui.note("film play")
        imgui.same_line()
        end = (film.frames - 1) / film.fps
        if self._plays:
            self._time_s = (self._time_s + imgui.get_io().delta_time) % (film.frames / film.fps)
        imgui.set_next_item_width(-ui.px(_LABELS))
        changed, second = imgui.slider_float("Preview", min(self._time_s, end), 0.0, end, "%.1f s")
        ui.note("film preview")
        if changed:
            self._time_s, self._plays = second, False
        return film


def _shade_outside(size: tuple[int, int], ui: UiContext) -> None:
    """Shade the parts of the picture that a narrower film leaves out; its height is the same."""
    x, y, width, height = ui.areas["picture"]
    side = (width - height * size[0] / size[1]) / 2
    if side < 1:
        return
    shade = pack_colour(BLACK, 0.6)
    with over_picture(ui) as draw_list:
        for left in (x, x + width - side):
            draw_list.add_rect_filled((left, y), (left + side, y + height), shade)


class PageDialog(_OutputDialog):
    """The dialog for a web page; it keeps its settings."""

    def __init__(self, size: PictureSize) -> None:
        super().__init__()
        self.file = PageFile(size=size)

    def draw(self, state: ViewState, ui: UiContext) -> bool:
        """Draw the dialog; return True if the page is to be saved now."""
        opens, self._opens = self._opens, False
        if not begin_dialog("Save a web page", opens, ui, 420):
            return False
        file = self.file
        imgui.push_item_width(-ui.px(_LABELS))
        _, title = imgui.input_text_with_hint("Title", short_title(state.document), file.title)
        ui.note("page title")
        _, views = imgui.slider_int("Views", file.views, 1, _MAX_SLIDER_VIEWS)
        ui.note("page views", "1 for a still; more to turn it by a drag")
        series, steps = state.document.series, file.steps
        if series is not None:
            _, steps = imgui.checkbox(f"All {len(series)} time steps", steps)
            ui.note("page steps")
        count = len(series) if series is not None and steps else 1
        views = min(views, MAX_VIEWS // count)
        size = _size_fields(file.size, state, ui)
        width, height = size.pixels(state.size)
        channels = state.transfer.basis.size * len(state.shading.groups) + 1
        megabytes = 0.2 + 1e-6 * views * count * width * height * channels * _PAGE_BYTES
        wrap_text(f"One file of up to {megabytes:,.1f} MB that any browser opens", _DIM)
        to = _destination_fields(file.to, state.document, ".html", ui)
        imgui.pop_item_width()
        self.file = PageFile(max(views, 1), title, size, to, steps)
        return self._end("page ok", state, to, ".html", ui)[0]


def _size_fields(size: PictureSize, state: ViewState, ui: UiContext) -> PictureSize:
    size = replace(size, preset=pick("Size", size.preset, PRESETS) or size.preset)
    ui.note("picture size")
    imgui.begin_disabled(size.preset != CUSTOM)
    changed, sides = imgui.input_int2("Pixels", list(size.pixels(state.size)))
    imgui.end_disabled()
    if changed and size.preset == CUSTOM:
        size = replace(size, custom=(sides[0], sides[1]))
    return size


_MARK_LABELS: dict[Mark, str] = {
    "scale": "Scale bar",
    "orientation": "Orientation",
    "title": "Title",
    "light": "Light",
    "materials": "Legend of materials",
    "values": "Bar of values",
}


def _mark_fields(
    marks: tuple[Mark, ...], title: str, document: Document, ui: UiContext
) -> tuple[tuple[Mark, ...], str]:
    """Draw a box for each mark, in as many lines as they need, and a field for a title."""
    right = imgui.get_cursor_pos_x() + imgui.get_content_region_avail().x
    new_marks = list(marks)
    for name, label in _MARK_LABELS.items():
        w = imgui.get_frame_height() + imgui.get_style().item_inner_spacing.x + text_width(label)
        imgui.same_line()
        if imgui.get_cursor_pos_x() + w > right or name == "scale":
            imgui.new_line()
        changed, on = imgui.checkbox(label, name in marks)
        ui.note(f"mark {name}")
        if changed:
            new_marks = [mark for mark in _MARK_LABELS if (on if mark == name else mark in marks)]
    if "title" in new_marks:
        _, title = imgui.input_text_with_hint("Title", short_title(document), title)
        ui.note("mark title text")
    return tuple(new_marks), title


def _destination_fields(
    to: Destination, document: Document, suffix: str, ui: UiContext
) -> Destination:
    about = short_title(document), output_folder(document), suffix, int(imgui.get_time())
    _, name = imgui.input_text_with_hint("Name", "from the title", to.name)
    ui.note("file name")
    _, folder = imgui.input_text_with_hint("Folder", str(about[1]), to.folder)
    ui.note("file folder")
    to = Destination(folder, name)
    wrap_text(f"Saves as {_path(to, *about)}", _DIM)
    return to


@lru_cache(maxsize=8)
def _path(to: Destination, title: str, usual: Path, suffix: str, _second: int) -> Path:
    """Look for a free name once a second, not once a frame."""
    return to.path(title, usual, suffix)


def draw_progress(progress: Progress, ui: UiContext) -> bool:
    """Draw a bar at the picture's bottom; return True if the cast is to be cancelled."""
    x, y, width, height = ui.areas["picture"]
    imgui.set_next_window_pos(
        (x + width / 2, y + height - ui.px(18) - ui.time_bar), imgui.Cond_.always, (0.5, 1.0)
    )
    imgui.set_next_window_bg_alpha(0.92)
    imgui.push_style_var(imgui.StyleVar_.window_rounding, ui.px(6))
    flags = (
        DIALOG_FLAGS | imgui.WindowFlags_.no_decoration | imgui.WindowFlags_.no_focus_on_appearing
    )
    imgui.begin("##progress", None, flags)
    imgui.align_text_to_frame_padding()
    imgui.text(progress.title)
    imgui.same_line()
    imgui.push_style_color(imgui.Col_.plot_histogram, imgui.get_style_color_vec4(_DIM))
    imgui.progress_bar(progress.fraction, (ui.px(140), 0), "")
    imgui.pop_style_color()
    imgui.same_line()
    step = progress.step or ("relighting" if progress.fraction >= 1 else "")
    imgui.text(step or f"{100 * progress.fraction:3.0f} %")
    imgui.same_line()
    ended = bool(imgui.button("Cancel"))
    ui.note("cancel")
    imgui.end()
    imgui.pop_style_var()
    return ended
