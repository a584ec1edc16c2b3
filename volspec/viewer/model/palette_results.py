"""Wizards' results and palette files, applied to a state.

state -> [palette_results] -> Scene -> wizard -> state
PALETTE.toml -> Palette -> [palette_results] -> state
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from volspec.errors import PaletteError, SceneError, VolspecError
from volspec.palette import Cell, DesignReport, Palette, PaletteSpectrum, Place
from volspec.scene import Scene, SceneFile
from volspec.scene.tables import TransferSpec
from volspec.settings import read_table
from volspec.spectra import Spectrum, light_names
from volspec.transfer import MAX_MATERIALS
from volspec.viewer.model import palette_table
from volspec.viewer.model.light_rows import MAX_ROWS
from volspec.viewer.model.materials import (
    can_be_exact,
    clip_spectrum,
    with_material_basis,
    with_reflectances,
)
from volspec.viewer.model.palette_targets import (
    LIGHT,
    REFLECTANCE,
    STAY,
    DesignTargets,
    PaletteState,
    clip_codes,
)
from volspec.viewer.model.room import shown_spec
from volspec.viewer.model.state import ViewState
from volspec.viewer.model.viewing import with_model
from volspec.wizard import Redesigned, hide, keep, merge, reveal

WIZARDS = ("hide", "reveal", "keep", "merge")
# The greatest weight of a colour rounded to the display's codes, which cannot be met exactly.
_FIRM = 10.0
# Spectra count as the same if no band differs by more than this fraction of the greatest.
_SAME = 1e-3


def run_wizard(state: ViewState, name: str) -> Redesigned:
    """Run one of `WIZARDS` on the choices of the panel, ``state.interface.pick``; takes seconds.

    Raises VolspecError if the wizard refuses.
    """
    if not can_be_exact(state.transfer):
        raise PaletteError(
            "wizards need materials as channels: at most "
            f"{MAX_MATERIALS}, and none with a filter; remove the others in the scene file",
            code="unsupported",
        )
    scene, pick = wizard_scene(state), state.interface.pick
    material, light = palette_table.wizard_place(state)
    model_light = pick.like if pick.like in palette_table.column_names(state.lights) else None
    if model_light is not None:
        light = palette_table.new_name(state)
    if name == "hide":
        within = pick.within if pick.within in scene.materials and not pick.black else None
        return hide(scene, material, under=light, within=within, black=pick.black, like=model_light)
    if name == "reveal":
        simulated = state.relight.viewing.deficiency
        viewers = () if simulated == "none" else (simulated,)
        distance = pick.distance
        return reveal(
            scene, material, under=light, distance=distance, like=model_light, deficiency=viewers
        )
    if name == "keep":
        return keep(scene, material)
    several = [m for m in scene.materials if m in pick.materials]
    if len(several) < 2:
        several = list(scene.materials)
    if model_light is not None:
        return merge(scene, several, under=model_light, split=light)
    return merge(scene, several, under=light)


def with_wizard_result(state: ViewState, redesign: Redesigned) -> ViewState:
    """Return the state with a wizard's spectra, and its targets in the table for editing."""
    changes = {m: clip_spectrum(redesign.design.reflectance(m), 1.0) for m in redesign.materials}
    transfer = with_reflectances(with_material_basis(state.transfer), changes)
    lights, new = state.lights, redesign.changes.light
    if new is not None:
        spectrum = clip_spectrum(redesign.design.light(new))
        label = f"designed: {', '.join(redesign.materials)}"
        lights = palette_table.with_designed_light(lights, new, label, spectrum)
    targets = _wizard_targets(redesign)
    return replace(state, transfer=transfer, lights=lights, palette=PaletteState(targets, targets))


def _wizard_targets(redesign: Redesigned) -> DesignTargets:
    """Return a wizard's targets for the table.

    A wizard compares with materials as they were before. The table has no rows for these, so
    their colours become the targets.
    """
    names = set(redesign.scene.materials)
    cells: dict[Place, Cell] = {}
    for report in DesignReport.of(redesign.design).cells:
        cell = redesign.design.palette.cells.get(report.place)
        if cell is None or report.reflectance not in names:
            continue
        if cell.other and cell.other[0] not in names and report.wanted is not None:
            weight = min(cell.weight, _FIRM) if cell.weight > 1.0 else STAY
            cell = Cell(colour=clip_codes(report.wanted), weight=weight)
        cells[report.place] = cell
    opened = {(REFLECTANCE, name) for name in redesign.materials}
    if redesign.changes.light is not None:
        opened.add((LIGHT, redesign.changes.light))
    return DesignTargets(cells, frozenset(opened), apart=redesign.design.palette.apart)


