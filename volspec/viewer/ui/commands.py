"""The command palette: all commands, found by a few letters of their names.

    commands, lights, models, displays, files -> [commands] -> state, or a request to the app

imgui-bundle's own palette shows no keys and keeps one list for the whole process.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache, partial
from types import MappingProxyType

from imgui_bundle import imgui

from volspec.appearance import MODELS, SURROUNDS
from volspec.appearance.display import DEFICIENCIES, GAMUTS, PRESETS, SPACES, VISION
from volspec.spectra.library import EVERYDAY, describe_light, library_names
from volspec.viewer.model import lights, viewing
from volspec.viewer.model.choices import TITLES, value_text
from volspec.viewer.model.commands import COMMANDS, open_panel, rank_matches
from volspec.viewer.model.edit import Change
from volspec.viewer.model.room import PANEL
from volspec.viewer.model.state import ViewState
from volspec.viewer.ui import lighting, quality, room
from volspec.viewer.ui import viewing as viewing_panel
from volspec.viewer.ui.context import Request, Search, UiContext
from volspec.viewer.ui.overlays import BARE_WINDOW
from volspec.viewer.ui.widgets import as_one_line, key_text, shown_rows, text_width
from volspec.viewer.work.session_store import RecentFile
from volspec.volume import Choice

_ROWS = 14
_SETTINGS = {
    "Viewing": viewing_panel.SETTINGS,
    "Lighting": lighting.SETTINGS,
    PANEL: room.SETTINGS,
    "Quality": quality.SETTINGS,
}
_VISION_NAMES = "colour blind deficiency CVD simulate protanopia deuteranopia tritanopia"
# Other names of settings.
_OTHER_NAMES = {
    "Illuminance": "lux brightness light level",
    "Adaptation": "white balance chromatic",
    "White": "luminance nits display brightness",
    "Exposure": "brightness gain",
    "Backdrop": "background colour grey",
    "Background": "adapting luminance Y_b",
    "Specular": "highlight gloss shiny",
    "Shininess": "highlight gloss roughness material",
    "Diffuse": "material shading Lambert",
    "Ambient": "material shading fill",
    "Step": "sampling rate distance quality",
    "Jitter": "noise dither rings quality",
    "Projection": "MIP maximum average mean intensity",
    "Light cells": "shadow occlusion detail quality",
    "Paint": "wall floor ceiling room colour",
    "Alpha stop": "early termination opacity limit",
    "Vision": _VISION_NAMES,
}
_FLAGS = BARE_WINDOW | imgui.WindowFlags_.no_nav | imgui.WindowFlags_.no_move


@dataclass(frozen=True, slots=True)
class Entry:
    """A row of the palette."""

    group: str
    title: str
    key: str = ""  # for display; empty if there is none
    change: Change | None = None
    request: Request | None = None  # to the app, if there is no edit
    panel: str = ""  # the panel that then comes to the front,
    item: str = ""  # and its item that gets keyboard focus
    words: str = ""  # other names, which are searched but not shown

    @property
    def text(self) -> str:
        """The text that is searched."""
        return f"{self.group}: {self.title}"


def list_entries(
    state: ViewState, recent: Sequence[RecentFile], text: str = ""
) -> tuple[Entry, ...]:
    """List a state's commands that match a text, the best first; all of them without a text."""
    names = tuple(
        f"{as_one_line(row.name)} alone"
        + ("" if row.label in ("", row.name) else f", {as_one_line(row.label)}")
        for row in state.lights
    )
    return _search(names, tuple(recent), state.document.choices, text)


@lru_cache(maxsize=8)
def _search(
    names: tuple[str, ...], recent: tuple[RecentFile, ...], choices: tuple[Choice, ...], text: str
) -> tuple[Entry, ...]:
    """Search the entries once per text, not in every frame."""
    return tuple(
        rank_matches(
            _entries(names, recent, choices),
            text,
            lambda entry: entry.text,
            lambda entry: entry.words,
        )
    )


@lru_cache(maxsize=8)
def _entries(
    names: tuple[str, ...], recent: tuple[RecentFile, ...], choices: tuple[Choice, ...]
) -> tuple[Entry, ...]:
    """Return all entries: commands, settings, the state's lights, files, lights of the library."""
    commands = (
        Entry(
            command.menu or "Move",
            command.title.removesuffix(" …"),
            key_text(command),
            command.change,
            Request(command.name) if command.change is None else None,
            words=command.words,
        )
        for command in COMMANDS
        if command.name != "commands"
    )
    return (
        *commands,
        *_choices("Model", MODELS, viewing.set_viewing, "model"),
        *_choices("Display", PRESETS, viewing.set_display, "preset"),
        *_choices("Surround", SURROUNDS, viewing.set_viewing, "surround"),
        *_choices("Space", SPACES, viewing.set_display, "space"),
        *_choices("Gamut", GAMUTS, viewing.set_display, "gamut"),
        *_choices("Vision", DEFICIENCIES, viewing.set_viewing, "deficiency", VISION, _VISION_NAMES),
        *(
            Entry(
                "Setting",
                name,
                change=partial(open_panel, title=panel),
                panel=panel,
                item=name,
                words=_OTHER_NAMES.get(name, ""),
            )
            for panel, settings in _SETTINGS.items()
            for name in settings
        ),
        *(
            Entry("Light", name, change=partial(lights.only, index=i))
            for i, name in enumerate(names)
        ),
        *(
            Entry(
                TITLES.get(choice.key, choice.key),
                as_one_line(value_text(choice, number)),
                request=Request("choose", f"{choice.key}={value}"),
            )
            for choice in choices
            for number, value in enumerate(choice.values)
        ),
        *(
            Entry("Open", row.label, request=Request("open", row.path))
            for row in recent
            if row.exists
        ),
        *(
            Entry(
                "Add light",
                f"{name}, {describe_light(name)}",
                change=partial(lights.add, text=name),
                words=" ".join(alias for alias, meant in EVERYDAY.items() if meant == name),
            )
            for name in library_names()
        ),
    )


