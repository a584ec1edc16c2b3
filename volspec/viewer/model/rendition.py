"""Colour rendition of the lights: the spectra to measure, and the figures of these.

rows -> [rendition] -> LightFigures -> panel
"""

from __future__ import annotations

from contextlib import suppress
from dataclasses import replace
from typing import NamedTuple

from volspec.appearance.rendition import LightFigures, light_figures
from volspec.errors import VolspecError
from volspec.relight import LightRig
from volspec.spectra import SpectralGrid, Spectrum, light
from volspec.spectra.photometry import extended_band_means
from volspec.viewer.model.light_rows import LightRow, Rows, light_rig, row_at
from volspec.viewer.model.state import ViewState


class Measured(NamedTuple):
    """One light, or the mix of all, to measure; equal as long as nothing changes."""

    rows: Rows
    whole: bool
    folder: str  # of the names of files


def chosen_lights(state: ViewState, whole: bool) -> Measured | None:
    """Return the mix, or the chosen light; None if none shines or is chosen.

    In a room both are the lamps' light, before the walls reflect it.
    """
    folder = state.document.folder
    if whole:
        return Measured(state.lights, True, folder) if light_rig(state.lights) else None
    row = row_at(state.lights, state.interface.light)
    return None if row is None else Measured((row,), False, folder)


def measure(measured: Measured) -> LightFigures | None:
    """Return the figures, which takes milliseconds; None if the bands of a light are too few."""

    def on(grid: SpectralGrid) -> Spectrum:
        rows = tuple(replace(row, rig=_on(row, grid, measured.folder)) for row in measured.rows)
        rig = light_rig(rows) if measured.whole else rows[0].rig
        assert rig is not None
        return rig.mixed(grid)

    try:
        return light_figures(on)
    except VolspecError:
        return None


def _on(row: LightRow, grid: SpectralGrid, folder: str) -> LightRig:
    """Return a row's rig on a grid that may be wider than the document's."""
    parts = zip(row.texts, row.rig.lights, strict=True)
    return replace(row.rig, lights=tuple(_spectrum(*part, grid, folder) for part in parts))


def _spectrum(text: str | None, spectrum: Spectrum, grid: SpectralGrid, folder: str) -> Spectrum:
    """Look a light up by its text; one that was drawn continues beyond its bands."""
    if text:
        with suppress(VolspecError):
            return light(text, grid, folder=folder)
    values = extended_band_means(spectrum.wavelengths_nm, spectrum.values, grid)
    return Spectrum(grid.wavelengths_nm, values, spectrum.name)
