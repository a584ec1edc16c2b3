"""Read palettes: TOML in, a `Palette` out.

TOML -> tables -> [file] -> Palette -> design
"""

from __future__ import annotations

import math
import os
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from volspec._parse import parse_toml, read_text, toml_remedy
from volspec.basis import SpectralBasis, load_basis
from volspec.errors import InputError, PaletteError, nearest
from volspec.palette.model import EVERY, Cell, Palette, Place, parse_colour
from volspec.palette.optimisation import fitted_exposure
from volspec.palette.tables import (
    CellSpec,
    CriteriaSpec,
    LightMember,
    PaletteFile,
    ReflectanceMember,
)
from volspec.palette.variables import PaletteSpectrum, fault
from volspec.settings import FileFaults, row_names, try_table
from volspec.spectra import SpectralGrid, Spectrum, grid_of_values, light, reflectance

# Values of a free spectrum came from a design.
_NOTES: dict[bool, dict[str, str]] = {True: {"designed": "volspec design"}, False: {}}
# The time of a design grows with the cube of the number of bands.
_MAX_BANDS = 1000
# Classes whose fields a file's tables fill in.
_OWNERS = ("Apart", "Cell", "Criteria", "Palette", "PaletteSpectrum", "criteria")
FileName = str | os.PathLike[str]


def load_palette(path: FileName) -> Palette:
    """Read a palette; docs/palettes.md explains the file.

    Parameters
    ----------
    path : path
        TOML. Names of files in it are relative to it. Free spectra start at their ``values``.

    Returns
    -------
    Palette
        If the file has ``exposure = "auto"``, with the `fitted_exposure`.

    Raises
    ------
    PaletteError
        If the file is missing, is not TOML, or has unknown keys or wrong values; the message names
        file, field and value.

    Examples
    --------
    >>> import volspec as vs
    >>> made = vs.design(vs.load_palette("data/palettes/figure-1.toml"))
    >>> made.reflectance("flame").designed
    True
    """
    file = palette_file(path)
    palette = _Reader(Path(path), file).palette()
    if file.auto_exposure:
        with _prefix_errors(os.fspath(path), "exposure:"):
            return palette.with_exposure(fitted_exposure(palette))
    return palette


class PaletteFaults(FileFaults, PaletteError):
    """Faults of a palette's file."""


def palette_file(path: FileName) -> PaletteFile:
    """Return the tables of a palette's file, each checked on its own."""
    name, text = os.fspath(path), palette_text(path)
    try:
        tables = parse_toml(text)
    except ValueError as error:
        problem = f"{name}: not valid TOML: {error}"
        raise PaletteError(problem, toml_remedy(error, text), code="syntax") from error
    if "volume" in tables and "transfer" in tables:
        problem = f"{name}: is a scene, not a palette"
        remedy = "give a palette, a file with [[reflectance]], [[light]] and [[cell]]"
        raise PaletteError(problem, remedy, code="type")
    file, faults = try_table(PaletteFile, tables, PaletteError, Path(path).parent)
    if file is None:
        raise PaletteFaults(path, faults, row_names(tables))
    return file


def palette_text(path: FileName) -> str:
    """Return a palette's file as text."""
    return read_text(path, PaletteError, "a palette's file")


@contextmanager
def _prefix_errors(path: str, where: str) -> Iterator[None]:
    """Prefix errors raised inside with the names of the file and the table."""
    try:
        yield
    except InputError as error:
        owner, _, key = error.field.rpartition(".")
        problem, field = error.problem, path
        if error.field:
            where = where.removesuffix(":")
            field = f"{path}: {where} {key if owner in _OWNERS else error.field}"
        else:
            problem = f"{where} {problem}".strip()
        raise PaletteError(
            problem, error.remedy, code=error.code, field=field, given=error.given
        ) from error


