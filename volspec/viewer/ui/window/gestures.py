"""What counts as one gesture, which undo takes back whole.

Input -> [gestures] -> number -> history

A drag is one, from the press to the release; so is a key, and a run of the wheel's notches or of a
key that steps.
"""

from __future__ import annotations

from volspec.viewer.ui.window.inputs import STEPPING, Input

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
