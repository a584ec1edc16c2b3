"""Linearise a palette's colours as affine functions of the spectra that a phase designs.

    state -> [linearisation] -> optimisation

In the first iteration CIELAB is replaced by its chord from the current colour to the wanted one,
which is exact if that is met; later by its tangent at the current colour (Gauss-Newton steps).
Chords alone would not converge: colours that cannot be met oscillate and get worse.

References
----------
[1] Bergner, Drew & Möller (2009), ACM TOG 28(1) art. 5, section 3, eq. 16, 22-24.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from volspec.palette.model import ApartPair, Cell, Index, Palette
from volspec.palette.quadratic_program import EquationBlock, Term
from volspec.palette.state import ColourModel, DesignState

Array = NDArray[np.float64]

ROW_WEIGHT = 1.0 / math.sqrt(3.0)
"""Weight of each of a colour's three equations, so that they count as one."""
# A hundredth of a CIELAB difference is about as large as a difference in linear RGB.
_Lab_UNIT = 0.01
# ΔE below which distinct colours have no direction yet; they are moved apart along a* and b*.
_ALIKE = 0.1
# Weight that keeps distinct colours within the display's gamut, relative to their difference.
_GAMUT = 10.0


@dataclass(frozen=True, slots=True, eq=False)
class AffineColour:
    """A colour as an affine function of the free variables."""

    parts: Mapping[str, Array]  # {block: (3, n)}; empty if the colour is constant
    constant: Array  # (3,)

    def transform(self, matrix: Array, shift: Array | float = 0.0) -> AffineColour:
        """Return matrix · colour + shift."""
        parts = {name: matrix @ rows for name, rows in self.parts.items()}
        return AffineColour(parts, matrix @ self.constant + shift)

    def plus(self, other: AffineColour) -> AffineColour:
        """Return the sum with another of other variables."""
        return AffineColour({**self.parts, **other.parts}, self.constant + other.constant)

    def equality(self, other: AffineColour, weight: float, label: str) -> Term:
        """Return the equations by which the colour equals another."""
        parts = dict(self.parts)
        for name, rows in other.parts.items():
            parts[name] = parts[name] - rows if name in parts else -rows
        return Term(parts, other.constant - self.constant, weight, label)


@dataclass(frozen=True, slots=True, eq=False)
class Variables:
    """Free variables of a phase."""

    state: DesignState
    lights: bool  # True if lights are designed, False if reflectances are
    names: Mapping[int, str]  # {number: block} of the free spectra
    synthesis: Mapping[int, Array]  # {number: (N, n)}: variables to the spectrum in the state
    first: bool  # True in the first iteration


@dataclass(frozen=True, slots=True, eq=False)
class Linearisation:
    """Linear RGB of all cells, each linearised at one colour in terms of the spectra."""

    variables: Variables
    jacobian: Array  # (R, L, 3, 3): linear RGB by XYZ
    rows: Array  # (R, L, 3, N): linear RGB by the spectrum that is designed
    constant: Array  # (R, L, 3)

    @classmethod
    def at(cls, variables: Variables, models: list[ColourModel], XYZ: Array) -> Linearisation:
        """Linearise at (R, L, 3) colours; exact there."""
        state = variables.state
        jacobian = np.stack([model.RGB_jacobian(XYZ[:, j]) for j, model in enumerate(models)], 1)
        RGB = np.stack([model.RGB_from_XYZ(XYZ[:, j]) for j, model in enumerate(models)], axis=1)
        constant = RGB - (jacobian @ XYZ[..., None])[..., 0]
        fixed = state.S[:, None, None] if variables.lights else state.E[None, :, None]
        return cls(variables, jacobian, jacobian @ (state.Q * fixed), constant)

    def colour(self, place: Index) -> AffineColour:
        """Return the linearised colour of a cell."""
        variables, state = self.variables, self.variables.state
        number = place[1] if variables.lights else place[0]
        if number in variables.names:
            rows = self.rows[place] @ variables.synthesis[number]
            return AffineColour({variables.names[number]: rows}, self.constant[place])
        spectrum = state.E[number] if variables.lights else state.S[number]
        return AffineColour({}, self.constant[place] + self.rows[place] @ spectrum)


