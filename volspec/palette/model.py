"""Palettes: lights are columns, reflectances are rows, and cells have the wanted colours.

Colours that any viewer must be able to distinguish are rows of their own, `Apart`.

    spectra, appearance -> [model] -> linearisation -> optimisation -> report

References
----------
[1] Bergner, Drew & Möller (2009), ACM TOG 28(1) art. 5, section 3.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import combinations
from types import MappingProxyType
from typing import Annotated, Literal, get_args

import numpy as np
from pydantic import Field

from volspec.appearance import Viewing
from volspec.appearance.display import DeficiencyName
from volspec.basis import SpectralBasis
from volspec.errors import Code, PaletteError, SpectrumError, nearest, quote
from volspec.palette.variables import PaletteSpectrum, fault
from volspec.settings import Fraction, Hint, NotNegative, Positive, settings
from volspec.spectra import DEFAULT_GRID, SpectralGrid
from volspec.spectra.construct import sRGB_from_word

Place = tuple[str, str]
"""Names of a cell's reflectance and light."""
Index = tuple[int, int]
"""Row and column of a cell."""
Triple = tuple[float, float, float]

KINDS = ("colour", "free", "black", "same", "distinct")
Metric = Literal["Lab", "RGB"]
Level = Literal["relative", "absolute"]
LEVELS: tuple[Level, ...] = get_args(Level)
_CODES_REMEDY = "give three display codes from 0 to 1"
EVERY = "*"
"""Instead of names: every light, or every reflectance."""
Names = Annotated[
    str | Annotated[tuple[str, ...], Field(strict=False)],
    Hint('a name, several, or "*" for all', whole=True),
]


