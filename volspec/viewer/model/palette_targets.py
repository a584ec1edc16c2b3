"""Targets of the palette: colours of cells, and the spectra that may change for them.

    palette_edits -> [palette_targets] -> Palette -> designs

The spectra themselves are in the state's transfer function and lights. Targets are part of the
state, so that undo reverts both together.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from types import MappingProxyType

from volspec.palette import Apart, Cell, Criteria, Place, Triple
from volspec.viewer.model.view import clamp

REFLECTANCE, LIGHT = "reflectance", "light"
Member = tuple[str, str]
"""Kind, `REFLECTANCE` or `LIGHT`, and name."""

# Weight of a cell that should keep its colour if possible; a target's weight is 1.
STAY = 0.05
WEIGHTS = (0.05, 20.0)
DISTANCES = (1.0, 100.0)
MIN_SMOOTHNESS = 1e-4
CRITERIA = {"smoothness": (0.0, 1.0), "rounds": (1, 20)}


@dataclass(frozen=True, slots=True, eq=False)
class DesignTargets:
    """Targets of cells, and the spectra that may change for them."""

    cells: Mapping[Place, Cell] = field(default_factory=dict)  # by material and light
    free: frozenset[Member] = frozenset()  # spectra that are designed; all others are given
    constant: frozenset[str] = frozenset()  # materials that should have one colour in every light
    # Real lamps by free light: the light must be a sum of them.
    lamps: Mapping[str, tuple[str, ...]] = field(default_factory=dict)
    criteria: Criteria = field(default_factory=Criteria)
    apart: tuple[Apart, ...] = ()  # materials to be distinguished, listed by name

    def __post_init__(self) -> None:
        object.__setattr__(self, "cells", MappingProxyType(dict(self.cells)))
        object.__setattr__(self, "lamps", MappingProxyType(dict(self.lamps)))

    def with_light_renamed(self, old: str, new: str) -> DesignTargets:
        """Return the targets with a light renamed; unchanged if they do not name it."""

        def renamed(place: Place) -> Place:
            return place[0], new if place[1] == old else place[1]

        cells = {
            renamed(place): replace(cell, other=cell.other and renamed(cell.other))
            for place, cell in self.cells.items()
        }
        free = frozenset(renamed(member) if member[0] == LIGHT else member for member in self.free)
        lamps = {new if name == old else name: parts for name, parts in self.lamps.items()}
        apart = tuple(
            replace(row, light=tuple(new if name == old else name for name in row.light))
            for row in self.apart
        )
        old_parts = self.cells, self.free, self.lamps, self.apart
        if (cells, free, lamps, apart) == old_parts:
            return self
        return replace(self, cells=cells, free=free, lamps=lamps, apart=apart)


@dataclass(frozen=True, slots=True)
class PaletteState:
    """Targets, and the targets that the state's spectra were last designed for."""

    targets: DesignTargets = field(default_factory=DesignTargets)
    designed_for: DesignTargets | None = None
    # Start the design without the current spectra: it may find another optimum.
    from_scratch: bool = False

    def with_light_renamed(self, old: str, new: str) -> PaletteState:
        """Return the palette with a light renamed."""
        targets = self.targets.with_light_renamed(old, new)
        designed_for = targets if self.designed_for is self.targets else self.designed_for
        return replace(self, targets=targets, designed_for=designed_for)

    @property
    def is_pending(self) -> bool:
        """Return True if there is something to design that has not been designed."""
        targets = self.targets
        return bool(targets.free and targets.cells) and self.designed_for is not targets

    def with_targets(self, targets: DesignTargets) -> PaletteState:
        """Return the palette with other targets, not designed yet."""
        return PaletteState(targets, self.designed_for)


@dataclass(frozen=True, slots=True)
class Pick:
    """Choices in the panel, for wizards and materials of values; changes are not undo steps."""

    place: Place | None = None  # the chosen cell, whose material and light wizards redesign
    materials: frozenset[str] = frozenset()  # to merge
    within: str = ""  # the material to hide in; empty for the hidden one's surroundings
    black: bool = False  # hide it in black instead
    like: str = ""  # design a new light like this one of the scene; empty for none
    distance: float = 20.0  # ΔE by which a material is revealed
    use: str = ""  # the material to assign to a range of values
    values: tuple[float, float] | None = None  # that range, low and high


@dataclass(frozen=True, slots=True)
class DesignStatus:
    """Messages about designs and wizards, for the panel."""

    busy: str = ""  # the task in progress; empty if there is none
    complaint: str = ""  # error message of the last design or wizard
    advice: tuple[str, ...] = ()  # changes that would help to meet missed targets
    reached: tuple[str, ...] = ()  # results of the last wizard


def as_kind(kind: str, old: Cell | None, codes: Triple, other: Place | None) -> Cell | None:
    """Return a cell's target of another kind and the same weight.

    A kind that compares two cells refers to ``other``. A new colour starts from the codes
    ``codes``. Any kind that is not one of `Cell.kind` removes the target.
    """
    weight = old.weight if old else 1.0
    if kind == "colour":
        return Cell(colour=old.colour if old and old.colour else codes, weight=weight)
    if kind == "free":
        return Cell("free", group=old.group if old and old.group else "one colour", weight=weight)
    if kind == "black":
        return Cell("black", weight=weight)
    if kind == "same" and other:
        return Cell("same", other=other, weight=weight)
    if kind == "distinct" and other:
        finite = weight if math.isfinite(weight) else 1.0
        return Cell("distinct", other=other, weight=finite, distance=20.0)
    return None


def stays(cell: Cell) -> bool:
    """Return True if a cell should only keep its colour, as far as other targets allow."""
    return cell.kind == "colour" and cell.weight <= STAY


def clip_codes(codes: Triple) -> Triple:
    """Return a display's codes, clipped to 0 to 1."""
    red, green, blue = (clamp(float(code), 0.0, 1.0) for code in codes)
    return red, green, blue
