"""The mouse over the picture, gestures that undo takes back whole, and the keyboard's focus.

    Input -> [mouse] -> state, number of the gesture

A drag is one gesture, from the press to the release; so is a key, and a run of the wheel's notches
or of a key that steps.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from typing import Literal, TypeAlias

from imgui_bundle import imgui

from volspec.viewer.model import camera, cuts, lights, projection, transfer_edits
from volspec.viewer.model.cuts import Handle, drag_handle, handles_of, nearest_handle
from volspec.viewer.model.projection import Place, Projection
from volspec.viewer.model.state import ViewState
from volspec.viewer.ui.inputs import STEPPING, Input

# Notches and steps that come sooner after each other belong together.
RUN_S = 0.5


class Gestures:
    """Numbers them.

    Attributes
    ----------
    number : int
        Of the gesture that is under way, or was last.
    """

    def __init__(self) -> None:
        self.number = 0
        self._run: tuple[str, str] | None = None
        self._last_s = 0.0

    def take(self, given: Input, now: float) -> None:
        """Follow an input at a time, seconds."""
        if given.name not in ("press", "wheel", "key"):
            return
        run = _run_of(given)
        goes_on = run is not None and run == self._run and now - self._last_s < RUN_S
        if not (goes_on or given.repeated):
            self.number += 1
        self._run, self._last_s = run, now


def _run_of(given: Input) -> tuple[str, str] | None:
    """What runs on with others of its kind; None where each is a gesture of its own."""
    if given.name == "wheel":
        return "wheel", given.modifiers
    steps = given.name == "key" and given.key.rpartition("+")[2] in STEPPING
    return ("key", given.key) if steps or given.key in STEPPING else None


Area = tuple[int, int, int, int]
# An edit by a drag across and down, in shares of the picture's height; or one that takes places.
Drag: TypeAlias = Callable[[ViewState, float, float], ViewState] | Literal["roll", "divide"]
# So near to the divide the mouse takes hold of it; pixels at 96 dpi, as the next.
GRIP = 8
# A press that moves less is a click.
STILL = 4.0
# What drags and the wheel do, by modifier keys and button; without an entry as without the keys.
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


class Mouse:
    """Knows which drag is under way, and which gesture.

    Attributes
    ----------
    scale : float
        Pixels of the window for each at 96 dpi; another where the window changes the monitor.
    """

    def __init__(self) -> None:
        self._gestures = Gestures()
        self.over_picture: Place | None = None
        self.scale = 1.0
        self._down: set[str] = set()
        self._drag = ""
        self._edit: Drag = camera.orbit
        self._handle: Handle | None = None
        self._face: int | None = None
        self._pressed: Place = (-1.0, -1.0)
        self._start: ViewState | None = None  # of a handle's drag
        self._at: Place = (-1.0, -1.0)  # unknown, and not over the picture

    @property
    def gesture(self) -> int:
        """The number of the gesture that is under way, or was last."""
        return self._gestures.number

    @property
    def held(self) -> bool:
        """Whether a button is down."""
        return bool(self._down)

    def take(self, inputs: list[Input]) -> None:
        """Follow the buttons where there is nothing to change."""
        for given in inputs:
            self._follow(given)

    def applied(self, state: ViewState, inputs: list[Input], area: Area) -> ViewState:
        """What inputs make of a state.

        Parameters
        ----------
        state : ViewState
        inputs : list of Input
        area : (x, y, width, height)
            Of the picture in the window.
        """
        io = imgui.get_io()
        for given in inputs:
            before = self._at
            self._follow(given)
            free = not io.want_capture_mouse and _inside(self._at, area)
            if given.name == "press" and free and not self._drag:
                state = self._begin(state, given, area)
            elif given.name == "release" and given.button == self._drag:
                self._drag = ""
                if self._face is not None:  # a click
                    state = camera.look_at_face(state, self._face)
            elif given.name == "move" and self._drag:
                state = self._dragged(state, before, area)
            elif given.name == "wheel" and free:
                # With Shift some systems turn the wheel sideways.
                turn = WHEELS.get(given.modifiers, WHEELS[""])
                state = turn(state, given.y or given.x)
        x, y, width, height = area
        inside = _inside(self._at, area) and not io.want_capture_mouse
        place = (self._at[0] - x) / max(width, 1), (self._at[1] - y) / max(height, 1)
        self.over_picture = place if inside else None
        return state

    def _begin(self, state: ViewState, given: Input, area: Area) -> ViewState:
        """Take hold of what a press is on."""
        self._drag, self._pressed = given.button, self._at
        self._edit = DRAGS.get((given.modifiers, given.button)) or DRAGS["", given.button]
        self._handle = self._face = None
        if given.button != "left" or given.modifiers:
            return state
        projected = Projection(state.view.camera(state.document.volume), area)
        self._handle = nearest_handle(
            handles_of(state, projected, self.scale), self._at, self.scale
        )
        if self._handle is not None:
            if self._handle.name != "crop":
                state = cuts.choose_plane(state, self._handle.index)
            self._start = state
        elif state.interface.aids.cube:
            self._face = projection.face_at(projected, self._at, self.scale)
        x, _, width, _ = area
        over = self._handle is not None or self._face is not None
        if state.other is not None and not over:
            near = abs(given.x - (x + state.divide * width)) < GRIP * self.scale
            self._edit = "divide" if near else self._edit
        return state

    def _dragged(self, state: ViewState, before: Place, area: Area) -> ViewState:
        """What the drag under way makes of a state."""
        x, y, width, height = area
        tall = max(height, 1)
        if self._face is not None:
            if math.dist(self._at, self._pressed) < STILL * self.scale:
                return state
            self._face, before = None, self._pressed
        if self._handle is not None and self._start is not None:
            return self._handled(state, self._start, self._handle, area)
        if self._edit == "divide":
            return lights.set_divide(state, (self._at[0] - x) / max(width, 1))
        if self._edit == "roll":
            middle = x + width / 2, y + height / 2
            return camera.roll(state, _turned_deg(middle, before, self._at))
        across, down = self._at[0] - before[0], self._at[1] - before[1]
        return self._edit(state, across / tall, down / tall)

    def _handled(self, state: ViewState, start: ViewState, handle: Handle, area: Area) -> ViewState:
        """What a handle's drag makes of a state, by what it was at its start."""
        volume = start.document.volume
        projected = Projection(start.view.camera(volume), area)
        place = (
            handle.held[0] + self._at[0] - self._pressed[0],
            handle.held[1] + self._at[1] - self._pressed[1],
        )
        x, y = drag_handle(start.shading, volume, handle, place, projected)
        return cuts.move_handle(state, handle, x, y)

    def _follow(self, given: Input) -> None:
        if given.name == "press":
            self._down.add(given.button)
        elif given.name == "release":
            self._down.discard(given.button)
        self._gestures.take(given, time.perf_counter())
        if given.name in ("press", "release", "move"):
            self._at = given.x, given.y


def _turned_deg(middle: Place, before: Place, after: Place) -> float:
    """By how much a place has gone clockwise around another."""
    first, last = (math.atan2(at[1] - middle[1], at[0] - middle[0]) for at in (before, after))
    return math.degrees(math.remainder(last - first, 2 * math.pi))


def _inside(place: Place, area: Area) -> bool:
    x, y, width, height = area
    return x <= place[0] < x + width and y <= place[1] < y + height


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
