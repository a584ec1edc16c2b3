"""Reflectances that are wanted alike under a light: how alike they are, and how apart elsewhere.

cells -> [metamers] -> report

References
----------
[1] CIE 15:2018, "Colorimetry", section 9.2: special metamerism index, change in illuminant.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from itertools import combinations

import numpy as np
from numpy.typing import NDArray

from volspec.appearance.models.cielab import delta_E_2000
from volspec.palette.model import Cell, Palette, Place

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class MetamerReport:
    """Two reflectances that are wanted alike under a light.

    Parameters
    ----------
    light : str
    reflectances : (str, str)
    delta_E : float
        CIEDE2000 between them under that light.
    apart : {light: float}
        The same under every other: the special metamerism indices [1].
    """

    light: str
    reflectances: tuple[str, str]
    delta_E: float
    apart: dict[str, float]


def metamer_reports(
    palette: Palette, wishes: Mapping[Place, Cell], Lab: Array
) -> Iterator[MetamerReport]:
    """Every pair of reflectances that cells ask one colour of, light by light."""
    rows, columns = palette.names
    for j, column in enumerate(columns):
        for (i, one), (k, other) in combinations(enumerate(rows), 2):
            if _alike(wishes, (one, column), (other, column)):
                between = delta_E_2000(Lab[i], Lab[k])
                apart = {n: float(d) for n, d in zip(columns, between, strict=True) if n != column}
                yield MetamerReport(column, (one, other), float(between[j]), apart)


def _alike(wishes: Mapping[Place, Cell], one: Place, other: Place) -> bool:
    """Whether two cells ask for one colour."""
    if one not in wishes or other not in wishes:
        return False
    first, second = _root(wishes, one), _root(wishes, other)
    if first == second:
        return True
    a, b = wishes.get(first), wishes.get(second)
    if a is None or b is None or a.kind != b.kind or a.kind not in ("colour", "black", "free"):
        return False
    return (a.colour, a.group) == (b.colour, b.group)


def _root(wishes: Mapping[Place, Cell], place: Place) -> Place:
    """Where the chain of cells that are each the same as the next one ends."""
    seen = {place}
    while (cell := wishes.get(place)) and cell.kind == "same" and cell.other not in seen:
        assert cell.other is not None
        place = cell.other
        seen.add(place)
    return place
