"""A palette's cells as rows of a least-squares problem.

    state, eyes -> straight -> [rows] -> criteria

Every cell's colour is made a straight function of the spectrum that a phase designs. In the first
round CIELAB is the chord from the colour as it stands to the one wanted, exact where that is met;
then its tangent, drawn anew in every round (Gauss and Newton's steps). Chords alone would not do:
where colours cannot be met they swing, and the palette gets worse round by round.

References
----------
[1] Bergner, Drew & Möller (2009), ACM TOG 28(1) art. 5, section 3, eq. 16, 22-24.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from itertools import groupby

import numpy as np
from numpy.typing import NDArray

from volspec.palette.eye import Eye
from volspec.palette.model import Cell, Palette
from volspec.palette.problem import Block, Term
from volspec.palette.straight import Seen, Straight, Unknowns

Array = NDArray[np.float64]
Pair = tuple[int, int]
"""Numbers of a cell's reflectance and of its light."""

# Rows of one colour count as one (1/√3); CIELAB differences in hundredths, near those of RGB.
ONE = 1.0 / math.sqrt(3.0)
_Lab_UNIT = 0.01
# Where two colours that shall part are alike, so much of a* and b* says into which direction.
_ALIKE = 0.1
# How much more than their difference counts that distinct cells are colours the display shows.
_GAMUT = 10.0


@dataclass(frozen=True, slots=True, eq=False)
class Table:
    """All cells that ask for something.

    Parameters
    ----------
    cells : {(i, j): Cell}
    Lab : (R, L, 3)
        Of the colours as they are.
    slopes : (R, L, 3, 3)
        Of CIELAB with linear RGB: chords or tangents.
    at_black : (R, L, 3)
        What these make of no light at all.
    wanted : {(i, j): ((3,), (3,))}
        Linear RGB and CIELAB where a colour is asked for, black included.
    free : {group: ((3, 3), (3,))}
        Slopes and what they make of no light for a free colour where its cells have it.
    now, met : Straight
        About the colours as they are, and about those that are wanted exactly or first.
    """

    cells: Mapping[Pair, Cell]
    Lab: Array
    slopes: Array
    at_black: Array
    wanted: Mapping[Pair, tuple[Array, Array]]
    free: Mapping[str, tuple[Array, Array]]
    now: Straight
    met: Straight

    @classmethod
    def of(cls, unknowns: Unknowns) -> Table:
        """The table of a phase."""
        state = unknowns.state
        cells, eyes, XYZ = asked(state.palette), state.eyes(), state.XYZ
        eye, near = eyes[0], state.linear(eyes)
        codes = {at: cell.wanted for at, cell in cells.items() if cell.wanted is not None}
        places = list(codes)
        colours = eye.space.decode(np.reshape(list(codes.values()), (-1, 3)))
        wanted = dict(zip(places, zip(colours, eye.Lab(colours), strict=True), strict=True))
        free = _free_colours(cells, near, eye, state.palette)
        ends, anchors = near.copy(), XYZ.copy()
        for j, of_light in groupby(sorted(places, key=_light), _light):
            places = [p for p in of_light if unknowns.first or math.isinf(cells[p].weight)]
            for place in places:
                ends[place] = wanted[place][0]
            rows = [i for i, _ in places]
            anchors[rows, j] = eyes[j].XYZ(ends[rows, j])
        if unknowns.first:
            for place, cell in cells.items():
                ends[place] = free.get(cell.group, ends[place])
        Lab, slopes = eye.Lab(near), eye.Lab_slopes(near, ends)
        return cls(
            cells,
            Lab,
            slopes,
            Lab - (slopes @ near[..., None])[..., 0],
            wanted,
            {group: _tangent(eye, colour) for group, colour in free.items()},
            Straight.about(unknowns, eyes, XYZ),
            Straight.about(unknowns, eyes, anchors),
        )

    def problem(self) -> tuple[dict[str, Block], list[Term]]:
        """Blocks of colours that are free themselves, and all rows."""
        blocks: dict[str, Block] = {}
        terms: list[Term] = []
        for place, cell in self.cells.items():
            more, rows = self._rows(place, cell)
            blocks |= more
            terms += [term for term in rows if term.parts]
        return blocks, terms

    def _rows(self, place: Pair, cell: Cell) -> tuple[dict[str, Block], list[Term]]:
        palette = self.now.unknowns.state.palette
        label = f"cell ({palette.reflectances[place[0]].name}, {palette.lights[place[1]].name})"
        must = math.isinf(cell.weight)
        in_RGB = must or palette.criteria.metric == "RGB"
        if place in self.wanted:
            straight = self.met if must or self.met.unknowns.first else self.now
            here = self._measured(straight.seen(*place), place, in_RGB)
            return {}, [here.equals(self._target(place, in_RGB), cell.weight, label)]
        here = self.now.seen(*place)
        if cell.other is None:
            name, colour = _colour(f"free colour {cell.group!r}")
            space = palette.viewing.display.colours
            block = Block(3, *space.decode(palette.free_bounds(cell.group)))
            if in_RGB or self.now.unknowns.first:
                colour = self._measured(colour, place, in_RGB)
            else:
                slopes, at_black = self.free[cell.group]
                colour = colour.through(ONE * _Lab_UNIT * slopes, ONE * _Lab_UNIT * at_black)
            here = self._measured(here, place, in_RGB)
            return {name: block}, [here.equals(colour, cell.weight, label)]
        other = palette.index(cell.other)
        if cell.kind == "same":
            here = self._measured(here, place, in_RGB)
            there = self._measured(self.now.seen(*other), other, in_RGB)
            return {}, [here.equals(there, cell.weight, label)]
        return self._distinct_rows(place, other, cell, label)

    def _distinct_rows(
        self, place: Pair, other: Pair, cell: Cell, label: str
    ) -> tuple[dict[str, Block], list[Term]]:
        """Two colours far from each other that the display shows, and the cells near them."""
        name, shown = _colour(f"the colour shown by {label}")
        beside, shown_there = _colour(f"the colour beside {label}")
        blocks = {each: Block(3, np.zeros(3), np.ones(3)) for each in (name, beside)}
        shows = [
            self.now.seen(*each).equals(colour, _GAMUT * cell.weight, label)
            for each, colour in ((place, shown), (other, shown_there))
        ]
        # Along the direction in which the two part already.
        way = self.Lab[place] - self.Lab[other]
        if np.linalg.norm(way) < _ALIKE:
            way = way + _ALIKE * np.array([0.0, 1.0, 1.0])
        along = (way / np.linalg.norm(way))[None] / ONE
        enough = self._measured(shown_there, other, False).through(along, _Lab_UNIT * cell.distance)
        apart = self._measured(shown, place, False).through(along)
        return blocks, [*shows, apart.equals(enough, cell.weight, label)]

    def _measured(self, seen: Seen, place: Pair, in_RGB: bool) -> Seen:
        """A colour near that of a place, in what is squared."""
        if in_RGB:
            return seen.through(ONE * np.eye(3))
        unit = ONE * _Lab_UNIT
        return seen.through(unit * self.slopes[place], unit * self.at_black[place])

    def _target(self, place: Pair, in_RGB: bool) -> Seen:
        """What is wanted in a place, in what is squared."""
        linear, Lab = self.wanted[place]
        return Seen({}, ONE * (linear if in_RGB else _Lab_UNIT * Lab))


