"""Spectra in a scene's file: by name, or as numbers in the file itself.

    tables -> [spectra] -> lights, materials

A table of numbers is read as a measured file would be: a light is scaled, a reflectance checked.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Annotated

import numpy as np
from pydantic import Discriminator, Field, Tag, model_validator

from volspec._tables import Table, value_or_table
from volspec.spectra import SpectralGrid, Spectrum, light, reflectance
from volspec.spectra.lights import as_light
from volspec.spectra.reflectances import as_reflectance

Numbers = Annotated[tuple[float, ...], Field(strict=False)]


class SpectrumTable(Table):
    """A spectrum as numbers, in place of a name: one that was edited, and is in no file of its own.

    Values that stand on the scene's own bands are taken as they are; others are averaged over
    them, as a file's are.
    """

    name: str = ""
    """Caption; left out, the name of the light or material."""
    wavelengths_nm: Annotated[Numbers, Field(examples=[[400, 700]])]
    """Rising, nm."""
    values: Annotated[Numbers, Field(examples=[[0.2, 0.8]])]
    """One a wavelength: of a light relative power, of a reflectance or filter 0 to 1."""
    notes: dict[str, str] = Field(default_factory=dict)
    """What is known of its making, such as designed, manufacturer or instrument."""

    @model_validator(mode="after")
    def _is_one(self) -> SpectrumTable:
        self.spectrum()
        return self

    @classmethod
    def of(cls, spectrum: Spectrum) -> SpectrumTable:
        """The table of a spectrum, which reads back to the last bit."""
        return cls(
            name=spectrum.name,
            wavelengths_nm=tuple(spectrum.wavelengths_nm.tolist()),
            values=tuple(spectrum.values.tolist()),
            notes=dict(spectrum.notes),
        )

    def spectrum(self, name: str = "") -> Spectrum:
        """The numbers as they stand; under another name where they have none.

        Raises
        ------
        SpectrumError
            If they are no spectrum.
        """
        numbers = np.array(self.wavelengths_nm), np.array(self.values)
        return Spectrum(*numbers, self.name or name, self.notes)


Given = Annotated[
    Annotated[str, Tag("<value>")] | Annotated[SpectrumTable, Tag("<table>")],
    Discriminator(value_or_table),
]
"""A name as `volspec.light` or `volspec.reflectance` takes it, or numbers."""


def given_light(
    given: str | SpectrumTable,
    name: str,
    grid: SpectralGrid,
    folder: Path,
    known: Mapping[str, Spectrum],
) -> Spectrum:
    """The light of a row.

    Parameters
    ----------
    given : str or SpectrumTable
    name : str
        The row's.
    grid : SpectralGrid
    folder : path
        What the names of files start from.
    known : {text: Spectrum}
        Spectra that are no file yet, on the grid.

    Raises
    ------
    SpectrumError
        If the name is unknown, or the numbers are no light.
    """
    if isinstance(given, SpectrumTable):
        return as_light(given.spectrum(name), grid, "spectrum.values")
    return known.get(given) or light(given, grid, folder=folder)


def given_reflectance(
    given: str | SpectrumTable,
    name: str,
    grid: SpectralGrid,
    folder: Path,
    known: Mapping[str, Spectrum],
) -> Spectrum:
    """The reflectance or the filter of a row; parameters and errors as `given_light`."""
    if isinstance(given, SpectrumTable):
        return as_reflectance(given.spectrum(name), grid, "values")
    return known.get(given) or reflectance(given, grid, folder=folder)
