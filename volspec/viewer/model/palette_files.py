"""A palette's spectra and targets, brought into a state.

PALETTE.toml -> Palette -> [palette_files] -> state
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from volspec.errors import PaletteError, VolspecError
from volspec.palette import Cell, Palette, PaletteSpectrum
from volspec.palette.model import Place
from volspec.spectra import Spectrum
from volspec.spectra.lights import light_names
from volspec.viewer.model import palette_table
from volspec.viewer.model.light_rows import MOST_ROWS
from volspec.viewer.model.materials import clip_spectrum, with_material_basis, with_reflectances
from volspec.viewer.model.palette_targets import LIGHT, REFLECTANCE, DesignTargets, PaletteState
from volspec.viewer.model.state import ViewState
from volspec.viewer.model.viewing import with_model

# Spectra are the same if no band differs by more than this fraction of the greatest.
_SAME = 1e-3


def with_palette(state: ViewState, palette: Palette) -> ViewState:
    """Return the state with a palette's spectra, targets and viewing.

    Its reflectances replace materials of the same name, then those of the same spectrum, then the
    others in order; lights that match none are added.

    Raises PaletteError if there is no room for its lights.
    """
    grid = state.document.grid
    rows = _match_spectra(palette.reflectances, state.transfer.materials)
    names = _match_by_name(palette.lights, dict(palette_table.lit_columns(state)))
    lights, changes = state.lights, dict[str, Spectrum]()
    for number, member in enumerate(palette.lights):
        spectrum = member.spectrum or palette_table.initial_spectrum(grid, number)
        spectrum = clip_spectrum(replace(spectrum, name=member.name).on(grid))
        if member.name in names:
            changes[names[member.name]] = spectrum
            continue
        if len(lights) >= MOST_ROWS:
            raise PaletteError(
                f"palette: no room for light {member.name!r}; {MOST_ROWS} lights are the most, "
                "remove some first",
                code="size",
            )
        lights = palette_table.with_designed_light(lights, member.name, "of the palette", spectrum)
        names[member.name] = palette_table.column_names(lights)[-1]
    reflectances = {
        rows[member.name]: clip_spectrum(member.spectrum.on(grid), 1.0)
        for member in palette.reflectances
        if member.spectrum is not None and member.name in rows
    }
    targets = _targets(palette, rows, names)
    complete = all(m.spectrum is not None for m in (*palette.reflectances, *palette.lights))
    viewing = replace(
        palette.viewing,
        adapting=with_model(state.relight, palette.viewing.model).viewing.adapting,
        fov_deg=state.relight.viewing.fov_deg,
    )
    return replace(
        state,
        transfer=with_reflectances(with_material_basis(state.transfer), reflectances),
        lights=palette_table.with_lights(lights, changes),
        relight=replace(state.relight, viewing=viewing),
        palette=PaletteState(targets, targets if complete else None, from_scratch=not complete),
    )


def unmatched_reflectances(state: ViewState, palette: Palette) -> tuple[str, ...]:
    """Return the names of a palette's reflectances for which the scene has no material left."""
    rows = _match_spectra(palette.reflectances, state.transfer.materials)
    return tuple(row.name for row in palette.reflectances if row.name not in rows)


def _targets(palette: Palette, rows: dict[str, str], names: dict[str, str]) -> DesignTargets:
    """Return the targets in terms of the scene's materials and lights."""
    cells: dict[Place, Cell] = {}
    for (row, column), cell in palette.cells.items():
        other = cell.other
        if row not in rows or (other and other[0] not in rows):
            continue
        if other:
            cell = replace(cell, other=(rows[other[0]], names[other[1]]))
        cells[rows[row], names[column]] = cell
    reflectances = [member for member in palette.reflectances if member.name in rows]
    opened = {(REFLECTANCE, rows[member.name]) for member in reflectances if member.free}
    opened |= {(LIGHT, names[light.name]) for light in palette.lights if light.free}
    constant = frozenset(rows[member.name] for member in reflectances if member.constant)
    lamps = {
        names[light.name]: tuple(lamp.name for lamp in light.mixture)
        for light in palette.lights
        if light.mixture and all(lamp.name in light_names() for lamp in light.mixture)
    }
    return DesignTargets(cells, frozenset(opened), constant, lamps, palette.criteria)


def _match_spectra(
    members: Sequence[PaletteSpectrum], there: Mapping[str, Spectrum]
) -> dict[str, str]:
    """Return the scene's name for each of the palette's, as long as the scene has any left."""
    found = _match_by_name(members, there)
    free = [name for name in there if name not in found.values()]
    return found | dict(zip((m.name for m in members if m.name not in found), free, strict=False))


def _match_by_name(
    members: Sequence[PaletteSpectrum], there: Mapping[str, Spectrum]
) -> dict[str, str]:
    """Return the scene's name for each of the palette's with the same name, or same spectrum."""
    found = {member.name: member.name for member in members if member.name in there}
    for member in members:
        if member.name not in found and member.spectrum is not None:
            free = (name for name in there if name not in found.values())
            same = next((name for name in free if _same(member.spectrum, there[name])), None)
            if same is not None:
                found[member.name] = same
    return found


def _same(one: Spectrum, other: Spectrum) -> bool:
    try:
        values = one.on(other.grid).values
    except VolspecError:
        return False
    most = max(float(np.abs(other.values).max()), 1e-12)
    return bool(np.abs(values - other.values).max() < _SAME * most)
