"""Colour rendition of the lights: the spectra to measure, and the figures of these.

rows -> [rendition] -> LightFigures -> panel
"""

from __future__ import annotations

from contextlib import suppress
from dataclasses import dataclass, replace
from itertools import combinations
from typing import NamedTuple

from volspec.appearance.comparison import (
    RENDITION_GRID,
    LightFigures,
    Metamerism,
    light_figures,
    metamerism,
)
from volspec.errors import VolspecError
from volspec.palette import ALIKE
from volspec.relight import LightRig
from volspec.spectra import SpectralGrid, Spectrum, extended_band_means, light
from volspec.viewer.model.light_rows import LightRow, Rows, light_rig, row_at
from volspec.viewer.model.state import ViewState

# Materials whose pairs are compared: 28 pairs take some milliseconds.
_MAX_MATERIALS = 8


class Measured(NamedTuple):
    """One light, or the mix of all, to measure; equal as long as nothing changes."""

    rows: Rows
    of_mix: bool
    folder: str  # of the names of files
    materials: tuple[tuple[str, Spectrum], ...] = ()


@dataclass(frozen=True, slots=True, eq=False)
class Figures:
    """Figures of a light, and of the scene's materials under it.

    ``pair`` are the two materials that are alike in daylight, D65, and differ most under the light;
    None if no two are alike.
    """

    light: LightFigures
    pair: tuple[str, str] | None = None
    metamerism: Metamerism | None = None


def chosen_lights(state: ViewState, of_mix: bool) -> Measured | None:
    """Return the mix, or the chosen light; None if none shines or is chosen.

    In a room both are the lamps' light, before the walls reflect it.
    """
    folder, materials = state.document.folder, tuple(state.transfer.materials.items())
    if of_mix:
        shines = light_rig(state.lights) is not None
        return Measured(state.lights, True, folder, materials) if shines else None
    row = row_at(state.lights, state.interface.light)
    return None if row is None else Measured((row,), False, folder, materials)


def measure(measured: Measured) -> Figures | None:
    """Return the figures, which takes milliseconds; None if the bands of a light are too few."""

    def on(grid: SpectralGrid) -> Spectrum:
        rows = tuple(replace(row, rig=_on(row, grid, measured.folder)) for row in measured.rows)
        rig = light_rig(rows) if measured.of_mix else rows[0].rig
        assert rig is not None
        return rig.mixed(grid)

    try:
        figures = light_figures(on)
    except VolspecError:
        return None
    with suppress(VolspecError):
        return Figures(figures, *_metamers(measured.materials, on(RENDITION_GRID)))
    return Figures(figures)


def _metamers(
    materials: tuple[tuple[str, Spectrum], ...], lamp: Spectrum
) -> tuple[tuple[str, str], Metamerism] | tuple[()]:
    """Return the materials alike in daylight that differ most under a light, if any are alike."""
    daylight = light("D65", RENDITION_GRID)
    widened = {name: _wider(spectrum, RENDITION_GRID) for name, spectrum in materials}
    pairs = [
        (pair, metamerism(widened[pair[0]], widened[pair[1]], daylight, lamp))
        for pair in combinations(list(widened)[:_MAX_MATERIALS], 2)
    ]
    alike = [entry for entry in pairs if entry[1].delta_E < ALIKE]
    return max(alike, key=lambda entry: entry[1].illuminant) if alike else ()


def _on(row: LightRow, grid: SpectralGrid, folder: str) -> LightRig:
    """Return a row's rig on a grid that may be wider than the document's."""
    parts = zip(row.texts, row.rig.lights, strict=True)
    return replace(row.rig, lights=tuple(_spectrum(*part, grid, folder) for part in parts))


def _spectrum(text: str | None, spectrum: Spectrum, grid: SpectralGrid, folder: str) -> Spectrum:
    """Look a light up by its text; one that was drawn continues beyond its bands."""
    if text:
        with suppress(VolspecError):
            return light(text, grid, folder=folder)
    return _wider(spectrum, grid)


def _wider(spectrum: Spectrum, grid: SpectralGrid) -> Spectrum:
    values = extended_band_means(spectrum.wavelengths_nm, spectrum.values, grid)
    return Spectrum(grid.wavelengths_nm, values, spectrum.name)
