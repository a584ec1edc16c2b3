"""The menu at the top: every action, with its key."""

from __future__ import annotations

from imgui_bundle import imgui

from volspec.viewer.actions import ACTIONS, MENUS, shown
from volspec.viewer.panels.desk import Desk
from volspec.viewer.state import ViewState


def draw(state: ViewState, desk: Desk) -> ViewState | None:
    """Draw it; what is picked changes the state, or is noted down for the app."""
    new = state
    if not imgui.begin_main_menu_bar():
        return None
    for title in MENUS:
        opened = imgui.begin_menu(title)
        desk.note(f"menu {title}")
        if not opened:
            continue
        for action in ACTIONS:
            if action.menu != title:
                continue
            key = shown(action.keys[0]) if action.keys and action.keys[0] else ""
            on = action.on is not None and action.on(state)
            if imgui.menu_item(action.title, key, on)[0]:
                if action.change is None:
                    desk.asked.append(action.name)
                else:
                    new = action.change(new)
            desk.note(f"action {action.name}")
        imgui.end_menu()
    imgui.end_main_menu_bar()
    return None if new is state else new
