"""Everything that can be asked for by name: for menus, keys, the command palette, the cheat sheet.

key, menu, palette -> [actions] -> state, or a request to the app
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

from volspec.viewer.model.events import camera, curve, cuts, lights, palette, slices
from volspec.viewer.model.events.event import Action, Change
from volspec.viewer.model.state import ViewState

MENUS = ("File", "Edit", "View", "Cut", "Light", "Transfer", "Palette", "Window")


def _flipped(name: str) -> Change:
    """Turns a part of the interface on or off."""

    def change(state: ViewState) -> ViewState:
        other: dict[str, Any] = {name: not getattr(state.interface, name)}
        return replace(state, interface=replace(state.interface, **other))

    return change


def _panel(title: str) -> Action:
    """Opens or closes a panel."""

    def change(state: ViewState) -> ViewState:
        panels = state.interface.panels ^ {title}
        return replace(state, interface=replace(state.interface, panels=panels))

    return Action(
        *(f"panel-{title.lower()}", "Window", f"{title} panel", (), change),
        lambda state: title in state.interface.panels,
    )


_FILES = (
    Action("open", "File", "Open …", ("ctrl+o",)),
    Action("reload", "File", "Read the file again, keeping only the view", ("f5", "ctrl+r")),
    Action("export-scene", "File", "Export as scene …", ("ctrl+s",)),
    Action("export-python", "File", "Export as Python …", ("ctrl+e",)),
    Action("save-session", "File", "Save the session as …", ("ctrl+shift+s",)),
    Action("open-session", "File", "Open a session …", ("ctrl+shift+o",)),
    Action("restore", "File", "Restore the last session", ("ctrl+shift+r",)),
    Action("screenshot", "File", "Save the picture", ("s",)),
    Action("picture", "File", "Save the picture as …", ("ctrl+i",)),
    Action("cancel", "File", "Give up the picture that is being cast"),
    Action("clear-recent", "File", "Clear the recent files"),
    Action("quit", "File", "Quit", ("ctrl+q",)),
)
_EDITS = (
    Action("undo", "Edit", "Undo", ("ctrl+z",)),
    Action("redo", "Edit", "Redo", ("ctrl+shift+z", "ctrl+y")),
    Action("copy-picture", "Edit", "Copy the picture", ("ctrl+c",)),
    Action("copy-values", "Edit", "Copy the values under the mouse", ("ctrl+shift+c",)),
)
_OVER = (
    Action(
        *("error-map", "View", "Error map", ("e",), _flipped("error_map")),
        lambda s: s.interface.error_map,
    ),
)
_WINDOW = (
    *(_panel(title) for title in ("Lights", "Viewing", "Transfer", "Palette", "Cuts")),
    replace(_panel("Slices"), keys=("o",)),
    Action("dark", "Window", "Dark theme", ("t",), _flipped("dark"), lambda s: s.interface.dark),
    Action(
        *("probe", "Window", "What is under the mouse", ("i",), _flipped("probe")),
        lambda s: s.interface.probe,
    ),
    Action("commands", "Window", "Commands …", ("ctrl+p", "f1")),
    Action("focus", "Window", "Next panel by keyboard", ("f6",)),
    Action("menu", "Window", "Menus by keyboard", ("f10",)),
    Action("keys", "Window", "Keys", ("h",), _flipped("keys"), lambda s: s.interface.keys),
)

ACTIONS: tuple[Action, ...] = (
    *_FILES,
    *_EDITS,
    *curve.ACTIONS,
    *camera.ACTIONS,
    *_OVER,
    *lights.ACTIONS,
    *palette.ACTIONS,
    *_WINDOW,
    *cuts.ACTIONS,
    *slices.ACTIONS,
)
BY_NAME = {action.name: action for action in ACTIONS}
BY_KEY = {key: action for action in ACTIONS for key in action.keys if key}


def shown(key: str) -> str:
    """A key as people write it.

    >>> shown("ctrl+shift+z"), shown("enter")
    ('Ctrl+Shift+Z', 'Enter')
    """
    return "+".join(part.capitalize() for part in key.split("+"))
