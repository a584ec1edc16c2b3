"""The registry of commands, and the search for them by a few letters.

menus, keys, command palette -> [commands] -> state, or a request to the app
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import TypeVar

from volspec.errors import InputError
from volspec.viewer.model import (
    camera,
    cuts,
    depth,
    labels,
    lighting,
    lights,
    measure,
    meshes,
    opacities,
    palette_edits,
    quality,
    room,
    slices,
    transfer_edits,
    viewing,
)
from volspec.viewer.model.edit import Command, Edited, refusable, switch, with_interface
from volspec.viewer.model.state import ViewState

Row = TypeVar("Row")
MENUS = ("File", "Edit", "View", "Cut", "Light", "Render", "Transfer", "Palette", "Window")
# A word's letters may spread over this many times its length.
_LOOSE = 3


def rank_matches(
    rows: Sequence[Row],
    search: str,
    text: Callable[[Row], str],
    synonyms: Callable[[Row], str] = lambda _: "",
) -> list[Row]:
    """Return the rows whose text contains the letters of every word in order, best match first.

    A word that begins one of the row's ``synonyms``, such as other names, counts less than one of
    its text.
    """
    words = search.casefold().split()
    if not words:
        return list(rows)
    rated = [(_rating(words, text(row).casefold(), synonyms(row).casefold()), row) for row in rows]
    matches = [(rating, row) for rating, row in rated if rating is not None]
    return [row for _, row in sorted(matches, key=lambda pair: -pair[0])]


def _rating(words: Sequence[str], text: str, synonyms: str) -> float | None:
    """Rate how well words match a text, higher is better; None if any word does not match."""
    total = 0.0
    for word in words:
        index = text.find(word)
        if f" {word}" in f" {text}" or (index > 0 and not text[index - 1].isalnum()):
            total += 4.0
        elif f" {word}" in f" {synonyms}":
            total += 3.0
        elif index > 0:
            total += 2.0
        elif (spread := _letter_span(word, text)) and spread <= _LOOSE * len(word):
            total += len(word) / spread
        else:
            return None
    return total


def _letter_span(word: str, text: str) -> int | None:
    """Return how many letters of a text a word's letters span; None if some are missing."""
    index, first = -1, -1
    for letter in word:
        index = text.find(letter, index + 1)
        if index < 0:
            return None
        first = index if first < 0 else first
    return index - first + 1


def _panel(title: str, *keys: str, words: str) -> Command:
    """Return the command that opens or closes a panel."""

    def toggle(state: ViewState) -> ViewState | Edited:
        if not has_panel(state, title):
            return Edited(state, _NEEDED[title])
        return with_interface(state, panels=state.interface.panels ^ {title})

    return Command(
        f"panel-{title.lower()}",
        "Window",
        f"{title} panel",
        keys,
        toggle,
        lambda state: title in state.interface.panels and has_panel(state, title),
        words,
    )


# Messages where there is nothing for a panel to show.
_NEEDED = {room.PANEL: room.NONE, meshes.PANEL: meshes.NONE}


def has_panel(state: ViewState, title: str) -> bool:
    """Return True if a panel is of use: those of the room and of meshes need some."""
    if title == meshes.PANEL:
        return bool(state.meshes)
    return title != room.PANEL or state.room is not None


