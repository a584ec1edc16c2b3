"""The keyboard in the panels: on by F6 or F10, off by Esc or a click.

    keys -> [focus] -> imgui's navigation, or our own keys

While it is on, Tab, arrows, Space and Enter move among a panel's items and use them, and no plain
key of ours does anything; those with Ctrl and the F keys do.
"""

from __future__ import annotations

from imgui_bundle import imgui

_FLAG = imgui.ConfigFlags_.nav_enable_keyboard
# Frames until imgui has found the first item.
_LAG = 4


class Focus:
    """Whether the keyboard is in a panel, and in which.

    Attributes
    ----------
    on : bool
    """

    def __init__(self) -> None:
        self.on = False
        self._panel = ""
        self._menu = False
        self._frames = 0

    def next(self, panels: list[str]) -> None:
        """To the panel after the one that has it; after the last, back to the picture."""
        at = panels.index(self._panel) + 1 if self.on and self._panel in panels else 0
        if at >= len(panels):
            self.leave()
            return
        self._panel = panels[at]
        self.enter()

    def enter(self, menu: bool = False) -> None:
        """Let imgui have the keyboard; for a menu until that is closed."""
        _navigate(True)
        imgui.set_nav_cursor_visible(True)
        self.on, self._menu, self._frames = True, menu, 0

    def leave(self) -> None:
        """Take it back."""
        _navigate(False)
        imgui.set_nav_cursor_visible(False)
        self.on, self._panel = False, ""

    def frame(self) -> None:
        """At the start of each frame: begin what was asked for; Esc or a click ends it."""
        if not self.on:
            # Menus and dialogs take arrows and Esc however they were opened.
            _navigate(_popup())
            return
        self._frames += 1
        if self._frames == 1 and self._panel:
            imgui.set_window_focus(self._panel)
            window = imgui.internal.find_window_by_name(self._panel)
            if window is not None:
                imgui.internal.nav_init_window(window, True)
        if self._frames <= _LAG:
            imgui.set_nav_cursor_visible(True)
        io = imgui.get_io()
        clicked = imgui.is_mouse_clicked(0) or imgui.is_mouse_clicked(1)
        # imgui's own Esc first leaves the part of a panel that scrolls.
        escaped = imgui.is_key_pressed(imgui.Key.escape) and not io.want_text_input
        over = self._menu or escaped or not io.nav_visible
        ended = self._frames > _LAG and not _popup() and over
        if clicked or ended:
            self.leave()

    def takes(self, key: str) -> bool:
        """Whether a key is imgui's; while a menu or a dialog is open, all are."""
        plain = not key.startswith("ctrl+") and not (key[0] == "f" and key[1:].isdigit())
        return _popup() or (self.on and plain)


def _navigate(on: bool) -> None:
    io = imgui.get_io()
    io.config_flags = io.config_flags | _FLAG if on else io.config_flags & ~_FLAG


def _popup() -> bool:
    return bool(imgui.is_popup_open("", imgui.PopupFlags_.any_popup))
