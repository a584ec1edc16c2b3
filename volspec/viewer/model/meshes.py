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
from volspec.viewer.model.edit import Edited, edit, with_interface
from volspec.viewer.model.materials import with_materials
from volspec.viewer.model.paths import relative_path
from volspec.viewer.model.state import ViewState
from volspec.viewer.model.view import clamp

PANEL = "Meshes"
NONE = "This scene has no meshes; drop a PLY, OBJ, STL, VTP or glTF file onto the window"
NO_ROOM = "With the materials of the meshes there would be too many; nothing was changed"
# A mesh that nobody sees is not shown instead.
MIN_OPACITY = 0.01
# Millimetres of a file's unit, and of a shape.
UNITS_MM = 1e-12, 1e12
FURTHEST_MM = 1e15


@edit
def set_shown(state: ViewState, index: int, visible: bool) -> ViewState:
    """Show or hide a mesh; one that is hidden casts no shadow."""
    return _change_mesh(state, index, shown=bool(visible))


@edit
def set_cut(state: ViewState, index: int, cut: bool) -> ViewState:
    """Let the volume's planes and crop cut a mesh, or leave it whole."""
    return _change_mesh(state, index, cut=bool(cut))


@edit
def set_opacity(state: ViewState, index: int, opacity: float) -> ViewState:
    """Set a mesh's opacity."""
    return _change_mesh(state, index, opacity=clamp(opacity, MIN_OPACITY, 1.0))


@edit
def set_material(state: ViewState, index: int, name: str) -> ViewState:
    """Make a mesh of one of the scene's materials, instead of its material or texture."""
    if name not in state.transfer.materials:
        return state
    look = {"material": name, "own_colours": False, "texture": None, "materials": (), "shares": {}}
    return _change_mesh(state, index, **look)


def chosen_mesh(state: ViewState) -> int:
    """Return the number of the mesh whose place is shown; -1 without any."""
    return min(state.interface.mesh, len(state.meshes) - 1)


@edit
def choose(state: ViewState, index: int) -> ViewState:
    """Choose the mesh whose place is shown."""
    return with_interface(state, mesh=max(index, 0))


@edit
def move(state: ViewState, index: int, axis: int, mm: float) -> ViewState:
    """Move a mesh along an axis of the world to an offset."""
    return _changed_axis(state, index, "move_mm", axis, clamp(mm, -FURTHEST_MM, FURTHEST_MM))


@edit
def turn(state: ViewState, index: int, axis: int, degrees: float) -> ViewState:
    """Turn a mesh about an axis."""
    return _changed_axis(state, index, "turn_deg", axis, math.remainder(degrees, 360.0))


@edit
def scale(state: ViewState, index: int, mm: float) -> ViewState:
    """Set the unit of a mesh's file, or the size of a shape."""
    if not 0 <= index < len(state.meshes):
        return state
    key = "unit_mm" if state.meshes[index].shape is None else "size_mm"
    return _change_mesh(state, index, **{key: clamp(mm, *UNITS_MM)})


@edit
def remove(state: ViewState, index: int) -> ViewState:
    """Remove a mesh from the scene."""
    if not 0 <= index < len(state.meshes):
        return state
    return replace(state, meshes=state.meshes[:index] + state.meshes[index + 1 :])


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


def _changed_axis(state: ViewState, index: int, key: str, axis: int, value: float) -> ViewState:
    if not (0 <= index < len(state.meshes) and 0 <= axis < 3):
        return state
    values = list(getattr(state.meshes[index], key))
    values[axis] = value
    return _change_mesh(state, index, **{key: tuple(values)})


def _change_mesh(state: ViewState, index: int, **changes: Any) -> ViewState:
    """Change settings of a mesh; an index or a value that changes nothing leaves the state."""
    if not 0 <= index < len(state.meshes):
        return state
    rows = list(state.meshes)
    rows[index] = replace(rows[index], **changes)
    return state if rows[index] == state.meshes[index] else replace(state, meshes=tuple(rows))
