"""The command palette: everything that can be done, found by a few letters of its name.

actions, lights, models, displays, files -> [commands] -> state, or a request to the app

imgui-bundle's own palette shows no keys and keeps one list for the whole process.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import lru_cache

from imgui_bundle import imgui

from volspec.appearance.display import GAMUTS
from volspec.appearance.presets import PRESETS
from volspec.appearance.spaces import SPACES
from volspec.appearance.spec import MODELS, SURROUNDS
from volspec.spectra import light_names
from volspec.viewer.model import commands, lights, viewing
from volspec.viewer.model.commands import COMMANDS, rank_matches
from volspec.viewer.model.edit import Change, Command, Edited
from volspec.viewer.model.state import ViewState
from volspec.viewer.ui.context import Search, UiContext
from volspec.viewer.ui.viewing import SETTINGS
from volspec.viewer.ui.widgets import as_one_line, key_text, text_width
from volspec.viewer.work.session_store import RecentFile

_ROWS = 14
_FLAGS = (
    imgui.WindowFlags_.no_decoration
    | imgui.WindowFlags_.no_docking
    | imgui.WindowFlags_.no_saved_settings
    | imgui.WindowFlags_.no_nav
    | imgui.WindowFlags_.no_move
)


@dataclass(frozen=True, slots=True)
class Entry:
    """One row.

    Parameters
    ----------
    group, title : str
    key : str
        As people write it; empty where there is none.
    change : callable, optional
        What it makes of a state.
    ask : str
        What is asked of the app instead.
    item : str
        What of the viewing panel takes the keyboard.
    """

    group: str
    title: str
    key: str = ""
    change: Change | None = None
    ask: str = ""
    item: str = ""

    @property
    def text(self) -> str:
        """What is searched."""
        return f"{self.group}: {self.title}"


def commands_of(
    state: ViewState, recent: Sequence[RecentFile], text: str = ""
) -> tuple[Entry, ...]:
    """All that can be done with a state, actions first; with a text the best matches first."""
    return _searched(_light_titles(state), tuple(recent), text)


def _light_titles(state: ViewState) -> tuple[str, ...]:
    """The lights, by what they are searched for."""
    return tuple(
        f"{as_one_line(row.name)} alone"
        + ("" if row.label in ("", row.name) else f", {as_one_line(row.label)}")
        for row in state.lights
    )


@lru_cache(maxsize=8)
def _searched(
    names: tuple[str, ...], recent: tuple[RecentFile, ...], text: str
) -> tuple[Entry, ...]:
    """Looked up when something is typed, not in every frame."""
    entries = (*_fixed(), *_alone(names), *_files(recent), *_added())
    return tuple(rank_matches(entries, text, lambda entry: entry.text))


@lru_cache(maxsize=1)
def _fixed() -> tuple[Entry, ...]:
    """Actions, models, displays, and settings of the viewing."""
    entries = [_entry_of(command) for command in COMMANDS if command.name != "commands"]
    for group, names, change in (
        ("Model", MODELS, viewing.set_model),
        ("Display", PRESETS, viewing.set_room),
        ("Surround", SURROUNDS, viewing.set_surround),
        ("Space", SPACES, viewing.set_space),
        ("Gamut", GAMUTS, viewing.set_gamut),
    ):
        entries += [Entry(group, name, change=_with(change, name)) for name in names]
    shown = commands.open_viewing
    entries += [Entry("Setting", name, change=shown, item=name) for name in SETTINGS]
    return tuple(entries)


def _entry_of(command: Command) -> Entry:
    ask = command.name if command.change is None else ""
    title = command.title.removesuffix(" …")
    return Entry(
        command.menu or "Step",
        title,
        key_text(command),
        command.change,
        ask,
    )


@lru_cache(maxsize=8)
def _alone(names: tuple[str, ...]) -> tuple[Entry, ...]:
    return tuple(Entry("Light", name, change=_with(lights.only, i)) for i, name in enumerate(names))


@lru_cache(maxsize=8)
def _files(recent: tuple[RecentFile, ...]) -> tuple[Entry, ...]:
    return tuple(Entry("Open", row.label, ask=f"open {row.path}") for row in recent if row.there)


@lru_cache(maxsize=1)
def _added() -> tuple[Entry, ...]:
    """Lights of the library."""
    return tuple(Entry("Add light", name, change=_with(lights.add, name)) for name in light_names())


def _with(change: Callable[..., ViewState | Edited], given: str | int) -> Change:
    """An edit with its argument."""
    return lambda state: change(state, given)


def draw(state: ViewState, ui: UiContext) -> ViewState | None:
    """Draw it over the picture's upper part; what is picked is done."""
    search = ui.commands
    if search is None:
        return None
    if search.picked is not None:
        search.waits -= 1
        return _act(search.picked, state, ui) if search.waits < 0 else None
    viewport = imgui.get_main_viewport()
    (x, y), room = viewport.work_pos, viewport.work_size
    gap = min(ui.px(28), room.y * 0.04)
    wide = min(ui.px(560), room.x * 0.94)
    tall = (imgui.get_frame_height() + ui.px(4)) * (_ROWS + 1) + ui.px(24)
    tall = min(tall, room.y - 2 * gap)
    imgui.set_next_window_pos((x + room.x / 2, y + gap), imgui.Cond_.always, (0.5, 0.0))
    imgui.set_next_window_size((wide, tall))
    imgui.push_style_var(imgui.StyleVar_.window_rounding, ui.px(8))
    imgui.push_style_var(imgui.StyleVar_.window_border_size, 1)
    imgui.begin("##commands", None, _FLAGS)
    picked = _body(search, state, ui)
    outside = imgui.is_mouse_clicked(0) and not imgui.is_window_hovered(
        imgui.HoveredFlags_.child_windows
    )
    imgui.end()
    imgui.pop_style_var(2)
    if picked is not None:
        search.picked, search.waits = picked, 1
    elif outside or imgui.is_key_pressed(imgui.Key.escape, False):
        ui.commands = None
    return None


