"""What a design asks for, as rows of a least-squares problem over the spectra that are open.

    state -> rows -> [criteria] -> problem

One phase designs the reflectances under the lights as they stand, the other the lights on the
reflectances as they stand; the rows are the same, as light and reflectance stand side by side in
XYZ = Q (E ∗ S).

References
----------
[1] Bergner, Drew & Möller (2009), ACM TOG 28(1) art. 5, section 3, eq. 16-24.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from volspec.basis import SpectralBasis
from volspec.basis.display import display_matrix
from volspec.palette.members import PaletteSpectrum
from volspec.palette.problem import Block, Term
from volspec.palette.rows import ONE, Table
from volspec.palette.state import State
from volspec.palette.straight import Unknowns

Array = NDArray[np.float64]

# Half the step of a difference quotient, as a share of a light's mean.
_STEP = 1e-4


@dataclass(frozen=True, slots=True, eq=False)
class Phase:
    """The rows of one phase.

    Parameters
    ----------
    state : State
    lights : bool
        Whether the lights are designed, rather than the reflectances.
    first : bool
        Whether no round has been before; see `rows`.
    """

    state: State
    lights: bool
    first: bool = True

    @property
    def members(self) -> tuple[PaletteSpectrum, ...]:
        """The spectra of which this phase designs the open ones."""
        palette = self.state.palette
        return palette.lights if self.lights else palette.reflectances

    @property
    def open(self) -> list[int]:
        """Numbers of the spectra that this phase designs."""
        return [number for number, member in enumerate(self.members) if member.open]

    def block_name(self, number: int) -> str:
        """Of the unknowns of one spectrum."""
        return f"{'light' if self.lights else 'reflectance'} {self.members[number].name!r}"

    @property
    def unit(self) -> float:
        """What an unknown of 1 is in the state: for lights the even light of Y = 100."""
        return 100.0 / float(self.state.Q[1].sum()) if self.lights else 1.0

    def synthesis(self, number: int) -> Array:
        """(N, n): unknowns to the spectrum as the state has it."""
        return self.members[number].synthesis(self.state.palette.grid) * self.unit

    def problem(self) -> tuple[dict[str, Block], list[Term]]:
        """Blocks of unknowns, and the rows over them.

        Raises
        ------
        PaletteError
            If a free spectrum has no band to be free in.
        """
        names = {number: self.block_name(number) for number in self.open}
        synthesis = {number: self.synthesis(number) for number in names}
        unknowns = Unknowns(self.state, self.lights, names, synthesis, self.first)
        table = Table.of(unknowns)
        colours, rows = table.problem()
        spectra = {name: self._block(number, unknowns) for number, name in names.items()}
        terms = [*self._own_terms(unknowns), *rows]
        basis = self.state.palette.basis
        if basis is not None and self.state.palette.criteria.subspace:
            terms += self._subspace_terms(table, basis)
        # Where all spectra stand a free colour mends nothing, and an exact one would contradict
        # its own rounding.
        tied = set(spectra)
        while more := {n for t in terms if t.parts.keys() & tied for n in t.parts} - tied:
            tied |= more
        terms = [term for term in terms if term.parts.keys() & tied]
        return spectra | {name: colours[name] for name in colours if name in tied}, terms

    def _block(self, number: int, unknowns: Unknowns) -> Block:
        member, size = self.members[number], unknowns.synthesis[number].shape[1]
        low = -math.inf if member.lower is None else float(member.lower)
        high = math.inf if member.upper is None else float(member.upper)
        return Block(size, np.full(size, low), np.full(size, high))

    def _own_terms(self, unknowns: Unknowns) -> Iterator[Term]:
        """Smoothness of each spectrum [1, eq. 21], and the luminance of each light."""
        palette, state = self.state.palette, self.state
        bands = palette.grid.size
        bend = np.diff(np.eye(bands), 2, axis=0) / (math.sqrt(6.0 * bands) * self.unit)
        for number, name in unknowns.names.items():
            synthesis = unknowns.synthesis[number]
            if palette.criteria.smoothness:
                zero = np.zeros(bands - 2)
                yield Term({name: bend @ synthesis}, zero, palette.criteria.smoothness, name)
            if self.lights and palette.level == "relative":
                luminance = (state.Q[1] @ synthesis)[None] / 100.0
                yield Term({name: luminance}, np.ones(1), math.inf, f"the luminance of {name}")

    def _subspace_terms(self, table: Table, basis: SpectralBasis) -> Iterator[Term]:
        """F of [1, eq. 20]: what all bands say less what the basis says, componentwise."""
        state, unknowns = self.state, table.now.unknowns
        subspace = state.palette.criteria.subspace
        channels = state.S @ basis.analysis.T
        from_basis: dict[int, Array] = {}
        for (i, j), cell in table.cells.items():
            number = j if self.lights else i
            if number not in unknowns.names:
                continue
            if j not in from_basis:
                make = _bent_by_light if self.lights else _bent_by_reflectance
                from_basis[j] = make(basis, state.E[j], state.Q)
            less = from_basis[j] @ channels[i] if self.lights else from_basis[j]
            other = state.S[i] if self.lights else state.E[j]
            rows = ONE * table.now.slopes[i, j] @ (state.Q * other - less)
            weight = subspace * (1.0 if math.isinf(cell.weight) else cell.weight)
            name = unknowns.names[number]
            part = {name: rows @ unknowns.synthesis[number]}
            yield Term(part, np.zeros(3), weight, f"the subspace error of {name}")


def _channels_matrix(basis: SpectralBasis, E: Array, Q: Array) -> Array:
    """(3, m): a reflectance's channels to XYZ under a light at its own level, componentwise."""
    e = basis.analysis @ E
    level = float(Q[1] @ E) / 100.0
    return level * display_matrix(basis.XYZ_from_channels, e, E, Q) * e


def _bent_by_reflectance(basis: SpectralBasis, E: Array, Q: Array) -> Array:
    """(3, N): a reflectance to the XYZ that the basis makes of it under a light."""
    return _channels_matrix(basis, E, Q) @ basis.analysis


def _bent_by_light(basis: SpectralBasis, E: Array, Q: Array) -> Array:
    """(3, N, m): slopes of `_channels_matrix` with the light, its white's exactness included.

    Twice the light makes twice the matrix, so the tangent goes through the origin (Euler).
    """
    step = _STEP * float(np.abs(E).mean())
    ahead, back = (
        [_channels_matrix(basis, E + sign * row, Q) for row in step * np.eye(len(E))]
        for sign in (1.0, -1.0)
    )
    slopes: Array = (np.stack(ahead, axis=1) - np.stack(back, axis=1)) / (2.0 * step)
    return slopes
