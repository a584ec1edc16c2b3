"""Edits of the list of meshes in and around the volume.

panel, dropped files -> [meshes] -> state -> cast, SCENE.toml
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

from volspec.basis import SpectralBasis
from volspec.errors import VolspecError
from volspec.scene.tables import MeshSpec
from volspec.viewer.model.edit import Edited, edit, with_interface, with_row_field, with_values
from volspec.viewer.model.light_rows import with_changes, without_item
from volspec.viewer.model.materials import with_materials
from volspec.viewer.model.paths import relative_path
from volspec.viewer.model.state import ViewState

PANEL = "Meshes"
NONE = "This scene has no meshes; drop a PLY, OBJ, STL, VTP or glTF file onto the window"
NO_ROOM = "With the materials of the meshes there would be too many; nothing was changed"
# Ranges of fields. A mesh that nobody sees is not shown instead.
_UNITS_MM = 1e-12, 1e12
LIMITS = {
    "opacity": (0.01, 1.0),
    "unit_mm": _UNITS_MM,
    "size_mm": _UNITS_MM,
    "move_mm": (-1e15, 1e15),
}


@edit
def set_mesh(state: ViewState, name: str, value: Any, index: int) -> ViewState:
    """Set a field of a mesh: shown, cut, opacity, unit or size, place or turns."""
    if name == "turn_deg":
        value = tuple(math.remainder(degrees, 360.0) for degrees in value)
    rows = with_row_field(state.meshes, index, name, value, LIMITS.get(name))
    return with_values(state, meshes=rows)


@edit
def set_material(state: ViewState, index: int, name: str) -> ViewState:
    """Make a mesh of one of the scene's materials, instead of its material or texture."""
    if name not in state.transfer.materials:
        return state
    look = {"material": name, "own_colours": False, "texture": None, "materials": (), "shares": {}}
    rows = with_changes(state.meshes, index, **look)
    return state if rows == state.meshes else replace(state, meshes=rows)


def chosen_mesh(state: ViewState) -> int:
    """Return the number of the mesh whose place is shown; -1 without any."""
    return min(state.interface.mesh, len(state.meshes) - 1)


@edit
def choose(state: ViewState, index: int) -> ViewState:
    """Choose the mesh whose place is shown."""
    return with_interface(state, mesh=max(index, 0))


@edit
def remove(state: ViewState, index: int) -> ViewState:
    """Remove a mesh from the scene."""
    return with_values(state, meshes=without_item(state.meshes, index))


def row_for(state: ViewState, path: str) -> MeshSpec:
    """Return the row for a mesh's file: its own colours, if the basis can have any.

    If not, the last mesh's material or else the first one.
    """
    names = [row.material for row in state.meshes if row.material is not None]
    material = names[-1] if names else next(iter(state.transfer.materials))
    return MeshSpec(
        file=relative_path(path, state.document.folder),
        material=material,
        own_colours=isinstance(state.transfer.basis, SpectralBasis),
    )


def add(state: ViewState, rows: Sequence[MeshSpec]) -> ViewState:
    """Add meshes to the scene, choose the last, and open their panel."""
    panels, meshes = state.interface.panels | {PANEL}, (*state.meshes, *rows)
    return replace(with_interface(state, panels=panels, mesh=len(meshes) - 1), meshes=meshes)


def with_own_materials(old: ViewState, new: ViewState) -> Edited:
    """Return the state with the materials of its meshes, which another transfer function lacks.

    If there would be too many, the transfer function stays the old one.
    """
    if new.transfer is old.transfer:
        return Edited(new)
    materials = new.transfer.materials
    used = {name for row in new.meshes for name in row.used if name not in materials}
    if not used:
        return Edited(new)
    missing = {name: spectrum for name, spectrum in old.transfer.materials.items() if name in used}
    try:
        return Edited(replace(new, transfer=with_materials(new.transfer, {**materials, **missing})))
    except VolspecError:
        return Edited(replace(new, transfer=old.transfer, shift=old.shift), NO_ROOM)


def look_text(row: MeshSpec) -> str:
    """Return what a mesh is made of.

    >>> look_text(MeshSpec(shape="plane", texture="maps/wood.png")), look_text(
    ...     MeshSpec(shape="disc", shares={"copper": "a.png", "gold": "b.png"}))
    ('wood.png', 'copper, gold')
    """
    if row.own_colours:
        return "own colours"
    if row.texture is not None:
        return row.texture.replace("\\", "/").rpartition("/")[2]
    return ", ".join(row.used) or "axes"
