"""The tables of a palette's file, as pydantic models: what keys there are and what they may hold.

    TOML -> [tables] -> file -> Palette

The keys' meaning is told to users in docs/palettes.md.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Annotated, Literal

from pydantic import AfterValidator, BaseModel, ConfigDict, Field, ValidationError, model_validator

from volspec.appearance import Display, Viewing
from volspec.appearance.presets import preset
from volspec.errors import nearest, require_name
from volspec.palette.model import Criteria

# TOML has lists where Python has tuples; all else is taken as it is written.
Pair = Annotated[tuple[float, float], Field(strict=False)]
Vector = Annotated[tuple[float, float, float], Field(strict=False)]
Place = Annotated[tuple[str, str], Field(strict=False)]
Name = Annotated[str, AfterValidator(require_name)]
Colour = str | list[float]
Bound = float | Literal["none"]
_VIEW, _CRITERIA = Viewing(), Criteria()
EVERY = "*"
"""In a cell: every light, or every reflectance."""
WANTS = ("colour", "free", "black", "same", "distinct")


class Table(BaseModel):
    """One table of the file; an unknown key is an error, so that no wish is lost in silence."""

    model_config = ConfigDict(extra="forbid", frozen=True, strict=True)


class DisplayTable(Table):
    """``[viewing.display]``: see `volspec.Display`; what is left out is the preset's."""

    preset: str = "sRGB"
    space: str = "sRGB"
    white_cd_m2: float | None = None
    L_A: float | None = None
    Y_b: float | None = None
    surround: str | float | None = None

    def display(self) -> Display:
        """The display that is meant."""
        given = self.model_dump(exclude={"preset", "space"}, exclude_none=True)
        if self.white_cd_m2 is not None and self.L_A is None:
            given["L_A"] = None
        return replace(preset(self.preset).display(self.space), **given)


class ViewingTable(Table):
    """``[viewing]``: see `volspec.Viewing`."""

    model: str = "none"
    illuminance_lux: float = _VIEW.illuminance_lux
    L_A: float | None = _VIEW.L_A
    Y_b: float = _VIEW.Y_b
    surround: str | float = _VIEW.surround
    D: float | None = _VIEW.D
    discount: bool = _VIEW.discount
    exposure: float | Literal["auto"] = _VIEW.exposure
    display: DisplayTable = Field(default_factory=DisplayTable)

    def viewing(self) -> Viewing:
        """The viewing that is meant; an exposure that is to be found begins at 1."""
        settings = self.model_dump(exclude={"display", "exposure"})
        exposure = 1.0 if self.exposure == "auto" else self.exposure
        return Viewing(**settings, exposure=exposure, display=self.display.display())


class CriteriaTable(Table):
    """``[criteria]``: see `volspec.palette.Criteria`; the bands, the level and the basis."""

    smoothness: float = _CRITERIA.smoothness
    subspace: float = _CRITERIA.subspace
    metric: str = _CRITERIA.metric
    rounds: int = _CRITERIA.rounds
    level: str = "relative"
    basis: str | None = None
    grid_nm: Vector | None = None

    def criteria(self) -> Criteria:
        """The criteria that are meant."""
        return Criteria(**self.model_dump(exclude={"level", "basis", "grid_nm"}))


class SpectrumTable(Table):
    """What ``[[light]]`` and ``[[reflectance]]`` share."""

    name: Name
    spectrum: Name | None = None
    values: list[float] | None = None
    design: bool | None = None
    lower: Bound = 0.0
    upper: Bound = "none"
    band_nm: Pair | None = None

    @property
    def open(self) -> bool:
        """Whether it is designed: because it says so, or as nothing else is known of it."""
        if self.design is not None:
            return self.design
        return self.spectrum is None and self.values is None

    @model_validator(mode="after")
    def _bounds_belong_to_open_ones(self) -> SpectrumTable:
        given = {"lower", "upper", "band_nm", "mixture", "constant"} & self.model_fields_set
        if given and not self.open:
            raise ValueError(
                f"{self.name!r} stands as it is, but has {' and '.join(sorted(given))}; give "
                "design = true, or leave that out"
            )
        if self.spectrum is not None and self.values is not None and not self.open:
            raise ValueError(f"{self.name!r} has spectrum and values; give one, or design = true")
        return self