def _choices(
    group: str,
    names: Iterable[str],
    change: Callable[[ViewState, str, object], ViewState],
    field: str,
    titles: Mapping[str, str] = MappingProxyType({}),
    words: str = "",
) -> list[Entry]:
    def choose(name: str) -> Change:
        return lambda state: change(state, field, name)

    return [
        Entry(group, titles.get(name, name), change=choose(name), words=words) for name in names
    ]


def draw(state: ViewState, ui: UiContext) -> ViewState | None:
    """Draw the palette over the picture's upper part; run the entry that was picked."""
    search = ui.commands
    if search is None:
        return None
    if search.picked is not None:
        search.waits -= 1
        return _run(search.picked, state, ui) if search.waits < 0 else None
    viewport = imgui.get_main_viewport()
    (x, y), room = viewport.work_pos, viewport.work_size
    gap = min(ui.px(28), room.y * 0.04)
    width = min(ui.px(560), room.x * 0.94)
    height = (imgui.get_frame_height() + ui.px(4)) * (_ROWS + 1) + ui.px(24)
    height = min(height, room.y - 2 * gap)
    imgui.set_next_window_pos((x + room.x / 2, y + gap), imgui.Cond_.always, (0.5, 0.0))
    imgui.set_next_window_size((width, height))
    imgui.push_style_var(imgui.StyleVar_.window_rounding, ui.px(8))
    imgui.push_style_var(imgui.StyleVar_.window_border_size, 1)
    imgui.begin("##commands", None, _FLAGS)
    picked = _body(search, state, ui)
    inside = imgui.is_window_hovered(imgui.HoveredFlags_.child_windows)
    outside = imgui.is_mouse_clicked(0) and not inside
    imgui.end()
    imgui.pop_style_var(2)
    if picked is not None:
        search.picked, search.waits = picked, 1
    elif outside or imgui.is_key_pressed(imgui.Key.escape, False):
        ui.commands = None
    return None


def _run(entry: Entry, state: ViewState, ui: UiContext) -> ViewState | None:
    """Close the palette; return the edited state, or request a command from the app."""
    ui.commands = None
    if entry.item:
        ui.front, ui.item = entry.panel, entry.item
    if entry.change is not None:
        return ui.edited(state, entry.change)
    if entry.request is not None:
        ui.requests.append(entry.request)
    return None


def _body(search: Search, state: ViewState, ui: UiContext) -> Entry | None:
    """Draw the field and the rows; return the entry that was picked."""
    if search.fresh:
        imgui.set_keyboard_focus_here()
        imgui.set_window_focus()
        search.fresh = False
    imgui.set_next_item_width(-1)
    hint, flags = "Search commands", imgui.InputTextFlags_.enter_returns_true
    entered, text = imgui.input_text_with_hint("##search", hint, search.text, flags)
    ui.note("commands")
    if text != search.text:
        search.text, search.row = text, 0
    rows = list_entries(state, ui.results.recent, search.text)
    pressed = imgui.is_key_pressed
    step = pressed(imgui.Key.down_arrow) - pressed(imgui.Key.up_arrow)
    step += _ROWS * (pressed(imgui.Key.page_down) - pressed(imgui.Key.page_up))
    search.row = min(max(search.row + step, 0), max(len(rows) - 1, 0))
    picked = rows[search.row] if entered and rows else None
    search.fresh |= entered and not rows  # Enter has taken the focus from the field
    if imgui.begin_child("rows", (0, 0)):
        for number in shown_rows(len(rows), always=search.row):
            if _row(rows[number], number == search.row, bool(step), ui):
                picked = rows[number]
        if not rows:
            imgui.text_disabled("No match")
    imgui.end_child()
    return picked


def _row(entry: Entry, is_chosen: bool, follow: bool, ui: UiContext) -> bool:
    """Draw a row: its group, title and key; return True if it was pressed."""
    imgui.push_id(f"{entry.text}{entry.request}")
    left = imgui.get_cursor_pos_x()
    right = left + imgui.get_content_region_avail().x
    pressed = bool(imgui.selectable("##row", is_chosen, 0, (0, imgui.get_frame_height()))[0])
    if is_chosen and follow:
        imgui.set_scroll_here_y(0.5)
    imgui.same_line(left + ui.px(6))
    imgui.align_text_to_frame_padding()
    imgui.text_disabled(entry.group)
    imgui.same_line(left + ui.px(92))
    imgui.text(entry.title)
    if entry.key:
        imgui.same_line(right - text_width(entry.key) - ui.px(8))
        imgui.text_disabled(entry.key)
    imgui.pop_id()
    return pressed
