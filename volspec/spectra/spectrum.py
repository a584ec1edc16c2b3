"""A light or a reflectance: values over wavelength.

grid -> [spectrum] -> photometry, library -> basis
"""

from __future__ import annotations

import csv
import os
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from volspec.errors import SpectrumError
from volspec.spectra._colour import colour_science
from volspec.spectra.grid import SpectralGrid


@dataclass(frozen=True, slots=True, eq=False)
class Spectrum:
    """Samples of a function of wavelength; the arrays are read-only copies.

    Parameters
    ----------
    wavelengths_nm : (L,) array
        Strictly increasing, nm, L >= 2.
    values : (L,) array
        Finite. Relative or absolute spectral power for a light, 0..1 for a reflectance.
    name : str
        For messages and legends.

    Raises
    ------
    SpectrumError
        If the arrays do not fit together or hold anything but finite numbers.

    Examples
    --------
    >>> s = Spectrum([400, 500, 700], [0.0, 1.0, 1.0], name="step")
    >>> s.on(SpectralGrid(500, 700, 100)).values.tolist()
    [0.875, 1.0, 1.0]
    """

    wavelengths_nm: NDArray[np.float64]
    values: NDArray[np.float64]
    name: str = ""

    def __post_init__(self) -> None:
        label = f"spectrum {self.name!r}" if self.name else "spectrum"
        for field in ("wavelengths_nm", "values"):
            try:
                array = np.array(getattr(self, field), dtype=np.float64)
            except (TypeError, ValueError) as error:
                raise SpectrumError(f"{label}: {field} are not numbers: {error}") from error
            array.flags.writeable = False
            object.__setattr__(self, field, array)
        w, v = self.wavelengths_nm, self.values
        if w.ndim != 1 or w.shape != v.shape or w.size < 2:
            raise SpectrumError(
                f"{label}: wavelengths have shape {w.shape}, values {v.shape}; "
                "expected two equal lengths of at least 2"
            )
        for field, array in (("wavelength", w), ("value", v)):
            if not np.isfinite(array).all():
                k = int(np.argmin(np.isfinite(array)))
                raise SpectrumError(f"{label}: {field} number {k + 1} is {array[k]}, not finite")
        if not np.all(np.diff(w) > 0):
            k = int(np.argmin(np.diff(w) > 0))
            raise SpectrumError(
                f"{label}: wavelengths must increase strictly, but {w[k]:g} nm is followed by "
                f"{w[k + 1]:g} nm; sort them and remove duplicates"
            )

    @property
    def grid(self) -> SpectralGrid:
        """The grid the samples lie on.

        Raises
        ------
        SpectrumError
            If they are not equidistant.
        """
        steps = np.diff(self.wavelengths_nm)
        if np.ptp(steps) > 1e-6:
            raise SpectrumError(
                f"spectrum {self.name!r} is not equidistant (steps {steps.min():g} to "
                f"{steps.max():g} nm); put it on a grid first: spectrum.on(grid)"
            )
        start, stop = self.wavelengths_nm[[0, -1]]
        return SpectralGrid(start, stop, (stop - start) / (self.wavelengths_nm.size - 1))

    def on(self, grid: SpectralGrid) -> Spectrum:
        """Band means on a grid; see `SpectralGrid.band_means` for the rules and errors."""
        try:
            values = grid.band_means(self.wavelengths_nm, self.values)
        except SpectrumError as error:
            label = f"{self.name!r}: " if self.name else ""
            raise SpectrumError(f"{label}{error}") from None
        return Spectrum(grid.wavelengths_nm, values, self.name)

    def __mul__(self, factor: float) -> Spectrum:
        if not isinstance(factor, int | float | np.integer | np.floating):
            return NotImplemented
        return Spectrum(self.wavelengths_nm, self.values * factor, self.name)

    __rmul__ = __mul__

    def __add__(self, other: Spectrum) -> Spectrum:
        if not isinstance(other, Spectrum):
            return NotImplemented
        if self.wavelengths_nm.shape != other.wavelengths_nm.shape or not np.allclose(
            self.wavelengths_nm, other.wavelengths_nm, rtol=0, atol=1e-6
        ):
            raise SpectrumError(
                f"cannot add {self.name!r} and {other.name!r}: their wavelengths differ; "
                "put both on one grid first: spectrum.on(grid)"
            )
        name = "+".join(n for n in (self.name, other.name) if n)
        return Spectrum(self.wavelengths_nm, self.values + other.values, name)

    @classmethod
    def from_colour(cls, distribution: Any) -> Spectrum:
        """From a ``colour.SpectralDistribution``."""
        return cls(distribution.wavelengths, distribution.values, str(distribution.name))

    def to_colour(self) -> Any:
        """As a ``colour.SpectralDistribution``."""
        data = dict(zip(self.wavelengths_nm.tolist(), self.values.tolist(), strict=True))
        return colour_science().SpectralDistribution(data, name=self.name)

    @classmethod
    def from_csv(cls, path: str | os.PathLike[str]) -> Spectrum:
        """Read ``nm,value`` lines; commas, semicolons, tabs or blanks separate.

        Blank lines, lines that start with ``#`` and one header line are skipped.

        Raises
        ------
        SpectrumError
            Names the file, and the line where one is at fault.
        """
        rows = read_table(path)
        for line, row in rows:
            if len(row) != 2:
                raise SpectrumError(
                    f"{path}, line {line}: {len(row)} columns, expected two: nm,value"
                )
        try:
            return cls(
                np.array([row[0] for _, row in rows]),
                np.array([row[1] for _, row in rows]),
                name=Path(path).stem,
            )
        except SpectrumError as error:
            raise SpectrumError(f"{path}: {error}") from None


def read_table(path: str | os.PathLike[str]) -> list[tuple[int, list[float]]]:
    """Numbered rows of numbers of a text table; see `Spectrum.from_csv` for what is skipped."""
    try:
        text = Path(path).read_text(encoding="utf-8-sig")
    except FileNotFoundError:
        raise SpectrumError(f"{path}: no such file") from None
    except (OSError, UnicodeDecodeError) as error:
        raise SpectrumError(f"{path}: cannot be read as a text table: {error}") from None
    rows: list[tuple[int, list[float]]] = []
    header_allowed = True
    for number, line in enumerate(text.splitlines(), start=1):
        line = line.strip()
        if not line or line.startswith("#"):
            continue
        separator = next((s for s in ",;\t" if s in line), None)
        cells = next(csv.reader([line], delimiter=separator)) if separator else line.split()
        try:
            rows.append((number, [float(cell) for cell in cells if cell.strip()]))
        except ValueError:
            if not header_allowed:
                raise SpectrumError(
                    f"{path}, line {number}: {line[:40]!r} is not a row of numbers (nm,value)"
                ) from None
        header_allowed = False
    if len(rows) < 2:
        raise SpectrumError(f"{path}: {len(rows)} rows of numbers, expected at least 2 (nm,value)")
    return rows
