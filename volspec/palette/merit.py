"""How good a palette is as it stands: what rounds are compared by.

    state -> [merit] -> solve

Rounds take straight pieces for what is bent, and take turns: now and then one is worse than the one
before. This is the cost itself, without pieces.
"""

from __future__ import annotations

import math
from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from volspec.palette.model import Cell
from volspec.palette.rows import Pair, asked
from volspec.palette.state import State

Array = NDArray[np.float64]

# What counts for a cell that must be met: more than all the others can.
_MUST = 1e4


def merit(state: State) -> float:
    """The weighted sum of squares of a palette's colours and bends; less is better.

    Colours are compared as `Criteria.metric` says, a free one with the mean of its group.
    """
    palette = state.palette
    cells, eyes = asked(palette), state.eyes()
    shown = state.linear(eyes)
    unit = 1.0
    if palette.criteria.metric == "Lab":
        shown, unit = eyes[0].Lab(shown), 0.01
    means = _free_means(cells, shown)
    total = 0.0
    for place, cell in cells.items():
        if cell.wanted is not None:
            target = eyes[0].space.decode(cell.wanted)
            off = shown[place] - (eyes[0].Lab(target) if unit < 1.0 else target)
        elif cell.other is None:
            off = shown[place] - means[cell.group]
        else:
            off = shown[place] - shown[palette.index(cell.other)]
            if cell.kind == "distinct":
                off = np.array([max(cell.distance - float(np.linalg.norm(off)), 0.0)])
        total += float(((_weight(cell) * unit * off) ** 2).sum()) / 3.0
    return total + palette.criteria.smoothness**2 * _bends(state)


def _weight(cell: Cell) -> float:
    return _MUST if math.isinf(cell.weight) else cell.weight


def _free_means(cells: Mapping[Pair, Cell], shown: Array) -> dict[str, Array]:
    groups: dict[str, list[Pair]] = {}
    for place, cell in cells.items():
        if cell.kind == "free":
            groups.setdefault(cell.group, []).append(place)
    return {
        group: np.average(
            [shown[place] for place in places],
            axis=0,
            weights=[_weight(cells[place]) ** 2 for place in places],
        )
        for group, places in groups.items()
    }


def _bends(state: State) -> float:
    """Squares of second differences, as `Criteria.smoothness` counts them."""
    unit = 100.0 / float(state.Q[1].sum())
    open_rows = [row.open for row in state.palette.reflectances]
    open_columns = [column.open for column in state.palette.lights]
    spectra = np.concatenate([state.S[open_rows], state.E[open_columns] / unit])
    return float((np.diff(spectra, 2, axis=1) ** 2).sum()) / (6.0 * state.palette.grid.size)
