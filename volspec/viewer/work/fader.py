"""The clock of cross-fades between light states.

    state -> [fader] -> state as shown -> panels, relight

The state has a fade's end from its first moment, so that a fade is one step of undo. Panels work on
the shown state; an edit of the lights there stops the fade.
"""

from __future__ import annotations

from dataclasses import replace

from volspec.viewer.model.light_rows import Fade
from volspec.viewer.model.light_states import interpolate_lights
from volspec.viewer.model.state import ViewState


class Fader:
    """Shows a state's fade; ``running`` is True while it needs more frames."""

    def __init__(self) -> None:
        self.running = False
        self._fade: Fade | None = None
        self._began = 0.0

    def shown(self, state: ViewState, now: float) -> ViewState:
        """Return a state with its lights at a time in seconds."""
        fade = state.fade
        if fade is not self._fade:
            self._fade, self._began = fade, now
        elapsed = now - self._began
        self.running = fade is not None and elapsed < fade.seconds
        if fade is None or not self.running:
            return state
        start, end = (fade.lights, fade.relight), (state.lights, state.relight)
        lights, spec = interpolate_lights(start, end, elapsed / fade.seconds)
        return replace(state, lights=lights, relight=spec)

    def to_keep(self, state: ViewState, shown: ViewState, new: ViewState) -> ViewState:
        """Return the state for the history, after input made ``new`` of the shown one."""
        if shown is state or new.fade is not shown.fade:
            return new
        if new.lights is shown.lights and new.relight is shown.relight:
            return replace(new, lights=state.lights, relight=state.relight)
        return replace(new, fade=None)
