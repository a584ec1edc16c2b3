"""The mouse in the picture: from what a window reports to events.

Window -> Input -> [mouse] -> Event -> state
"""

from __future__ import annotations

from imgui_bundle import imgui

from volspec.viewer.events import Event, reduced
from volspec.viewer.inputs import Input
from volspec.viewer.state import ViewState

# So near to the divide the mouse takes hold of it.
GRIP = 8
DRAGS = {"left": "orbit", "middle": "pan", "right": "zoom"}


class Mouse:
    """Knows which drag is under way, and what a gesture is.

    A gesture ends with the button's release, or is one key; undo takes it back whole.
    """

    def __init__(self) -> None:
        self.gesture = 0
        self.over_picture: tuple[float, float] | None = None
        self._down: set[str] = set()
        self._drag = self._event = ""
        self._at = (-1.0, -1.0)  # unknown, and not over the picture

    @property
    def held(self) -> bool:
        """Whether a button is down."""
        return bool(self._down)

    def take(self, inputs: list[Input]) -> None:
        """Follow the buttons where there is nothing to change."""
        for given in inputs:
            self._follow(given)

    def applied(
        self, state: ViewState, inputs: list[Input], area: tuple[int, int, int, int]
    ) -> ViewState:
        """What inputs make of a state.

        Parameters
        ----------
        state : ViewState
        inputs : list of Input
        area : (x, y, width, height)
            Of the picture in the window.
        """
        io = imgui.get_io()
        x, y, width, height = area
        tall = max(height, 1)
        for given in inputs:
            before = self._at
            self._follow(given)
            free = not io.want_capture_mouse and _inside(self._at, area)
            if given.name == "press" and free and not self._drag:
                self._drag = given.button
                line = x + state.divide * width
                near = state.other is not None and abs(given.x - line) < GRIP
                self._event = "divide" if near else DRAGS[given.button]
            elif given.name == "release" and given.button == self._drag:
                self._drag = ""
            elif given.name == "move" and self._drag and self._event == "divide":
                state = reduced(state, Event("divide", (given.x - x) / max(width, 1)))
            elif given.name == "move" and self._drag:
                across, down = given.x - before[0], given.y - before[1]
                state = reduced(state, Event(self._event, across / tall, down / tall))
            elif given.name == "wheel" and free:
                state = reduced(state, Event("wheel", 0.0, given.y))
        inside = _inside(self._at, area) and not io.want_capture_mouse
        place = (self._at[0] - x) / max(width, 1), (self._at[1] - y) / tall
        self.over_picture = place if inside else None
        return state

    def _follow(self, given: Input) -> None:
        if given.name == "press":
            self._down.add(given.button)
        elif given.name == "release":
            self._down.discard(given.button)
        if given.name in ("press", "key", "wheel"):
            self.gesture += 1
        if given.name in ("press", "release", "move"):
            self._at = given.x, given.y


def _inside(place: tuple[float, float], area: tuple[int, int, int, int]) -> bool:
    x, y, width, height = area
    return x <= place[0] < x + width and y <= place[1] < y + height