@dataclass(frozen=True, slots=True, eq=False)
class CellEquations:
    """Linearised equations of all cells."""

    cells: Mapping[Index, Cell]
    Lab: Array  # (R, L, 3): current colours
    Lab_slopes: Array  # (R, L, 3, 3): CIELAB by linear RGB, chords or tangents
    Lab_at_black: Array  # (R, L, 3): value of the chords or tangents at linear RGB 0
    targets: Mapping[Index, tuple[Array, Array]]  # linear RGB and CIELAB, black included
    model: ColourModel  # between linear RGB and CIELAB, the same under every light
    RGB: Array  # (R, L, 3): current colours; in the first iteration, those wanted
    free: Mapping[str, tuple[Array, Array]]  # slopes and value at linear RGB 0, by group
    at_current: Linearisation
    at_wanted: Linearisation  # for equality constraints, and in the first iteration

    @classmethod
    def of(cls, variables: Variables) -> CellEquations:
        """Linearise the cells of a phase."""
        state = variables.state
        cells, models, XYZ = state.palette.indexed_cells(), state.colour_models(), state.XYZ
        model, current = models[0], state.RGB(models)
        codes = {place: cell.wanted for place, cell in cells.items() if cell.wanted is not None}
        places = list(codes)
        colours = model.space.decode(np.reshape(list(codes.values()), (-1, 3)))
        targets = dict(
            zip(places, zip(colours, model.Lab_from_RGB(colours), strict=True), strict=True)
        )
        free = _free_colours(cells, current, model, state.palette)
        ends, anchors = current.copy(), XYZ.copy()
        met = [place for place in places if variables.first or math.isinf(cells[place].weight)]
        for place in met:
            ends[place] = targets[place][0]
        for j in {j for _, j in met}:
            rows = [i for i, k in met if k == j]
            anchors[rows, j] = models[j].XYZ_from_RGB(ends[rows, j])
        if variables.first:
            for place, cell in cells.items():
                ends[place] = free.get(cell.group, ends[place])
        Lab, slopes = model.Lab_from_RGB(current), model.Lab_chord(current, ends)
        return cls(
            cells,
            Lab,
            slopes,
            Lab - (slopes @ current[..., None])[..., 0],
            targets,
            model,
            ends if variables.first else current,
            {group: _tangent(model, colour) for group, colour in free.items()},
            Linearisation.at(variables, models, XYZ),
            Linearisation.at(variables, models, anchors),
        )

    def problem(self) -> tuple[dict[str, EquationBlock], list[Term]]:
        """Return the blocks of free colours and all equations."""
        blocks: dict[str, EquationBlock] = {}
        terms: list[Term] = []
        for place, cell in self.cells.items():
            more, rows = self._equations(place, cell)
            blocks |= more
            terms += [term for term in rows if term.parts]
        more, rows = self._apart_equations()
        return blocks | more, [*terms, *rows]

    def _equations(self, place: Index, cell: Cell) -> tuple[dict[str, EquationBlock], list[Term]]:
        palette, first = self._palette, self.at_current.variables.first
        label = f"cell ({palette.reflectances[place[0]].name}, {palette.lights[place[1]].name})"
        exact = math.isinf(cell.weight)
        in_RGB = exact or palette.criteria.metric == "RGB"
        if place in self.targets:
            linearised = self.at_wanted if exact or first else self.at_current
            here = self._metric(linearised.colour(place), place, in_RGB)
            RGB, Lab = self.targets[place]
            target = AffineColour({}, ROW_WEIGHT * (RGB if in_RGB else _Lab_UNIT * Lab))
            return {}, [here.equality(target, cell.weight, label)]
        here = self._metric(self.at_current.colour(place), place, in_RGB)
        if cell.other is None:
            name, colour = _variable_colour(f"free colour {cell.group!r}")
            space = palette.viewing.display.colours
            block = EquationBlock(3, *space.decode(palette.free_bounds(cell.group)))
            if in_RGB or first:
                colour = self._metric(colour, place, in_RGB)
            else:
                slopes, at_black = self.free[cell.group]
                unit = ROW_WEIGHT * _Lab_UNIT
                colour = colour.transform(unit * slopes, unit * at_black)
            return {name: block}, [here.equality(colour, cell.weight, label)]
        other = palette.index(cell.other)
        if cell.kind == "same":
            target = self._metric(self.at_current.colour(other), other, in_RGB)
            return {}, [here.equality(target, cell.weight, label)]
        return self._distinct_equations(place, other, cell, label)

    @property
    def _palette(self) -> Palette:
        return self.at_current.variables.state.palette

    def _distinct_equations(
        self, place: Index, other: Index, cell: Cell, label: str
    ) -> tuple[dict[str, EquationBlock], list[Term]]:
        """Return two distant colours within the gamut, and terms that tie the cells to them."""
        name, displayed = _variable_colour(f"the colour shown by {label}")
        other_name, other_displayed = _variable_colour(f"the colour compared with {label}")
        blocks = {
            variable: EquationBlock(3, np.zeros(3), np.ones(3)) for variable in (name, other_name)
        }
        shows = [
            self.at_current.colour(index).equality(colour, _GAMUT * cell.weight, label)
            for index, colour in ((place, displayed), (other, other_displayed))
        ]
        # Along the direction in which the two colours already differ.
        difference = self.Lab[place] - self.Lab[other]
        if np.linalg.norm(difference) < _ALIKE:
            difference = difference + _ALIKE * np.array([0.0, 1.0, 1.0])
        direction = (difference / np.linalg.norm(difference))[None] / ROW_WEIGHT
        target = self._metric(other_displayed, other, in_RGB=False)
        enough = target.transform(direction, _Lab_UNIT * cell.distance)
        far = self._metric(displayed, place, in_RGB=False).transform(direction)
        return blocks, [*shows, far.equality(enough, cell.weight, label)]

    def _apart_equations(self) -> tuple[dict[str, EquationBlock], list[Term]]:
        """Return equations by which viewers distinguish pairs of colours, one for each deficiency.

        Along the direction u in which the viewer sees the two differ now, or as they are wanted in
        the first iteration,

            u · (Lab(M c) - Lab(M c')) - excess = distance,   excess >= 0

        where M c is the simulated colour, and c lies within the display's gamut; linearised, this
        is convex. Pairs that already differ by more cost nothing, as the excess is free.
        """
        blocks: dict[str, EquationBlock] = {}
        terms: list[Term] = []
        weights: dict[Index, float] = {}
        for number, pair in enumerate(self._palette.apart_pairs()):
            for place in (pair.one, pair.other):
                weights[place] = max(weights.get(place, 0.0), pair.row.weight)
            for deficiency in pair.row.deficiencies:
                excess = f"excess of pair {number} for {deficiency}"
                blocks[excess] = EquationBlock(1, np.zeros(1), np.full(1, math.inf))
                terms.append(self._apart_equation(pair, deficiency, excess))
        for place, weight in weights.items():
            name, displayed = _variable_colour(_shown_name(place))
            blocks[name] = EquationBlock(3, np.zeros(3), np.ones(3))
            label = f"the gamut at {place}"
            terms.append(self.at_current.colour(place).equality(displayed, _GAMUT * weight, label))
        return blocks, terms

    def _apart_equation(self, pair: ApartPair, deficiency: str, excess: str) -> Term:
        row, ends, RGB = pair.row, (pair.one, pair.other), self.RGB
        Labs = [self.model.simulated_Lab(RGB[place], deficiency, row.severity) for place in ends]
        compared = np.array([float(row.lightness), 1.0, 1.0])
        difference = compared * (Labs[0] - Labs[1])
        if np.linalg.norm(difference) < _ALIKE:
            difference = difference + _ALIKE * np.array([0.0, 1.0, 1.0])
        unit = ROW_WEIGHT * _Lab_UNIT
        direction = unit * (difference / np.linalg.norm(difference))[None]
        colours = []
        for place in ends:
            slopes, at_black = self.model.simulated_tangent(RGB[place], deficiency, row.severity)
            _, displayed = _variable_colour(_shown_name(place))
            colours.append(displayed.transform(direction @ slopes, direction @ at_black))
        over = AffineColour({excess: unit * np.eye(1)}, np.array([unit * row.distance]))
        far = colours[1].plus(over)
        return colours[0].equality(far, row.weight, excess)

    def _metric(self, colour: AffineColour, place: Index, in_RGB: bool) -> AffineColour:
        """Transform a colour near the colour of a place to the metric's coordinates."""
        if in_RGB:
            return colour.transform(ROW_WEIGHT * np.eye(3))
        unit = ROW_WEIGHT * _Lab_UNIT
        return colour.transform(unit * self.Lab_slopes[place], unit * self.Lab_at_black[place])


