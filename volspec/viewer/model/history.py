"""Undo and redo over frozen states, and the cost of a change as a value.

    state, state -> [history] -> "cast" | "relight" | "frame" | None

A gesture, such as one drag, is one step.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Literal

from volspec.viewer.model.palette_spectra import repainted
from volspec.viewer.model.state import ViewState

Stage = Literal["cast", "relight", "frame"]

# Field by field; a light is not among those that cast.
STAGES: dict[str, Stage] = {
    "document": "cast",
    "view": "cast",
    "transfer": "cast",
    "shift": "cast",
    "shading": "cast",
    "size": "cast",
    "lights": "relight",
    "seen": "relight",
    "other": "relight",
    "divide": "relight",
    "interface": "frame",
    "kept": "frame",
    "fade": "frame",
    "board": "relight",
    "thickness": "cast",
    "thin": "frame",
}


def stale_stage(old: ViewState | None, new: ViewState) -> Stage | None:
    """The first stage whose result two states do not share.

    Parameters
    ----------
    old : ViewState or None
        What is shown; None where nothing is.
    new : ViewState
        What shall be.

    Returns
    -------
    "cast", "relight", "frame" or None
        None where the window can stay as it is.
    """
    if old is None:
        return "cast"
    if old is new:
        return None
    differ = [name for name in STAGES if getattr(old, name) != getattr(new, name)]
    found = {STAGES[name] for name in differ}
    if "transfer" in differ and repainted(old.transfer, new.transfer):
        # Other reflectances of materials that are channels are read when the picture is lit.
        found = {STAGES[name] for name in differ if name != "transfer"} | {"relight"}
    order: tuple[Stage, ...] = ("cast", "relight", "frame")
    return next((stage for stage in order if stage in found), None)


def lit_otherwise(old: ViewState | None, new: ViewState) -> bool:
    """Whether the picture that is shown must be lit anew, be another under way or not."""
    if old is None:
        return True
    lighting = (name for name, stage in STAGES.items() if stage == "relight")
    differs = any(getattr(old, name) != getattr(new, name) for name in lighting)
    return differs or old.transfer.basis is not new.transfer.basis


MOST_STEPS = 200
# What a step has changed, in words; the first that fits.
_WHAT = (
    ("palette", ("board",)),  # before the spectra that it has designed
    ("view", ("view",)),
    ("lights", ("lights", "other", "divide")),
    ("light states", ("kept",)),
    ("transfer function", ("transfer", "shift", "thickness")),
    ("viewing", ("seen",)),
)
_CUTS = ("clip_planes", "crop_voxels")


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
        interface = now.interface
        if state.lights != now.lights:  # which one was chosen goes with them
            interface = replace(interface, light=state.interface.light)
        return replace(state, size=now.size, interface=interface, fade=None)


def changed_in(old: ViewState, new: ViewState) -> str:
    """What two states differ in, in words."""
    for what, names in _WHAT:
        if any(getattr(old, name) != getattr(new, name) for name in names):
            return what
    if any(getattr(old.shading, name) != getattr(new.shading, name) for name in _CUTS):
        return "cuts"
    return "shading"
