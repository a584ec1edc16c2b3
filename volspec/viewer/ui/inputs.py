"""Inputs as glfw reports them: passed to imgui, and collected for the viewer.

glfw -> [inputs] -> Input -> mouse, app
"""

from __future__ import annotations

import os
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import glfw
from imgui_bundle import imgui

BUTTONS = {0: "left", 1: "right", 2: "middle"}
# glfw's bit, its two keys, and imgui's key; a system without Ctrl has it on another key, as glfw
# counts them.
_MODIFIERS = (
    (glfw.MOD_CONTROL, glfw.KEY_LEFT_CONTROL, glfw.KEY_RIGHT_CONTROL, imgui.Key.mod_ctrl),
    (glfw.MOD_SHIFT, glfw.KEY_LEFT_SHIFT, glfw.KEY_RIGHT_SHIFT, imgui.Key.mod_shift),
    (glfw.MOD_ALT, glfw.KEY_LEFT_ALT, glfw.KEY_RIGHT_ALT, imgui.Key.mod_alt),
    (glfw.MOD_SUPER, glfw.KEY_LEFT_SUPER, glfw.KEY_RIGHT_SUPER, imgui.Key.mod_super),
)
_MODIFIER_KEYS = frozenset(key for _, *keys, _ in _MODIFIERS for key in keys)
_ARROWS = {
    getattr(glfw, f"KEY_{name.upper()}"): name.replace("_", "")
    for name in ("left", "right", "up", "down", "page_up", "page_down")
}
_KEYS: dict[int, str] = {
    glfw.KEY_ENTER: "enter",
    glfw.KEY_KP_ENTER: "enter",
    glfw.KEY_SPACE: "space",
    glfw.KEY_ESCAPE: "escape",
    **_ARROWS,
}
# Keys that repeat while they are held down.
STEPPING = frozenset({*_ARROWS.values(), "+", "=", "-"})


@dataclass(frozen=True, slots=True)
class Input:
    """Something that the user did."""

    # "press", "release", "move", "wheel", "key", "modifier", "typed", "drop" or "resize"
    name: str
    x: float = 0.0  # the mouse's place in the window, or the wheel's notches
    y: float = 0.0
    button: str = ""
    key: str = ""  # as written on it: a, 1, enter; prefixed by ctrl+, alt+ or ctrl+shift+
    paths: tuple[str, ...] = ()
    modifiers: str = ""  # keys held with the mouse: ctrl, shift, alt, or several as ctrl+shift
    repeated: bool = False  # a key that is held down


