"""Wizards on a state: from the state to a scene, and from a wizard's result to a state.

state -> [palette_wizards] -> Scene -> wizard -> state
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

from volspec.errors import PaletteError, SceneError
from volspec.palette import Cell, DesignReport
from volspec.palette.model import Place
from volspec.scene import Scene, SceneFile
from volspec.settings import read_table
from volspec.spectra import Spectrum
from volspec.transfer import MAX_CHANNELS
from volspec.viewer.model import palette_table
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
from volspec.viewer.model.scene_file import transfer_table
from volspec.viewer.model.state import ViewState
from volspec.wizard import Redesigned, hide, keep, merge, reveal

WIZARDS = ("hide", "reveal", "keep", "merge")
# The most weight of a colour rounded to the display's codes, which cannot be met exactly.
_FIRM = 10.0


def run_wizard(state: ViewState, name: str) -> Redesigned:
    """Run one of `WIZARDS` on the choices of the panel, ``state.interface.pick``; takes seconds.

    Raises VolspecError if the wizard refuses.
    """
    if not can_be_exact(state.transfer):
        raise PaletteError(
            "wizards need materials as channels: at most "
            f"{MAX_CHANNELS - 1}, and none with a filter; remove those in the scene file",
            code="unsupported",
        )
    scene, pick = wizard_scene(state), state.interface.pick
    material, light = palette_table.wizard_place(state)
    like = pick.like if pick.like in palette_table.column_names(state.lights) else None
    if like is not None:
        light = palette_table.new_name(state)
    if name == "hide":
        within = pick.within if pick.within in scene.materials and not pick.black else None
        return hide(scene, material, under=light, within=within, black=pick.black, like=like)
    if name == "reveal":
        return reveal(scene, material, under=light, distance=pick.distance, like=like)
    if name == "keep":
        return keep(scene, material)
    several = [each for each in scene.materials if each in pick.materials]
    if len(several) < 2:
        several = list(scene.materials)
    if like is not None:
        return merge(scene, several, under=like, split=light)
    return merge(scene, several, under=light)


def with_wizard_result(state: ViewState, made: Redesigned) -> ViewState:
    """Return the state with a wizard's spectra; its targets are in the table, to be edited."""
    changes = {name: clip_spectrum(made.design.reflectance(name), 1.0) for name in made.materials}
    transfer = with_reflectances(with_material_basis(state.transfer), changes)
    lights, new = state.lights, made.changes.light
    if new is not None:
        spectrum = clip_spectrum(made.design.light(new))
        label = f"designed: {', '.join(made.materials)}"
        lights = palette_table.with_designed_light(lights, new, label, spectrum)
    targets = _targets(made)
    return replace(state, transfer=transfer, lights=lights, palette=PaletteState(targets, targets))


def _targets(made: Redesigned) -> DesignTargets:
    """Return a wizard's targets for the table.

    A wizard compares with materials as they were. The table has no rows for these, so their
    colours become the targets.
    """
    names = set(made.scene.materials)
    cells: dict[Place, Cell] = {}
    for report in DesignReport.of(made.design).cells:
        cell = made.design.palette.cells.get(report.place)
        if cell is None or report.reflectance not in names:
            continue
        if cell.other and cell.other[0] not in names and report.wanted is not None:
            weight = min(cell.weight, _FIRM) if cell.weight > 1.0 else STAY
            cell = Cell(colour=clip_codes(report.wanted), weight=weight)
        cells[report.place] = cell
    opened = {(REFLECTANCE, name) for name in made.materials}
    if made.changes.light is not None:
        opened.add((LIGHT, made.changes.light))
    return DesignTargets(cells, frozenset(opened))


def result_lines(made: Redesigned, begun: ViewState) -> tuple[str, ...]:
    """Return the ΔE reached, a line for each light; the light that it was for comes first."""
    about = made.changes.light or palette_table.wizard_place(begun)[1]
    lines = []
    for row in sorted(made.evaluations, key=lambda row: row.light != about):
        apart = [f"{one} – {two} ΔE {value:.1f}" for (one, two), value in row.apart.items()]
        lines.append(f"{row.light}: {', '.join(apart[:3])}")
    return tuple(lines)


def wizard_scene(state: ViewState) -> Scene:
    """Return the state as a scene with materials as channels, and its spectra in memory."""
    grid, transfer = state.document.grid, state.transfer
    known: dict[str, Spectrum] = {}
    materials, lights = [], []
    for name, spectrum in transfer.materials.items():
        known[f"material {name}"] = spectrum
        materials.append({"name": name, "reflectance": f"material {name}"})
    for (name, spectrum), row in zip(palette_table.lit_columns(state), state.lights, strict=True):
        known[f"light {name}"] = spectrum
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
            "transfer": transfer_table(transfer),
            "basis": {
                "method": "materials",
                "grid_nm": [grid.start_nm, grid.stop_nm, grid.step_nm],
                "observer_deg": transfer.basis.observer_deg,
            },
            "light": lights,
            "viewing": replace(state.relight, backdrop=0.0),
        },
        SceneError,
    )
    return Scene(file, state.document.title, known)
