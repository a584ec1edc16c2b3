"""What a design shows in each of its cells, beside what was wanted there.

state -> [cells] -> metamers, report
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from volspec.appearance.models.cielab import delta_E_2000
from volspec.palette.colours import hexadecimal
from volspec.palette.model import Cell, Palette, Place
from volspec.palette.state import State

Array = NDArray[np.float64]
Triple = tuple[float, float, float]

# Half a step of 8 bits: so far outside a display's codes is not seen.
_CODE = 0.5 / 255.0


@dataclass(frozen=True, slots=True)
class CellReport:
    """A place of the palette: what was wanted there and what is seen.

    Parameters
    ----------
    reflectance, light : str
    kind : str
        As `Cell.kind`; ``""`` where nothing is wanted.
    weight : float
    wanted : (3,) floats, optional
        Display codes: the colour asked for; of a free cell what its group came to, of a cell that
        is to be the same as another that one's. None where no colour is wanted.
    obtained : (3,) floats
        Display codes, not clipped.
    XYZ : (3,) floats
        In the scene, Y = 100 for a perfect diffuser under a light of the palette.
    delta_E_2000, delta_E_1976 : float, optional
        Between the two before the display's white; of a distinct cell how far it is from the
        other.
    in_gamut : bool
        Whether the display shows what was obtained.
    """

    reflectance: str
    light: str
    kind: str
    weight: float
    wanted: Triple | None
    obtained: Triple
    XYZ: Triple
    delta_E_2000: float | None
    delta_E_1976: float | None
    in_gamut: bool

    @property
    def place(self) -> Place:
        """Names of its reflectance and light."""
        return self.reflectance, self.light

    @property
    def error(self) -> float | None:
        """CIEDE2000 from what is wanted; a distinct cell has none."""
        return None if self.kind == "distinct" else self.delta_E_2000

    def to_dict(self) -> dict[str, Any]:
        """For JSON."""
        words = asdict(self) | {"hex": hexadecimal(self.obtained)}
        words["wanted_hex"] = None if self.wanted is None else hexadecimal(self.wanted)
        words["weight"] = self.weight if np.isfinite(self.weight) else "must"
        words |= dict(zip("XYZ", words.pop("XYZ"), strict=True))
        return words


def cell_reports(
    state: State, wishes: Mapping[Place, Cell]
) -> tuple[tuple[CellReport, ...], Array]:
    """Every place, row by row; and (R, L, 3) CIELAB before the display's white."""
    palette, eyes = state.palette, state.eyes()
    linear, XYZ = state.linear(eyes), state.XYZ
    targets = _targets(palette, wishes, linear)
    Lab = np.stack([eye.Lab(linear[:, j]) for j, eye in enumerate(eyes)], axis=1)
    found = []
    for i, row in enumerate(palette.names[0]):
        for j, column in enumerate(palette.names[1]):
            cell, target = wishes.get((row, column)), targets.get((row, column))
            codes = eyes[j].space.encode(linear[i, j])
            far = None if target is None else eyes[j].Lab(target)
            found.append(
                CellReport(
                    *(row, column, cell.kind if cell else "", cell.weight if cell else 0.0),
                    None
                    if target is None or (cell and cell.kind == "distinct")
                    else _triple(eyes[j].space.encode(target)),
                    *(_triple(codes), _triple(XYZ[i, j])),
                    None if far is None else float(delta_E_2000(far, Lab[i, j])),
                    None if far is None else float(np.linalg.norm(far - Lab[i, j])),
                    bool(((codes > -_CODE) & (codes < 1.0 + _CODE)).all()),
                )
            )
    return tuple(found), Lab


def _targets(palette: Palette, wishes: Mapping[Place, Cell], linear: Array) -> dict[Place, Array]:
    """Linear RGB that each cell is compared with."""
    targets, space = {}, palette.viewing.display.colours
    for place, cell in wishes.items():
        if cell.other is not None:
            target = linear[palette.index(cell.other)]
        elif cell.wanted is not None:
            target = space.decode(cell.wanted)
        else:
            members = {at: c.weight for at, c in wishes.items() if c.group == cell.group}
            shares = np.array([1e9 if np.isinf(w) else w**2 for w in members.values()])
            target = shares @ np.array([linear[palette.index(at)] for at in members])
            target = target / shares.sum()
        targets[place] = target
    return targets


def _triple(values: Array) -> Triple:
    one, two, three = values.tolist()
    return one, two, three
