"""A palette: lights are columns, reflectances rows, and their cells say which colours are wanted.

    spectra, appearance -> [model] -> criteria -> solve -> design -> report

References
----------
[1] Bergner, Drew & Möller (2009), ACM TOG 28(1) art. 5, section 3.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from types import MappingProxyType

import numpy as np

from volspec.appearance.spec import Viewing
from volspec.basis import SpectralBasis
from volspec.errors import PaletteError, nearest
from volspec.palette.members import PaletteSpectrum
from volspec.spectra import DEFAULT_GRID, SpectralGrid

Place = tuple[str, str]
"""A cell: names of its reflectance and of its light."""
Triple = tuple[float, float, float]

KINDS = ("colour", "free", "black", "same", "distinct")
METRICS = ("Lab", "RGB")
LEVELS = ("relative", "absolute")


@dataclass(frozen=True, slots=True)
class Cell:
    """What is wanted where a light meets a reflectance. A place without a cell does not matter.

    Parameters
    ----------
    kind : str
        ``"colour"``: this colour. ``"black"``: none at all, a metameric black. ``"free"``: the
        colour of all cells of the ``group``, which the solver picks (metamers). ``"same"``: the
        colour of the cell ``other``. ``"distinct"``: as far from ``other`` as can be.
    colour : (3,) floats, optional
        The display's codes, 0 to 1.
    group : str
        Name of a free colour.
    other : (reflectance, light), optional
    weight : float
        Importance beside the others, above 0; infinity: it must be met exactly.
    low, high : (3,) floats
        Bounds of a free colour, the display's codes.
    distance : float
        Of a distinct cell: the ΔE in CIELAB that is enough.

    Raises
    ------
    PaletteError
        If the kind lacks what it needs or a number is out of range.
    """

    kind: str = "colour"
    colour: Triple | None = None
    group: str = ""
    other: Place | None = None
    weight: float = 1.0
    low: Triple = (0.0, 0.0, 0.0)
    high: Triple = (1.0, 1.0, 1.0)
    distance: float = 100.0

    def __post_init__(self) -> None:
        if self.kind not in KINDS:
            raise PaletteError(
                f"cell: kind is {self.kind!r}; {nearest(str(self.kind), KINDS)}"
                f"expected {', '.join(KINDS)}"
            )
        needs = {"colour": "colour", "free": "group", "same": "other", "distinct": "other"}
        for name in ("colour", "group", "other"):
            needed, given = needs.get(self.kind) == name, bool(getattr(self, name))
            if needed != given:
                raise PaletteError(
                    f"cell: kind {self.kind!r} {'needs' if needed else 'takes no'} {name}"
                )
        for name in ("weight", "distance"):
            value = getattr(self, name)
            if not (isinstance(value, int | float) and value > 0.0):
                raise PaletteError(f"cell: {name} is {value!r}; expected a number above 0")
        if not math.isfinite(self.distance):
            raise PaletteError("cell: distance is infinite; 100 is from black to white")
        if self.kind == "distinct" and math.isinf(self.weight):
            raise PaletteError("cell: a distinct cell has no exact answer; give a finite weight")
        for name in ("colour", "low", "high"):
            if (value := getattr(self, name)) is not None:
                object.__setattr__(self, name, _codes(name, value))
        if any(low > high for low, high in zip(self.low, self.high, strict=True)):
            raise PaletteError(f"cell: low {self.low} lies above high {self.high}; swap them")

    @property
    def wanted(self) -> Triple | None:
        """Codes of the colour that is asked for, black included; None where none is."""
        return (0.0, 0.0, 0.0) if self.kind == "black" else self.colour


def _codes(name: str, value: object) -> Triple:
    try:
        array = np.asarray(value, dtype=np.float64)
    except (TypeError, ValueError):
        array = np.full(1, np.nan)
    if array.shape != (3,) or not ((array >= 0.0) & (array <= 1.0)).all():
        raise PaletteError(
            f"cell: {name} is {value!r:.60}; expected three display codes within 0 to 1, as no "
            "display shows more"
        )
    red, green, blue = array.tolist()
    return red, green, blue


@dataclass(frozen=True, slots=True)
class Criteria:
    """What counts in a design beside its cells.

    Parameters
    ----------
    smoothness : float
        ω_D of [1, eq. 22]: weight of second differences, at least 0; a flat curve costs nothing.
    subspace : float
        ω_F: weight of the difference between the colour of all bands and that of the basis,
        componentwise; at least 0.
    metric : {"Lab", "RGB"}
        Colours are compared in CIELAB, linearised and solved again in every round, or in the
        display's linear RGB, as [1].
    rounds : int
        How often lights and reflectances take turns, and CIELAB is linearised anew; the best
        is kept.
    """

    smoothness: float = 1e-3
    subspace: float = 0.0
    metric: str = "Lab"
    rounds: int = 8

    def __post_init__(self) -> None:
        for name in ("smoothness", "subspace"):
            value = getattr(self, name)
            if not (isinstance(value, int | float) and math.isfinite(value) and value >= 0.0):
                raise PaletteError(f"criteria: {name} is {value!r}; expected a number, at least 0")
        if self.metric not in METRICS:
            raise PaletteError(
                f"criteria: metric is {self.metric!r}; {nearest(str(self.metric), METRICS)}"
                f"expected {' or '.join(METRICS)}"
            )
        if not (isinstance(self.rounds, int) and self.rounds >= 1):
            raise PaletteError(f"criteria: rounds is {self.rounds!r}; expected 1 or more")


@dataclass(frozen=True, slots=True, eq=False)
class Palette:
    """Lights, reflectances, and the colours wanted where they meet.

    Parameters
    ----------
    reflectances, lights : tuple of PaletteSpectrum
        Rows and columns; those that are ``open`` are designed, the others stay.
    cells : {(reflectance, light): Cell}
    viewing : Viewing
        How colours are seen: a wanted colour is what the display shows under the viewing's model
        and exposure, so ``"none"`` asks for the tristimulus values themselves.
    grid : SpectralGrid
        The bands; 31 by default.
    criteria : Criteria
    level : {"relative", "absolute"}
        Whether every designed light has the luminance Y = 100 (a picture's white), or whatever
        its colours need. Given lights have Y = 100.
    basis : SpectralBasis, optional
        For `Criteria.subspace`; on the palette's grid.

    Raises
    ------
    PaletteError
        If it is empty, a name is unknown or there twice, nothing is open, or a cell asks for a
        colour of what cannot change.
    """

    reflectances: tuple[PaletteSpectrum, ...]
    lights: tuple[PaletteSpectrum, ...]
    cells: Mapping[Place, Cell]
    viewing: Viewing = field(default_factory=lambda: Viewing(model="none"))
    grid: SpectralGrid = DEFAULT_GRID
    criteria: Criteria = field(default_factory=Criteria)
    level: str = "relative"
    basis: SpectralBasis | None = None

    def __post_init__(self) -> None:
        for name in ("reflectances", "lights"):
            members = tuple(getattr(self, name))
            object.__setattr__(self, name, members)
            if not members:
                raise PaletteError(f"palette: there are no {name}; give at least one")
            names = [member.name for member in members]
            if twice := next((n for n in names if names.count(n) > 1), None):
                raise PaletteError(f"palette: two {name} are named {twice!r}; rename one")
        object.__setattr__(self, "cells", MappingProxyType(dict(self.cells)))
        if not self.cells:
            raise PaletteError("palette: there are no cells; say at least one wanted colour")
        if self.level not in LEVELS:
            raise PaletteError(
                f"palette: level is {self.level!r}; {nearest(str(self.level), LEVELS)}"
                f"expected {' or '.join(LEVELS)}"
            )
        if self.criteria.subspace and (self.basis is None or self.basis.grid != self.grid):
            raise PaletteError(
                f"palette: criteria.subspace is {self.criteria.subspace:g}, but the basis is "
                f"{'missing' if self.basis is None else f'on {self.basis.grid}'}; give one on "
                f"{self.grid}"
            )
        if self.criteria.subspace and self.basis is not None and self.basis.observer_deg != 2:
            raise PaletteError(
                f"palette: the basis {self.basis.name!r} is for the "
                f"{self.basis.observer_deg} degree observer, palettes for that of 2 degrees; fit "
                "one for it"
            )
        for place, cell in self.cells.items():
            for reflectance, light in (place, cell.other or place):
                self.member("reflectance", reflectance)
                self.member("light", light)
            if cell.other == place:
                raise PaletteError(f"palette: cell {place} is compared with itself; name another")
        for cell in self.cells.values():
            if cell.kind == "free":
                low, high = self.free_bounds(cell.group)
                if any(one > other for one, other in zip(low, high, strict=True)):
                    raise PaletteError(
                        f"palette: the free colour {cell.group!r} has cells whose bounds exclude "
                        f"each other, low {low} and high {high}; widen them"
                    )
        if not any(member.open for member in (*self.reflectances, *self.lights)):
            raise PaletteError("palette: every spectrum is given, none is open; open one to design")

    @property
    def names(self) -> tuple[tuple[str, ...], tuple[str, ...]]:
        """Of the reflectances and of the lights."""
        rows, columns = self.reflectances, self.lights
        return tuple(r.name for r in rows), tuple(c.name for c in columns)

    def free_bounds(self, group: str) -> tuple[Triple, Triple]:
        """Display codes, lowest and highest, that all cells of a free colour allow."""
        own = [cell for cell in self.cells.values() if cell.group == group]
        low = np.max([(0.0, 0.0, 0.0), *(cell.low for cell in own)], axis=0)
        high = np.min([(1.0, 1.0, 1.0), *(cell.high for cell in own)], axis=0)
        return _codes("low", low), _codes("high", high)

    def index(self, place: Place) -> tuple[int, int]:
        """Row and column of a place."""
        rows, columns = self.names
        return rows.index(place[0]), columns.index(place[1])

    def member(self, kind: str, name: str) -> PaletteSpectrum:
        """A ``"light"`` or a ``"reflectance"`` by its name.

        Raises
        ------
        PaletteError
            If there is none of that name.
        """
        members = self.lights if kind == "light" else self.reflectances
        found = next((member for member in members if member.name == name), None)
        if found is None:
            names = [member.name for member in members]
            raise PaletteError(
                f"palette: no {kind} is named {name!r}; {nearest(name, names)}"
                f"there is {', '.join(names)}"
            )
        return found

    def with_exposure(self, exposure: float) -> Palette:
        """The same, lit by so much more: `Viewing.exposure`."""
        return replace(self, viewing=replace(self.viewing, exposure=exposure))