def asked(palette: Palette) -> dict[Pair, Cell]:
    """The cells by number, and those that a constant row stands for."""
    rows = {name: number for number, name in enumerate(palette.names[0])}
    columns = {name: number for number, name in enumerate(palette.names[1])}
    cells = {(rows[i], columns[j]): cell for (i, j), cell in palette.cells.items()}
    for i, row in enumerate(palette.reflectances):
        if row.constant:
            own = [cells[i, j] for j in columns.values() if (i, j) in cells]
            meant = next((cell for cell in own if cell.kind in ("colour", "free")), None)
            meant = meant or Cell("free", group=f"of the constant {row.name}")
            cells = {(i, j): meant for j in columns.values()} | cells
    return cells


def _free_colours(
    cells: Mapping[Pair, Cell], near: Array, eye: Eye, palette: Palette
) -> dict[str, Array]:
    """Of each group the linear RGB, within its bounds, that has least squares to its cells now."""
    members: dict[str, list[tuple[Pair, float]]] = {}
    for place, cell in cells.items():
        if cell.kind == "free":
            share = 1.0 if math.isinf(cell.weight) else cell.weight**2
            members.setdefault(cell.group, []).append((place, share))
    colours = {}
    for group, own in members.items():
        Lab = eye.Lab(np.stack([near[place] for place, _ in own]))
        mean = np.average(Lab, axis=0, weights=[share for _, share in own])
        low, high = eye.space.decode(palette.free_bounds(group))
        colours[group] = np.clip(eye.linear_from_Lab(mean), low, high)
    return colours


def _tangent(eye: Eye, colour: Array) -> tuple[Array, Array]:
    """Slopes of CIELAB at a colour, and what they make of no light."""
    slopes = eye.Lab_slopes(colour, colour)
    return slopes, eye.Lab(colour) - slopes @ colour


def _light(place: Pair) -> int:
    return place[1]


def _colour(name: str) -> tuple[str, Seen]:
    """A colour that is itself a block of unknowns."""
    return name, Seen({name: np.eye(3)}, np.zeros(3))
