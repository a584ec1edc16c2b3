"""What a design asks for, as rows of a least-squares problem over the spectra that are open.

    state -> [criteria] -> problem

One phase designs the reflectances under the lights as they stand, the other the lights on the
reflectances as they stand; the rows are the same, as light and reflectance stand side by side in
XYZ = Q (E ∗ S).

References
----------
[1] Bergner, Drew & Möller (2009), ACM TOG 28(1) art. 5, section 3, eq. 16-24.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from volspec.palette.eye import Eye
from volspec.palette.model import Cell, Place
from volspec.palette.problem import Block, Term
from volspec.palette.state import State, named

Array = NDArray[np.float64]

# Rows of one colour count as one (1/√3); CIELAB differences in hundredths, near those of RGB.
_ONE = 1.0 / math.sqrt(3.0)
_Lab_UNIT = 0.01
# Where two colours that shall part are alike, so much of a* and b* says into which direction.
_ALIKE = 0.1
# How much more than its difference counts that a distinct cell is a colour the display shows.
_GAMUT = 10.0


@dataclass(frozen=True, slots=True, eq=False)
class Seen:
    """A cell's linear RGB as a straight function of the unknowns.

    Parameters
    ----------
    parts : {block: (3, n)}
        Empty where both its spectra stand.
    constant : (3,)
    """

    parts: dict[str, Array]
    constant: Array


@dataclass(frozen=True, slots=True, eq=False)
class Phase:
    """The rows of one phase.

    Parameters
    ----------
    state : State
    lights : bool
        Whether the lights are designed, rather than the reflectances.
    """

    state: State
    lights: bool

    @property
    def open(self) -> list[int]:
        """Numbers of the spectra that this phase designs."""
        palette = self.state.palette
        members = palette.lights if self.lights else palette.reflectances
        return [number for number, member in enumerate(members) if member.open]

    def block_name(self, number: int) -> str:
        """Of the unknowns of one spectrum."""
        return f"{'light' if self.lights else 'reflectance'} {number}"

    def synthesis(self, number: int) -> Array:
        """(N, n): unknowns to the spectrum as the state has it."""
        palette = self.state.palette
        members = palette.lights if self.lights else palette.reflectances
        synthesis = members[number].synthesis(palette.grid)
        return synthesis * self.unit

    @property
    def unit(self) -> float:
        """What an unknown of 1 is in the state: for lights the even light of Y = 100."""
        return 100.0 / float(self.state.Q[1].sum()) if self.lights else 1.0

    def problem(self) -> tuple[dict[str, Block], list[Term]]:
        """Blocks of unknowns, and the rows over them."""
        state, cells = self.state, self.state.palette.cells
        eyes = state.eyes()
        current = state.linear(eyes)
        blocks = {self.block_name(n): self._block(n) for n in self.open}
        terms = list(self._own_terms())
        for place, cell in self.with_constancy(cells).items():
            more, rows = self._cell_rows(place, cell, eyes, current)
            blocks |= more
            terms += [term for term in rows if term.parts.keys() & blocks.keys()]
        # Where both spectra stand a free colour mends nothing, and an exact one would contradict
        # its own rounding.
        spectra = {self.block_name(number) for number in self.open}
        tied = spectra.union(*(t.parts for t in terms if t.parts.keys() & spectra))
        terms = [term for term in terms if term.parts.keys() & tied]
        return {name: block for name, block in blocks.items() if name in tied}, terms

    def _block(self, number: int) -> Block:
        palette = self.state.palette
        member = (palette.lights if self.lights else palette.reflectances)[number]
        size = member.synthesis(palette.grid).shape[1]
        low = -math.inf if member.lower is None else member.lower
        high = math.inf if member.upper is None else member.upper
        return Block(size, np.full(size, low), np.full(size, high))

    def _own_terms(self) -> Iterator[Term]:
        """Smoothness of each spectrum, and the luminance of each light."""
        palette, state = self.state.palette, self.state
        bands = palette.grid.size
        bend = np.diff(np.eye(bands), 2, axis=0) / math.sqrt(6.0 * bands)
        for number in self.open:
            name, synthesis = self.block_name(number), self.synthesis(number)
            if palette.criteria.smoothness:
                rows = bend @ synthesis / self.unit
                yield Term({name: rows}, np.zeros(len(rows)), palette.criteria.smoothness, name)
            if self.lights and palette.level == "relative":
                luminance = (state.Q[1] @ synthesis)[None] / 100.0
                label = f"the luminance of light {palette.lights[number].name!r}"
                yield Term({name: luminance}, np.ones(1), math.inf, label)

    def with_constancy(self, cells: Mapping[Place, Cell]) -> dict[Place, Cell]:
        """The cells, and those that a constant row stands for."""
        palette = self.state.palette
        every = dict(cells)
        for row in palette.reflectances:
            lights = palette.names[1]
            own = [cells[row.name, light] for light in lights if (row.name, light) in cells]
            coloured = next((cell for cell in own if cell.kind in ("colour", "free")), None)
            if row.constant:
                meant = coloured or Cell("free", group=f"constant {row.name}")
                every |= {(row.name, n): meant for n in lights if (row.name, n) not in cells}
        return every

    def _seen(self, i: int, j: int, eye: Eye, anchor: Array) -> Seen:
        state = self.state
        slopes = eye.slopes(anchor)
        constant = eye.linear(anchor) - slopes @ anchor
        number, other = (j, state.S[i]) if self.lights else (i, state.E[j])
        members = state.palette.lights if self.lights else state.palette.reflectances
        if not members[number].open:
            return Seen({}, constant + slopes @ state.XYZ[i, j])
        rows = slopes @ (state.Q * other) @ self.synthesis(number)
        return Seen({self.block_name(number): rows}, constant)

    def _cell_rows(
        self, place: Place, cell: Cell, eyes: list[Eye], current: Array
    ) -> tuple[dict[str, Block], list[Term]]:
        """The unknowns of a cell's own, and its rows."""
        i, j = self.state.palette.index(place)
        eye, now, label = eyes[j], current[i, j], f"cell ({place[0]}, {place[1]})"
        blocks: dict[str, Block] = {}
        rows = list(self._subspace_rows(i, j, cell, eye))
        target = wanted(cell, eye)
        here = self._seen(i, j, eye, self.state.XYZ[i, j] if target is None else eye.XYZ(target))
        if target is not None:
            metric = self._metric(eye, now, target, cell)
            rows.append(_term(metric, here, Seen({}, target), cell.weight, label))
        elif cell.other is None:
            low, high = eye.space.decode(cell.low), eye.space.decode(cell.high)
            near = np.clip(now, low, high)
            name = f"free {cell.group}"
            blocks[name] = Block(3, low, high)
            metric = self._metric(eye, near, near, cell)
            rows.append(_term(metric, here, _unknown(name), cell.weight, label))
        else:
            k, m = self.state.palette.index(cell.other)
            there = self._seen(k, m, eyes[m], self.state.XYZ[k, m])
            if cell.kind == "same":
                metric = self._metric(eye, now, current[k, m], cell)
                rows.append(_term(metric, here, there, cell.weight, label))
            else:
                # In its place a colour that the display shows, as near as can be.
                name = f"shown {i} {j}"
                blocks[name] = Block(3, np.zeros(3), np.ones(3))
                shown = _unknown(name)
                rows.append(_term(_GAMUT * np.eye(3), here, shown, cell.weight, label))
                rows.append(self._distinct(cell, shown, there, eye, now, current[k, m], label))
        return blocks, rows

    def _metric(self, eye: Eye, one: Array, other: Array, cell: Cell) -> Array:
        """(3, 3): differences of linear RGB to those that are squared."""
        if self.state.palette.criteria.metric == "RGB" or math.isinf(cell.weight):
            return _ONE * np.eye(3)
        return _ONE * _Lab_UNIT * eye.Lab_slopes(one, other)

    def _distinct(
        self, cell: Cell, here: Seen, there: Seen, eye: Eye, one: Array, other: Array, label: str
    ) -> Term:
        """One row: the difference along the direction in which it lies already."""
        W = eye.Lab_slopes(one, other)
        difference = W @ (one - other)
        if np.linalg.norm(difference) < _ALIKE:
            difference = difference + _ALIKE * np.array([0.0, 1.0, 1.0])
        along = (difference / np.linalg.norm(difference)) @ W
        apart = _minus(here, there)
        parts = {name: along[None] @ rows for name, rows in apart.parts.items()}
        enough = Seen({}, np.full(1, cell.distance))
        return _term(
            _Lab_UNIT * np.eye(1),
            Seen(parts, along[None] @ apart.constant),
            enough,
            cell.weight,
            label,
        )

    def _subspace_rows(self, i: int, j: int, cell: Cell, eye: Eye) -> Iterator[Term]:
        """F of [1, eq. 20]: what all bands say less what the basis says, componentwise."""
        state, palette = self.state, self.state.palette
        number = j if self.lights else i
        if not palette.criteria.subspace or palette.basis is None or number not in self.open:
            return
        light = named(palette.lights[j], state.E[j], palette.grid)
        other, A = (state.S[i] if self.lights else state.E[j]), palette.basis.analysis
        less = state.Q * other - palette.basis.display_matrix(light) * (A @ other) @ A
        rows = _ONE * eye.slopes(state.XYZ[i, j]) @ less @ self.synthesis(number)
        weight = palette.criteria.subspace * (1.0 if math.isinf(cell.weight) else cell.weight)
        name = self.block_name(number)
        yield Term({name: rows}, np.zeros(3), weight, f"the subspace error of {name}")


def wanted(cell: Cell, eye: Eye) -> Array | None:
    """(3,) linear RGB of a cell that asks for a colour, or for black."""
    if cell.kind == "black":
        return np.zeros(3)
    return None if cell.colour is None else eye.space.decode(cell.colour)


def _unknown(name: str) -> Seen:
    """A colour that is itself a block of unknowns."""
    return Seen({name: np.eye(3)}, np.zeros(3))


def _minus(one: Seen, other: Seen) -> Seen:
    parts = dict(one.parts)
    for name, rows in other.parts.items():
        parts[name] = parts[name] - rows if name in parts else -rows
    return Seen(parts, one.constant - other.constant)


def _term(metric: Array, one: Seen, other: Seen, weight: float, label: str) -> Term:
    """Metric · (one - other) = 0."""
    apart = _minus(one, other)
    parts = {name: metric @ rows for name, rows in apart.parts.items()}
    return Term(parts, -metric @ apart.constant, weight, label)