class Inputs:
    """Queue of a window's inputs.

    A gesture is passed to imgui only when it is taken from the queue. Otherwise imgui could react
    first, for example close a dialog on Enter, before the key is known to belong to the dialog.
    ``to_imgui`` is imgui's own listener for keys.
    """

    def __init__(self, window: Any, to_imgui: Callable[..., None]) -> None:
        self._window, self._to_imgui = window, to_imgui
        # Inputs, each with the call that passes it to imgui.
        self._queue: list[tuple[Input, Callable[[], object]]] = []
        self._cursor: tuple[float, float] | None = None
        glfw.set_mouse_button_callback(window, self._on_button)
        glfw.set_cursor_pos_callback(window, self._on_move)
        glfw.set_scroll_callback(window, self._on_wheel)
        glfw.set_key_callback(window, self._on_key)
        glfw.set_char_callback(window, self._on_char)
        # glfw.set_drop_callback decodes names as UTF-8; where one is not, its error loses what else
        # comes in the same poll.
        library: Any = glfw
        self._dropped = library._GLFWdropfun(self._on_drop)
        library._glfw.glfwSetDropCallback(window, self._dropped)
        glfw.set_cursor_enter_callback(window, self._on_enter)
        glfw.set_framebuffer_size_callback(window, lambda *_: self._add(Input("resize")))
        glfw.set_window_refresh_callback(window, lambda *_: self._add(Input("resize")))

    @property
    def waiting(self) -> bool:
        """True while there are inputs that have not been taken."""
        return bool(self._queue)

    def take(self) -> list[Input]:
        """Take the inputs since the last call, but no more than one gesture; pass them to imgui."""
        end = _gesture_end([event for event, _ in self._queue])
        taken = self._queue[:end]
        for _, pass_on in taken:
            pass_on()
        del self._queue[:end]
        return [event for event, _ in taken]

    def _add(self, event: Input, pass_on: Callable[[], object] = lambda: None) -> None:
        self._queue.append((event, pass_on))

    def _on_button(self, _: Any, button: int, action: int, modifiers: int) -> None:
        down = action == glfw.PRESS
        if button in BUTTONS:
            # The place at that time; glfw reports only the current one, which may be farther along.
            x, y = self._cursor or glfw.get_cursor_pos(self._window)
            name, modifier_text = "press" if down else "release", _modifier_text(modifiers)
            self._add(
                Input(name, x, y, button=BUTTONS[button], modifiers=modifier_text),
                lambda: imgui.get_io().add_mouse_button_event(button, down),
            )

    def _on_move(self, _: Any, x: float, y: float) -> None:
        self._cursor = x, y
        self._add(Input("move", x, y), lambda: imgui.get_io().add_mouse_pos_event(x, y))

    def _on_enter(self, _: Any, entered: int) -> None:
        if not entered:
            no_xy = -3.4e38, -3.4e38
            self._add(Input("move", -1.0, -1.0), lambda: imgui.get_io().add_mouse_pos_event(*no_xy))

    def _on_drop(self, _: Any, count: int, paths: Sequence[bytes]) -> None:
        self._add(Input("drop", paths=tuple(os.fsdecode(paths[i]) for i in range(count))))

    def _on_wheel(self, _: Any, x: float, y: float) -> None:
        bits = sum(bit for bit, left, right, _ in _MODIFIERS if self._is_down(left, right))
        self._add(
            Input("wheel", x, y, modifiers=_modifier_text(bits)),
            lambda: imgui.get_io().add_mouse_wheel_event(x, y),
        )

    def _is_down(self, left: int, right: int) -> bool:
        return glfw.PRESS in (glfw.get_key(self._window, key) for key in (left, right))

    def _on_char(self, _: Any, char: int) -> None:
        self._add(Input("typed"), lambda: imgui.get_io().add_input_character(char))

    def _on_key(self, window: Any, key: int, code: int, action: int, modifiers: int) -> None:
        down = [(modifier, self._is_down(left, right)) for _, left, right, modifier in _MODIFIERS]

        def pass_on() -> None:
            # Before the key, as imgui processes events in order; their own bits lag behind on X11.
            for modifier_event in down:
                imgui.get_io().add_key_event(*modifier_event)
            self._to_imgui(window, key, code, action, modifiers)

        name = _key_name(key, code)
        repeated = action == glfw.REPEAT and name in STEPPING
        if name and (action == glfw.PRESS or repeated):
            ctrl = modifiers & (glfw.MOD_CONTROL | glfw.MOD_SUPER)
            # The name of a printable key includes Shift.
            shift = "shift+" if (ctrl or key in _ARROWS) and modifiers & glfw.MOD_SHIFT else ""
            alt = "alt+" if modifiers & glfw.MOD_ALT else ""
            shortcut = f"{'ctrl+' if ctrl else ''}{alt}{shift}{name}"
            self._add(Input("key", key=shortcut, repeated=repeated), pass_on)
        else:  # for imgui alone: Tab, keys that are held or released
            self._add(Input("modifier" if key in _MODIFIER_KEYS else "typed"), pass_on)


def _gesture_end(inputs: Sequence[Input]) -> int:
    """Return the number of inputs before a second gesture begins."""
    before = next(iter(inputs), None)
    for i, event in enumerate(inputs):
        if before is not None and _begins_gesture(before, event):
            return i
        # A hand that turns the wheel moves the mouse, too.
        if event.name != "move":
            before = event
    return len(inputs)


def _begins_gesture(before: Input, event: Input) -> bool:
    """Return True unless an input belongs to the same gesture as the one before it."""
    if event.name == "modifier":
        # imgui sees a key with the modifiers at the frame's end.
        return before.name == "key"
    runs = replace(event, x=before.x, y=before.y, repeated=before.repeated) == before
    return event.name in ("press", "wheel", "key") and not runs


def _modifier_text(bits: int) -> str:
    """Return modifier keys as `Input.modifiers`; the Mac's Command counts as Ctrl."""
    names = (
        ("ctrl", glfw.MOD_CONTROL | glfw.MOD_SUPER),
        ("shift", glfw.MOD_SHIFT),
        ("alt", glfw.MOD_ALT),
    )
    return "+".join(name for name, bit in names if bits & bit)


def _key_name(key: int, code: int) -> str:
    """Return ``a``, ``1``, ``enter``, …, as written on the key in any layout."""
    if key in _KEYS:
        return _KEYS[key]
    if glfw.KEY_F1 <= key <= glfw.KEY_F12:
        return f"f{key - glfw.KEY_F1 + 1}"
    if glfw.KEY_KP_0 <= key <= glfw.KEY_KP_9:
        return str(key - glfw.KEY_KP_0)
    return (glfw.get_key_name(key, code) or "").lower()
