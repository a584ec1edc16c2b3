"""Specs of a palette's file: its keys and the values that they may have.

    TOML -> [tables] -> file -> Palette

docs/palettes.md explains the keys.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Any, ClassVar, Literal

from pydantic import Field

from volspec.appearance import Viewing
from volspec.errors import PaletteError
from volspec.palette.model import Apart, Criteria, Level, Names
from volspec.palette.variables import fault
from volspec.settings import FLAT, PYTHON_ONLY, Hint, Name, Pair, Unit, Vector, settings

Place = Annotated[tuple[str, str], Field(strict=False), Hint("reflectance and light", whole=True)]
Colour = Annotated[
    str | Annotated[tuple[float, ...], Field(strict=False)],
    Hint("a name, #RRGGBB or three numbers", whole=True),
]
Bound = float | Literal["none"]
WANTS = ("colour", "free", "black", "same", "distinct")


@settings(PaletteError)
@dataclass(frozen=True, slots=True)
class CriteriaSpec:
    """``[criteria]``: see `volspec.palette.Criteria`; the bands, the level and the basis."""

    criteria: Annotated[Criteria, FLAT] = field(default_factory=Criteria)
    """Weights and iterations."""
    level: Level = "relative"
    """relative: every designed light has Y = 100; absolute: the level that its colours need."""
    basis: str | None = None
    """For subspace: a basis that ships, or FILE.json."""
    grid_nm: Annotated[Vector, Unit("nm")] | None = None
    """First, last, step of the bands, at most 1000; if omitted, 380 to 780 by 5, or
    400 to 700 by 10 if values are given for these 31 bands."""


@dataclass(frozen=True, slots=True, kw_only=True)
class _MemberSpec:
    """Keys that ``[[light]]`` and ``[[reflectance]]`` share."""

    row_keys: ClassVar = ("name",)
    name: Annotated[Name, Field(examples=["day"])]
    """Name in cells."""
    spectrum: Name | None = None
    """A light (D65, planck:3200, FILE.csv, …) or a reflectance (copper, …); if the spectrum is
    designed, the starting point of its design."""
    values: Annotated[tuple[float, ...], Field(strict=False)] | None = None
    """Designed values, band by band; written by `volspec design` and used to start the next one."""
    design: bool | None = None
    """true: design it although it has a spectrum; if omitted, it is designed if it has neither
    spectrum nor values."""
    lower: Bound = 0.0
    """Least value in every band of a designed spectrum; none: it may be negative."""
    upper: Bound = "none"
    """Greatest value in every band; for a light, in units of the equal-energy light."""
    band_nm: Annotated[Pair, Unit("nm")] | None = None
    """[shortest, longest]: a designed spectrum is zero outside."""

    @staticmethod
    def from_table(table: Mapping[str, Any], folder: Path | None) -> Mapping[str, Any]:
        """Refuse keys that only designed spectra may have."""
        keys = {"lower", "upper", "band_nm", "mixture", "shares", "constant"} & set(table)
        has_spectrum = table.get("spectrum") is not None or table.get("values") is not None
        if keys and not table.get("design", not has_spectrum):
            problem = f"it is not designed, but has {' and '.join(sorted(keys))}"
            raise fault("design", f"{problem}; give design = true, or leave that out")
        return table

    @property
    def open(self) -> bool:
        """True if it is designed: it says so, or it has neither a spectrum nor values."""
        if self.design is not None:
            return self.design
        return self.spectrum is None and self.values is None

    def __post_init__(self) -> None:
        if self.spectrum is not None and self.values is not None and not self.open:
            raise fault("values", "given with spectrum; give one, or design = true")


@settings(PaletteError)
@dataclass(frozen=True, slots=True, kw_only=True)
class LightMember(_MemberSpec):
    """``[[light]]``: a column."""

    mixture: Annotated[tuple[str, ...], Field(strict=False)] = ()
    """Lamps to mix the light from, so that it can be built; if omitted, any spectrum is allowed."""
    shares: Annotated[tuple[float, ...], Field(strict=False)] = ()
    """Share of each lamp in the mixture's illuminance, written by `volspec design`; not read."""


@settings(PaletteError)
@dataclass(frozen=True, slots=True, kw_only=True)
class ReflectanceMember(_MemberSpec):
    """``[[reflectance]]``: a row."""

    upper: Bound = 1.0
    """Greatest value of each band, or none."""
    constant: bool = False
    """Require the same colour under every light."""


