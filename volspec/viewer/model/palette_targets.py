"""Targets of the palette: colours of cells, and which spectra may change for them.

    palette_edits -> [palette_targets] -> Palette -> designs

The spectra themselves are in the state's transfer function and lights; what was wanted of them is
here, so that undo takes both back together.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from types import MappingProxyType

from volspec.palette import Cell, Criteria
from volspec.palette.model import Place, Triple

REFLECTANCE, LIGHT = "reflectance", "light"
Member = tuple[str, str]
"""Kind, `REFLECTANCE` or `LIGHT`, and name."""

# Weight of a cell that is only to stay as it was, if it can; a target of its own has 1.
STAY = 0.05
WEIGHTS = (0.05, 20.0)
DISTANCES = (1.0, 100.0)
SMOOTHNESS = (1e-4, 1.0)
MOST_ROUNDS = 20
# The group that cells left free belong to at first.
GROUP = "one colour"


@dataclass(frozen=True, slots=True, eq=False)
class DesignTargets:
    """What is wanted, and what may change for it.

    Parameters
    ----------
    cells : {(material, light): Cell}
    open : set of (kind, name)
        Spectra that are designed; all others are given.
    constant : set of str
        Materials that are to show one colour under every light.
    lamps : {light: names}
        Open lights that are to be a sum of these.
    criteria : Criteria
    """

    cells: Mapping[Place, Cell] = field(default_factory=dict)
    open: frozenset[Member] = frozenset()
    constant: frozenset[str] = frozenset()
    lamps: Mapping[str, tuple[str, ...]] = field(default_factory=dict)
    criteria: Criteria = field(default_factory=Criteria)

    def __post_init__(self) -> None:
        object.__setattr__(self, "cells", MappingProxyType(dict(self.cells)))
        object.__setattr__(self, "lamps", MappingProxyType(dict(self.lamps)))

    def with_cell(self, place: Place, cell: Cell | None) -> DesignTargets:
        """The same with another target at a place; None asks for nothing there."""
        cells = {at: own for at, own in self.cells.items() if at != place}
        if cell is not None:
            cells[place] = cell
        return replace(self, cells=cells)

    def with_light_renamed(self, old: str, new: str) -> DesignTargets:
        """The same for a light that is called something else; itself where none is about it."""

        def now(name: str) -> str:
            return new if name == old else name

        def moved(cell: Cell) -> Cell:
            other = cell.other
            return replace(cell, other=(other[0], now(other[1]))) if other else cell

        about = {light for _, light in self.cells} | {name for _, name in self.open}
        about |= {cell.other[1] for cell in self.cells.values() if cell.other} | {*self.lamps}
        if old not in about:
            return self
        return replace(
            self,
            cells={(row, now(name)): moved(cell) for (row, name), cell in self.cells.items()},
            open=frozenset((k, now(name) if k == LIGHT else name) for k, name in self.open),
            lamps={now(name): lamps for name, lamps in self.lamps.items()},
        )

    def toggled(self, member: Member) -> DesignTargets:
        """The same with a spectrum open that was given, or the other way round."""
        return replace(self, open=self.open ^ {member})


@dataclass(frozen=True, slots=True)
class PaletteState:
    """Wishes, and how far the spectra have followed them.

    Parameters
    ----------
    targets : DesignTargets
    designed_for : DesignTargets, optional
        Those that the state's spectra were last designed for.
    from_scratch : bool
        Begin without the spectra that are there: another optimum may be found.
    """

    targets: DesignTargets = field(default_factory=DesignTargets)
    designed_for: DesignTargets | None = None
    from_scratch: bool = False

    def with_light_renamed(self, old: str, new: str) -> PaletteState:
        """The same targets for a light that is called something else."""
        targets = self.targets.with_light_renamed(old, new)
        designed_for = targets if self.designed_for is self.targets else self.designed_for
        return replace(self, targets=targets, designed_for=designed_for)

    @property
    def is_pending(self) -> bool:
        """Whether there is something to design that has not been."""
        return (
            bool(self.targets.open and self.targets.cells) and self.designed_for is not self.targets
        )

    def with_targets(self, targets: DesignTargets) -> PaletteState:
        """Other targets, not answered yet."""
        return PaletteState(targets, self.designed_for)


@dataclass(frozen=True, slots=True)
class Pick:
    """What is chosen in the panel: the window's own, no step of undo.

    Parameters
    ----------
    place : (material, light), optional
        The chosen cell: what wizards are about.
    materials : set of str
        That are to be merged.
    within : str
        What a material is hidden in; empty: what surrounds it.
    black : bool
        Hide it as nothing instead.
    like : str
        Design a new light like this one of the scene; empty: none.
    distance : float
        ΔE by which a material is revealed.
    use : str
        The material that a range of values is to be of.
    values : (low, high), optional
        That range.
    """

    place: Place | None = None
    materials: frozenset[str] = frozenset()
    within: str = ""
    black: bool = False
    like: str = ""
    distance: float = 20.0
    use: str = ""
    values: tuple[float, float] | None = None


@dataclass(frozen=True, slots=True)
class DesignStatus:
    """What threads have to say about the design, for the panel.

    Parameters
    ----------
    busy : str
        What is under way; empty: nothing.
    complaint : str
        Why the last design or wizard was refused.
    advice : tuple of str
        What would help the targets that are missed.
    reached : tuple of str
        What the last wizard came to.
    """

    busy: str = ""
    complaint: str = ""
    advice: tuple[str, ...] = ()
    reached: tuple[str, ...] = ()


def as_kind(kind: str, own: Cell | None, shown: Triple, other: Place | None) -> Cell | None:
    """A cell's target of another kind, its weight kept.

    Parameters
    ----------
    kind : str
        As `Cell.kind`; another word asks for nothing.
    own : Cell, optional
        The target as it was.
    shown : (3,) floats
        The colour that is there, which a fixed one begins with.
    other : (material, light), optional
        What it is compared with.
    """
    weight = own.weight if own else 1.0
    if kind == "colour":
        return Cell(colour=own.colour if own and own.colour else shown, weight=weight)
    if kind == "free":
        return Cell("free", group=own.group if own and own.group else GROUP, weight=weight)
    if kind == "black":
        return Cell("black", weight=weight)
    if kind == "same" and other:
        return Cell("same", other=other, weight=weight)
    if kind == "distinct" and other:
        finite = weight if math.isfinite(weight) else 1.0
        return Cell("distinct", other=other, weight=finite, distance=20.0)
    return None


def stays(cell: Cell) -> bool:
    """Whether a colour is only to stay, as far as targets of weight leave it."""
    return cell.kind == "colour" and cell.weight <= STAY


def clipped(codes: Triple) -> Triple:
    """Codes as a display has them, 0 to 1."""
    red, green, blue = (min(max(float(code), 0.0), 1.0) for code in codes)
    return red, green, blue
