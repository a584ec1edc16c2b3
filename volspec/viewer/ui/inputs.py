"""Inputs as glfw reports them: passed to imgui, and collected for the viewer.

glfw -> [inputs] -> Input -> mouse, app
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import glfw
from imgui_bundle import imgui

BUTTONS = {0: "left", 1: "right", 2: "middle"}
_MODIFIERS = (
    (glfw.KEY_LEFT_CONTROL, glfw.KEY_RIGHT_CONTROL, imgui.Key.mod_ctrl),
    (glfw.KEY_LEFT_SHIFT, glfw.KEY_RIGHT_SHIFT, imgui.Key.mod_shift),
    (glfw.KEY_LEFT_ALT, glfw.KEY_RIGHT_ALT, imgui.Key.mod_alt),
    (glfw.KEY_LEFT_SUPER, glfw.KEY_RIGHT_SUPER, imgui.Key.mod_super),
)
# As a system without Ctrl has it on another key, as glfw counts them.
_KEYS_OF_MODIFIERS = {
    glfw.MOD_CONTROL: (glfw.KEY_LEFT_CONTROL, glfw.KEY_RIGHT_CONTROL),
    glfw.MOD_SHIFT: (glfw.KEY_LEFT_SHIFT, glfw.KEY_RIGHT_SHIFT),
    glfw.MOD_ALT: (glfw.KEY_LEFT_ALT, glfw.KEY_RIGHT_ALT),
    glfw.MOD_SUPER: (glfw.KEY_LEFT_SUPER, glfw.KEY_RIGHT_SUPER),
}
_ARROWS = {
    glfw.KEY_LEFT: "left",
    glfw.KEY_RIGHT: "right",
    glfw.KEY_UP: "up",
    glfw.KEY_DOWN: "down",
    glfw.KEY_PAGE_UP: "pageup",
    glfw.KEY_PAGE_DOWN: "pagedown",
}
# What goes on step by step while it is held down.
STEPPING = frozenset({*_ARROWS.values(), "+", "=", "-"})


@dataclass(frozen=True, slots=True)
class Input:
    """Something that the user did.

    Parameters
    ----------
    name : {"press", "release", "move", "wheel", "key", "typed", "drop", "resize"}
    x, y : float
        Where the mouse is in the window; of the wheel its notches.
    button : str
    key : str
        What is written on it, as ``a``, ``1``, ``enter``; with ``ctrl+``, ``alt+`` or
        ``ctrl+shift+`` in front.
    paths : tuple of str
        What was dropped.
    modifiers : str
        Keys held with the mouse: ``ctrl``, ``shift``, ``alt``, or several as ``ctrl+shift``.
    repeated : bool
        Whether a key comes again as it is held down.
    """

    name: str
    x: float = 0.0
    y: float = 0.0
    button: str = ""
    key: str = ""
    paths: tuple[str, ...] = ()
    modifiers: str = ""
    repeated: bool = False


class Inputs:
    """Listens to a window.

    imgui hears of a gesture when it is taken: what it makes of Enter, say, a dialog that closes,
    must not come before the key is known to be the dialog's.

    Parameters
    ----------
    window : glfw window
    to_imgui : callable
        imgui's own listener for keys.
    """

    def __init__(self, window: Any, to_imgui: Callable[..., None]) -> None:
        self._window, self._to_imgui = window, to_imgui
        # What has happened, and what tells imgui of it.
        self._heard: list[tuple[Input, Callable[[], object]]] = []
        self._at: tuple[float, float] | None = None
        listeners: tuple[tuple[Callable[..., Any], Callable[..., None]], ...] = (
            (glfw.set_mouse_button_callback, self._on_button),
            (glfw.set_cursor_pos_callback, self._on_move),
            (glfw.set_scroll_callback, self._on_wheel),
            (glfw.set_key_callback, self._on_key),
            (glfw.set_char_callback, self._on_char),
            (glfw.set_drop_callback, lambda _, paths: self.drop(paths)),
            (glfw.set_cursor_enter_callback, self._on_enter),
            (glfw.set_framebuffer_size_callback, self._on_change),
            (glfw.set_window_refresh_callback, self._on_change),
        )
        for set_callback, listener in listeners:
            set_callback(window, listener)

    @property
    def waiting(self) -> bool:
        """Whether something has happened that has not been taken."""
        return bool(self._heard)

    def take(self) -> list[Input]:
        """What has happened since the last call, but no more than one gesture of it."""
        inputs = [given for given, _ in self._heard]
        end = _gesture_end(inputs)
        for _, tell in self._heard[:end]:
            tell()
        self._heard = self._heard[end:]
        return inputs[:end]

    def drop(self, paths: Sequence[str]) -> None:
        """Files have been dropped."""
        self._hear(Input("drop", paths=tuple(paths)))

    def _hear(self, given: Input, tell: Callable[[], object] = lambda: None) -> None:
        self._heard.append((given, tell))

    def _on_button(self, _: Any, button: int, action: int, modifiers: int) -> None:
        down = action == glfw.PRESS
        if button in BUTTONS:
            # Where it was then: glfw knows only where it is by now, which may be farther.
            x, y = self._at or glfw.get_cursor_pos(self._window)
            name, held = "press" if down else "release", _held(modifiers)
            self._hear(
                Input(name, x, y, button=BUTTONS[button], modifiers=held),
                lambda: imgui.get_io().add_mouse_button_event(button, down),
            )

    def _on_move(self, _: Any, x: float, y: float) -> None:
        self._at = x, y
        self._hear(Input("move", x, y), lambda: imgui.get_io().add_mouse_pos_event(x, y))

    def _on_enter(self, _: Any, entered: int) -> None:
        if not entered:
            away = -3.4e38, -3.4e38
            self._hear(Input("move", -1.0, -1.0), lambda: imgui.get_io().add_mouse_pos_event(*away))

    def _on_wheel(self, _: Any, x: float, y: float) -> None:
        bits = sum(
            bit
            for bit, keys in _KEYS_OF_MODIFIERS.items()
            if any(glfw.get_key(self._window, key) == glfw.PRESS for key in keys)
        )
        self._hear(
            Input("wheel", x, y, modifiers=_held(bits)),
            lambda: imgui.get_io().add_mouse_wheel_event(x, y),
        )

    def _on_char(self, _: Any, char: int) -> None:
        self._hear(Input("typed"), lambda: imgui.get_io().add_input_character(char))

    def _on_change(self, *_: Any) -> None:
        self._hear(Input("resize"))

    def _on_key(self, window: Any, key: int, code: int, action: int, modifiers: int) -> None:
        down = [
            (modifier, glfw.PRESS in (glfw.get_key(window, left), glfw.get_key(window, right)))
            for left, right, modifier in _MODIFIERS
        ]

        def tell() -> None:
            # Before the key, which imgui takes in order; an event's own bits lag behind on X11.
            for each in down:
                imgui.get_io().add_key_event(*each)
            self._to_imgui(window, key, code, action, modifiers)

        name = _key_name(key, code)
        repeated = action == glfw.REPEAT and name in STEPPING
        if name and (action == glfw.PRESS or repeated):
            ctrl = modifiers & (glfw.MOD_CONTROL | glfw.MOD_SUPER)
            # Of keys that write, Shift has already made another.
            shift = "shift+" if (ctrl or key in _ARROWS) and modifiers & glfw.MOD_SHIFT else ""
            alt = "alt+" if modifiers & glfw.MOD_ALT else ""
            whole = f"{'ctrl+' if ctrl else ''}{alt}{shift}{name}"
            self._hear(Input("key", key=whole, repeated=repeated), tell)
        else:  # imgui's: Tab, what is held or let go
            self._hear(Input("typed"), tell)


def _gesture_end(inputs: Sequence[Input]) -> int:
    """How many inputs there are before a second gesture begins."""
    before = next(iter(inputs), None)
    for i, given in enumerate(inputs):
        if before is not None and _parts(before, given):
            return i
        # A hand that turns the wheel moves the mouse, too.
        if given.name != "move":
            before = given
    return len(inputs)


def _parts(before: Input, given: Input) -> bool:
    """Whether an input begins something else than the one before it belongs to."""
    runs = replace(given, x=before.x, y=before.y, repeated=before.repeated) == before
    return given.name in ("press", "wheel", "key") and not runs


def _held(bits: int) -> str:
    """Modifier keys as `Input.modifiers`; the Mac's Command counts as Ctrl."""
    names = (
        ("ctrl", glfw.MOD_CONTROL | glfw.MOD_SUPER),
        ("shift", glfw.MOD_SHIFT),
        ("alt", glfw.MOD_ALT),
    )
    return "+".join(name for name, bit in names if bits & bit)


def _key_name(key: int, code: int) -> str:
    """``a``, ``1``, ``enter``, …; by what is written on the key, in any layout."""
    named: dict[int, str] = {
        glfw.KEY_ENTER: "enter",
        glfw.KEY_KP_ENTER: "enter",
        glfw.KEY_SPACE: "space",
        glfw.KEY_ESCAPE: "escape",
        **_ARROWS,
    }
    if key in named:
        return named[key]
    if glfw.KEY_F1 <= key <= glfw.KEY_F12:
        return f"f{key - glfw.KEY_F1 + 1}"
    if glfw.KEY_KP_0 <= key <= glfw.KEY_KP_9:
        return str(key - glfw.KEY_KP_0)
    return (glfw.get_key_name(key, code) or "").lower()
