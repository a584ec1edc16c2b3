"""Edits and commands of the transfer function, of whatever kind: its parts, its values.

mouse, panels -> [transfer_edits] -> Transfer
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace

from volspec.transfer import Isosurfaces, LabelFunction, Transfer, TransferFunction
from volspec.transfer import TransferFunction2D as Regions
from volspec.viewer.model import (
    presets,
    transfer_convert,
    transfer_parts,
    transfer_placing,
)
from volspec.viewer.model.edit import Change, Command, Edited, edit
from volspec.viewer.model.state import ViewState

THICKNESSES = (0.02, 50.0)
# What a drag over the picture's height in the picture does: values move by the volume's range,
# widths and thicknesses are multiplied by e to these.
_WIDER, _THICKER = 2.0, 3.0


def _with_transfer(state: ViewState, transfer: Transfer) -> ViewState:
    """The state with another one; itself where it is the same."""
    return state if transfer is state.transfer else replace(state, transfer=transfer)


@edit
def move_point(state: ViewState, index: int, value: float, opacity: float) -> ViewState:
    """Move a point of a curve, or a surface."""
    transfer, value = state.transfer, _within(state, value)
    if isinstance(transfer, TransferFunction):
        return _with_transfer(state, transfer_placing.move_point(transfer, index, value, opacity))
    if isinstance(transfer, Isosurfaces):
        return _with_transfer(state, transfer_placing.move_surface(transfer, index, value, opacity))
    return state


@edit
def add_point(state: ViewState, value: float, opacity: float) -> ViewState:
    """Add a point, a surface, a label, or a region at (value, gradient)."""
    transfer = state.transfer
    if isinstance(transfer, Regions):
        place = _within(state, value), max(opacity, 0.0)
        top = state.document.joint.top
        new: Transfer = transfer_placing.add_region(transfer, *place, _span(state), top)
    elif isinstance(transfer, LabelFunction):
        new = transfer_placing.add_part(transfer, value, opacity)
    else:
        new = transfer_placing.add_part(transfer, _within(state, value), opacity)
    added = _with_transfer(state, new)
    if added is state:
        return state
    old = {part.values for part in transfer_parts.parts_of(transfer)}
    found = [i for i, part in enumerate(transfer_parts.parts_of(new)) if part.values not in old]
    return _chosen(added, found[0]) if found else added


@edit
def remove_point(state: ViewState, index: int) -> ViewState:
    """Remove a part."""
    return _with_transfer(state, transfer_parts.without_part(state.transfer, index))


@edit
def choose_part(state: ViewState, index: int) -> ViewState:
    """Choose the part whose details are shown."""
    known = 0 <= index < len(transfer_parts.parts_of(state.transfer))
    return _chosen(state, index) if known else state


def _chosen(state: ViewState, index: int) -> ViewState:
    return replace(state, interface=replace(state.interface, part=index))


@edit
def set_opacity(state: ViewState, index: int, opacity: float) -> ViewState:
    """Set a part's opacity."""
    return _with_transfer(state, transfer_parts.with_opacity(state.transfer, index, opacity))


@edit
def set_material(state: ViewState, index: int, name: str) -> ViewState:
    """Make a part of one material."""
    if name not in state.transfer.materials:
        return state
    return _with_transfer(state, transfer_parts.with_mix(state.transfer, index, name))


@edit
def set_material_weight(state: ViewState, index: int, name: str, weight: float) -> ViewState:
    """Set the weight of a material in a part's mix."""
    transfer = transfer_parts.with_share(state.transfer, index, name, weight)
    return _with_transfer(state, transfer)


@edit
def set_region_values(state: ViewState, index: int, low: float, high: float) -> ViewState:
    """Set the values of a region."""
    return _placed(state, index, (low, high), None)


@edit
def set_region_gradients(state: ViewState, index: int, low: float, high: float) -> ViewState:
    """Set the gradients of a region."""
    return _placed(state, index, None, (low, high))


def _placed(
    state: ViewState,
    index: int,
    values: tuple[float, float] | None,
    gradients: tuple[float, float] | None,
) -> ViewState:
    if not isinstance(state.transfer, Regions):
        return state
    axes = _span(state), state.document.joint.top
    return _with_transfer(
        state, transfer_placing.place_region(state.transfer, index, values, gradients, *axes)
    )


@edit
def set_softness(state: ViewState, index: int, softness: float) -> ViewState:
    """Set how softly a region ends."""
    if not isinstance(state.transfer, Regions):
        return state
    return _with_transfer(
        state, transfer_placing.set_region_softness(state.transfer, index, softness)
    )


@edit
def toggle_gradient_opacity(state: ViewState) -> ViewState:
    """Turn opacity by gradient on, as the scene's own if it has that, or off."""
    curve, own = state.transfer, state.document.transfer
    if not isinstance(curve, TransferFunction) or curve.filters:  # these do not go together
        return state
    if curve.gradient_opacity:
        return replace(state, transfer=replace(curve, gradient_opacity=None))
    if isinstance(own, TransferFunction) and own.gradient_opacity:
        return replace(state, transfer=replace(curve, gradient_opacity=own.gradient_opacity))
    return replace(
        state, transfer=transfer_placing.with_gradient_factors(curve, state.document.joint.top)
    )


@edit
def move_gradient_point(state: ViewState, index: int, gradient: float, factor: float) -> ViewState:
    """Move a point of a curve's factors over gradients."""
    return _factored(state, transfer_placing.move_factor, index, gradient, factor, _top(state))