_FILES = (
    Command("open", "File", "Open …", ("ctrl+o",), words="load import volume file"),
    Command("open-folder", "File", "Open a folder of slices …"),
    Command("add-mesh", "File", "Add a mesh …", words="surface model import STL OBJ PLY glTF"),
    Command("demonstrations", "File", "Demonstrations …"),
    Command("reload", "File", "Reload the file, keeping the view", ("f5", "ctrl+r")),
    Command("export-scene", "File", "Save as a scene …", ("ctrl+s",)),
    Command("export-python", "File", "Export as Python …", ("ctrl+e",)),
    Command("save-session", "File", "Save the session as …", ("ctrl+shift+s",)),
    Command("open-session", "File", "Open a session …", ("ctrl+shift+o",)),
    Command("restore", "File", "Restore the last session", ("ctrl+shift+r",)),
    Command("screenshot", "File", "Save the picture", ("s",), words="screenshot image png"),
    Command("picture", "File", "Save the picture as …", ("ctrl+i",), words="screenshot image png"),
    Command("film", "File", "Save a film …", ("ctrl+m",), words="movie video turntable animation"),
    Command("page", "File", "Save a web page …", ("ctrl+shift+m",), words="html share browser"),
    Command("cancel", "File", "Cancel the file that is being made"),
    Command("clear-recent", "File", "Clear the recent files"),
    Command("quit", "File", "Quit", ("ctrl+q",), words="exit close"),
)
_EDITS = (
    Command("undo", "Edit", "Undo", ("ctrl+z",)),
    Command("redo", "Edit", "Redo", ("ctrl+shift+z", "ctrl+y")),
    Command("copy-picture", "Edit", "Copy the picture", ("ctrl+c",)),
    Command("copy-values", "Edit", "Copy the values under the mouse", ("ctrl+shift+c",)),
)


# Panels in the order of the menu, with other names.
_PANELS = {
    "Lights": "spectrum illuminant lamp",
    "Viewing": "appearance adaptation display exposure",
    room.PANEL: "wall paint colour floor ceiling adaptation lux",
    meshes.PANEL: "surface model STL OBJ PLY glTF implant",
    "Transfer": "opacity transparent colour map curve label segment",
    opacities.PANEL: "fade hide show materials transparent layers",
    "Palette": "design",
    "Lighting": "light source direction shadow occlusion material shininess specular shading",
    "Quality": "sampling step jitter rendering MIP maximum average projection",
    "Cuts": "crop clip plane section",
}


@refusable
def open_panel(state: ViewState, title: str) -> ViewState:
    """Open a panel that has settings."""
    if title not in _PANELS:
        return state
    if not has_panel(state, title):
        raise InputError(_NEEDED[title], code="missing")
    return with_interface(state, panels=state.interface.panels | {title})


_WINDOW = (
    *(_panel(title, words=words) for title, words in _PANELS.items()),
    _panel("Slices", "o", words="cross-section axial coronal sagittal MPR"),
    _panel("Messages", words="errors warnings log"),
    _panel(measure.PANEL, words="annotations notes list"),
    Command("clear-messages", "Window", "Clear the messages"),
    switch("interface.dark", "dark", "Window", "Dark theme", ("t",)),
    switch("interface.probe", "probe", "Window", "Values under the mouse", ("i",)),
    Command("commands", "Window", "Commands …", ("ctrl+p", "f1")),
    Command("focus", "Window", "Next panel by keyboard", ("f6",)),
    Command("menu", "Window", "Menus by keyboard", ("f10",)),
    switch("interface.keys", "keys", "Window", "Keys", ("h",)),
)

COMMANDS: tuple[Command, ...] = (
    *_FILES,
    *_EDITS,
    *transfer_edits.COMMANDS,
    *labels.COMMANDS,
    *opacities.COMMANDS,
    *camera.COMMANDS,
    Command("next-step", "View", "Next time step", (".",), words="time series frame"),
    Command("play", "View", "Play the time steps", ("j",), words="time series animate pause"),
    Command("previous-step", "View", "Previous time step", (",",), words="time series frame"),
    *depth.COMMANDS,
    switch("interface.error_map", "error-map", "View", "Error map", ("e",)),
    *measure.COMMANDS,
    *viewing.COMMANDS,
    *lights.COMMANDS,
    *palette_edits.COMMANDS,
    *_WINDOW,
    *cuts.COMMANDS,
    *slices.COMMANDS,
    *lighting.COMMANDS,
    *quality.COMMANDS,
    *room.COMMANDS,
)
BY_NAME = {command.name: command for command in COMMANDS}
BY_KEY = {key: command for command in COMMANDS for key in command.keys}


def format_key(key: str) -> str:
    """Format a key as menus show it.

    >>> format_key("ctrl+shift+z"), format_key("enter")
    ('Ctrl+Shift+Z', 'Enter')
    """
    return "+".join(part.capitalize() for part in key.split("+"))
