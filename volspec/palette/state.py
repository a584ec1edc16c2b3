"""Where a design stands: the spectra of all rows and columns, and the colours they make.

model -> [state] -> criteria, design, report
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from volspec.errors import PaletteError
from volspec.palette.eye import Eye
from volspec.palette.members import PaletteSpectrum
from volspec.palette.model import Palette
from volspec.spectra import SpectralGrid, Spectrum, colour_matching_functions
from volspec.spectra.spectrum import light_power, reflectance_values

Array = NDArray[np.float64]

# Periods of the waves that open lights begin with, nm (Bergner et al., section 4.1: 60 and 85).
_WAVES_NM = (60.0, 85.0, 110.0, 140.0, 45.0)
# A light with less luminance than this share of an even one has none for a colour.
_LEAST_Y = 1e-9
# Share of a white's largest value below which no adaptation goes.
_LEAST_WHITE = 1e-6


@dataclass(frozen=True, slots=True, eq=False)
class State:
    """Spectra, eyes and colours.

    Parameters
    ----------
    palette : Palette
    S : (R, N)
        Reflectances.
    E : (L, N)
        Lights, scaled so that XYZ = Q (E ∗ S) and a given one's white has Y = 100.
    """

    palette: Palette
    S: Array
    E: Array

    @classmethod
    def start(cls, palette: Palette) -> State:
        """Given spectra as they are, open ones where their design begins.

        Raises
        ------
        SpectrumError
            If a spectrum does not cover the grid, or a given one is no light or reflectance.
        PaletteError
            If the light that an open one begins with has no luminance within its band.
        """
        grid = palette.grid
        S = [_reflectance(row, grid) for row in palette.reflectances]
        V = colour_matching_functions(grid)[1]
        E = []
        for number, column in enumerate(palette.lights):
            power = _light(column, grid, number)
            if not V @ power > _LEAST_Y * V.sum():
                raise PaletteError(
                    f"palette: light {column.name!r} has no luminous energy to show a colour by; "
                    "widen its band, or begin with another spectrum"
                )
            E.append(100.0 * power / (V @ power))
        return cls(palette, np.stack(S), np.stack(E))

    @property
    def Q(self) -> Array:
        """(3, N) colour-matching functions."""
        return colour_matching_functions(self.palette.grid)

    @property
    def XYZ(self) -> Array:
        """(R, L, 3) colours in the scene."""
        colours: Array = np.einsum("cn,ln,rn->rlc", self.Q, self.E, self.S)
        return colours

    def eyes(self) -> list[Eye]:
        """One adapted to each light: to its chromaticity, at Y = 100."""
        even = self.Q.sum(axis=1)
        whites = self.E @ self.Q.T
        # A light that was designed away leaves the eye as an even one does.
        whites = np.where(whites[:, 1:2] > _LEAST_Y * 100.0, whites, even)
        whites = np.maximum(whites, _LEAST_WHITE * np.abs(whites).max(axis=1, keepdims=True))
        viewing = self.palette.viewing
        return [Eye.of(viewing, 100.0 * white / white[1]) for white in whites]

    def linear(self, eyes: list[Eye]) -> Array:
        """(R, L, 3) colours as the display shows them: its linear RGB, not clipped."""
        XYZ = self.XYZ
        return np.stack([eye.linear(XYZ[:, j]) for j, eye in enumerate(eyes)], axis=1)

    def with_rows(self, rows: dict[int, Array]) -> State:
        """The same with other reflectances."""
        S = self.S.copy()
        for i, values in rows.items():
            S[i] = values
        return replace(self, S=S)

    def with_columns(self, columns: dict[int, Array]) -> State:
        """The same with other lights."""
        E = self.E.copy()
        for j, values in columns.items():
            E[j] = values
        return replace(self, E=E)


def _reflectance(row: PaletteSpectrum, grid: SpectralGrid) -> Array:
    if row.spectrum is None:
        return np.full(grid.size, 0.5)
    if row.open:
        return row.spectrum.on(grid).values
    return reflectance_values(row.spectrum, grid, f"palette: reflectance {row.name!r}")


def _light(column: PaletteSpectrum, grid: SpectralGrid, number: int) -> Array:
    if column.spectrum is not None:
        return light_power(column.spectrum, grid, f"palette: light {column.name!r}")
    wavelengths = grid.wavelengths_nm
    period = _WAVES_NM[number % len(_WAVES_NM)]
    wave = 0.5 + 0.5 * np.cos(2.0 * np.pi * (wavelengths - grid.start_nm) / period)
    synthesis = column.synthesis(grid)
    if column.mixture:
        return synthesis.sum(axis=1)
    return synthesis @ (synthesis.T @ wave)


def named(member: PaletteSpectrum, values: Array, grid: SpectralGrid) -> Spectrum:
    """A designed spectrum: it says that it is one."""
    return Spectrum(grid.wavelengths_nm, values, member.name, {"designed": "volspec design"})
