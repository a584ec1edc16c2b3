"""Fluorescence: light absorbed at some wavelengths and emitted at others, as a Donaldson matrix.

    excitation, emission, quantum yield -> [fluorescence] -> Spectrum -> photometry, MaterialBasis

A fluorophore emits φ photons for each that it absorbs, distributed as its emission spectrum
whatever the exciting wavelength: a matrix of rank one. With the absorbed fraction a(λ') and the
emission e(λ), in photons and of unit sum, power falling in band j leaves band i as

    M_ij = φ a(λ_j) e(λ_i) λ_j / λ_i.

A measured bispectral matrix, which may have any rank, is given as it is.

References
----------
[1] Donaldson (1954), "Spectrophotometry of Fluorescent Pigments", British Journal of Applied
    Physics 5(6), 210-214.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray

from volspec.errors import SpectrumError
from volspec.spectra.grid import SpectralGrid

Array = NDArray[np.float64]
_ROUNDING = 1e-6


class Sampled(Protocol):
    """Values by wavelength, as of a `Spectrum`."""

    @property
    def name(self) -> str:
        """Name for messages."""

    @property
    def grid(self) -> SpectralGrid:
        """Grid of the samples."""

    @property
    def values(self) -> Array:
        """(L,) samples."""

    def on(self, grid: SpectralGrid) -> Sampled:
        """Return band means on another grid."""


@dataclass(frozen=True, slots=True, eq=False)
class Fluorescence:
    """Power that a material emits in each band for the power that falls in each band.

    Parameters
    ----------
    grid : SpectralGrid
        L bands.
    matrix : (L, L) array
        ``matrix[i, j]`` is the power emitted in band i for a unit of power that falls in band j;
        0 or more, with columns that sum to at most 1.

    Raises
    ------
    SpectrumError
        If the matrix has another shape, is not finite, is negative, or emits more than it gets.

    Examples
    --------
    >>> from volspec.spectra import DEFAULT_GRID, Spectrum
    >>> nm = DEFAULT_GRID.wavelengths_nm
    >>> blue, green = (Spectrum(nm, abs(nm - peak) < 12) for peak in (480, 520))
    >>> Fluorescence.of(blue, green, quantum_yield=0.5).matrix[28, 20].round(3)
    np.float64(0.092)
    """

    grid: SpectralGrid
    matrix: Array = field(repr=False)

    def __post_init__(self) -> None:
        matrix = np.array(self.matrix, dtype=np.float64)
        matrix.flags.writeable = False
        object.__setattr__(self, "matrix", matrix)
        size = self.grid.size
        if matrix.shape != (size, size):
            raise SpectrumError(
                f"fluorescence: the matrix has shape {matrix.shape}; expected ({size}, {size}), "
                "emission by excitation",
                code="shape",
            )
        if not (np.isfinite(matrix).all() and matrix.min() >= 0):
            raise SpectrumError(
                f"fluorescence: the matrix has the value {matrix.min():g}; give finite numbers of "
                "0 or more"
            )
        emitted = matrix.sum(0)
        peak = int(emitted.argmax())
        if emitted[peak] > 1 + _ROUNDING:
            raise SpectrumError(
                f"fluorescence: {emitted[peak]:.3g} of the power that falls in at "
                f"{self.grid.wavelengths_nm[peak]:g} nm is emitted; at most 1 can be, lower the "
                "quantum yield",
                code="impossible",
            )

    @classmethod
    def of(
        cls, excitation: Sampled, emission: Sampled, quantum_yield: float, absorptance: float = 1
    ) -> Fluorescence:
        """Return the fluorescence of one fluorophore, a matrix of rank one.

        Parameters
        ----------
        excitation : Spectrum
            Relative absorption by wavelength, on an equidistant grid: that of the result.
        emission : Spectrum
            Relative emission by wavelength, in photons; resampled to that grid.
        quantum_yield : float
            Photons emitted for each that is absorbed, 0 to 1.
        absorptance : float
            Fraction of light absorbed at the peak of the excitation, 0 to 1.

        Raises
        ------
        SpectrumError
            If a spectrum is negative or 0 throughout, or a number is not 0 to 1.
        """
        for name, value in (("quantum yield", quantum_yield), ("absorptance", absorptance)):
            if not 0 <= value <= 1:
                raise SpectrumError(f"fluorescence: the {name} is {value:g}; give 0 to 1")
        grid = excitation.grid
        bands = []
        for spectrum, kind in ((excitation, "excitation"), (emission, "emission")):
            values = spectrum.on(grid).values
            if values.min() < -_ROUNDING * np.abs(values).max() or not values.max() > 0:
                raise SpectrumError(
                    f"fluorescence: the {kind} {spectrum.name!r} ranges from {values.min():g} to "
                    f"{values.max():g}; give 0 or more, with a peak above 0"
                )
            bands.append(np.maximum(values, 0.0))
        absorbed, photons = absorptance * bands[0] / bands[0].max(), bands[1] / bands[1].sum()
        w = grid.wavelengths_nm
        return cls(grid, quantum_yield * np.outer(photons / w, absorbed * w))

    def on(self, grid: SpectralGrid) -> Fluorescence:
        """Return the matrix of another grid, for light that is even within each of its bands.

        What is absorbed or emitted beyond the grid is left out.
        """
        if grid == self.grid:
            return self
        mine, theirs = (
            g.wavelengths_nm[:, None] + g.step_nm * np.array([-0.5, 0.5]) for g in (self.grid, grid)
        )
        shared = np.minimum(theirs[:, None, 1], mine[None, :, 1]) - np.maximum(
            theirs[:, None, 0], mine[None, :, 0]
        )
        shared = np.maximum(shared, 0.0)
        return Fluorescence(
            grid, (shared / self.grid.step_nm) @ self.matrix @ (shared / grid.step_nm).T
        )

    def emitted(self, power: ArrayLike) -> Array:
        """Return the (..., L) power emitted under light of (..., L) power in each band."""
        return np.asarray(power, dtype=np.float64) @ self.matrix.T

    def __mul__(self, factor: float) -> Fluorescence:
        return Fluorescence(self.grid, self.matrix * factor)

    __rmul__ = __mul__

    def __add__(self, other: Fluorescence) -> Fluorescence:
        return Fluorescence(self.grid, self.matrix + other.on(self.grid).matrix)
