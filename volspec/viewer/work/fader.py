"""The clock of cross-fades between light states.

    state -> [fader] -> state as shown -> panels, relight

The state holds a fade's end from its first moment, so that a fade is one step of undo, and ends
exactly there. Panels work on what is shown; what they change there stops the fade.
"""

from __future__ import annotations

from dataclasses import replace

from volspec.viewer.model.light_rows import Fade
from volspec.viewer.model.light_states import interpolate_lights
from volspec.viewer.model.state import ViewState


class Fader:
    """Shows a state's fade as time goes by.

    Attributes
    ----------
    running : bool
        Whether more frames are wanted.
    """

    def __init__(self) -> None:
        self.running = False
        self._fade: Fade | None = None
        self._began = 0.0

    def shown(self, state: ViewState, now: float) -> ViewState:
        """A state with the lights of this moment.

        Parameters
        ----------
        state : ViewState
        now : float
            Seconds.
        """
        fade = state.fade
        if fade is not self._fade:
            self._fade, self._began = fade, now
        share = 1.0
        if fade is not None and fade.seconds > 0:
            share = (now - self._began) / fade.seconds
        self.running = share < 1.0
        if fade is None or not self.running:
            return state
        lights, spec = interpolate_lights(
            (fade.lights, fade.relight), (state.lights, state.relight), share
        )
        return replace(state, lights=lights, relight=spec)

    def to_keep(self, state: ViewState, shown: ViewState, new: ViewState) -> ViewState:
        """What input has made of the shown state, as it is to be kept.

        Parameters
        ----------
        state, shown : ViewState
            As they were given to `shown`, and came from it.
        new : ViewState
            After input.
        """
        if shown is state or new.fade is not shown.fade:
            return new
        if new.lights is shown.lights and new.relight is shown.relight:
            return replace(new, lights=state.lights, relight=state.relight)
        return replace(new, fade=None)
