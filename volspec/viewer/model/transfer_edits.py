"""Events of the transfer function, of whatever kind: its parts edited, its values moved.

mouse, panels -> [curve] -> Transfer
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace

from volspec.transfer import Isosurfaces, LabelFunction, Transfer, TransferFunction
from volspec.transfer import TransferFunction2D as Regions
from volspec.viewer.model import (
    materials,
    presets,
    transfer_convert,
    transfer_parts,
    transfer_placing,
)
from volspec.viewer.model import presets as preset_table
from volspec.viewer.model.event import Action, Change, Event, Reducer
from volspec.viewer.model.state import ViewState

THICKNESSES = (0.02, 50.0)
# What a drag over the picture's height in the picture does: values move by the volume's range,
# widths and thicknesses are multiplied by e to these.
_WIDER, _THICKER = 2.0, 3.0


def _with_transfer(state: ViewState, transfer: Transfer) -> ViewState:
    """The state with another one; itself where it is the same."""
    return state if transfer is state.transfer else replace(state, transfer=transfer)


def _point(state: ViewState, event: Event) -> ViewState:
    transfer, value = state.transfer, _within(state, event.x)
    if isinstance(transfer, TransferFunction):
        return _with_transfer(state, transfer_placing.moved(transfer, event.index, value, event.y))
    if isinstance(transfer, Isosurfaces):
        return _with_transfer(
            state, transfer_placing.surface_moved(transfer, event.index, value, event.y)
        )
    return state


def _add_point(state: ViewState, event: Event) -> ViewState:
    transfer = state.transfer
    if isinstance(transfer, Regions):
        place = _within(state, event.x), max(event.y, 0.0)
        top = state.document.joint.top
        new: Transfer = transfer_placing.region_added(transfer, *place, _span(state), top)
    elif isinstance(transfer, LabelFunction):
        new = transfer_placing.added(transfer, event.x, event.y)
    else:
        new = transfer_placing.added(transfer, _within(state, event.x), event.y)
    added = _with_transfer(state, new)
    if added is state:
        return state
    old = {part.values for part in transfer_parts.parts_of(transfer)}
    found = [i for i, part in enumerate(transfer_parts.parts_of(new)) if part.values not in old]
    return _chosen(added, found[0]) if found else added


def _remove_point(state: ViewState, event: Event) -> ViewState:
    return _with_transfer(state, transfer_parts.removed(state.transfer, event.index))


def _choose(state: ViewState, event: Event) -> ViewState:
    known = 0 <= event.index < len(transfer_parts.parts_of(state.transfer))
    return _chosen(state, event.index) if known else state


def _chosen(state: ViewState, index: int) -> ViewState:
    return replace(state, interface=replace(state.interface, part=index))


def _opacity(state: ViewState, event: Event) -> ViewState:
    return _with_transfer(state, transfer_parts.with_opacity(state.transfer, event.index, event.x))


def _material(state: ViewState, event: Event) -> ViewState:
    if event.key not in state.transfer.materials:
        return state
    return _with_transfer(state, transfer_parts.with_mix(state.transfer, event.index, event.key))


def _share(state: ViewState, event: Event) -> ViewState:
    transfer = transfer_parts.with_share(state.transfer, event.index, event.key, event.x)
    return _with_transfer(state, transfer)


def _region_values(state: ViewState, event: Event) -> ViewState:
    return _placed(state, event.index, (event.x, event.y), None)


def _region_gradients(state: ViewState, event: Event) -> ViewState:
    return _placed(state, event.index, None, (event.x, event.y))


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
        state, transfer_placing.region_placed(state.transfer, index, values, gradients, *axes)
    )


def _softness(state: ViewState, event: Event) -> ViewState:
    if not isinstance(state.transfer, Regions):
        return state
    return _with_transfer(state, transfer_placing.softened(state.transfer, event.index, event.x))


def _by_gradient(state: ViewState, _: Event) -> ViewState:
    """Opacity by gradient on, as the scene's own where that has it, or off."""
    curve, own = state.transfer, state.document.transfer
    if not isinstance(curve, TransferFunction) or curve.filters:  # these do not go together
        return state
    if curve.gradient_opacity:
        return replace(state, transfer=replace(curve, gradient_opacity=None))
    if isinstance(own, TransferFunction) and own.gradient_opacity:
        return replace(state, transfer=replace(curve, gradient_opacity=own.gradient_opacity))
    return replace(state, transfer=transfer_placing.factors_begun(curve, state.document.joint.top))


def _gradient(edit: Callable[[TransferFunction, Event, float], TransferFunction]) -> Reducer:
    """An edit of a curve's factors over gradients; it is given where the volume's end."""

    def reducer(state: ViewState, event: Event) -> ViewState:
        curve = state.transfer
        if not isinstance(curve, TransferFunction) or not curve.gradient_opacity:
            return state
        return _with_transfer(state, edit(curve, event, state.document.joint.top))

    return reducer


def _shift(state: ViewState, event: Event) -> ViewState:
    low, high = _span(state)
    shift = min(max(event.x, low - high), high - low)
    by = shift - state.shift
    moved = _remapped(state, lambda old: transfer_parts.shifted(old, by, (low, high)))
    return state if moved is state else replace(moved, shift=shift)