@dataclass(frozen=True, slots=True, eq=False)
class _Reader:
    """Build a palette from its tables."""

    path: Path
    table: PaletteFile

    def palette(self) -> Palette:
        table, name = self.table, os.fspath(self.path)
        rows = (*table.light, *table.reflectance)
        grid = grid_of_values(next((len(row.values) for row in rows if row.values is not None), 0))
        with _prefix_errors(name, "[criteria]"):
            if table.criteria.grid_nm is not None:
                grid = SpectralGrid(*table.criteria.grid_nm)
                if grid.size > _MAX_BANDS:
                    remedy = f"give a longer step, for at most {_MAX_BANDS}"
                    raise fault("", f"grid_nm has {grid.size} bands; {remedy}", "size")
            criteria, basis = table.criteria.criteria, self._basis(table.criteria)
        reflectances = tuple(self._member(row, grid) for row in table.reflectance)
        lights = tuple(self._member(row, grid) for row in table.light)
        cells = self._cells()
        with _prefix_errors(name, ""):
            return Palette(
                *(reflectances, lights, cells, table.viewing, grid, criteria),
                level=table.criteria.level,
                basis=basis,
                apart=table.apart,
            )

    def _basis(self, table: CriteriaSpec) -> SpectralBasis | None:
        if table.basis is None:
            return None
        file = table.basis.endswith(".json")
        basis = load_basis(os.fspath(self.path.parent / table.basis) if file else table.basis)
        if not isinstance(basis, SpectralBasis):
            problem = f"basis {table.basis!r} is made of materials; give a fitted one"
            raise fault("", problem, "unsupported")
        return basis

    def _member(self, row: LightMember | ReflectanceMember, grid: SpectralGrid) -> PaletteSpectrum:
        kind, find = (
            ("light", light) if isinstance(row, LightMember) else ("reflectance", reflectance)
        )
        with _prefix_errors(os.fspath(self.path), f"[[{kind}]] {row.name}:"):
            spectrum = self._values(row, grid)
            if spectrum is None and row.spectrum is not None:
                spectrum = find(row.spectrum, grid, folder=self.path.parent)
            if not row.open:
                return PaletteSpectrum(row.name, spectrum)
            mixture = row.mixture if isinstance(row, LightMember) else ()
            return PaletteSpectrum(
                *(row.name, spectrum, True),
                lower=None if row.lower == "none" else row.lower,
                upper=None if row.upper == "none" else row.upper,
                band_nm=row.band_nm,
                mixture=tuple(light(lamp, grid, folder=self.path.parent) for lamp in mixture),
                constant=isinstance(row, ReflectanceMember) and row.constant,
            )

    def _values(self, row: LightMember | ReflectanceMember, grid: SpectralGrid) -> Spectrum | None:
        if row.values is None:
            return None
        if len(row.values) != grid.size:
            remedy = "leave the values out, or give the [criteria] grid_nm they were made with"
            problem = f"{len(row.values)} values, but {grid.size} bands ({grid}); {remedy}"
            raise fault("", problem, "shape")
        return Spectrum(grid.wavelengths_nm, np.array(row.values), row.name, _NOTES[row.open])

    def _cells(self) -> dict[Place, Cell]:
        cells: dict[Place, Cell] = {}
        groups: dict[str, tuple[int, Cell]] = {}
        for number, row in enumerate(self.table.cell, start=1):
            with _prefix_errors(os.fspath(self.path), f"cell {number}:"):
                cell = _cell(row)
                first, other = groups.setdefault(cell.group, (number, cell))
                if cell.group and (cell.low, cell.high) != (other.low, other.high):
                    remedy = "give both the same low and high, or rename one of them"
                    problem = f"the free colour {cell.group!r} has different bounds in cell {first}"
                    raise fault("", f"{problem}; {remedy}")
                for place in self._places(row):
                    if place in cells:
                        problem = f"({', '.join(place)}) is given twice"
                        raise fault("", f"{problem}; leave out one of them", "duplicate")
                    cells[place] = cell
        return cells

    def _places(self, row: CellSpec) -> Iterator[Place]:
        rows, columns = row.at or (row.reflectance, row.light)
        for reflectance_name in self._names("reflectance", rows):
            for light_name in self._names("light", columns):
                yield reflectance_name, light_name

    def _names(self, kind: str, selection: str | tuple[str, ...] | None) -> list[str]:
        all_names = [row.name for row in getattr(self.table, kind)]
        if selection == EVERY:
            return all_names
        names = [selection] if isinstance(selection, str) else list(selection or ())
        if not names:
            problem = f"{kind} is empty; give a name, several, or {EVERY!r} for all"
            raise fault("", problem, "missing")
        for name in names:
            if name not in all_names:
                hint = f"{nearest(name, all_names)}known: {', '.join(all_names)}"
                raise fault("", f"no {kind} is named {name!r}; {hint}", "unknown")
        return names


def _cell(row: CellSpec) -> Cell:
    fields: dict[str, Any] = {"kind": row.kind}
    if row.colour is not None:
        fields["colour"] = parse_colour(row.colour)
    if row.free is not None:
        fields["group"] = row.free
    if other := row.same or row.distinct:
        fields["other"] = other
    if row.must or row.weight is not None:
        fields["weight"] = math.inf if row.must else row.weight
    for name in ("low", "high"):
        if (bound := getattr(row, name)) is not None:
            fields[name] = parse_colour(bound)
    if row.distance is not None:
        fields["distance"] = row.distance
    return Cell(**fields)