class LightTable(SpectrumTable):
    """``[[light]]``: a column."""

    mixture: list[str] = Field(default_factory=list)


class ReflectanceTable(SpectrumTable):
    """``[[reflectance]]``: a row."""

    upper: Bound = 1.0
    constant: bool = False


class CellTable(Table):
    """``[[cell]]``: a place, or several, and what is wanted there."""

    at: Place | None = None
    reflectance: str | list[str] | None = None
    light: str | list[str] | None = None
    colour: Colour | None = None
    free: Name | None = None
    black: bool = False
    same: Place | None = None
    distinct: Place | None = None
    weight: float | None = None
    must: bool = False
    low: Colour | None = None
    high: Colour | None = None
    distance: float | None = None

    @model_validator(mode="after")
    def _one_place_and_one_wish(self) -> CellTable:
        both = self.reflectance is not None and self.light is not None
        any_of_them = self.reflectance is not None or self.light is not None
        if (self.at is not None) == any_of_them or any_of_them != both:
            raise ValueError('give at = ["reflectance", "light"], or both reflectance and light')
        wishes = [name for name in WANTS if getattr(self, name) not in (None, False)]
        if len(wishes) != 1:
            said = " and ".join(wishes) or "nothing"
            raise ValueError(f"asks for {said}; give one of {', '.join(WANTS)}")
        if self.must and self.weight is not None:
            raise ValueError("has must and weight; what must be met needs no weight")
        for name, owner in (("low", "free"), ("high", "free"), ("distance", "distinct")):
            if getattr(self, name) is not None and wishes != [owner]:
                raise ValueError(f"{name} is for {owner} cells; leave it out")
        return self

    @property
    def wish(self) -> str:
        """Which of `WANTS` it asks for."""
        return next(name for name in WANTS if getattr(self, name) not in (None, False))


class PaletteTable(Table):
    """The whole file."""

    title: str = ""
    viewing: ViewingTable = ViewingTable()
    criteria: CriteriaTable = CriteriaTable()
    light: Annotated[list[LightTable], Field(min_length=1)]
    reflectance: Annotated[list[ReflectanceTable], Field(min_length=1)]
    cell: Annotated[list[CellTable], Field(min_length=1)]


_TABLES: dict[str, type[Table]] = {
    "viewing": ViewingTable,
    "display": DisplayTable,
    "criteria": CriteriaTable,
    "light": LightTable,
    "reflectance": ReflectanceTable,
    "cell": CellTable,
}


def explained(error: ValidationError) -> str:
    """pydantic's first complaint in one line: field, what is wrong, the value."""
    first = error.errors()[0]
    # A misspelt key comes with the complaint that the right one is missing; name the former.
    first = next((e for e in error.errors() if e["type"] == "extra_forbidden"), first)
    table: type[Table] = PaletteTable
    words: list[str] = []
    for part in first["loc"]:
        if isinstance(part, int):
            words.append(str(part + 1))
        elif not words or part in table.model_fields or first["type"] == "extra_forbidden":
            words.append(part)
            table = _TABLES.get(part, table) if part in table.model_fields else table
    field = ".".join(words)
    if first["type"] == "extra_forbidden":
        known = list(table.model_fields)
        return f"{field}: unknown key; {nearest(words[-1], known)}known: {', '.join(known)}"
    if len(first["loc"]) == 1 and first["type"] in ("missing", "too_short"):
        return f"there is no [[{field}]]; add one"
    if first["type"] == "missing":
        return f"{field}: is missing; give it"
    what = first["msg"].removeprefix("Value error, ")
    if first["type"].startswith("model_"):
        what = "give a table, { key = value, … }"
    for other in error.errors():  # a number or a word
        if other["type"] == "literal_error" and other["loc"][:-1] == first["loc"][:-1]:
            what += f", or {other['ctx']['expected']}"
    told = first["type"] == "value_error" and isinstance(first["input"], dict)
    return f"{field}: {what}" + ("" if told else f" (it is {first['input']!r:.60})")