def _act(entry: Entry, state: ViewState, ui: UiContext) -> ViewState | None:
    """Do what was picked, or have it done."""
    ui.commands = None
    if entry.item:
        ui.front, ui.item = "Viewing", entry.item
    if entry.change is not None:
        return ui.edited(state, entry.change)
    ui.requests.append(entry.ask)
    return None


def _body(search: Search, state: ViewState, ui: UiContext) -> Entry | None:
    """The field and the rows; what was picked."""
    if search.fresh:
        imgui.set_keyboard_focus_here()
        imgui.set_window_focus()
        search.fresh = False
    imgui.set_next_item_width(-1)
    entered, text = imgui.input_text_with_hint(
        "##search",
        "What do you want to do?",
        search.text,
        imgui.InputTextFlags_.enter_returns_true,
    )
    ui.note("commands")
    if text != search.text:
        search.text, search.at = text, 0
    rows = commands_of(state, ui.results.recent, search.text)
    step = _pressed(imgui.Key.down_arrow) - _pressed(imgui.Key.up_arrow)
    step += _ROWS * (_pressed(imgui.Key.page_down) - _pressed(imgui.Key.page_up))
    search.at = min(max(search.at + step, 0), max(len(rows) - 1, 0))
    picked = rows[search.at] if entered and rows else None
    # Enter has taken the keyboard from the field.
    search.fresh = search.fresh or (entered and not rows)
    if imgui.begin_child("rows", (0, 0)):
        clipper = imgui.ListClipper()
        clipper.begin(len(rows))
        if rows:
            clipper.include_item_by_index(search.at)
        while clipper.step():
            for number in range(clipper.display_start, clipper.display_end):
                if _row(rows[number], number == search.at, bool(step), ui):
                    picked = rows[number]
        if not rows:
            imgui.text_disabled("There is nothing of that name")
    imgui.end_child()
    return picked


def _row(entry: Entry, chosen: bool, follow: bool, ui: UiContext) -> bool:
    """One row: its group, what it does, its key at the right."""
    imgui.push_id(entry.text + entry.ask)
    left = imgui.get_cursor_pos_x()
    right = left + imgui.get_content_region_avail().x
    pressed = bool(imgui.selectable("##row", chosen, 0, (0, imgui.get_frame_height()))[0])
    if chosen and follow:
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


def _pressed(key: imgui.Key) -> int:
    return int(imgui.is_key_pressed(key))
