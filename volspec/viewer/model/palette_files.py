"""Palettes loaded into a state, and written from one.

PALETTE.toml -> [palette_files] -> state -> PALETTE.toml
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from volspec.errors import PaletteError, VolspecError
from volspec.palette import Cell, Palette, PaletteSpectrum, save_palette
from volspec.palette.model import Place
from volspec.spectra import Spectrum
from volspec.spectra.lights import light_names
from volspec.viewer.model.light_rows import MOST_ROWS
from volspec.viewer.model.materials import clip_spectrum, with_material_basis, with_reflectances
from volspec.viewer.model.palette_table import (
    column_names,
    initial_spectrum,
    lit_columns,
    palette_of,
    unmeasured_viewing,
    with_designed_light,
    with_lights,
)
from volspec.viewer.model.palette_targets import (
    LIGHT,
    REFLECTANCE,
    DesignTargets,
    Member,
    PaletteState,
)
from volspec.viewer.model.state import ViewState
from volspec.viewer.model.viewing import with_model

# Spectra of which no band differs by more are one.
_SAME = 1e-3


def save_state_palette(state: ViewState, path: str) -> None:
    """Write the palette of a state.

    Raises
    ------
    PaletteError
        If the name is not ``.toml``, or nothing is wanted or open.
    OSError
        If it cannot be written there.
    """
    save_palette(palette_of(state), path)


def with_palette(state: ViewState, palette: Palette) -> ViewState:
    """The state with a palette's spectra and targets.

    Its reflectances go to materials of the same name, then to those that have their spectrum
    already, then in order; lights that are not there are added. Colours are wanted as its viewing
    shows them, which comes along.

    Raises
    ------
    PaletteError
        If its lights find no room.
    """
    grid = state.document.grid
    materials = dict(state.transfer.materials)
    rows = _matched(palette.reflectances, materials)
    there = dict(lit_columns(state))
    names = _named(palette.lights, there)
    lights, changes = state.lights, dict[str, Spectrum]()
    for number, member in enumerate(palette.lights):
        spectrum = member.spectrum or initial_spectrum(grid, number)
        spectrum = replace(spectrum, name=member.name)
        if member.name in names:
            changes[names[member.name]] = clip_spectrum(spectrum.on(grid))
            continue
        if len(lights) >= MOST_ROWS:
            raise PaletteError(
                f"palette: no room for light {member.name!r}; {MOST_ROWS} lights are the most, "
                "remove some first"
            )
        lights = with_designed_light(
            lights, member.name, "of the palette", clip_spectrum(spectrum.on(grid))
        )
        names[member.name] = column_names(lights)[-1]
    lights = with_lights(lights, changes)
    reflectances = {
        rows[member.name]: clip_spectrum(member.spectrum.on(grid), 1.0)
        for member in palette.reflectances
        if member.spectrum is not None and member.name in rows
    }
    targets = _targets(palette, rows, names)
    complete = all(m.spectrum is not None for m in (*palette.reflectances, *palette.lights))
    viewing = replace(
        *(unmeasured_viewing(palette.viewing),),
        adapting=with_model(state.relight, palette.viewing.model).viewing.adapting,
        fov_deg=state.relight.viewing.fov_deg,
    )
    return replace(
        state,
        transfer=with_reflectances(with_material_basis(state.transfer), reflectances),
        lights=lights,
        relight=replace(state.relight, viewing=viewing),
        palette=PaletteState(targets, targets if complete else None, from_scratch=not complete),
    )


def unmatched_reflectances(state: ViewState, palette: Palette) -> tuple[str, ...]:
    """Reflectances of a palette that find no material in the scene."""
    rows = _matched(palette.reflectances, dict(state.transfer.materials))
    return tuple(row.name for row in palette.reflectances if row.name not in rows)


def _targets(palette: Palette, rows: dict[str, str], names: dict[str, str]) -> DesignTargets:
    cells: dict[Place, Cell] = {}
    for (row, column), cell in palette.cells.items():
        other = cell.other
        if row not in rows or (other and other[0] not in rows):
            continue
        if other:
            cell = replace(cell, other=(rows[other[0]], names[other[1]]))
        cells[rows[row], names[column]] = cell
    opened: set[Member] = {
        (REFLECTANCE, rows[row.name])
        for row in palette.reflectances
        if row.open and row.name in rows
    }
    opened |= {(LIGHT, names[light.name]) for light in palette.lights if light.open}
    constant = {rows[r.name] for r in palette.reflectances if r.constant and r.name in rows}
    lamps = {
        names[light.name]: tuple(lamp.name for lamp in light.mixture)
        for light in palette.lights
        if light.mixture and all(lamp.name in light_names() for lamp in light.mixture)
    }
    return DesignTargets(cells, frozenset(opened), frozenset(constant), lamps, palette.criteria)


def _matched(members: tuple[PaletteSpectrum, ...], there: dict[str, Spectrum]) -> dict[str, str]:
    """Which of the scene's stands for each of the palette's; none for those that are too many."""
    found = _named(members, there)
    free = [name for name in there if name not in found.values()]
    for member in members:
        if member.name not in found and free:
            found[member.name] = free.pop(0)
    return found


def _named(members: tuple[PaletteSpectrum, ...], there: dict[str, Spectrum]) -> dict[str, str]:
    """Those of the same name, then those of the same spectrum."""
    found = {member.name: member.name for member in members if member.name in there}
    for member in members:
        free = [name for name in there if name not in found.values()]
        if member.name not in found and member.spectrum is not None:
            same = [name for name in free if _same(member.spectrum, there[name])]
            if same:
                found[member.name] = same[0]
    return found


def _same(one: Spectrum, other: Spectrum) -> bool:
    try:
        values = one.on(other.grid).values
    except VolspecError:
        return False
    most = max(float(np.abs(other.values).max()), 1e-12)
    return bool(np.abs(values - other.values).max() < _SAME * most)
