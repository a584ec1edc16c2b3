"""Colours as straight functions of the spectra that a phase looks for.

    state, eyes -> [straight] -> rows

References
----------
[1] Bergner, Drew & Möller (2009), ACM TOG 28(1) art. 5, eq. 16.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from volspec.palette.eye import Eye
from volspec.palette.problem import Term
from volspec.palette.state import State

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True, eq=False)
class Seen:
    """A colour in linear RGB as a straight function of the unknowns.

    Parameters
    ----------
    parts : {block: (3, n)}
        Empty where both its spectra stand.
    constant : (3,)
    """

    parts: Mapping[str, Array]
    constant: Array

    def through(self, matrix: Array, shift: Array | float = 0.0) -> Seen:
        """Matrix · self + shift."""
        parts = {name: matrix @ rows for name, rows in self.parts.items()}
        return Seen(parts, matrix @ self.constant + shift)

    def equals(self, other: Seen, weight: float, label: str) -> Term:
        """Rows that want self - other = 0."""
        parts = dict(self.parts)
        for name, rows in other.parts.items():
            parts[name] = parts[name] - rows if name in parts else -rows
        return Term(parts, other.constant - self.constant, weight, label)


@dataclass(frozen=True, slots=True, eq=False)
class Unknowns:
    """What a phase looks for.

    Parameters
    ----------
    state : State
    lights : bool
        Whether lights are designed, rather than reflectances.
    names : {number: block}
        Of the open ones.
    synthesis : {number: (N, n)}
        Unknowns to the spectrum as the state has it.
    first : bool
        Whether no round has been before.
    """

    state: State
    lights: bool
    names: Mapping[int, str]
    synthesis: Mapping[int, Array]
    first: bool


@dataclass(frozen=True, slots=True, eq=False)
class Straight:
    """What eyes see of all cells, as straight functions of the spectra about a colour each.

    Parameters
    ----------
    unknowns : Unknowns
    slopes : (R, L, 3, 3)
        Linear RGB from XYZ.
    rows : (R, L, 3, N)
        Linear RGB from the spectrum that is designed.
    constant : (R, L, 3)
    """

    unknowns: Unknowns
    slopes: Array
    rows: Array
    constant: Array

    @classmethod
    def about(cls, unknowns: Unknowns, eyes: list[Eye], XYZ: Array) -> Straight:
        """(R, L, 3) colours where slopes are taken; exact there."""
        state = unknowns.state
        slopes = np.stack([eye.slopes(XYZ[:, j]) for j, eye in enumerate(eyes)], axis=1)
        seen = np.stack([eye.linear(XYZ[:, j]) for j, eye in enumerate(eyes)], axis=1)
        constant = seen - (slopes @ XYZ[..., None])[..., 0]
        others = state.S[:, None, None] if unknowns.lights else state.E[None, :, None]
        return cls(unknowns, slopes, slopes @ (state.Q * others), constant)

    def seen(self, i: int, j: int) -> Seen:
        """One cell."""
        number, state = (j if self.unknowns.lights else i), self.unknowns.state
        if number in self.unknowns.names:
            rows = self.rows[i, j] @ self.unknowns.synthesis[number]
            return Seen({self.unknowns.names[number]: rows}, self.constant[i, j])
        spectrum = state.E[j] if self.unknowns.lights else state.S[i]
        return Seen({}, self.constant[i, j] + self.rows[i, j] @ spectrum)
