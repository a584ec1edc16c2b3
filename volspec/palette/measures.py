"""Measures of a design: colours wanted and obtained, metamers, bounds that bind, the cost.

state, design -> [measures] -> advice, text, report

References
----------
[1] CIE 15:2018, "Colorimetry", section 9.2: special metamerism index, change in illuminant.
[2] Asano, Fairchild & Blondé (2016), "Individual Colorimetric Observer Model", PLoS ONE 11(2).
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from itertools import combinations
from typing import Any, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

from volspec.appearance.comparison import Difference, distance, uniform
from volspec.appearance.display import DEFICIENCIES
from volspec.appearance.models import cielab, delta_E_2000
from volspec.palette.model import Cell, Place, Triple, hexadecimal
from volspec.palette.optimisation import Design, Phase, apart_cost, compared_colours
from volspec.palette.state import ColourModel, DesignState
from volspec.spectra import Spectrum, population

Array = NDArray[np.float64]

# Half an 8-bit step: codes this far outside the display's range are not visibly clipped.
_CODE = 0.5 / 255.0
# CIEDE2000 below which two colours are alike.
ALIKE = 1.0
# A white's least tristimulus value, as a fraction of its largest.
_MIN_WHITE = 1e-6
# A bound counts as touched within this fraction of the spectrum's largest value.
_TOUCH = 1e-4


@dataclass(frozen=True, slots=True)
class CellReport:
    """Wanted and obtained colour of a place.

    Parameters
    ----------
    reflectance, light : str
    kind : str
        `Cell.kind`; ``""`` without a cell.
    weight : float
    wanted : (3,) floats, optional
        Target colour in display codes. For a free cell, the mean of its group; for a ``same``
        cell, the colour of the cell it refers to. None if there is no target.
    obtained : (3,) floats
        Display codes, not clipped.
    XYZ : (3,) floats
        In the scene, Y = 100 for a perfect diffuser under a light of the palette.
    delta_E_2000, delta_E_1976 : float, optional
        Difference of the two, adapted to the display's white; for a distinct cell, from the other.
    in_gamut : bool
        True if the display shows the obtained colour.
    delta_E_CAM16 : float, optional
        The difference in CAM16-UCS.
    difference : {"CIEDE2000", "CAM16-UCS"}
        The difference that counts, `delta_E`.
    """

    reflectance: str
    light: str
    kind: str
    weight: float
    wanted: Triple | None
    obtained: Triple
    XYZ: Triple
    delta_E_2000: float | None
    delta_E_1976: float | None
    in_gamut: bool
    delta_E_CAM16: float | None = None
    difference: Difference = "CIEDE2000"

    @property
    def place(self) -> Place:
        """Names of the cell's reflectance and light."""
        return self.reflectance, self.light

    @property
    def delta_E(self) -> float | None:
        """The difference that counts."""
        return self.delta_E_2000 if self.difference == "CIEDE2000" else self.delta_E_CAM16

    @property
    def error(self) -> float | None:
        """Difference to the wanted colour; None for a distinct cell."""
        return None if self.kind == "distinct" else self.delta_E

    def to_dict(self) -> dict[str, Any]:
        """Return the figures for JSON."""
        figures = asdict(self) | {"hex": hexadecimal(self.obtained)}
        figures["wanted_hex"] = None if self.wanted is None else hexadecimal(self.wanted)
        figures["weight"] = self.weight if np.isfinite(self.weight) else "must"
        figures |= dict(zip("XYZ", figures.pop("XYZ"), strict=True))
        return figures


@dataclass(frozen=True, slots=True)
class ObserverReport:
    """CIEDE2000 between two reflectances to individual observers, `spectra.observers` [2].

    Every observer's CIELAB is relative to their own white under the light.

    Parameters
    ----------
    count : int
    alike : float
        Fraction of the observers to whom the difference is below `ALIKE`.
    median, p95 : float
        CIEDE2000 that half, and 95 %, of the observers see at most.
    """

    count: int
    alike: float
    median: float
    p95: float


