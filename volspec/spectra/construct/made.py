"""Reflectances made for colours, and how each came about.

[made] -> construct, command line
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from volspec.errors import SpectrumError
from volspec.spectra.construct.base import BaseSpectra

ROUTES = ("tetrahedron", "delaunay", "extended", "smoothest", "nearest", "recovered")
"""How a reflectance came about: mixed from the paper's tetrahedron or Delaunay's; extended smoothly
from the mixture where the way from grey leaves the base colours; as smooth as can be; of the
nearest colour there is, since no reflectance has the one asked for; or as a method of
colour-science recovers it, whose colour may be off."""

_LEAST_SHARE = 1e-9


@dataclass(frozen=True, slots=True, eq=False)
class MadeReflectances:
    """Reflectances for an array of colours; the arrays are read-only.

    Parameters
    ----------
    values : (..., N) float64
        0 to 1.
    route : (...) uint8
        Index into `ROUTES`.
    vertices : (..., 4) int
        Which base spectra were mixed, or mixed and extended; -1 where none were.
    shares : (..., 4) float64
        Of each, summing to 1; 0 where none were.
    base : BaseSpectra
        What was mixed from.

    Raises
    ------
    SpectrumError
        If the shapes do not belong together.
    """

    values: NDArray[np.float64]
    route: NDArray[np.uint8]
    vertices: NDArray[np.intp]
    shares: NDArray[np.float64]
    base: BaseSpectra

    def __post_init__(self) -> None:
        shape = self.values.shape[:-1]
        if not (
            self.route.shape == shape
            and self.vertices.shape == self.shares.shape == (*shape, 4)
            and self.values.shape[-1:] == (self.base.grid.size,)
        ):
            raise SpectrumError(
                f"made reflectances: values {self.values.shape}, route {self.route.shape}, "
                f"vertices {self.vertices.shape}, shares {self.shares.shape}; expected (..., "
                f"{self.base.grid.size}), (...), (..., 4) and (..., 4)"
            )
        for name in ("values", "route", "vertices", "shares"):
            view = getattr(self, name).view()
            view.flags.writeable = False
            object.__setattr__(self, name, view)

    def counts(self) -> dict[str, int]:
        """How many colours went each of the `ROUTES`; those that none went are left out."""
        numbers = np.bincount(self.route.ravel(), minlength=len(ROUTES)).tolist()
        return {name: n for name, n in zip(ROUTES, numbers, strict=True) if n}

    def mix(self, index: Sequence[int] = ()) -> dict[str, float]:
        """The base spectra that one reflectance was mixed or extended from, with shares."""
        rows, shares = self.vertices[tuple(index)], self.shares[tuple(index)]
        parts = [
            (self.base.names[row], float(share))
            for row, share in zip(rows.tolist(), shares, strict=True)
            if share > _LEAST_SHARE
        ]
        return dict(sorted(parts, key=lambda part: -part[1]))
