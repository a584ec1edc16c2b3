"""The mouse over the picture, gestures that are one step of undo, and the keyboard's focus.

    Input -> [mouse] -> state, number of the gesture

A drag is one gesture, from the press to the release; so is a key, and a run of the wheel's notches
or of a key that repeats.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from typing import Literal, TypeAlias

from imgui_bundle import imgui

from volspec.camera import Place, Projection
from volspec.viewer.model import camera, cuts, lighting, lighting_aim, lights, transfer_edits
from volspec.viewer.model.state import ViewState
from volspec.viewer.model.view import face_at
from volspec.viewer.ui.inputs import STEPPING, Input

Area = tuple[int, int, int, int]
# An edit by a drag across and down, in fractions of the picture's height, or one that uses places.
Drag: TypeAlias = Callable[[ViewState, float, float], ViewState] | Literal["roll", "divide"]
# Notches and steps closer together in time are one gesture.
RUN_S = 0.5
# The divide can be gripped this far to either side; pixels at 96 dpi, as is the next.
GRIP = 8
# A press that moves less is a click.
STILL = 4.0
# Drags by modifier keys and button, and the wheel by modifier keys; combinations without an
# entry act like no modifiers.
DRAGS: dict[tuple[str, str], Drag] = {
    ("", "left"): camera.orbit,
    ("", "middle"): camera.pan,
    ("", "right"): camera.zoom,
    ("shift", "left"): "roll",
    ("shift", "right"): camera.pan,
    ("ctrl", "left"): transfer_edits.window,
    ("ctrl", "right"): transfer_edits.thicken_by,
    ("ctrl+shift", "left"): transfer_edits.thicken_by,
}
WHEELS: dict[str, Callable[[ViewState, float], ViewState]] = {
    "": camera.zoom_notches,
    "shift": camera.roll_notches,
    "ctrl": camera.widen_notches,
}
# Frames until imgui has found the first item of a panel.
_LAG = 4


class Gestures:
    """Counter of gestures; ``number`` is that of the current or last gesture."""

    def __init__(self) -> None:
        self.number = 0
        self._run: tuple[str, str] | None = None
        self._last_s = 0.0

    def take(self, event: Input, now: float, writes: bool = False) -> None:
        """Count an input at a time in seconds.

        While the user ``writes`` a text, its letters are of the gesture that began it.
        """
        if event.name not in ("press", "wheel", "key") or (writes and event.name == "key"):
            return
        run = _run_of(event)
        goes_on = run is not None and run == self._run and now - self._last_s < RUN_S
        if not (goes_on or event.repeated):
            self.number += 1
        self._run, self._last_s = run, now


def _run_of(event: Input) -> tuple[str, str] | None:
    """Return a key that the inputs of one run share; None if each is its own gesture."""
    if event.name == "wheel":
        return "wheel", event.modifiers
    steps = event.key in STEPPING or event.key.rpartition("+")[2] in STEPPING
    return ("key", event.key) if steps else None


class Mouse:
    """The mouse's drag in progress, and the gesture."""

    def __init__(self) -> None:
        self.gestures = Gestures()
        # The mouse's place, 0 to 1 of the picture; None if it is elsewhere, or over a panel.
        self.over_picture: Place | None = None
        # The button of a click in this frame, and its place, 0 to 1 of the picture; None if none.
        self.clicked: tuple[str, Place] | None = None
        # Window pixels per pixel at 96 dpi; it differs between monitors.
        self.scale = 1.0
        self._down: set[str] = set()
        self._drag = ""
        self._edit: Drag = camera.orbit
        # The dragged handle, and the state at the start of the drag; or the cube's face.
        self._handle: tuple[cuts.CutHandle, ViewState] | None = None
        self._face: int | None = None
        self._pressed: Place = (-1.0, -1.0)
        self._still = False  # the press may still become a click
        self._cursor: Place = (-1.0, -1.0)  # unknown, and not over the picture

    @property
    def held(self) -> bool:
        """True while a button is down."""
        return bool(self._down)

    def take(self, inputs: list[Input]) -> None:
        """Follow inputs while there is no state to change."""
        for event in inputs:
            self._follow(event)

    def apply(self, state: ViewState, inputs: list[Input], area: Area) -> ViewState:
        """Return the state after inputs; ``area`` is the picture's in the window."""
        io = imgui.get_io()
        x, y, width, height = area
        self.clicked = None
        for event in inputs:
            before = self._cursor
            self._follow(event)
            free = not io.want_capture_mouse and _inside(self._cursor, area)
            if event.name == "press" and free and not self._drag:
                state = self._begin(state, event, area)
            elif event.name == "release" and event.button == self._drag:
                self._drag = ""
                if self._still and self._face is None and self._handle is None:
                    place = (self._cursor[0] - x) / width, (self._cursor[1] - y) / height
                    self.clicked = event.button, place
                if self._face is not None:  # a click
                    state = camera.look_at_face(state, self._face)
            elif event.name == "move" and self._drag:
                state = self._drag_to(state, before, area)
            elif event.name == "move" and free and state.interface.tool == lighting.FLASHLIGHT:
                projected = Projection(state.view.camera(state.document.volume), area)
                state = lighting.carry(state, self._cursor, projected)
            elif event.name == "wheel" and free:
                # With Shift, some systems report the wheel as horizontal.
                turn = WHEELS.get(event.modifiers, WHEELS[""])
                state = turn(state, event.y or event.x)
        self.over_picture = None
        if _inside(self._cursor, area) and not io.want_capture_mouse:
            self.over_picture = (self._cursor[0] - x) / width, (self._cursor[1] - y) / height
        return state

    def _begin(self, state: ViewState, event: Input, area: Area) -> ViewState:
        """Begin a drag at a press."""
        self._drag, self._pressed = event.button, self._cursor
        self._edit = DRAGS.get((event.modifiers, event.button)) or DRAGS["", event.button]
        self._handle = self._face = None
        self._still = not event.modifiers
        if event.button != "left" or event.modifiers:
            return state
        if state.document.image is None:
            state = self._begin_in_volume(state, area)
        if state.other is not None and self._handle is None and self._face is None:
            x, _, width, _ = area
            if abs(event.x - (x + state.divide * width)) < GRIP * self.scale:
                self._edit = "divide"
        return state

    def _begin_in_volume(self, state: ViewState, area: Area) -> ViewState:
        """Grip the handle or the cube's face at the mouse, if there is one."""
        projected = Projection(state.view.camera(state.document.volume), area)
        lamps = lighting_aim.list_handles(state, projected)
        handles = (*lamps, *cuts.list_handles(state, projected, self.scale))
        handle = cuts.nearest_handle(handles, self._cursor, self.scale)
        if handle is not None:
            if handle.name == lighting_aim.HANDLE:
                state = lighting.choose_source(state, handle.index)
            elif handle.name != "crop":
                state = cuts.choose_plane(state, handle.index)
            self._handle = handle, state
        elif state.interface.overlays.cube:
            self._face = face_at(projected, self._cursor, self.scale)
        return state

    def _drag_to(self, state: ViewState, before: Place, area: Area) -> ViewState:
        """Return the state after a move during a drag."""
        x, y, width, height = area
        # A click that does something else is no drag.
        if self._still and math.dist(self._cursor, self._pressed) >= STILL * self.scale:
            self._still = False
        if self._still and (self._drag == "right" or state.interface.tool):
            return state
        if self._face is not None:
            if math.dist(self._cursor, self._pressed) < STILL * self.scale:
                return state
            self._face, before = None, self._pressed
        if self._handle is not None:
            handle, start = self._handle
            volume = start.document.volume
            projected = Projection(start.view.camera(volume), area)
            place = (
                handle.anchor[0] + self._cursor[0] - self._pressed[0],
                handle.anchor[1] + self._cursor[1] - self._pressed[1],
            )
            if handle.name == lighting_aim.HANDLE:
                return lighting.drag_handle(state, start, handle, place, projected)
            to = cuts.drag_handle(start.shading, volume, handle, place, projected)
            return cuts.move_handle(state, handle, *to)
        if self._edit == "divide":
            return lights.set_divide(state, (self._cursor[0] - x) / max(width, 1))
        if self._edit == "roll":
            middle = x + width / 2, y + height / 2
            return camera.roll(state, _turn_deg(middle, before, self._cursor))
        across, down = self._cursor[0] - before[0], self._cursor[1] - before[1]
        return self._edit(state, across / max(height, 1), down / max(height, 1))

    def _follow(self, event: Input) -> None:
        if event.name == "press":
            self._down.add(event.button)
        elif event.name == "release":
            self._down.discard(event.button)
        writes = imgui.get_io().want_text_input
        self.gestures.take(event, time.perf_counter(), writes)
        if event.name in ("press", "release", "move"):
            self._cursor = event.x, event.y


