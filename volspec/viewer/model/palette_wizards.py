"""The wizards on a state: the state as a scene, and the wizard's result as a state.

state -> [palette_wizards] -> Scene -> wizard -> state
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

from volspec.errors import PaletteError
from volspec.palette import Cell, Criteria, DesignReport
from volspec.palette.model import Place
from volspec.scene import Scene, SceneFile
from volspec.spectra import Spectrum
from volspec.transfer import MAX_CHANNELS
from volspec.viewer.model.materials import (
    can_be_exact,
    clip_spectrum,
    with_material_basis,
    with_reflectances,
)
from volspec.viewer.model.palette_table import (
    column_names,
    lit_columns,
    new_name,
    with_designed_light,
    wizard_place,
)
from volspec.viewer.model.palette_targets import (
    LIGHT,
    REFLECTANCE,
    STAY,
    DesignTargets,
    PaletteState,
    clipped,
)
from volspec.viewer.model.scene_file import transfer_table, viewing_table
from volspec.viewer.model.state import ViewState
from volspec.wizard import Redesigned, hide, keep, merge, reveal

WIZARDS = ("hide", "reveal", "keep", "merge")
# What a target counts that a wizard had met exactly, once it is a colour rounded to the display's.
_FIRM = 10.0


def run_wizard(state: ViewState, name: str) -> Redesigned:
    """Have a wizard redesign what the state shows; takes seconds.

    Parameters
    ----------
    state : ViewState
        Its pick says which material and light.
    name : str
        One of `WIZARDS`.

    Raises
    ------
    VolspecError
        If it refuses: the message says why.
    """
    if not can_be_exact(state.transfer):
        raise PaletteError(
            "wizards need materials as channels: at most "
            f"{MAX_CHANNELS - 1}, and none with a filter; remove those in the scene file"
        )
    scene, pick = scene_of(state), state.interface.pick
    material, light = wizard_place(state)
    like: dict[str, Any] = {}
    if pick.like in column_names(state.lights):
        light, like = new_name(state), {"like": pick.like}
    if name == "hide":
        within = pick.within if pick.within in scene.materials and not pick.black else None
        return hide(scene, material, under=light, within=within, black=pick.black, **like)
    if name == "reveal":
        return reveal(scene, material, under=light, distance=pick.distance, **like)
    if name == "keep":
        return keep(scene, material)
    several = [each for each in scene.materials if each in pick.materials]
    if len(several) < 2:
        several = list(scene.materials)
    if like:
        return merge(scene, several, under=pick.like, split=light)
    return merge(scene, several, under=light)


def with_wizard_result(state: ViewState, made: Redesigned) -> ViewState:
    """The state with what a wizard made; its targets stand in the table, to be changed."""
    changes = {name: clip_spectrum(made.design.reflectance(name), 1.0) for name in made.materials}
    transfer = with_reflectances(with_material_basis(state.transfer), changes)
    lights, new = state.lights, made.changes.light
    if new is not None:
        spectrum = clip_spectrum(made.design.light(new))
        lights = with_designed_light(
            lights, new, f"designed: {', '.join(made.materials)}", spectrum
        )
    targets = targets_of(made)
    return replace(state, transfer=transfer, lights=lights, palette=PaletteState(targets, targets))


def targets_of(made: Redesigned) -> DesignTargets:
    """What a wizard asked for, as targets of the table.

    It compares with materials as they were, which are no rows here: the colours that they had
    stand for them.
    """
    names = set(made.scene.materials)
    cells: dict[Place, Cell] = {}
    for report in DesignReport.of(made.design).cells:
        cell = made.design.palette.cells.get(report.place)
        if cell is None or report.reflectance not in names:
            continue
        if cell.other and cell.other[0] not in names and report.wanted is not None:
            weight = min(cell.weight, _FIRM) if cell.weight > 1.0 else STAY
            cell = Cell(colour=clipped(report.wanted), weight=weight)
        cells[report.place] = cell
    opened = {(REFLECTANCE, name) for name in made.materials}
    if made.changes.light is not None:
        opened.add((LIGHT, made.changes.light))
    return DesignTargets(cells, frozenset(opened), criteria=Criteria())


def result_lines(made: Redesigned, begun: ViewState) -> tuple[str, ...]:
    """What was reached, a line for each light; the one that it was about comes first."""
    about = made.changes.light or wizard_place(begun)[1]
    lines = []
    for row in sorted(made.reached, key=lambda row: row.light != about):
        apart = [f"{one} – {two} ΔE {value:.1f}" for (one, two), value in row.apart.items()]
        lines.append(f"{row.light}: {', '.join(apart[:3])}")
    return tuple(lines)


def scene_of(state: ViewState) -> Scene:
    """What the state shows as a scene, cast by its materials; its spectra are no files."""
    grid, transfer = state.document.grid, state.transfer
    known: dict[str, Spectrum] = {}
    materials, lights = [], []
    for name, spectrum in transfer.materials.items():
        known[f"material {name}"] = spectrum
        materials.append({"name": name, "reflectance": f"material {name}"})
    for (name, spectrum), row in zip(lit_columns(state), state.lights, strict=True):
        known[f"light {name}"] = spectrum
        table: dict[str, Any] = {"name": name, "spectrum": f"light {name}"}
        if row.rig.total_lux is not None:
            table["illuminance_lux"] = float(row.rig.total_lux)
        lights.append(table)
    file = SceneFile.model_validate(
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
            "viewing": viewing_table(replace(state.relight, backdrop=0.0)),
        }
    )
    return Scene(file, state.document.title, known)
