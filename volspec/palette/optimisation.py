"""Design a palette: optimise its free lights and reflectances in turn.

    model -> state -> linearisation -> quadratic_program -> [optimisation] -> report

One phase designs the reflectances under the current lights, the other the lights on the current
reflectances. Both have the same equations, as light and reflectance are interchangeable in
XYZ = Q (E ∗ S). The phases alternate, each linearised, so the true cost may rise; the iteration of
least true cost is kept.

References
----------
[1] Bergner, Drew & Möller (2009), ACM TOG 28(1) art. 5, sections 3 and 5, after Smits (1999).
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from volspec.basis import SpectralBasis, display_matrix
from volspec.errors import PaletteError
from volspec.palette.linearisation import ROW_WEIGHT, CellEquations, Variables
from volspec.palette.model import Cell, Index, Palette
from volspec.palette.quadratic_program import EquationBlock, Term, solve
from volspec.palette.state import ColourModel, DesignState
from volspec.palette.variables import PaletteSpectrum
from volspec.spectra import Spectrum

Array = NDArray[np.float64]

# Half the step of a difference quotient, as a fraction of a light's mean.
_STEP = 1e-4
# Linear RGB within which a cell is met exactly.
_MET = 1e-4
# CIELAB difference within which a design in a file meets a cell: half a visible one.
_KEPT_dE = 0.5
# Weight of an exact cell in the true cost: more than all other cells together.
_EXACT_WEIGHT = 1e4
_SUBSPACE = "the subspace error of"


@dataclass(frozen=True, slots=True, eq=False)
class Phase:
    """Least-squares problem of the free reflectances, or of the free lights."""

    state: DesignState
    lights: bool  # True to design the lights, False the reflectances
    first: bool = True  # in the first iteration; see `linearisation`

    @property
    def members(self) -> tuple[PaletteSpectrum, ...]:
        """The palette's lights or reflectances, given ones too."""
        palette = self.state.palette
        return palette.lights if self.lights else palette.reflectances

    @property
    def free(self) -> list[int]:
        """Indices of the spectra that this phase designs."""
        return [number for number, member in enumerate(self.members) if member.free]

    @property
    def names(self) -> dict[int, str]:
        """Names of the free spectra's blocks of variables, by the spectrum's index."""
        kind = "light" if self.lights else "reflectance"
        return {number: f"{kind} {self.members[number].name!r}" for number in self.free}

    @property
    def unit(self) -> float:
        """Value in the state of a variable of 1; for lights, equal energy of Y = 100."""
        return 100.0 / float(self.state.Q[1].sum()) if self.lights else 1.0

    def synthesis(self, number: int) -> Array:
        """Return the (N, n) matrix from variables to the spectrum in the state."""
        return self.members[number].synthesis(self.state.palette.grid) * self.unit

    def values(self) -> dict[int, Array]:
        """Return the variables of each free spectrum: its bands, or the weights of its lamps."""
        spectra = self.state.E if self.lights else self.state.S
        return {
            number: np.linalg.lstsq(self.synthesis(number), spectra[number], rcond=None)[0]
            for number in self.free
        }

    def problem(self) -> tuple[dict[str, EquationBlock], list[Term]]:
        """Return the blocks of variables and the terms over them."""
        names = self.names
        synthesis = {number: self.synthesis(number) for number in names}
        variables = Variables(self.state, self.lights, names, synthesis, self.first)
        equations = CellEquations.of(variables)
        colours, rows = equations.problem()
        spectra = {name: self._block(number, variables) for number, name in names.items()}
        terms = [*self._own_terms(variables), *rows]
        basis = self.state.palette.basis
        if basis is not None and self.state.palette.criteria.subspace:
            terms += self._subspace_terms(equations, basis)
        # Skip free colours of given spectra: nothing can change them, and exact ones would
        # contradict their own rounding.
        connected = set(spectra)
        while more := {n for t in terms if t.parts.keys() & connected for n in t.parts} - connected:
            connected |= more
        terms = [term for term in terms if term.parts.keys() & connected]
        return spectra | {name: colours[name] for name in colours if name in connected}, terms

    def solve(self) -> tuple[DesignState, float, float]:
        """Return the state with this phase's spectra designed, the cost, and the residual."""
        optimum = solve(*self.problem())
        spectra = {n: self.synthesis(n) @ optimum.values[name] for n, name in self.names.items()}
        return self.state.with_spectra(self.lights, spectra), optimum.cost, optimum.residual

    def costs(self) -> dict[str, float]:
        """Return the weighted squared smoothness and subspace errors of the current state."""
        costs = {"smoothness": 0.0, "subspace": 0.0}
        names = self.names
        x = {names[number]: values for number, values in self.values().items()}
        for term in self.problem()[1]:
            subspace = term.label.startswith(_SUBSPACE)
            if subspace or term.label in x:  # smoothness has the spectrum's name
                predicted = sum(rows @ x[name] for name, rows in term.parts.items())
                square = float(((predicted - term.target) ** 2).sum())
                costs["subspace" if subspace else "smoothness"] += term.weight**2 * square
        return costs

    def _block(self, number: int, variables: Variables) -> EquationBlock:
        member, size = self.members[number], variables.synthesis[number].shape[1]
        low = -math.inf if member.lower is None else float(member.lower)
        high = math.inf if member.upper is None else float(member.upper)
        return EquationBlock(size, np.full(size, low), np.full(size, high))

    def _own_terms(self, variables: Variables) -> Iterator[Term]:
        """Yield the smoothness of each spectrum [1, eq. 21], and the luminance of each light."""
        palette, state = self.state.palette, self.state
        bands = palette.grid.size
        bend = np.diff(np.eye(bands), 2, axis=0) / (math.sqrt(6.0 * bands) * self.unit)
        for number, name in variables.names.items():
            synthesis = variables.synthesis[number]
            if palette.criteria.smoothness:
                zero = np.zeros(bands - 2)
                yield Term({name: bend @ synthesis}, zero, palette.criteria.smoothness, name)
            if self.lights and palette.level == "relative":
                luminance = (state.Q[1] @ synthesis)[None] / 100.0
                yield Term({name: luminance}, np.ones(1), math.inf, f"the luminance of {name}")

    def _subspace_terms(self, equations: CellEquations, basis: SpectralBasis) -> Iterator[Term]:
        """Yield F of [1, eq. 20]: colours of all bands minus the basis's componentwise colours."""
        state, variables = self.state, equations.at_current.variables
        subspace = state.palette.criteria.subspace
        channels = state.S @ basis.analysis.T
        from_basis: dict[int, Array] = {}
        for (i, j), cell in equations.cells.items():
            number = j if self.lights else i
            if number not in variables.names:
                continue
            if j not in from_basis:
                arguments = basis, state.E[j], state.Q
                from_basis[j] = (
                    _basis_XYZ_by_light(*arguments)
                    if self.lights
                    else _XYZ_from_channels(*arguments) @ basis.analysis
                )
            less = from_basis[j] @ channels[i] if self.lights else from_basis[j]
            other = state.S[i] if self.lights else state.E[j]
            rows = ROW_WEIGHT * equations.at_current.jacobian[i, j] @ (state.Q * other - less)
            weight = subspace * (1.0 if math.isinf(cell.weight) else cell.weight)
            name = variables.names[number]
            part = {name: rows @ variables.synthesis[number]}
            yield Term(part, np.zeros(3), weight, f"{_SUBSPACE} {name}")


