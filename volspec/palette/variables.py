"""Spectra of a palette: given ones, and design variables with bounds and an initial value.

spectra -> [variables] -> model
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from volspec._deprecated import renamed_attribute, renamed_keyword
from volspec.errors import PaletteError
from volspec.spectra import SpectralGrid, Spectrum, colour_matching_functions
from volspec.spectra.spectrum import light_power, reflectance_values

Array = NDArray[np.float64]

# Periods of the waves that free lights start from, nm (Bergner et al., section 4.1: 60 and 85).
_WAVES_NM = (60.0, 85.0, 110.0, 140.0, 45.0)
# A light with less luminance than this fraction of an even one has none for a colour.
_LEAST_Y = 1e-9


@dataclass(frozen=True, slots=True, eq=False)
class PaletteSpectrum:
    """A light or a reflectance of a palette.

    Parameters
    ----------
    name : str
    spectrum : Spectrum, optional
        Its values; the initial ones if it is free (by default one half for a reflectance, a wave
        of its own period for a light).
    free : bool
        True if it is a variable of the design.
    lower, upper : float, optional
        Bounds of a free spectrum in every band; None is unbounded. A light's are relative to its
        mean.
    band_nm : (shortest, longest), optional
        A free spectrum is zero outside.
    mixture : tuple of Spectrum
        Lamps; a free light is a sum of these with weights of at least 0, so that it can be built.
    constant : bool
        True for a reflectance of one colour under every light: objective colour constancy.

    Raises
    ------
    PaletteError
        If a given one has no spectrum, bounds contradict each other, or a given one has what only
        free ones may have.
    """

    name: str
    spectrum: Spectrum | None = None
    free: bool = False
    lower: float | None = 0.0
    upper: float | None = None
    band_nm: tuple[float, float] | None = None
    mixture: tuple[Spectrum, ...] = ()
    constant: bool = False

    def __post_init__(self) -> None:
        if not (isinstance(self.name, str) and self.name.strip()):
            raise PaletteError.refused("PaletteSpectrum.name", self.name, "give it a name")
        if self.spectrum is None and not self.free:
            raise PaletteError(
                f"{self.name!r} has no spectrum; give one, or make it free for design",
                code="missing",
                field="PaletteSpectrum.spectrum",
            )
        for name in ("lower", "upper"):
            value = getattr(self, name)
            if value is not None and not math.isfinite(value):
                field = f"PaletteSpectrum.{name}"
                raise PaletteError.refused(field, value, "give a number, or none", "range")
        if self.lower is not None and self.upper is not None and not self.lower < self.upper:
            remedy = "leave a range between them" if self.lower == self.upper else "swap them"
            raise PaletteError(
                f"{self.lower:g} is not below upper {self.upper:g}",
                remedy,
                code="conflict",
                field="PaletteSpectrum.lower",
                given=self.lower,
            )
        if self.band_nm is not None and not self.band_nm[0] < self.band_nm[1]:
            remedy = "the band is empty, the shortest comes first"
            raise PaletteError.refused("PaletteSpectrum.band_nm", self.band_nm, remedy, "range")
        if self.mixture and not self.free:
            raise PaletteError(
                f"{self.name!r} is a given spectrum, not a sum of lamps; make it free for design",
                code="conflict",
                field="PaletteSpectrum.mixture",
            )

    def synthesis(self, grid: SpectralGrid) -> Array:
        """Return the (N, n) matrix from variables to bands: an identity, a part of it, or lamps.

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
                    f"{self.name!r}: no band of {grid} lies within {self.band_nm} nm; widen it",
                    code="range",
                    field="PaletteSpectrum.band_nm",
                    given=self.band_nm,
                )
        if self.mixture:
            lamps = np.stack([light_power(lamp, grid) for lamp in self.mixture], axis=-1)
            return (lamps / lamps.mean(axis=0)) * inside[:, None]
        return np.eye(grid.size)[:, inside]

    open = renamed_attribute("free")


PaletteSpectrum.__init__ = renamed_keyword(open="free")(PaletteSpectrum.__init__)  # type: ignore[method-assign]


def initial_reflectance(row: PaletteSpectrum, grid: SpectralGrid) -> Array:
    """Return the (N,) values of a given reflectance, or those that a free one starts from.

    Raises
    ------
    SpectrumError
        If it does not cover the grid, or a given one is no reflectance.
    """
    if row.spectrum is None:
        return np.full(grid.size, 0.5)
    if row.free:
        return row.spectrum.on(grid).values
    return reflectance_values(row.spectrum, grid, f"palette: reflectance {row.name!r}")


def initial_light(column: PaletteSpectrum, grid: SpectralGrid, number: int) -> Array:
    """Return the (N,) power, at Y = 100, of a given light, or that a free one starts from.

    Parameters
    ----------
    column : PaletteSpectrum
    grid : SpectralGrid
    number : int
        Its column: free lights start from waves of different periods.

    Raises
    ------
    SpectrumError
        If it does not cover the grid or is no light.
    PaletteError
        If it has no luminance within its band.
    """
    power = _initial_power(column, grid, number)
    V = colour_matching_functions(grid)[1]
    if not V @ power > _LEAST_Y * V.sum():
        raise PaletteError(
            f"light {column.name!r} has no luminous energy to show a colour by; widen its band, or "
            "start from another spectrum",
            code="impossible",
        )
    return 100.0 * power / (V @ power)


def _initial_power(column: PaletteSpectrum, grid: SpectralGrid, number: int) -> Array:
    if column.spectrum is not None:
        return light_power(column.spectrum, grid, f"palette: light {column.name!r}")
    period = _WAVES_NM[number % len(_WAVES_NM)]
    wave = 0.5 + 0.5 * np.cos(2.0 * np.pi * (grid.wavelengths_nm - grid.start_nm) / period)
    synthesis = column.synthesis(grid)
    if column.mixture:
        return synthesis.sum(axis=1)
    return synthesis @ (synthesis.T @ wave)
