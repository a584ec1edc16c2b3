"""Opacities of the materials: edits.

panel -> [opacities] -> RaycastSpec.opacities -> recompose, or a cast
"""

from __future__ import annotations

from dataclasses import replace

from volspec.basis import MaterialBasis
from volspec.transfer import used_materials
from volspec.viewer.model.edit import Command, bind, edit
from volspec.viewer.model.materials import can_be_exact, with_material_basis
from volspec.viewer.model.quality import opacity_scales
from volspec.viewer.model.state import ViewState
from volspec.viewer.model.transfer_parts import list_parts
from volspec.viewer.model.view import clamp

PANEL = "Opacity"
NEEDED = (
    "Opacities can be scaled if materials are the channels of the picture. Here they cannot be: "
    "there are too many of them, or filters, or several fields."
)
# The greatest scale on a slider.
MAX_SCALE = 8.0


def names(state: ViewState) -> tuple[str, ...]:
    """Return the materials whose opacity can be scaled: those that are channels, or can be."""
    transfer = state.transfer
    if isinstance(transfer.basis, MaterialBasis):
        return tuple(transfer.basis.materials)
    possible = can_be_exact(transfer) and not state.fields and state.document.image is None
    return tuple(transfer.materials) if possible else ()


def is_in_volume(state: ViewState, name: str) -> bool:
    """Return False of a material that only meshes have, which do not fade."""
    if state.document.image is not None or not any(name in row.used for row in state.meshes):
        return True
    return name in used_materials(part.mix for part in list_parts(state.transfer))


@edit
def set_opacity(state: ViewState, name: str, scale: float) -> ViewState:
    """Scale a material's optical depth: 0 hides it, 1 is as the transfer function has it.

    Materials become the channels, if they are not yet.
    """
    if name not in names(state):
        return state
    return _with(state, opacity_scales(state) | {name: clamp(scale, 0.0, MAX_SCALE)})


@edit
def toggle(state: ViewState, name: str) -> ViewState:
    """Hide a material, or show it again as the transfer function does."""
    return set_opacity(state, name, 0.0 if opacity_scales(state).get(name, 1.0) > 0 else 1.0)


@edit
def show_only(state: ViewState, name: str) -> ViewState:
    """Hide all materials but one, or show all again if that is so already."""
    if name not in names(state):
        return state
    alone = {other: 0.0 for other in names(state) if other != name}
    return _with(state, {} if opacity_scales(state) == alone else alone)


@edit
def reset(state: ViewState) -> ViewState:
    """Show all materials as the transfer function does."""
    return _with(state, {})


def _with(state: ViewState, scales: dict[str, float]) -> ViewState:
    kept = {name: scale for name, scale in scales.items() if scale != 1.0}
    if kept == state.shading.opacities:
        return state
    shading = replace(state.shading, opacities=kept)
    return replace(state, shading=shading, transfer=with_material_basis(state.transfer))


COMMANDS = (
    Command(
        "opacities-reset",
        "Transfer",
        "Opacities: as in the transfer function",
        (),
        bind(reset),
        words="fade hide show materials all",
    ),
)