def _thicken(state: ViewState, event: Event) -> ViewState:
    thickness = min(max(event.x, THICKNESSES[0]), THICKNESSES[1])
    thin, own = _thin(state)
    thicker = transfer_parts.thickened(thin, thickness / own)
    return replace(state, transfer=thicker, thickness=thickness, thin=(thin, own, thicker))


def _thin(state: ViewState) -> tuple[Transfer, float]:
    """What is thickened, and how thick that is."""
    transfer = state.transfer
    if state.thin is None or type(state.thin[2]) is not type(transfer):
        return transfer, state.thickness
    thin, own, thick = state.thin
    if thick is transfer:
        return thin, own
    return transfer_parts.thinned(transfer, thick, thin, state.thickness / own), own


def _remapped(state: ViewState, change: Callable[[Transfer], Transfer]) -> ViewState:
    """With other values, those of what it was thickened from as well."""
    (thin, own), new = _thin(state), change(state.transfer)
    if new is state.transfer:
        return state
    return replace(state, transfer=new, thin=(change(thin), own, new))


def _window(state: ViewState, event: Event) -> ViewState:
    """A drag: across shifts the values, upwards spreads them."""
    low, high = _span(state)
    moved = _shift(state, Event("shift", state.shift + event.x * (high - low)))
    factor = math.exp(min(max(-_WIDER * event.y, -10.0), 10.0))
    return _remapped(moved, lambda old: transfer_parts.stretched(old, factor, (low, high)))


def _thicken_by(state: ViewState, event: Event) -> ViewState:
    """A drag: upwards makes denser."""
    factor = math.exp(min(max(-_THICKER * event.y, -10.0), 10.0))
    return _thicken(state, Event("thicken", state.thickness * factor))


def _span(state: ViewState) -> tuple[float, float]:
    return presets.span(state.document.volume)


def _within(state: ViewState, value: float) -> float:
    low, high = _span(state)
    return min(max(value, low), high)


def _fresh(state: ViewState, transfer: Transfer) -> ViewState:
    """With another transfer function altogether."""
    new = replace(state, transfer=transfer, shift=0.0, thickness=1.0, thin=None)
    return _chosen(new, 0)


def _reset(state: ViewState) -> ViewState:
    return _fresh(state, state.document.transfer)


def _preset(preset: preset_table.Preset) -> Change:
    def change(state: ViewState) -> ViewState:
        if isinstance(state.transfer, LabelFunction):  # labels are names, no values
            return state
        document = state.document
        basis = document.transfer.basis
        fitted = presets.transfer_of(preset, document.volume, document.histogram, basis)
        return _fresh(state, fitted)

    return change


def _into(kind: transfer_convert.Kind) -> Change:
    def change(state: ViewState) -> ViewState:
        new = transfer_convert.converted(state.transfer, kind, _span(state))
        return state if new is state.transfer else _chosen(_with_transfer(state, new), 0)

    return change


def _labelled(state: ViewState) -> str:
    """Why a transfer function stays what it is."""
    if not isinstance(state.transfer, LabelFunction):
        return ""
    return "Labels are names, no values: neither presets nor other kinds fit them"


def _lost(kind: transfer_convert.Kind) -> Callable[[ViewState], str]:
    return lambda state: transfer_convert.left_out(state.transfer, kind, _span(state))


def _is(kind: transfer_convert.Kind) -> Callable[[ViewState], bool]:
    return lambda state: transfer_convert.kind_of(state.transfer) == kind


EVENTS: dict[str, Reducer] = {
    "point": _point,
    "add-point": _add_point,
    "remove-point": _remove_point,
    "choose-point": _choose,
    "opacity": _opacity,
    "material": _material,
    "share": _share,
    "region-values": _region_values,
    "region-gradients": _region_gradients,
    "softness": _softness,
    "by-gradient": _by_gradient,
    "gradient-point": _gradient(
        lambda c, e, top: transfer_placing.factor_moved(c, e.index, e.x, e.y, top)
    ),
    "add-gradient-point": _gradient(
        lambda c, e, top: transfer_placing.factor_added(c, e.x, e.y, top)
    ),
    "remove-gradient-point": _gradient(lambda c, e, _: transfer_placing.factor_removed(c, e.index)),
    **materials.EVENTS,
    "shift": _shift,
    "thicken": _thicken,
    "window": _window,
    "thicken-by": _thicken_by,
}

# By kind: how it is called.
KIND_TITLES: dict[transfer_convert.Kind, str] = {
    "points": "Curve (1-D)",
    "regions": "Regions (2-D)",
    "surfaces": "Surfaces",
}
ACTIONS = (
    *(
        Action(
            *(f"preset-{preset.name}", "Transfer", f"Preset: {preset.title}", (), _preset(preset)),
            refusal=_labelled,
        )
        for preset in preset_table.PRESETS
    ),
    *(
        Action(
            *(f"transfer-{kind}", "Transfer", f"Kind: {title}", (), _into(kind), _is(kind)),
            refusal=_labelled,
            told=_lost(kind),
        )
        for kind, title in KIND_TITLES.items()
    ),
    Action("reset-transfer", "Transfer", "The scene's own transfer function", (), _reset),
)
