"""Lights and reflectances in turn, until the colours stand: the design itself.

model -> state -> criteria -> problem -> [solve] -> report
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from volspec.palette.criteria import Phase
from volspec.palette.members import PaletteSpectrum
from volspec.palette.model import Palette
from volspec.palette.problem import solve
from volspec.palette.state import State, named
from volspec.spectra import Spectrum

Array = NDArray[np.float64]


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
    `Criteria.rounds` times in turn.

    Raises
    ------
    PaletteError
        If cells that must be met contradict each other or the bounds.
    SpectrumError
        If a given spectrum is none, or does not cover the palette's grid.
    """
    state = State.start(palette)
    cost = residual = 0.0
    for turn in range(palette.criteria.rounds):
        cost = residual = 0.0
        for lights in (False, True):
            phase = Phase(state, lights, turn == 0)
            if phase.open:
                state, own, wrong = _step(phase)
                cost, residual = own, max(residual, wrong)
    return Design(_filled(palette, state), state, cost, residual)


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