@edit
def add_gradient_point(state: ViewState, gradient: float, factor: float) -> ViewState:
    """Add a point to a curve's factors over gradients."""
    return _factored(state, transfer_placing.add_factor, gradient, factor, _top(state))


@edit
def remove_gradient_point(state: ViewState, index: int) -> ViewState:
    """Remove a point of a curve's factors over gradients."""
    return _factored(state, transfer_placing.remove_factor, index)


def _factored(
    state: ViewState, change: Callable[..., TransferFunction], *given: float
) -> ViewState:
    curve = state.transfer
    if not isinstance(curve, TransferFunction) or not curve.gradient_opacity:
        return state
    return _with_transfer(state, change(curve, *given))


def _top(state: ViewState) -> float:
    """The volume's greatest gradient."""
    return state.document.joint.top


@edit
def shift(state: ViewState, shift: float) -> ViewState:
    """Shift all values, by what is given from the start."""
    low, high = _span(state)
    shift = min(max(shift, low - high), high - low)
    by = shift - state.shift
    moved = _remapped(state, lambda old: transfer_parts.shift_values(old, by, (low, high)))
    return state if moved is state else replace(moved, shift=shift)


@edit
def thicken(state: ViewState, thickness: float) -> ViewState:
    """Multiply what opacities absorb, from the start."""
    thickness = min(max(thickness, THICKNESSES[0]), THICKNESSES[1])
    thin, own = _thin(state)
    thicker = transfer_parts.thicken_opacities(thin, thickness / own)
    return replace(state, transfer=thicker, thickness=thickness, unthickened=(thin, own, thicker))


def _thin(state: ViewState) -> tuple[Transfer, float]:
    """What is thickened, and how thick that is."""
    transfer = state.transfer
    if state.unthickened is None or type(state.unthickened[2]) is not type(transfer):
        return transfer, state.thickness
    thin, own, thick = state.unthickened
    if thick is transfer:
        return thin, own
    return transfer_parts.undo_thickening(transfer, thick, thin, state.thickness / own), own


def _remapped(state: ViewState, change: Callable[[Transfer], Transfer]) -> ViewState:
    """With other values, those of what it was thickened from as well."""
    (thin, own), new = _thin(state), change(state.transfer)
    if new is state.transfer:
        return state
    return replace(state, transfer=new, unthickened=(change(thin), own, new))


@edit
def window(state: ViewState, across: float, down: float) -> ViewState:
    """Shift the values by a drag across, and spread them by one upwards."""
    low, high = _span(state)
    moved = shift(state, state.shift + across * (high - low))
    factor = math.exp(min(max(-_WIDER * down, -10.0), 10.0))
    return _remapped(moved, lambda old: transfer_parts.stretch_values(old, factor, (low, high)))


@edit
def thicken_by(state: ViewState, _across: float, down: float) -> ViewState:
    """Make denser by a drag upwards."""
    factor = math.exp(min(max(-_THICKER * down, -10.0), 10.0))
    return thicken(state, state.thickness * factor)


def _span(state: ViewState) -> tuple[float, float]:
    return presets.value_span(state.document.volume)


def _within(state: ViewState, value: float) -> float:
    low, high = _span(state)
    return min(max(value, low), high)


def _fresh(state: ViewState, transfer: Transfer) -> ViewState:
    """With another transfer function altogether."""
    new = replace(state, transfer=transfer, shift=0.0, thickness=1.0, unthickened=None)
    return _chosen(new, 0)


def _reset(state: ViewState) -> ViewState:
    return _fresh(state, state.document.transfer)


_LABELLED = "Labels are names, no values: neither presets nor other kinds fit them"


def _preset(preset: presets.Preset) -> Change:
    def change(state: ViewState) -> Edited:
        if isinstance(state.transfer, LabelFunction):
            return Edited(state, _LABELLED)
        document = state.document
        basis = document.transfer.basis
        fitted = presets.transfer_of(preset, document.volume, document.histogram, basis)
        return Edited(_fresh(state, fitted))

    return change


def _into(kind: transfer_convert.Kind) -> Change:
    def change(state: ViewState) -> Edited:
        new = transfer_convert.convert(state.transfer, kind, _span(state))
        if new is state.transfer:
            labelled = isinstance(state.transfer, LabelFunction)
            return Edited(state, _LABELLED if labelled else "")
        lost = transfer_convert.conversion_losses(state.transfer, kind, _span(state))
        return Edited(_chosen(_with_transfer(state, new), 0), lost)

    return change


def _is(kind: transfer_convert.Kind) -> Callable[[ViewState], bool]:
    return lambda state: transfer_convert.kind_of(state.transfer) == kind


# By kind: how it is called.
KIND_TITLES: dict[transfer_convert.Kind, str] = {
    "points": "Curve (1-D)",
    "regions": "Regions (2-D)",
    "surfaces": "Surfaces",
}
COMMANDS = (
    *(
        Command(f"preset-{preset.name}", "Transfer", f"Preset: {preset.title}", (), _preset(preset))
        for preset in presets.PRESETS
    ),
    *(
        Command(f"transfer-{kind}", "Transfer", f"Kind: {title}", (), _into(kind), _is(kind))
        for kind, title in KIND_TITLES.items()
    ),
    Command("reset-transfer", "Transfer", "The scene's own transfer function", (), _reset),
)