@dataclass(frozen=True, slots=True)
class MetamerReport:
    """Two reflectances that should have the same colour under a light.

    Parameters
    ----------
    light : str
    reflectances : (str, str)
    delta_E : float
        The report's difference between them under that light.
    delta_E_1nm : float
        The same on bands of 1 nm, between which a design on wider ones is interpolated: what a
        light and paints of these spectra would show.
    apart : {light: float}
        The difference under every other light: the special metamerism indices [1].
    observers : ObserverReport
        What a population sees under the light, on bands of 1 nm, instead of the standard observer.
    """

    light: str
    reflectances: tuple[str, str]
    delta_E: float
    delta_E_1nm: float
    apart: dict[str, float]
    observers: ObserverReport


@dataclass(frozen=True, slots=True)
class ApartReport:
    """Two reflectances to be distinguished, as viewers with and without a deficiency see them.

    Parameters
    ----------
    reflectances : (str, str)
    deficiencies : tuple of str
        Those asked for; ``"none"`` is normal vision.
    severity : float
        Of all deficiencies.
    lights : tuple of str
        Those under which to distinguish them.
    delta_E : {light: {deficiency: float}}
        CIEDE2000 between the two on the display, for every light and every deficiency.
    """

    reflectances: tuple[str, str]
    deficiencies: tuple[str, ...]
    severity: float
    lights: tuple[str, ...]
    delta_E: dict[str, dict[str, float]]

    @property
    def smallest(self) -> dict[str, float]:
        """Least CIEDE2000 under ``lights`` by deficiency, ``"none"`` included."""
        return {
            name: min(self.delta_E[light][name] for light in self.lights) for name in DEFICIENCIES
        }

    def to_dict(self) -> dict[str, Any]:
        """Return the figures for JSON."""
        return asdict(self) | {"smallest": self.smallest}


@dataclass(frozen=True, slots=True)
class SpectrumReport:
    """Counts of a free spectrum's bands (or lamps), and of the bands that touch its bounds.

    ``lamps`` has the share of each lamp in the illuminance of a light that is a mixture.
    """

    kind: str
    name: str
    bands: int
    at_lower: int
    at_upper: int
    largest: float
    lamps: dict[str, float] = field(default_factory=dict)


@dataclass(frozen=True, slots=True)
class DesignMeasures:
    """Figures of a design, see `DesignReport`."""

    cells: tuple[CellReport, ...]
    metamers: tuple[MetamerReport, ...]
    spectra: tuple[SpectrumReport, ...]
    exposure: float
    cost: dict[str, float]
    suggestions: tuple[str, ...] = ()
    difference: Difference = "CIEDE2000"
    apart: tuple[ApartReport, ...] = ()

    @classmethod
    def measured(
        cls, design: Design, suggestions: Sequence[str] = (), difference: Difference = "CIEDE2000"
    ) -> Self:
        """Measure a design by a difference."""
        state = design.state
        rows, columns = state.palette.names
        targets = {(rows[i], columns[j]): c for (i, j), c in state.palette.indexed_cells().items()}
        cells, coordinates = report_cells(state, targets, difference)
        return cls(
            cells,
            tuple(_metamers(state, targets, coordinates, difference)),
            tuple(_spectra(state)),
            state.palette.viewing.exposure,
            _costs(state, cells),
            tuple(suggestions),
            difference,
            tuple(apart_reports(state, targets)),
        )

    @property
    def errors(self) -> list[float]:
        """Difference of every cell with a wanted colour."""
        return [cell.error for cell in self.cells if cell.error is not None]

    @property
    def mean(self) -> float:
        """Mean of the `errors`."""
        return float(np.mean(self.errors)) if self.errors else 0.0

    @property
    def max(self) -> float:
        """Largest of the `errors`."""
        return max(self.errors, default=0.0)

    def cell(self, place: Place) -> CellReport:
        """Return the cell of a reflectance and a light."""
        return next(cell for cell in self.cells if cell.place == place)

    def to_dict(self) -> dict[str, Any]:
        """Return all figures for JSON, under the names above."""
        return {
            "exposure": self.exposure,
            "mean": self.mean,
            "max": self.max,
            "difference": self.difference,
            "cost": self.cost,
            "cells": [cell.to_dict() for cell in self.cells],
            "metamers": [asdict(pair) for pair in self.metamers],
            "spectra": [asdict(spectrum) for spectrum in self.spectra],
            "suggestions": list(self.suggestions),
            "apart": [pair.to_dict() for pair in self.apart],
        }