@settings(PaletteError)
@dataclass(frozen=True, slots=True)
class CellSpec:
    """``[[cell]]``: one or more places, and the colour wanted there."""

    at: Place | None = None
    """Its reflectance and light."""
    reflectance: Names | None = None
    """Alternative to at, together with light: one reflectance, several, or all."""
    light: Names | None = None
    """Alternative to at, together with reflectance: one light, several, or all."""
    colour: Colour | None = None
    """This colour: "#ca0020", a CSS name, or [r, g, b] as display codes 0 to 1."""
    free: Name | None = None
    """Name of a free colour: all its cells get one colour, which the solver picks (metamers)."""
    black: bool = False
    """Target black: the cell reflects nothing under its light (a metameric black)."""
    same: Place | None = None
    """Cell whose colour to match."""
    distinct: Place | None = None
    """Cell to differ from as far as possible."""
    weight: float | None = None
    """Importance relative to other cells; 1 if omitted."""
    must: bool = False
    """Hard constraint: the colour is met exactly, or the design is refused."""
    low: Colour | None = None
    """Lower bounds of a free colour; the same in all its cells. Black if omitted."""
    high: Colour | None = None
    """Upper bounds of a free colour; the same in all its cells. White if omitted."""
    distance: float | None = None
    """Sufficient ΔE (CIELAB) of a distinct cell; 100 if omitted."""

    def __post_init__(self) -> None:
        both = self.reflectance is not None and self.light is not None
        either = self.reflectance is not None or self.light is not None
        if (self.at is not None) == either or either != both:
            remedy = 'give at = ["reflectance", "light"], or both reflectance and light'
            raise fault("at", f"the cell has no place, or two; {remedy}")
        targets = [name for name in WANTS if getattr(self, name) not in (None, False)]
        if len(targets) != 1:
            problem = f"has {' and '.join(targets) or 'no target'}"
            raise fault("", f"{problem}; give one of {', '.join(WANTS)}")
        if self.must and self.weight is not None:
            problem = "given with must; exact colours need no weight, leave it out"
            raise fault("weight", problem)
        for name, owner in (("low", "free"), ("high", "free"), ("distance", "distinct")):
            if getattr(self, name) is not None and targets != [owner]:
                raise fault(name, f"for {owner} cells; leave it out")

    @property
    def kind(self) -> str:
        """Kind of target, one of `WANTS`."""
        return next(name for name in WANTS if getattr(self, name) not in (None, False))


@settings(PaletteError)
@dataclass(frozen=True, slots=True, kw_only=True)
class PaletteFile:
    """A palette: lights, reflectances, and the colours wanted where they meet."""

    title: str = ""
    """Caption."""
    viewing: Viewing = field(default_factory=lambda: Viewing(model="none"))
    """Viewing conditions; here model is none by default, and exposure may be auto."""
    auto_exposure: Annotated[bool, PYTHON_ONLY] = False
    """Find the exposure that fits the colours best."""
    criteria: CriteriaSpec = field(default_factory=CriteriaSpec)
    """Criteria of the design besides the cells."""
    light: Annotated[tuple[LightMember, ...], Field(strict=False, min_length=1)]
    """Columns."""
    reflectance: Annotated[tuple[ReflectanceMember, ...], Field(strict=False, min_length=1)]
    """Rows."""
    cell: Annotated[tuple[CellSpec, ...], Field(strict=False, min_length=1)]
    """Wanted colours."""
    apart: Annotated[tuple[Apart, ...], Field(strict=False)] = ()
    """Reflectances to be distinguished."""

    @staticmethod
    def from_table(table: Mapping[str, Any], folder: Path | None) -> Mapping[str, Any]:
        """Fill in a palette's own defaults of ``[viewing]``."""
        fields = table.get("viewing", {})
        if not isinstance(fields, Mapping):
            return table
        for key in ("adapting", "fov_deg"):
            if key in fields:
                raise fault(f"viewing.{key}", "measured in pictures; leave it out", "unknown")
        for key in ("deficiency", "severity"):
            if key in fields:
                problem = "a design compares colours before a simulation"
                raise fault(f"viewing.{key}", f"{problem}; give it in [[apart]]", "unknown")
        for key, measured in (("surround", "measured"), ("adopted_white", "scene")):
            if fields.get(key) == measured:
                problem = f"{measured!r} is of pictures; leave it out"
                raise fault(f"viewing.{key}", problem, "unsupported", measured)
        viewing, auto = {"model": "none", **fields}, fields.get("exposure") == "auto"
        if auto:
            viewing.pop("exposure")
        return {**table, "viewing": viewing, "auto_exposure": auto}