def _XYZ_from_channels(basis: SpectralBasis, E: Array, Q: Array) -> Array:
    """Return the (3, m) matrix from a reflectance's channels to XYZ at the light's level."""
    e = basis.analysis @ E
    level = float(Q[1] @ E) / 100.0
    return level * display_matrix(basis.XYZ_from_channels, e, E, Q) * e


def _basis_XYZ_by_light(basis: SpectralBasis, E: Array, Q: Array) -> Array:
    """Return (3, N, m): `_XYZ_from_channels`, exact white included, differentiated by the light.

    Twice the light gives twice the matrix, so the tangent goes through the origin (Euler).
    """
    step = _STEP * float(np.abs(E).mean())
    ahead, back = (
        [_XYZ_from_channels(basis, E + sign * row, Q) for row in step * np.eye(len(E))]
        for sign in (1.0, -1.0)
    )
    slopes: Array = (np.stack(ahead, axis=1) - np.stack(back, axis=1)) / (2.0 * step)
    return slopes


def true_cost(state: DesignState) -> float:
    """Return the weighted sum of squared colour errors and roughness, not linearised.

    Colours are compared by `Criteria.metric`, free ones with the mean of their group.
    """
    palette = state.palette
    cells, models = palette.indexed_cells(), state.colour_models()
    colours, unit, model = state.RGB(models), 1.0, None
    if palette.criteria.metric == "Lab":
        model = models[0]
        colours, unit = model.Lab_from_RGB(colours), 0.01
    total = 0.0
    for place, target in compared_colours(palette, cells, colours, model).items():
        cell, off = cells[place], colours[place] - target
        if cell.kind == "distinct":
            off = np.array([max(cell.distance - float(np.linalg.norm(off)), 0.0)])
        total += float(((_finite_weight(cell) * unit * off) ** 2).sum()) / 3.0
    total += apart_cost(state, state.RGB(models))
    return total + palette.criteria.smoothness**2 * _roughness(state)


