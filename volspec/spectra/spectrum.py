"""A light or a reflectance: values over wavelength.

grid -> [spectrum] -> photometry, library -> basis
"""

from __future__ import annotations

import os
from collections.abc import Mapping
from dataclasses import dataclass, field
from types import MappingProxyType
from typing import Any

import numpy as np
from numpy.typing import NDArray

from volspec.errors import SpectrumError
from volspec.spectra._colour import colour_science
from volspec.spectra._paths import path_text
from volspec.spectra.grid import SpectralGrid, require_grid


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
    notes : {str: str}
        What is known of its making: ``manufacturer``, ``instrument``, ``spectral quantity``,
        ``designed``, … Keys are kept in lower case with single blanks; read-only.

    Raises
    ------
    SpectrumError
        If the arrays do not fit together or hold anything but finite numbers, or a note is
        not text under a name of its own.

    Notes
    -----
    `on` and a factor keep the notes. A sum keeps what both sides say alike: a lamp's maker did
    not make the sum. But a sum with a designed part is designed, whatever the other part is.

    Examples
    --------
    >>> s = Spectrum([400, 500, 700], [0.0, 1.0, 1.0], name="step")
    >>> s.on(SpectralGrid(500, 700, 100)).values.tolist()
    [0.875, 1.0, 1.0]
    """

    wavelengths_nm: NDArray[np.float64]
    values: NDArray[np.float64]
    name: str = ""
    notes: Mapping[str, str] = field(default_factory=dict)

    def __post_init__(self) -> None:
        label = f"spectrum {self.name!r}" if self.name else "spectrum"
        for key in ("wavelengths_nm", "values"):
            try:
                array = np.array(getattr(self, key), dtype=np.float64)
            except (TypeError, ValueError) as error:
                raise SpectrumError(f"{label}: {key} are not numbers: {error}") from error
            array.flags.writeable = False
            object.__setattr__(self, key, array)
        object.__setattr__(self, "notes", read_only_notes(self.notes, label))
        w, v = self.wavelengths_nm, self.values
        if w.ndim != 1 or w.shape != v.shape or w.size < 2:
            raise SpectrumError(
                f"{label}: wavelengths have shape {w.shape}, values {v.shape}; "
                "expected two equal lengths of at least 2"
            )
        for key, array in (("wavelength", w), ("value", v)):
            if not np.isfinite(array).all():
                k = int(np.argmin(np.isfinite(array)))
                raise SpectrumError(f"{label}: {key} number {k + 1} is {array[k]}, not finite")
        if not np.all(np.diff(w) > 0):
            k = int(np.argmin(np.diff(w) > 0))
            raise SpectrumError(
                f"{label}: wavelengths must increase strictly, but {w[k]:g} nm is followed by "
                f"{w[k + 1]:g} nm; sort them and remove duplicates"
            )

    def __reduce__(self) -> tuple[Any, ...]:
        # A read-only view of a dictionary cannot be pickled as it stands.
        return Spectrum, (self.wavelengths_nm, self.values, self.name, dict(self.notes))

    @property
    def designed(self) -> bool:
        """Whether the notes say that a designer made it, not an instrument (``designed: yes``)."""
        return self.notes.get("designed", "no").casefold() not in ("", "no", "false", "0")

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
        require_grid(grid)
        try:
            values = grid.band_means(self.wavelengths_nm, self.values)
        except SpectrumError as error:
            label = f"{self.name!r}: " if self.name else ""
            raise SpectrumError(f"{label}{error}") from None
        return Spectrum(grid.wavelengths_nm, values, self.name, self.notes)

    def __mul__(self, factor: float) -> Spectrum:
        if not isinstance(factor, int | float | np.integer | np.floating):
            return NotImplemented
        return Spectrum(self.wavelengths_nm, self.values * factor, self.name, self.notes)

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
        notes = dict(self.notes.items() & other.notes.items())
        for part in (self, other):
            if part.designed:
                notes["designed"] = part.notes["designed"]
        return Spectrum(self.wavelengths_nm, self.values + other.values, name, notes)

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
        """Read a text table, ``FILE`` or ``FILE#column``, whatever its suffix.

        `volspec.spectra.read_spectrum` describes the tables and also reads other formats.

        Raises
        ------
        SpectrumError
            Names the file, and the line where one is at fault.
        """
        # Late: both stand downstream of this module.
        from volspec.spectra.files import split_address
        from volspec.spectra.tables import read_table

        file, selector = split_address(path) or (path_text(path), "")
        return read_table(file).spectrum(selector)


def read_only_notes(notes: Mapping[str, str], label: str) -> Mapping[str, str]:
    """A read-only copy of notes, keys in lower case with single blanks.

    Raises
    ------
    SpectrumError
        If it is no mapping, a key or a value is not text, or a key is empty or given twice.
    """
    if not isinstance(notes, Mapping):
        raise SpectrumError(f"{label}: notes are {notes!r}; give a dict of texts")
    kept: dict[str, str] = {}
    for key, value in notes.items():
        if not (isinstance(key, str) and isinstance(value, str)):
            raise SpectrumError(f"{label}: note {key!r}: {value!r}; notes are text, use str(…)")
        short = " ".join(key.split()).lower()
        if not short or short in kept:
            fault = "appears twice" if short else "is empty"
            raise SpectrumError(f"{label}: the name of a note, {key!r}, {fault}; choose another")
        kept[short] = value
    return MappingProxyType(kept)
