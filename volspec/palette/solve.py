"""Lights and reflectances in turn, until the colours stand: the design itself.

model -> state -> criteria -> problem -> [solve] -> report
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from volspec.errors import PaletteError
from volspec.palette.criteria import Phase
from volspec.palette.members import PaletteSpectrum
from volspec.palette.merit import merit
from volspec.palette.model import Palette
from volspec.palette.problem import solve
from volspec.palette.state import State, named
from volspec.spectra import Spectrum

Array = NDArray[np.float64]

# Linear RGB within which a cell counts as met exactly.
_MET = 1e-4


@dataclass(frozen=True, slots=True, eq=False)
class Design:
    """A palette that has been designed.

    Parameters
    ----------
    palette : Palette
        With every spectrum filled in; its exposure is what the design came to.
    state : State
        The spectra on the palette's grid.
    cost : float
        The weighted sum of squares of the last solution.
    residual : float
        How far the last solutions are from optimal; see `problem.Optimum`.
    """

    palette: Palette
    state: State
    cost: float
    residual: float

    def light(self, name: str) -> Spectrum:
        """A light of the palette, as it came out."""
        return _spectrum(self.palette.member("light", name))

    def reflectance(self, name: str) -> Spectrum:
        """A reflectance of the palette, as it came out."""
        return _spectrum(self.palette.member("reflectance", name))


def design(palette: Palette) -> Design:
    """Find the open spectra.

    Reflectances come first, under the lights as they begin; then lights, on these reflectances;
    `Criteria.rounds` times in turn, of which the best is kept. Where both are open and some cells
    count more than others, all count alike at first: what must be met under lights that are
    anyhow would else tie them there.

    Raises
    ------
    PaletteError
        If cells that must be met contradict each other or the bounds.
    SpectrumError
        If a given spectrum is none, or does not cover the palette's grid.
    """
    begun = _Round(State.start(palette), math.inf, math.inf)
    weights = {cell.weight for cell in palette.cells.values()}
    both = all(any(m.open for m in members) for members in (palette.lights, palette.reflectances))
    if both and (len(weights) > 1 or math.inf in weights):
        alike = {place: replace(cell, weight=1.0) for place, cell in palette.cells.items()}
        begun = _rounds(replace(begun.state, palette=replace(palette, cells=alike)))
        begun = replace(begun, state=replace(begun.state, palette=palette))
    try:
        best = _rounds(begun.state)
    except PaletteError:
        # What lies on a bound can be met, but not as an equation between rounded numbers.
        if math.isinf(begun.cost) or not _meets_what_must_be(begun.state):
            raise
        best = begun
    return Design(_filled(palette, best.state), best.state, best.cost, best.residual)


@dataclass(frozen=True, slots=True, eq=False)
class _Round:
    """Where a round has come to, what its last solution cost, and how far that is from optimal."""

    state: State
    cost: float
    residual: float


def _rounds(state: State) -> _Round:
    """The best of a palette's rounds."""
    best, least = None, math.inf
    refused: dict[bool, PaletteError] = {}
    solved: set[bool] = set()
    for turn in range(state.palette.criteria.rounds):
        cost = residual = 0.0
        for lights in (False, True):
            phase = Phase(state, lights, turn == 0)
            if not phase.open:
                continue
            try:
                state, cost, wrong = _step(phase)
            except PaletteError as error:  # perhaps the other phase can meet what must be
                refused[lights] = error
            else:
                solved.add(lights)
                residual = max(residual, wrong)
        if solved and (reached := merit(state)) < least:
            best, least = _Round(state, cost, residual), reached
    for lights, complaint in refused.items():
        if best is None or lights not in solved or not _meets_what_must_be(best.state):
            raise complaint
    assert best is not None
    return best


def _meets_what_must_be(state: State) -> bool:
    """Whether every cell that must be met is, to what an eye could tell by far."""
    palette, eyes = state.palette, state.eyes()
    shown = state.linear(eyes)
    for place, cell in palette.cells.items():
        if math.isinf(cell.weight):
            here = shown[palette.index(place)]
            if cell.other is not None:
                target = shown[palette.index(cell.other)]
            elif cell.wanted is not None:
                target = eyes[0].space.decode(cell.wanted)
            else:
                continue  # of a free group that is met as one
            if np.abs(here - target).max() > _MET:
                return False
    return True


def _step(phase: Phase) -> tuple[State, float, float]:
    blocks, terms = phase.problem()
    found = solve(blocks, terms)
    spectra = {
        number: phase.synthesis(number) @ found.values[phase.block_name(number)]
        for number in phase.open
    }
    state = phase.state
    state = state.with_columns(spectra) if phase.lights else state.with_rows(spectra)
    return state, found.cost, found.residual


def _spectrum(member: PaletteSpectrum) -> Spectrum:
    assert member.spectrum is not None  # a design has filled them all
    return member.spectrum


def _filled(palette: Palette, state: State) -> Palette:
    """The palette with what was designed in it; open spectra stay open.

    Lights are as `volspec.light` gives them: 1 is the even light of Y = 100.
    """
    unit = 100.0 / float(state.Q[1].sum())
    rows = tuple(
        replace(row, spectrum=named(row, values, palette.grid)) if row.open else row
        for row, values in zip(palette.reflectances, state.S, strict=True)
    )
    columns = tuple(
        replace(column, spectrum=named(column, values / unit, palette.grid))
        if column.open
        else column
        for column, values in zip(palette.lights, state.E, strict=True)
    )
    return replace(palette, reflectances=rows, lights=columns)
