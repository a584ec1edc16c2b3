"""Edits of the list of meshes in and around the volume.

panel, dropped files -> [meshes] -> state -> cast, SCENE.toml
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

from volspec.scene.specs import MeshSpec
from volspec.viewer.model.edit import edit
from volspec.viewer.model.state import ViewState
from volspec.viewer.model.view import clamp

PANEL = "Meshes"
NONE = "This scene has no meshes; drop a PLY, OBJ, STL, VTP or glTF file onto the picture"
# A mesh that nobody sees is not shown instead.
LEAST_OPACITY = 0.01


@edit
def set_shown(state: ViewState, index: int, shown: bool) -> ViewState:
    """Show or hide a mesh; one that is hidden casts no shadow."""
    return _changed(state, index, shown=bool(shown))


@edit
def set_opacity(state: ViewState, index: int, opacity: float) -> ViewState:
    """Set a mesh's opacity."""
    return _changed(state, index, opacity=clamp(opacity, LEAST_OPACITY, 1.0))


@edit
def set_material(state: ViewState, index: int, name: str) -> ViewState:
    """Make a mesh of one of the scene's materials, instead of its material or texture."""
    if name not in state.transfer.materials:
        return state
    return _changed(state, index, material=name, texture=None, materials=(), shares={})


@edit
def remove(state: ViewState, index: int) -> ViewState:
    """Remove a mesh from the scene."""
    if not 0 <= index < len(state.meshes):
        return state
    return replace(state, meshes=state.meshes[:index] + state.meshes[index + 1 :])


def look_text(row: MeshSpec) -> str:
    """Return what a mesh is made of.

    >>> look_text(MeshSpec(shape="plane", texture="maps/wood.png")), look_text(
    ...     MeshSpec(shape="disc", shares={"copper": "a.png", "gold": "b.png"}))
    ('wood.png', 'copper, gold')
    """
    if row.texture is not None:
        return row.texture.replace("\\", "/").rpartition("/")[2]
    return ", ".join(row.used) or "axes"


def _changed(state: ViewState, index: int, **changes: Any) -> ViewState:
    """Change settings of a mesh; an index or a value that changes nothing leaves the state."""
    if not 0 <= index < len(state.meshes):
        return state
    rows = list(state.meshes)
    rows[index] = replace(rows[index], **changes)
    return state if rows[index] == state.meshes[index] else replace(state, meshes=tuple(rows))
