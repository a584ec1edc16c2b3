"""The menu at the top: every action, with its key, and the files opened lately."""

from __future__ import annotations

from imgui_bundle import imgui

from volspec.viewer.model.actions import ACTIONS, MENUS
from volspec.viewer.model.events.event import Action
from volspec.viewer.model.state import ViewState
from volspec.viewer.ui.context import UiContext
from volspec.viewer.ui.panels.widgets import key_text, whole_label

# Actions that begin another part of their menu; the recent files follow the first.
_PARTS = ("export-scene", "save-session", "screenshot", "quit", "copy-picture", "commands")
_AFTER = "open"
# Offered elsewhere: beside the files, and where a cast shows how far it is.
_ELSEWHERE = ("clear-recent", "cancel")


def draw(state: ViewState, ui: UiContext) -> ViewState | None:
    """Draw it; what is picked changes the state, or is noted down for the app."""
    new = state
    if not imgui.begin_main_menu_bar():
        return None
    for title in MENUS:
        if ui.menu:
            ui.menu = False
            imgui.open_popup(title)
        opened = imgui.begin_menu(title)
        ui.note(f"menu {title}")
        if not opened:
            continue
        for action in ACTIONS:
            if action.menu == title and action.name not in _ELSEWHERE:
                new = _row(action, new, ui)
        imgui.end_menu()
    imgui.end_main_menu_bar()
    return None if new is state else new


def _row(action: Action, state: ViewState, ui: UiContext) -> ViewState:
    if action.name in _PARTS:
        imgui.separator()
    on = action.on is not None and action.on(state)
    picked = imgui.menu_item(action.title, key_text(action), on)[0]
    ui.note(f"action {action.name}")
    if action.name == _AFTER:
        _recent(ui)
    return ui.done(state, action) if picked else state


def _recent(ui: UiContext) -> None:
    if not imgui.begin_menu("Open recent", bool(ui.results.recent)):
        return
    for number, row in enumerate(ui.results.recent):
        if imgui.menu_item(f"{whole_label(row.label)}##{number}", "", False, row.there)[0]:
            ui.asked.append(f"open {row.path}")
        ui.note(f"recent {number}")
    imgui.separator()
    if imgui.menu_item("Clear the list", "", False)[0]:
        ui.asked.append("clear-recent")
    imgui.end_menu()