def shortfalls(state: DesignState, RGB: Array) -> Iterator[tuple[float, float]]:
    """Yield (weight, ΔE that is lacking) of each pair to be distinguished, for each deficiency."""
    model = state.colour_models()[0]
    for pair in state.palette.apart_pairs():
        row = pair.row
        for deficiency in row.deficiencies:
            one, other = (
                model.simulated_Lab(RGB[place], deficiency, row.severity)[
                    0 if row.lightness else 1 :
                ]
                for place in (pair.one, pair.other)
            )
            yield row.weight, max(row.distance - float(np.linalg.norm(one - other)), 0.0)


def apart_cost(state: DesignState, RGB: Array) -> float:
    """Return the weighted squared shortfalls of pairs to be distinguished."""
    return sum((weight * 0.01 * lacking) ** 2 / 3.0 for weight, lacking in shortfalls(state, RGB))


def _finite_weight(cell: Cell) -> float:
    return _EXACT_WEIGHT if math.isinf(cell.weight) else cell.weight


def compared_colours(
    palette: Palette, cells: Mapping[Index, Cell], colours: Array, Lab: ColourModel | None = None
) -> dict[Index, Array]:
    """Return the colour that each cell is compared with: linear RGB, or CIELAB if a model is given.

    This is the wanted colour, the colour of another cell, or for free cells their group's mean.
    """
    space = palette.viewing.display.colours
    compared: dict[Index, Array] = {}
    for place, cell in cells.items():
        if cell.wanted is not None:
            target = space.decode(cell.wanted)
            compared[place] = target if Lab is None else Lab.Lab_from_RGB(target)
        elif cell.other is not None:
            compared[place] = colours[palette.index(cell.other)]
        else:
            group = [key for key, member in cells.items() if member.group == cell.group]
            weights = [_finite_weight(cells[key]) ** 2 for key in group]
            compared[place] = np.average([colours[key] for key in group], axis=0, weights=weights)
    return compared


def _roughness(state: DesignState) -> float:
    """Return the squared second differences of free spectra that `Criteria.smoothness` weights."""
    unit = 100.0 / float(state.Q[1].sum())
    rows = [row.free for row in state.palette.reflectances]
    columns = [column.free for column in state.palette.lights]
    spectra = np.concatenate([state.S[rows], state.E[columns] / unit])
    return float((np.diff(spectra, 2, axis=1) ** 2).sum()) / (6.0 * state.palette.grid.size)


@dataclass(frozen=True, slots=True, eq=False)
class Design:
    """A palette that has been designed.

    Parameters
    ----------
    palette : Palette
        The palette with every spectrum filled in.
    state : State
        Spectra on the palette's grid.
    cost : float
        Weighted sum of squares of the best iteration's last solve.
    residual : float
        Largest relative violation of the optimality conditions in the best iteration.
    kept : bool
        True if the palette's own values meet every cell and were kept.
    """

    palette: Palette
    state: DesignState
    cost: float
    residual: float
    kept: bool = False

    def light(self, name: str) -> Spectrum:
        """Return a light of the palette."""
        return _spectrum(self.palette.member("light", name))

    def reflectance(self, name: str) -> Spectrum:
        """Return a reflectance of the palette."""
        return _spectrum(self.palette.member("reflectance", name))


def design(palette: Palette, *, again: bool = False) -> Design:
    """Optimise a palette's free spectra.

    A palette that has been designed already and meets every cell is kept: metamers and free
    colours have many designs, and another run would drift to another of them. ``again`` goes on
    from it.

    Otherwise reflectances are designed under the initial lights, then lights on these reflectances,
    and so on for `Criteria.rounds` iterations; the best one is the result. If both are free and
    weights differ, a first design weights all cells alike: equality constraints under arbitrary
    lights would otherwise fix the reflectances.

    Raises
    ------
    PaletteError
        If exact cells contradict each other or the bounds.
    SpectrumError
        If a given spectrum is invalid, or does not cover the palette's grid.
    """
    begun = _Iteration(DesignState.start(palette), math.inf, math.inf)
    if not again and _is_designed(begun.state):
        return Design(palette, begun.state, true_cost(begun.state), 0.0, kept=True)
    weights = {cell.weight for cell in palette.cells.values()}
    both = all(any(m.free for m in members) for members in (palette.lights, palette.reflectances))
    if both and (len(weights) > 1 or math.inf in weights):
        alike = {place: replace(cell, weight=1.0) for place, cell in palette.cells.items()}
        begun = _iterate(replace(begun.state, palette=replace(palette, cells=alike)))
        begun = replace(begun, state=replace(begun.state, palette=palette))
    try:
        best = _iterate(begun.state)
    except PaletteError:
        # A colour on a bound can be met, but not as an equation between rounded numbers.
        if math.isinf(begun.cost) or not _meets_exact_cells(begun.state):
            raise
        best = begun
    return Design(_designed_palette(palette, best.state), best.state, best.cost, best.residual)