def _free_colours(
    cells: Mapping[Index, Cell], current: Array, model: ColourModel, palette: Palette
) -> dict[str, Array]:
    """Return each group's linear RGB: the least-squares mean of its cells, within its bounds."""
    members: dict[str, list[tuple[Index, float]]] = {}
    for place, cell in cells.items():
        if cell.kind == "free":
            weight = 1.0 if math.isinf(cell.weight) else cell.weight**2
            members.setdefault(cell.group, []).append((place, weight))
    colours = {}
    for group, weighted in members.items():
        Lab = model.Lab_from_RGB(np.stack([current[place] for place, _ in weighted]))
        mean = np.average(Lab, axis=0, weights=[weight for _, weight in weighted])
        low, high = model.space.decode(palette.free_bounds(group))
        colours[group] = np.clip(model.RGB_from_Lab(mean), low, high)
    return colours


def _tangent(model: ColourModel, colour: Array) -> tuple[Array, Array]:
    """Return the slopes of CIELAB at a colour and the tangent's value at linear RGB 0."""
    slopes = model.Lab_chord(colour, colour)
    return slopes, model.Lab_from_RGB(colour) - slopes @ colour


def _shown_name(place: Index) -> str:
    return f"the colour shown at {place}"


def _variable_colour(name: str) -> tuple[str, AffineColour]:
    """Return a colour that is itself a block of variables."""
    return name, AffineColour({name: np.eye(3)}, np.zeros(3))
