"""Undo and redo over frozen states, and the cost of a change as a value.

    state, state -> [history] -> "cast" | "recompose" | "relight" | "frame" | None

A gesture, such as one drag, is one step.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Literal

from volspec.raycast import RaycastSpec
from volspec.viewer.model.edit import Edited
from volspec.viewer.model.materials import differ_in_spectra
from volspec.viewer.model.state import ViewState

# Of a cast with layers, other opacities are recomposed; otherwise that is a cast, too.
Stage = Literal["cast", "recompose", "relight", "frame"]

# The first stage that depends on each field of a state; lights never need a cast.
STAGES: dict[str, Stage] = {
    "document": "cast",
    "view": "cast",
    "transfer": "cast",
    "fields": "cast",
    "chosen_field": "frame",
    "shift": "cast",
    "shading": "cast",
    "size": "cast",
    "lights": "relight",
    "relight": "relight",
    "other": "relight",
    "room": "relight",
    "divide": "relight",
    "interface": "frame",
    "saved_lights": "frame",
    "fade": "frame",
    "palette": "relight",
    "annotations": "frame",
    "meshes": "cast",
    "depth": "recompose",
    "thickness": "cast",
    "unthickened": "frame",
}
# Fields that undo brings back though the picture is not lit again for them.
_STEPS = frozenset({"saved_lights", "annotations"})
MAX_UNDO = 200
ONE_VIEW = "A cast image has one view of fixed materials; open its scene to change them"
_ORDER: tuple[Stage, ...] = ("cast", "recompose", "relight", "frame")
# Names of changes; the first match is used.
_WORDS = (
    ("palette", ("palette",)),  # before the spectra that the palette has designed
    ("view", ("view",)),
    ("paint", ("room",)),
    ("lights", ("lights", "other", "divide")),
    ("light states", ("saved_lights",)),
    ("fields", ("fields",)),
    ("transfer function", ("transfer", "shift", "thickness")),
    ("meshes", ("meshes",)),
    ("viewing", ("relight",)),
    ("annotations", ("annotations",)),
    ("depth", ("depth",)),
)
_CUTS = ("clip_planes", "crop_voxels")


@dataclass(frozen=True, slots=True)
class Difference:
    """Fields of two states that differ: all of them if there was no state before."""

    old: ViewState | None
    new: ViewState
    fields: frozenset[str]

    @classmethod
    def between(cls, old: ViewState | None, new: ViewState) -> Difference:
        """Compare two states field by field."""
        if old is new:
            return cls(old, new, frozenset())
        names = (n for n in STAGES if old is None or getattr(old, n) != getattr(new, n))
        return cls(old, new, frozenset(names))

    @property
    def stage(self) -> Stage | None:
        """Return the first stage that must run again; None if nothing needs to be drawn."""
        return self._stage_of(self.fields)

    @property
    def relights(self) -> bool:
        """Return True if the current picture must be relit, even while another is being cast.

        Reflectances of materials that are channels are read when the picture is lit.
        """
        if self.old is None or self.old.transfer.basis is not self.new.transfer.basis:
            return True
        return any(STAGES[name] == "relight" for name in self.fields)

    @property
    def turns(self) -> bool:
        """Return True if nothing but the view needs a cast."""
        return {name for name in self.fields if STAGES[name] == "cast"} == {"view"}

    @property
    def undoable(self) -> bool:
        """Return True if the change is an undo step.

        The window's size and settings are none, nor is another time step of the document.
        """
        stage = self._stage_of(self.fields - {"size", "document"})
        return stage not in (None, "frame") or not self.fields.isdisjoint(_STEPS)

    @property
    def name(self) -> str:
        """Return the name of the change for the user."""
        for name, fields in _WORDS:
            if not self.fields.isdisjoint(fields):
                return name
        old, new = self.old and self.old.shading, self.new.shading
        if old and old.groups != new.groups:
            return "light sources"
        if old and _differ_in_opacities(old, new):
            return "opacity"
        cut = any(getattr(old, name, None) != getattr(new, name) for name in _CUTS)
        return "cuts" if cut else "shading"

    def _stage_of(self, fields: frozenset[str]) -> Stage | None:
        stages = {name: STAGES[name] for name in fields}
        old = self.old
        if "transfer" in fields and old and differ_in_spectra(old.transfer, self.new.transfer):
            stages["transfer"] = "relight"
        if "shading" in fields and old and _differ_in_opacities(old.shading, self.new.shading):
            stages["shading"] = "recompose"
        return min(stages.values(), key=_ORDER.index, default=None)


def _differ_in_opacities(old: RaycastSpec, new: RaycastSpec) -> bool:
    """Return True if nothing but the opacities of materials differs."""
    return replace(old, opacities=new.opacities) == new


def without_cast(old: ViewState, new: ViewState) -> Edited:
    """Return a state without the changes that need a cast: an image has one view only."""
    image = old.document.image
    if image is None:
        return Edited(new)
    names = (n for n, stage in STAGES.items() if stage == "cast" and n not in ("document", "size"))
    kept = {n: getattr(old, n) for n in names if getattr(old, n) != getattr(new, n)}
    if "transfer" in kept and differ_in_spectra(old.transfer, new.transfer):
        del kept["transfer"]
    if "shading" in kept and image.opacity_layers is not None:
        kept["shading"] = replace(old.shading, opacities=new.shading.opacities)
        if kept["shading"] == new.shading:
            del kept["shading"]
    edited = Edited(replace(new, unthickened=old.unthickened, **kept), ONE_VIEW)
    return edited if kept else Edited(new)


@dataclass(frozen=True, slots=True)
class History:
    """States before and after the current one; in both tuples the nearest is last."""

    present: ViewState
    past: tuple[ViewState, ...] = ()
    future: tuple[ViewState, ...] = ()
    gesture: int = -1  # number of the gesture that made the current state
    difference: Difference | None = None  # from the state before

    def then(self, state: ViewState, gesture: int) -> History:
        """Continue with a state; a gesture is one step, however many states it makes."""
        difference = Difference.between(self.present, state)
        if not difference.undoable:
            return replace(self, present=state, difference=difference)
        if gesture == self.gesture:
            return replace(self, present=state, future=(), difference=difference)
        past = (*self.past, self.present)[-MAX_UNDO:]
        return History(state, past, (), gesture, difference)

    def step(self, state: ViewState) -> History:
        """Continue with a state that no gesture made, as a step of its own."""
        past = (*self.past, self.present)[-MAX_UNDO:]
        return History(state, past, difference=Difference.between(self.present, state))

    def amend(self, state: ViewState) -> History:
        """Replace the current state with a late result of its step."""
        difference = Difference.between(self.present, state)
        amended = replace(self, present=state, difference=difference)
        if "document" not in difference.fields:
            return amended
        # Undo keeps the time step, and earlier states must not keep those before in memory.
        past, future = (
            tuple(replace(step, document=state.document) for step in states)
            for states in (self.past, self.future)
        )
        return replace(amended, past=past, future=future)

    def undo(self) -> History:
        """Go one step back; the window stays as it is."""
        if not self.past:
            return self
        return self._moved_to(self.past[-1], self.past[:-1], (*self.future, self.present))

    def redo(self) -> History:
        """Go one step forward again."""
        if not self.future:
            return self
        return self._moved_to(self.future[-1], (*self.past, self.present), self.future[:-1])

    def _moved_to(
        self, state: ViewState, past: tuple[ViewState, ...], future: tuple[ViewState, ...]
    ) -> History:
        now = self.present
        interface = now.interface
        if state.lights != now.lights:  # the chosen light belongs to them
            interface = replace(interface, light=state.interface.light)
        state = replace(state, document=now.document, size=now.size, interface=interface, fade=None)
        return History(state, past, future, difference=Difference.between(now, state))
