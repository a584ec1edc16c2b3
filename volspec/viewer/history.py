"""Undo and redo over frozen states: a gesture, such as one drag, is one step."""

from __future__ import annotations

from dataclasses import dataclass, replace

from volspec.viewer.stale import stale_stage
from volspec.viewer.state import ViewState

MOST_STEPS = 200


@dataclass(frozen=True, slots=True)
class History:
    """States before and after the present one.

    Parameters
    ----------
    present : ViewState
    past, future : tuple of ViewState
        The nearest last.
    gesture : int
        That made the present state.
    """

    present: ViewState
    past: tuple[ViewState, ...] = ()
    future: tuple[ViewState, ...] = ()
    gesture: int = -1

    def then(self, state: ViewState, gesture: int) -> History:
        """Go on to a state; of one gesture only the start is kept."""
        old = self.present
        same = state.kept == old.kept
        if same and stale_stage(old, replace(state, size=old.size)) in (None, "frame"):
            return replace(self, present=state)
        if gesture == self.gesture:
            return replace(self, present=state, future=())
        return History(state, (*self.past, old)[-MOST_STEPS:], (), gesture)

    def step(self, state: ViewState) -> History:
        """Go on to a state that nobody's hand made: a step of its own."""
        return History(state, (*self.past, self.present)[-MOST_STEPS:])

    def amended(self, state: ViewState) -> History:
        """The present step, completed: what follows from it took its time."""
        return replace(self, present=state)

    def undone(self) -> History:
        """One step back; the window stays as it is."""
        if not self.past:
            return self
        future = (*self.future, self.present)
        return History(self._here(self.past[-1]), self.past[:-1], future)

    def redone(self) -> History:
        """One step forth again."""
        if not self.future:
            return self
        past = (*self.past, self.present)
        return History(self._here(self.future[-1]), past, self.future[:-1])

    def _here(self, state: ViewState) -> ViewState:
        now = self.present
        return replace(state, size=now.size, interface=now.interface, fade=None)
