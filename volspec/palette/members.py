"""The spectra of a palette: given ones, and open ones with what they may become.

spectra -> [members] -> model
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from volspec.errors import PaletteError
from volspec.spectra import SpectralGrid, Spectrum
from volspec.spectra.spectrum import light_power, stack

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True, eq=False)
class PaletteSpectrum:
    """A light or a reflectance of a palette.

    Parameters
    ----------
    name : str
    spectrum : Spectrum, optional
        What it is; of an open one, where the design begins (a reflectance by default at one half,
        a light at a wave of its own).
    open : bool
        Whether it is designed.
    lower, upper : float, optional
        Bounds of an open one in every band; None is none. A light's are relative to its mean.
    band_nm : (shortest, longest), optional
        An open one is zero outside.
    mixture : tuple of Spectrum
        An open light is a sum of these, each at least 0 times: one that can be built.
    constant : bool
        A reflectance that shows one colour under every light: objective colour constancy.

    Raises
    ------
    PaletteError
        If a given one has no spectrum, bounds contradict, or what is for open ones is given for
        another.
    """

    name: str
    spectrum: Spectrum | None = None
    open: bool = False
    lower: float | None = 0.0
    upper: float | None = None
    band_nm: tuple[float, float] | None = None
    mixture: tuple[Spectrum, ...] = ()
    constant: bool = False

    def __post_init__(self) -> None:
        if not (isinstance(self.name, str) and self.name.strip()):
            raise PaletteError.refused("palette: a spectrum's name", self.name, "give it a name")
        label = f"palette: {self.name!r}"
        if self.spectrum is None and not self.open:
            raise PaletteError(
                f"{label} has no spectrum; give one, or open it for design", code="conflict"
            )
        for name in ("lower", "upper"):
            value = getattr(self, name)
            if value is not None and not math.isfinite(value):
                raise PaletteError.refused(f"{label}: {name}", value, "give a number, or none")
        if self.lower is not None and self.upper is not None and not self.lower < self.upper:
            remedy = "leave a range between them" if self.lower == self.upper else "swap them"
            raise PaletteError(
                f"{label}: lower {self.lower:g} is not below upper {self.upper:g}; {remedy}"
            )
        if self.band_nm is not None and not self.band_nm[0] < self.band_nm[1]:
            raise PaletteError(f"{label}: band_nm {self.band_nm} is empty; shortest comes first")
        if self.mixture and not self.open:
            raise PaletteError(f"{label} has a mixture, but is not open; open it for design")

    def synthesis(self, grid: SpectralGrid) -> Array:
        """(N, n): the unknowns to the bands; the identity, bands within limits, or lamps.

        Raises
        ------
        PaletteError
            If no band lies within the limits.
        SpectrumError
            If a lamp does not cover the grid.
        """
        inside = np.ones(grid.size, dtype=bool)
        if self.band_nm is not None:
            wavelengths = grid.wavelengths_nm
            inside = (wavelengths >= self.band_nm[0]) & (wavelengths <= self.band_nm[1])
            if not inside.any():
                raise PaletteError(
                    f"palette: {self.name!r}: no band of {grid} lies within {self.band_nm} nm; "
                    "widen the band"
                )
        if self.mixture:
            lamps = np.stack([light_power(lamp, grid) for lamp in self.mixture], axis=-1)
            return (lamps / lamps.mean(axis=0)) * inside[:, None]
        return np.eye(grid.size)[:, inside]

    def values(self, grid: SpectralGrid) -> Array | None:
        """(N,) on a grid; None where the design has not begun."""
        return None if self.spectrum is None else stack(self.spectrum, grid)