def report_cells(
    state: DesignState, targets: Mapping[Place, Cell], difference: Difference = "CIEDE2000"
) -> tuple[tuple[CellReport, ...], Array]:
    """Return reports of every place, row by row, and (R, L, 3) coordinates of their difference."""
    palette, models = state.palette, state.colour_models()
    RGB, XYZ = state.RGB(models), state.XYZ
    cells = {palette.index(place): cell for place, cell in targets.items()}
    compared = compared_colours(palette, cells, RGB)
    reports = []
    for i, row in enumerate(palette.names[0]):
        for j, column in enumerate(palette.names[1]):
            cell, target = cells.get((i, j)), compared.get((i, j))
            codes = models[j].space.encode(RGB[i, j])
            errors: dict[str, float | None] = dict.fromkeys(("2000", "1976", "CAM16"))
            if target is not None:
                Lab, ucs = (
                    [_coordinates(colour, models[j], name) for colour in (target, RGB[i, j])]
                    for name in ("CIEDE2000", "CAM16-UCS")
                )
                errors = {
                    "2000": float(distance("CIEDE2000", *Lab)),
                    "1976": float(np.linalg.norm(Lab[0] - Lab[1])),
                    "CAM16": float(distance("CAM16-UCS", *ucs)),
                }
            distinct = cell is not None and cell.kind == "distinct"
            reports.append(
                CellReport(
                    row,
                    column,
                    cell.kind if cell else "",
                    cell.weight if cell else 0.0,
                    None if target is None or distinct else _triple(models[j].space.encode(target)),
                    _triple(codes),
                    _triple(XYZ[i, j]),
                    errors["2000"],
                    errors["1976"],
                    bool(((codes > -_CODE) & (codes < 1.0 + _CODE)).all()),
                    errors["CAM16"],
                    difference,
                )
            )
    return tuple(reports), _all_coordinates(RGB, models, difference)


def _coordinates(RGB: ArrayLike, model: ColourModel, difference: Difference) -> Array:
    """Return coordinates of linear RGB relative to the display's white."""
    space = model.space
    return uniform(difference, np.asarray(RGB) @ space.XYZ_from_RGB.T, space.white_XYZ)


def _all_coordinates(RGB: Array, models: Sequence[ColourModel], difference: Difference) -> Array:
    columns = [_coordinates(RGB[:, j], m, difference) for j, m in enumerate(models)]
    return np.stack(columns, axis=1)


def apart_reports(state: DesignState, targets: Mapping[Place, Cell]) -> Iterator[ApartReport]:
    """Yield a report of each pair to be distinguished, those of distinct cells included."""
    models = state.colour_models()
    RGB, (rows, columns) = state.RGB(models), state.palette.names
    asked: dict[tuple[Any, ...], list[str]] = {}
    for pair in state.palette.apart_pairs():
        (one, column), (other, _) = pair.one, pair.other
        key = rows[one], rows[other], pair.row.deficiencies, pair.row.severity
        asked.setdefault(key, []).append(columns[column])
    for (row, light), cell in targets.items():
        if cell.kind == "distinct" and cell.other is not None and cell.other[1] == light:
            asked.setdefault((row, cell.other[0], ("none",), 1.0), []).append(light)
    for (one, other, deficiencies, severity), lights in asked.items():
        dE00: dict[str, dict[str, float]] = {}
        for light in columns:
            at = [RGB[state.palette.index((row, light))] for row in (one, other)]
            dE00[light] = {
                name: float(delta_E_2000(*(models[0].simulated_Lab(c, name, severity) for c in at)))
                for name in DEFICIENCIES
            }
        yield ApartReport((one, other), deficiencies, severity, tuple(dict.fromkeys(lights)), dE00)


def _triple(values: Array) -> Triple:
    one, two, three = values.tolist()
    return one, two, three