@dataclass(frozen=True, slots=True)
class Cell:
    """Target colour of a reflectance under a light; places without a cell have no target.

    Parameters
    ----------
    kind : str
        ``"colour"``: the given colour. ``"black"``: black, reflecting nothing (a metameric black).
        ``"free"``: one colour for all cells of the ``group``, picked by the solver (metamers).
        ``"same"``: the colour of the cell ``other``. ``"distinct"``: as far from it as possible.
    colour : (3,) floats, optional
        Display codes, 0 to 1.
    group : str
        Name of a free colour.
    other : (reflectance, light), optional
    weight : float
        Importance relative to the other cells, above 0; infinity makes it an equality constraint.
    low, high : (3,) floats
        Bounds of a free colour, display codes.
    distance : float
        Sufficient ΔE in CIELAB of a distinct cell.

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
            remedy = f"{nearest(str(self.kind), KINDS)}expected {', '.join(KINDS)}"
            raise PaletteError.refused("Cell.kind", self.kind, remedy, "unknown")
        needs = {"colour": "colour", "free": "group", "same": "other", "distinct": "other"}
        for name in ("colour", "group", "other"):
            needed, present = needs.get(self.kind) == name, bool(getattr(self, name))
            if needed != present:
                problem = f"kind {self.kind!r} {'needs' if needed else 'cannot have'} {name}"
                code: Code = "missing" if needed else "conflict"
                raise fault(f"Cell.{name}", problem, code, getattr(self, name))
        for name in ("weight", "distance"):
            value = getattr(self, name)
            if not (isinstance(value, int | float) and value > 0.0):
                raise PaletteError.refused(f"Cell.{name}", value, "give a number above 0", "range")
        if not math.isfinite(self.distance):
            remedy = "give at most 100, from black to white"
            raise PaletteError.refused("Cell.distance", self.distance, remedy, "range")
        if self.kind == "distinct" and math.isinf(self.weight):
            remedy = "a distinct cell has no exact answer, give a finite weight"
            raise PaletteError.refused("Cell.weight", self.weight, remedy, "range")
        for name in ("colour", "low", "high"):
            if (value := getattr(self, name)) is not None:
                object.__setattr__(self, name, _display_codes(f"Cell.{name}", value, _CODES_REMEDY))
        if any(low > high for low, high in zip(self.low, self.high, strict=True)):
            remedy = f"it exceeds high {self.high}, swap them"
            raise PaletteError.refused("Cell.low", self.low, remedy, "conflict")

    @property
    def wanted(self) -> Triple | None:
        """Display codes of the target colour, black included; None if it has none of its own."""
        return (0.0, 0.0, 0.0) if self.kind == "black" else self.colour


def _display_codes(field: str, value: object, remedy: str) -> Triple:
    """Return three display codes; refuse anything but three numbers from 0 to 1."""
    try:
        red, green, blue = np.asarray(value, dtype=np.float64).tolist()
        codes = float(red), float(green), float(blue)
    except (TypeError, ValueError, OverflowError):
        raise PaletteError.refused(field, value, remedy, "type") from None
    if outside := [code for code in codes if not 0.0 <= code <= 1.0]:
        hint = "divide by 255" if 1.0 < max(outside) <= 255.0 else remedy
        problem = f"{quote(value)} has a code of {outside[0]:g}, which no display shows"
        raise fault(field, f"{problem}; {hint}", "range", value)
    return codes


def parse_colour(colour: str | Sequence[float]) -> Triple:
    """Return the display codes, 0 to 1, of a colour in hexadecimal, a CSS name, or three codes.

    >>> parse_colour("#f00"), parse_colour("white")
    ((1.0, 0.0, 0.0), (1.0, 1.0, 1.0))
    """
    remedy = "give [r, g, b] with codes 0 to 1"
    if not isinstance(colour, str):
        return _display_codes("colour", colour, remedy)
    try:
        red, green, blue = sRGB_from_word(colour, remedy.removeprefix("give "))
    except SpectrumError as error:
        raise PaletteError(
            error.problem, error.remedy, code=error.code, field=error.field, given=colour
        ) from None
    return float(red), float(green), float(blue)


def hexadecimal(codes: Iterable[float]) -> str:
    """Return display codes as ``#rrggbb``, clipped to the display.

    >>> hexadecimal((1.0, 0.5, -0.1))
    '#ff8000'
    """
    return "#" + "".join(f"{round(255 * min(max(code, 0.0), 1.0)):02x}" for code in codes)


@settings(PaletteError)
@dataclass(frozen=True, slots=True, kw_only=True)
class Apart:
    """Reflectances to be distinguished, pair by pair, by viewers with and without a deficiency.

    Examples
    --------
    >>> Apart(reflectance=("vein", "nerve"), deficiency=("none", "deutan")).distance
    20.0
    """

    reflectance: Annotated[Names, Field(examples=[["vein", "nerve"]])] = EVERY
    """Reflectances, each to be distinguished from each other."""
    light: Annotated[Names, Field(examples=["day"])] = EVERY
    """Lights under which to distinguish them."""
    deficiency: Annotated[
        DeficiencyName | Annotated[tuple[DeficiencyName, ...], Field(strict=False, min_length=1)],
        Hint("none, protan, deutan, tritan, or several", whole=True),
    ] = "none"
    """Colour-vision deficiencies of the viewers; none is normal vision, which is not implied."""
    severity: Fraction = 1.0
    """Severity of the deficiencies; 1 is dichromacy."""
    distance: Annotated[Positive, Field(le=100)] = 20.0
    """Sufficient ΔE (CIELAB) between the two colours as these viewers see them."""
    lightness: bool = True
    """false: only differences of a* and b* count, as shading changes lightness anyway."""
    weight: Positive = 1.0
    """Importance relative to the cells."""

    @property
    def deficiencies(self) -> tuple[DeficiencyName, ...]:
        """The deficiencies, each once."""
        names = self.deficiency
        return (names,) if isinstance(names, str) else tuple(dict.fromkeys(names))

    def renamed(self, reflectances: Mapping[str, str], lights: Mapping[str, str]) -> Apart | None:
        """Return the row with new names, without those that have none; None if no pair is left."""
        rows = tuple(reflectances[name] for name in _select_known(self.reflectance, reflectances))
        columns = tuple(lights[name] for name in _select_known(self.light, lights))
        return replace(self, reflectance=rows, light=columns) if rows[1:] and columns else None


def _select_known(value: str | tuple[str, ...], choices: Iterable[str]) -> list[str]:
    """Return those of the given names that are known, each once, in their order."""
    names = choices if value == EVERY else (value,) if isinstance(value, str) else value
    return [name for name in dict.fromkeys(names) if name in choices]


@dataclass(frozen=True, slots=True)
class ApartPair:
    """Two cells that a row of `Apart` asks to be distinguished."""

    row: Apart
    one: Index
    other: Index


@settings(PaletteError)
@dataclass(frozen=True, slots=True)
class Criteria:
    """Criteria of a design besides its cells."""

    smoothness: NotNegative = 1e-3
    """ω_D of [1, eq. 22]: weight of second differences; a flat curve costs nothing."""
    subspace: NotNegative = 0.0
    """ω_F: weight of the colour difference between all bands and the basis's componentwise
    product."""
    metric: Metric = "Lab"
    """Space in which colours are compared: CIELAB, linearised again in every iteration, or the
    display's linear RGB, as in [1]."""
    rounds: Annotated[int, Field(ge=1)] = 8
    """Iterations, each of which designs reflectances and lights in turn and linearises CIELAB
    again; the best result is kept."""