def _turn_deg(middle: Place, before: Place, after: Place) -> float:
    """Return the clockwise angle of a move around a place."""
    first, last = (math.atan2(end[1] - middle[1], end[0] - middle[0]) for end in (before, after))
    return math.degrees(math.remainder(last - first, 2 * math.pi))


def _inside(place: Place, area: Area) -> bool:
    x, y, width, height = area
    return x <= place[0] < x + width and y <= place[1] < y + height


class Focus:
    """The keyboard's focus: ``on`` while it is in a panel or a menu."""

    def __init__(self) -> None:
        self.on = False
        self._panel = ""
        self._menu = False
        self._frames = self._without = 0  # since it was entered, and since a popup was open

    def next(self, panels: list[str]) -> None:
        """Move on to the next panel; after the last, back to the picture."""
        number = panels.index(self._panel) + 1 if self.on and self._panel in panels else 0
        if number >= len(panels):
            self.leave()
            return
        self._panel = panels[number]
        self.enter()

    def enter(self, menu: bool = False) -> None:
        """Give imgui the keyboard; for a menu, until it is closed."""
        _navigate(True)
        imgui.set_nav_cursor_visible(True)
        self.on, self._menu, self._frames, self._without = True, menu, 0, 0

    def leave(self) -> None:
        """Take the keyboard back from imgui."""
        _navigate(False)
        imgui.set_nav_cursor_visible(False)
        self.on, self._panel = False, ""

    def frame(self) -> None:
        """Begin a frame: enter the panel that `next` chose, or leave on Esc or a click."""
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
        # Between two menus there is none for a frame or two.
        self._without = 0 if _popup() else self._without + 1
        ended = self._frames > _LAG and self._without > (_LAG if self._menu else 0) and over
        if clicked or ended:
            self.leave()

    def takes(self, key: str, menu: bool) -> bool:
        """Return True if imgui takes a key: all keys while a ``menu`` or a dialog is open."""
        if menu and not self.on:  # opened by the mouse
            self.enter(menu=True)
        navigates = not key.startswith("ctrl+") and not (key[0] == "f" and key[1:].isdigit())
        return _popup() or (self.on and navigates)


def _navigate(on: bool) -> None:
    io, flag = imgui.get_io(), imgui.ConfigFlags_.nav_enable_keyboard
    io.config_flags = io.config_flags | flag if on else io.config_flags & ~flag


def _popup() -> bool:
    return bool(imgui.is_popup_open("", imgui.PopupFlags_.any_popup))