def _metamers(
    state: DesignState, targets: Mapping[Place, Cell], colours: Array, difference: Difference
) -> Iterator[MetamerReport]:
    """Yield every pair of reflectances with the same target colour, light by light."""
    rows, columns = state.palette.names
    fine = state.at_1_nm()
    models = fine.colour_models()
    fine_colours = _all_coordinates(fine.RGB(models), models, difference)
    for j, column in enumerate(columns):
        pairs = [
            (i, k)
            for (i, one), (k, other) in combinations(enumerate(rows), 2)
            if _have_one_target(targets, (one, column), (other, column))
        ]
        observed = _observers(fine, j) if pairs else np.zeros(0)
        for i, k in pairs:
            between = distance(difference, colours[i], colours[k])
            errors = {n: float(d) for n, d in zip(columns, between, strict=True) if n != column}
            at_1_nm = float(distance(difference, fine_colours[i, j], fine_colours[k, j]))
            differences = delta_E_2000(observed[:, i], observed[:, k])
            crowd = ObserverReport(
                differences.size,
                float((differences < ALIKE).mean()),
                *np.percentile(differences, (50, 95)).tolist(),
            )
            pair = rows[i], rows[k]
            yield MetamerReport(column, pair, float(between[j]), at_1_nm, errors, crowd)


def _observers(state: DesignState, light: int) -> Array:
    """Return CIELAB (n, R, 3) of all reflectances under a light to a population of observers."""
    Q = population(state.palette.grid) * state.E[light]
    white = Q.sum(axis=2)[:, None]
    white = np.maximum(white, _MIN_WHITE * white.max(axis=2, keepdims=True))
    return cielab(np.swapaxes(Q @ state.S.T, 1, 2) / white, np.ones(3))


def _have_one_target(targets: Mapping[Place, Cell], one: Place, other: Place) -> bool:
    if one not in targets or other not in targets:
        return False
    first, second = _last_same(targets, one), _last_same(targets, other)
    if first == second:
        return True
    a, b = targets.get(first), targets.get(second)
    if a is None or b is None or a.kind != b.kind or a.kind not in ("colour", "black", "free"):
        return False
    return (a.colour, a.group) == (b.colour, b.group)


def _last_same(targets: Mapping[Place, Cell], place: Place) -> Place:
    """Return the end of a chain of ``same`` cells, each of which refers to the next."""
    visited = {place}
    while (cell := targets.get(place)) and cell.kind == "same" and cell.other not in visited:
        assert cell.other is not None
        place = cell.other
        visited.add(place)
    return place


def _spectra(state: DesignState) -> Iterator[SpectrumReport]:
    grid = state.palette.grid
    for kind, phase in (("reflectance", Phase(state, False)), ("light", Phase(state, True))):
        for number, x in phase.values().items():
            member = phase.members[number]
            spectrum = Spectrum(grid.wavelengths_nm, (state.S, state.E)[kind == "light"][number])
            lamps: dict[str, float] = {}
            weights = replace(member, spectrum=spectrum).lamp_shares(grid)
            for lamp, weight in zip(member.mixture, weights, strict=True):
                lamps[lamp.name] = lamps.get(lamp.name, 0.0) + weight
            near = _TOUCH * max(float(np.abs(x).max()), 1e-12)
            yield SpectrumReport(
                kind,
                member.name,
                len(x),
                0 if member.lower is None else int((x <= member.lower + near).sum()),
                0 if member.upper is None else int((x >= member.upper - near).sum()),
                float(x.max()),
                lamps,
            )


def _costs(state: DesignState, cells: tuple[CellReport, ...]) -> dict[str, float]:
    criteria, space, colours = state.palette.criteria, state.palette.viewing.display.colours, 0.0
    for cell in cells:
        if cell.wanted is None or not np.isfinite(cell.weight):
            continue
        if criteria.metric == "Lab":
            off = (cell.delta_E_1976 or 0.0) / 100.0
        else:
            off = float(np.linalg.norm(space.decode(cell.wanted) - space.decode(cell.obtained)))
        colours += (cell.weight * off) ** 2 / 3.0
    phases = Phase(state, lights=False).costs(), Phase(state, lights=True).costs()
    costs = {"colours": colours} | {name: sum(p[name] for p in phases) for name in phases[0]}
    return costs | {"apart": apart_cost(state, state.RGB())}