def result_lines(redesign: Redesigned, begun: ViewState) -> tuple[str, ...]:
    """Return the ΔE reached, one line per light; the light of the redesign comes first."""
    about = redesign.changes.light or palette_table.wizard_place(begun)[1]
    lines = []
    for row in sorted(redesign.evaluations, key=lambda row: row.light != about):
        distances = [f"{one} – {two} ΔE {value:.1f}" for (one, two), value in row.apart.items()]
        lines.append(f"{row.light}: {', '.join(distances[:3])}")
    return tuple(lines)


def wizard_scene(state: ViewState) -> Scene:
    """Return the state as a scene with materials as channels, and its spectra in memory."""
    grid, transfer = state.document.grid, state.transfer
    in_memory: dict[str, Spectrum] = {}
    materials, lights = [], []
    for name, spectrum in transfer.materials.items():
        in_memory[f"material {name}"] = spectrum
        materials.append({"name": name, "reflectance": f"material {name}"})
    for (name, spectrum), row in zip(palette_table.lit_columns(state), state.lights, strict=True):
        in_memory[f"light {name}"] = spectrum
        table: dict[str, Any] = {"name": name, "spectrum": f"light {name}"}
        if row.rig.total_lux is not None:
            table["illuminance_lux"] = float(row.rig.total_lux)
        lights.append(table)
    file = read_table(
        SceneFile,
        {
            "title": state.document.title,
            "volume": {"file": "volume"},
            "material": materials,
            "transfer": TransferSpec.of(transfer),
            "basis": {
                "method": "materials",
                "grid_nm": [grid.start_nm, grid.stop_nm, grid.step_nm],
                "observer_deg": transfer.basis.observer_deg,
            },
            "light": lights,
            "viewing": replace(shown_spec(state), backdrop=0.0),
        },
        SceneError,
    )
    return Scene(file, state.document.title, in_memory)


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
        if len(lights) >= MAX_ROWS:
            raise PaletteError(
                f"palette: no room for light {member.name!r}, as the limit is {MAX_ROWS}; "
                "remove some first",
                code="size",
            )
        lights = palette_table.with_designed_light(lights, member.name, "from a palette", spectrum)
        names[member.name] = palette_table.column_names(lights)[-1]
    reflectances = {
        rows[member.name]: clip_spectrum(member.spectrum.on(grid), 1.0)
        for member in palette.reflectances
        if member.spectrum is not None and member.name in rows
    }
    targets = _palette_targets(palette, rows, names)
    complete = all(m.spectrum is not None for m in (*palette.reflectances, *palette.lights))
    viewing = replace(
        palette.viewing,
        adapting=with_model(state.relight, palette.viewing.model).viewing.adapting,
        fov_deg=state.relight.viewing.fov_deg,
        deficiency=state.relight.viewing.deficiency,
        severity=state.relight.viewing.severity,
    )
    return replace(
        state,
        transfer=with_reflectances(with_material_basis(state.transfer), reflectances),
        lights=palette_table.with_lights(lights, changes),
        relight=replace(state.relight, viewing=viewing),
        palette=PaletteState(targets, targets if complete else None, from_scratch=not complete),
    )


def unmatched_reflectances(state: ViewState, palette: Palette) -> tuple[str, ...]:
    """Return the names of a palette's reflectances left without a material in the scene."""
    rows = _match_spectra(palette.reflectances, state.transfer.materials)
    return tuple(row.name for row in palette.reflectances if row.name not in rows)


def _palette_targets(
    palette: Palette, rows: dict[str, str], names: dict[str, str]
) -> DesignTargets:
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
    renamed = (row.renamed(rows, names) for row in palette.apart)
    distinct = tuple(row for row in renamed if row is not None)
    return DesignTargets(cells, frozenset(opened), constant, lamps, palette.criteria, distinct)


def _match_spectra(
    members: Sequence[PaletteSpectrum], spectra: Mapping[str, Spectrum]
) -> dict[str, str]:
    """Map the palette's names to the scene's, as long as the scene has any left."""
    pairs = _match_by_name(members, spectra)
    free = [name for name in spectra if name not in pairs.values()]
    return pairs | dict(zip((m.name for m in members if m.name not in pairs), free, strict=False))


def _match_by_name(
    members: Sequence[PaletteSpectrum], spectra: Mapping[str, Spectrum]
) -> dict[str, str]:
    """Map the palette's names to the scene's where the name or the spectrum is the same."""
    pairs = {member.name: member.name for member in members if member.name in spectra}
    for member in members:
        if member.name not in pairs and member.spectrum is not None:
            free = (name for name in spectra if name not in pairs.values())
            same = next((name for name in free if _same(member.spectrum, spectra[name])), None)
            if same is not None:
                pairs[member.name] = same
    return pairs


def _same(one: Spectrum, other: Spectrum) -> bool:
    try:
        values = one.on(other.grid).values
    except VolspecError:
        return False
    peak = max(float(np.abs(other.values).max()), 1e-12)
    return bool(np.abs(values - other.values).max() < _SAME * peak)
