"""The tables of a palette's file, as pydantic models: what keys there are and what they may hold.

    TOML -> [tables] -> file -> Palette

The keys' meaning is told to users in docs/palettes.md.
"""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field, model_validator

from volspec._tables import Name, Pair, Table, Vector, ViewedTable
from volspec.appearance import Viewing
from volspec.palette.model import Criteria

# TOML has lists where Python has tuples; all else is taken as it is written.
Place = Annotated[tuple[str, str], Field(strict=False)]
Colour = str | list[float]
Bound = float | Literal["none"]
_VIEW, _CRITERIA = Viewing(), Criteria()
EVERY = "*"
"""In a cell: every light, or every reflectance."""
WANTS = ("colour", "free", "black", "same", "distinct")


class ViewingTable(ViewedTable):
    """``[viewing]``: see `volspec.Viewing`."""

    model: str = "none"
    exposure: float | Literal["auto"] = _VIEW.exposure

    def viewing(self) -> Viewing:
        """The viewing that is meant; an exposure that is to be found begins at 1.

        Raises
        ------
        ViewingError
            If a name is unknown or a number out of range.
        """
        settings = self.model_dump(exclude={"display"})
        return self.viewed(settings | ({"exposure": 1.0} if self.exposure == "auto" else {}))


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

    name: Annotated[Name, Field(examples=["day"])]
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
