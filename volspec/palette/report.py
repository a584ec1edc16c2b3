"""A design in figures: colours wanted and obtained, metamers, bounds that bind, the cost.

design -> [report] -> advice, figure, text, JSON
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import asdict, dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from volspec.palette.cells import CellReport, cell_reports
from volspec.palette.criteria import Phase
from volspec.palette.metamers import MetamerReport, metamer_reports
from volspec.palette.model import Place
from volspec.palette.rows import asked
from volspec.palette.solve import Design
from volspec.palette.state import State

Array = NDArray[np.float64]

# A bound counts as touched from here, as a share of the spectrum's largest value.
_TOUCH = 1e-4


@dataclass(frozen=True, slots=True)
class SpectrumReport:
    """How an open spectrum stands to its bounds: how many of its bands (or lamps) touch them."""

    kind: str
    name: str
    bands: int
    at_lower: int
    at_upper: int
    largest: float


@dataclass(frozen=True, slots=True)
class DesignReport:
    """A design in figures.

    Parameters
    ----------
    cells : tuple of CellReport
        Of every place, row by row.
    metamers : tuple of MetamerReport
    spectra : tuple of SpectrumReport
    exposure : float
    cost : {criterion: float}
        What ``colours``, ``smoothness`` and ``subspace`` add to the sum that the design minimises.
    suggestions : tuple of str
        What would help, with figures; see `volspec.palette.advice`. Empty unless asked for.

    Examples
    --------
    >>> import volspec as vs
    >>> made = vs.design(vs.load_palette("data/palettes/figure-2.toml"))
    >>> vs.DesignReport.of(made).mean < 1
    True
    """

    cells: tuple[CellReport, ...]
    metamers: tuple[MetamerReport, ...]
    spectra: tuple[SpectrumReport, ...]
    exposure: float
    cost: dict[str, float]
    suggestions: tuple[str, ...] = field(default=())

    @classmethod
    def of(cls, design: Design, *, advice: bool = False) -> DesignReport:
        """Measure a design.

        Parameters
        ----------
        design : Design
        advice : bool
            Whether to look for `suggestions`, too: that solves some ten times more.
        """
        from volspec.palette.advice import suggestions

        state = design.state
        rows, columns = state.palette.names
        wishes = {(rows[i], columns[j]): cell for (i, j), cell in asked(state.palette).items()}
        cells, Lab = cell_reports(state, wishes)
        return cls(
            cells,
            tuple(metamer_reports(state.palette, wishes, Lab)),
            tuple(_spectra(state)),
            state.palette.viewing.exposure,
            _cost(state, cells),
            suggestions(design) if advice else (),
        )

    @property
    def errors(self) -> list[float]:
        """CIEDE2000 of every cell that a colour is wanted of."""
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
        """The cell of a reflectance and a light."""
        return next(cell for cell in self.cells if cell.place == place)

    def to_dict(self) -> dict[str, Any]:
        """For JSON: all figures, under the names above."""
        return {
            "exposure": self.exposure,
            "mean": self.mean,
            "max": self.max,
            "cost": self.cost,
            "cells": [cell.to_dict() for cell in self.cells],
            "metamers": [asdict(pair) for pair in self.metamers],
            "spectra": [asdict(spectrum) for spectrum in self.spectra],
            "suggestions": list(self.suggestions),
        }

    def __str__(self) -> str:
        """As ``volspec design`` prints it, without colours."""
        from volspec.palette.text import plain_text

        return plain_text(self)


def _spectra(state: State) -> Iterator[SpectrumReport]:
    for lights in (False, True):
        phase = Phase(state, lights)
        members = state.palette.lights if lights else state.palette.reflectances
        for number, x in _unknowns(phase).items():
            member = members[number]
            near = _TOUCH * max(float(np.abs(x).max()), 1e-12)
            yield SpectrumReport(
                "light" if lights else "reflectance",
                member.name,
                len(x),
                0 if member.lower is None else int((x <= member.lower + near).sum()),
                0 if member.upper is None else int((x >= member.upper - near).sum()),
                float(x.max()),
            )


def _unknowns(phase: Phase) -> dict[int, Array]:
    """What the solver found for each open spectrum: its bands, or the shares of its lamps."""
    spectra = phase.state.E if phase.lights else phase.state.S
    return {n: np.linalg.lstsq(phase.synthesis(n), spectra[n], rcond=None)[0] for n in phase.open}


def _cost(state: State, cells: tuple[CellReport, ...]) -> dict[str, float]:
    criteria, eyes, total = state.palette.criteria, state.eyes(), 0.0
    for cell in cells:
        if cell.wanted is None or not np.isfinite(cell.weight):
            continue
        if criteria.metric == "Lab":
            off = (cell.delta_E_1976 or 0.0) / 100.0
        else:
            decode = eyes[0].space.decode
            off = float(np.linalg.norm(decode(cell.wanted) - decode(cell.obtained)))
        total += (cell.weight * off) ** 2 / 3.0
    costs = {"colours": total, "smoothness": 0.0, "subspace": 0.0}
    for phase in (Phase(state, lights=False), Phase(state, lights=True)):
        x = {phase.block_name(n): values for n, values in _unknowns(phase).items()}
        for term in phase.problem()[1]:
            subspace = term.label.startswith("the subspace error")
            if subspace or term.label in x:  # smoothness goes by the spectrum's name
                made = sum(rows @ x[name] for name, rows in term.parts.items())
                square = float(((made - term.target) ** 2).sum())
                costs["subspace" if subspace else "smoothness"] += term.weight**2 * square
    return costs