@dataclass(frozen=True, slots=True, eq=False)
class _Iteration:
    """State after an iteration, with the cost and residual of its last solve."""

    state: DesignState
    cost: float
    residual: float


def _iterate(state: DesignState) -> _Iteration:
    """Alternate reflectances and lights; return the iteration of least true cost."""
    best, best_cost = None, math.inf
    refused: dict[bool, PaletteError] = {}
    solved: set[bool] = set()
    for iteration in range(state.palette.criteria.rounds):
        cost = residual = 0.0
        for lights in (False, True):
            phase = Phase(state, lights, iteration == 0)
            if not phase.free:
                continue
            try:
                state, cost, violation = phase.solve()
            except PaletteError as error:  # perhaps the other phase can meet the exact cells
                refused[lights] = error
            else:
                solved.add(lights)
                residual = max(residual, violation)
        if solved and (reached := true_cost(state)) < best_cost:
            best, best_cost = _Iteration(state, cost, residual), reached
    for lights, refusal in refused.items():
        if best is None or lights not in solved or not _meets_exact_cells(best.state):
            raise refusal
    assert best is not None
    return best


def _meets_exact_cells(state: DesignState) -> bool:
    """Return True if every cell of infinite weight is met to well below a visible difference."""
    RGB, palette = state.RGB(), state.palette
    exact = {
        palette.index(place): cell
        for place, cell in palette.cells.items()
        if math.isinf(cell.weight) and cell.kind != "free"  # free groups are met as one
    }
    compared = compared_colours(palette, exact, RGB)
    return all(np.abs(RGB[index] - target).max() <= _MET for index, target in compared.items())


def _is_designed(state: DesignState) -> bool:
    """Return True if all free spectra were designed, are within bounds and meet every cell."""
    palette, unit = state.palette, 100.0 / float(state.Q[1].sum())
    for members, spectra in ((palette.reflectances, state.S), (palette.lights, state.E / unit)):
        for member, values in zip(members, spectra, strict=True):
            if member.free and not (
                member.spectrum is not None
                and member.spectrum.designed
                and member.allows(values, palette.grid)
            ):
                return False
    if palette.criteria.subspace or not _meets_exact_cells(state):
        return False
    models, cells = state.colour_models(), palette.indexed_cells()
    RGB, model = state.RGB(models), models[0]
    Lab = model.Lab_from_RGB(RGB)
    for place, target in compared_colours(palette, cells, Lab, model).items():
        cell, error = cells[place], float(np.linalg.norm(Lab[place] - target))
        if cell.kind == "distinct":
            error = max(cell.distance - error, 0.0)
        if cell.kind == "free":
            bounds = model.space.decode(palette.free_bounds(cell.group))
            inside = model.Lab_from_RGB(np.clip(RGB[place], *bounds))
            error = max(error, float(np.linalg.norm(Lab[place] - inside)))
        if error > _KEPT_dE:
            return False
    return all(lacking <= _KEPT_dE for _, lacking in shortfalls(state, RGB))


def _spectrum(member: PaletteSpectrum) -> Spectrum:
    assert member.spectrum is not None  # a design fills in all spectra
    return member.spectrum


def _designed_palette(palette: Palette, state: DesignState) -> Palette:
    """Return the palette with the designed values in its free spectra, which stay free.

    Lights are scaled as in `volspec.light`: 1 is the equal-energy light of Y = 100.
    """
    unit = 100.0 / float(state.Q[1].sum())

    def filled(members: tuple[PaletteSpectrum, ...], spectra: Array) -> tuple[PaletteSpectrum, ...]:
        nm, note = palette.grid.wavelengths_nm, {"designed": "volspec design"}
        return tuple(
            replace(member, spectrum=Spectrum(nm, values, member.name, note))
            if member.free
            else member
            for member, values in zip(members, spectra, strict=True)
        )

    rows, columns = filled(palette.reflectances, state.S), filled(palette.lights, state.E / unit)
    return replace(palette, reflectances=rows, lights=columns)


def fitted_exposure(palette: Palette) -> float:
    """Return the exposure at which the designed reflectances stay within their upper bounds.

    The palette is designed without upper bounds; if a reflectance exceeds its bound, the exposure
    is raised by that factor [1]. Half the reflectance under twice the light has the same colour,
    so nothing is lost.

    Returns
    -------
    float
        At least the palette's own exposure; for `Palette.with_exposure`.

    Raises
    ------
    PaletteError
        As `design`.
    """
    rows = palette.reflectances
    unbounded = tuple(replace(row, upper=None) if row.free else row for row in rows)
    S = design(replace(palette, reflectances=unbounded), again=True).state.S
    ratios = [
        float(values.max() / row.upper)
        for row, values in zip(rows, S, strict=True)
        if row.free and row.upper
    ]
    return palette.viewing.exposure * max([1.0, *ratios])