@dataclass(frozen=True, slots=True, eq=False)
class Palette:
    """Lights, reflectances, and the target colours of their products.

    Parameters
    ----------
    reflectances, lights : tuple of PaletteSpectrum
        Rows and columns; ``free`` ones are variables of the design, the others are given.
    cells : {(reflectance, light): Cell}
    viewing : Viewing
        Appearance model and exposure under which the display shows the target colours; with
        ``"none"``, target colours are plain tristimulus values.
    grid : SpectralGrid
        Bands; 81 by default.
    criteria : Criteria
    level : {"relative", "absolute"}
        Luminance of designed lights: Y = 100, a picture's white, or whatever their colours need.
        Given lights have Y = 100.
    basis : SpectralBasis, optional
        For `Criteria.subspace`; on the palette's grid.
    apart : tuple of Apart
        Reflectances to be distinguished, also by viewers with a colour-vision deficiency.

    Raises
    ------
    PaletteError
        If it is empty, a name is unknown or a duplicate, no spectrum is free, or the bounds of a
        free colour contradict each other.
    """

    reflectances: tuple[PaletteSpectrum, ...]
    lights: tuple[PaletteSpectrum, ...]
    cells: Mapping[Place, Cell]
    viewing: Viewing = field(default_factory=lambda: Viewing(model="none"))
    grid: SpectralGrid = DEFAULT_GRID
    criteria: Criteria = field(default_factory=Criteria)
    level: Level = "relative"
    basis: SpectralBasis | None = None
    apart: tuple[Apart, ...] = ()

    def __post_init__(self) -> None:
        for name in ("reflectances", "lights"):
            members = tuple(getattr(self, name))
            object.__setattr__(self, name, members)
            if not members:
                raise fault(f"Palette.{name}", "is empty; give at least one", "missing")
            names = [member.name for member in members]
            if twice := next((n for n in names if names.count(n) > 1), None):
                problem = f"two are named {twice!r}; rename one"
                raise fault(f"Palette.{name}", problem, "duplicate", twice)
        object.__setattr__(self, "cells", MappingProxyType(dict(self.cells)))
        object.__setattr__(self, "apart", tuple(self.apart))
        if not self.cells:
            problem = "is empty; give at least one wanted colour"
            raise fault("Palette.cells", problem, "missing")
        if self.level not in LEVELS:
            remedy = f"{nearest(str(self.level), LEVELS)}expected {' or '.join(LEVELS)}"
            raise PaletteError.refused("Palette.level", self.level, remedy, "unknown")
        if self.criteria.subspace:
            self._check_basis()
        self._check_cells()
        for number, row in enumerate(self.apart, start=1):
            rows, _ = self._apart_names(number, row)
            if len(rows) < 2:
                problem = f"row {number} has one reflectance, {rows[0]!r}; name another"
                raise fault("Palette.apart", problem, "missing", rows[0])
        if not any(member.free for member in (*self.reflectances, *self.lights)):
            problem = "every spectrum is given; make one free to design it"
            raise fault("Palette.reflectances", problem, "missing")

    def _check_basis(self) -> None:
        basis, subspace = self.basis, self.criteria.subspace
        if basis is None or basis.grid != self.grid:
            state = "missing" if basis is None else f"on {basis.grid}"
            problem = f"criteria.subspace is {subspace:g}, but the basis is {state}"
            code: Code = "missing" if basis is None else "conflict"
            raise fault("Palette.basis", f"{problem}; give one on {self.grid}", code)
        if basis.observer_deg != 2:
            problem = f"{basis.name!r} is for the {basis.observer_deg} degree observer"
            remedy = "but palettes use the 2 degree observer; fit a basis for it"
            raise fault("Palette.basis", f"{problem}, {remedy}")

    def _check_cells(self) -> None:
        for place, cell in self.cells.items():
            for reflectance, light in (place, cell.other or place):
                self.member("reflectance", reflectance)
                self.member("light", light)
            if cell.other == place:
                problem = f"cell {place} is compared with itself; name another"
                raise fault("Palette.cells", problem, given=place)
            if cell.kind == "free":
                low, high = self.free_bounds(cell.group)
                if any(one > other for one, other in zip(low, high, strict=True)):
                    problem = f"bounds of the free colour {cell.group!r} contradict each other:"
                    bounds = f"low {low} exceeds high {high}; widen them"
                    raise fault("Palette.cells", f"{problem} {bounds}", given=cell.group)

    @property
    def names(self) -> tuple[tuple[str, ...], tuple[str, ...]]:
        """Names of the reflectances and of the lights."""
        rows, columns = self.reflectances, self.lights
        return tuple(r.name for r in rows), tuple(c.name for c in columns)

    def free_bounds(self, group: str) -> tuple[Triple, Triple]:
        """Return the lowest and highest display codes that all cells of a free colour allow."""
        cells = [cell for cell in self.cells.values() if cell.group == group]
        low = np.max([(0.0, 0.0, 0.0), *(cell.low for cell in cells)], axis=0)
        high = np.min([(1.0, 1.0, 1.0), *(cell.high for cell in cells)], axis=0)
        return tuple(low.tolist()), tuple(high.tolist())

    def _apart_names(self, number: int, row: Apart) -> tuple[list[str], list[str]]:
        """Return the reflectances and lights of a row, each once; refuse unknown names."""
        selected = []
        for kind, value, choices in (
            ("reflectance", row.reflectance, self.names[0]),
            ("light", row.light, self.names[1]),
        ):
            names = choices if value == EVERY else (value,) if isinstance(value, str) else value
            unknown = next((name for name in names if name not in choices), None)
            if unknown is not None or not names:
                hint = f"{nearest(unknown or '', choices)}known: {', '.join(choices)}"
                problem = f"no {kind} is named {unknown!r}" if names else f"{kind} is empty"
                raise fault("Palette.apart", f"row {number}: {problem}; {hint}", "unknown", unknown)
            selected.append(list(dict.fromkeys(names)))
        return selected[0], selected[1]

    def apart_pairs(self) -> Iterator[ApartPair]:
        """Yield every pair of cells to be distinguished, light by light."""
        for number, row in enumerate(self.apart, start=1):
            rows, columns = self._apart_names(number, row)
            for column in columns:
                for one, other in combinations(rows, 2):
                    yield ApartPair(row, self.index((one, column)), self.index((other, column)))

    def index(self, place: Place) -> Index:
        """Return the row and column of a place."""
        rows, columns = self.names
        return rows.index(place[0]), columns.index(place[1])

    def indexed_cells(self) -> dict[Index, Cell]:
        """Return the cells by row and column, with those implied by constant reflectances."""
        rows, columns = ({name: n for n, name in enumerate(names)} for names in self.names)
        cells = {(rows[i], columns[j]): cell for (i, j), cell in self.cells.items()}
        for i, row in enumerate(self.reflectances):
            if row.constant:
                present = [cells[i, j] for j in columns.values() if (i, j) in cells]
                common = next((cell for cell in present if cell.kind in ("colour", "free")), None)
                common = common or Cell("free", group=f"of the constant {row.name}")
                cells = {(i, j): common for j in columns.values()} | cells
        return cells

    def member(self, kind: str, name: str) -> PaletteSpectrum:
        """Return a ``"light"`` or a ``"reflectance"`` by its name; refuse an unknown one."""
        members = self.lights if kind == "light" else self.reflectances
        member = next((member for member in members if member.name == name), None)
        if member is None:
            names = [member.name for member in members]
            hint = f"{nearest(name, names)}known: {', '.join(names)}"
            problem = f"no {kind} is named {name!r}; {hint}"
            raise fault(f"Palette.{kind}s", problem, "unknown", name)
        return member

    def with_exposure(self, exposure: float) -> Palette:
        """Return the palette with another exposure."""
        return replace(self, viewing=replace(self.viewing, exposure=exposure))
