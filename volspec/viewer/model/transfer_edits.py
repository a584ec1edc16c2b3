"""Edits and commands of the transfer function, of any kind: its parts, its values.

mouse, panels -> [transfer_edits] -> Transfer
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from typing import Any

from volspec.transfer import (
    Isosurfaces,
    LabelFunction,
    Transfer,
    TransferFunction,
    label_function,
    presets,
    with_labels,
)
from volspec.transfer import TransferFunction2D as Regions
from volspec.viewer.model import fields, transfer_convert, transfer_parts
from volspec.viewer.model.edit import Change, Command, Edited, edit, refusable, with_interface
from volspec.viewer.model.state import ViewState
from volspec.viewer.model.view import clamp

THICKNESSES = (0.02, 50.0)
# A drag over the picture's height shifts values by the volume's range, and multiplies widths and
# thicknesses by e to these powers.
_WIDER, _THICKER = 2.0, 3.0
# The narrowest region, as a fraction of either axis.
_NARROWEST = 0.01
# The greatest fraction of a mix that one material can take.
_PUREST = 0.999
# A curve's factors over gradients: their greatest number, and their least distance as a fraction
# of the axis; a table has too few rows for closer ones.
MAX_FACTORS = 16
_FACTOR_GAP = 1 / 128
# New factors rise from 0 to 1 between these fractions of the axis, so that boundaries remain.
_RISE = 0.05, 0.4


def _with_transfer(state: ViewState, transfer: Transfer) -> ViewState:
    return state if transfer is state.transfer else replace(state, transfer=transfer)


@edit
def move_point(state: ViewState, index: int, value: float, opacity: float) -> ViewState:
    """Move a point of a curve, or a surface, between its neighbours."""
    transfer = state.transfer
    if not isinstance(transfer, TransferFunction | Isosurfaces):
        return state
    rows = list(transfer_parts.list_points(transfer))
    if not 0 <= index < len(rows):
        return state
    places = [place for place, _, _ in rows]
    value = transfer_parts.limit_between(
        places, index, clamp(value, *_span(state)), transfer_parts.value_gap(rows)
    )
    rows[index] = value, clamp(opacity, 0.0, 1.0), rows[index][2]
    return replace(state, transfer=transfer_parts.with_parts(transfer, rows))


@edit
def add_point(state: ViewState, value: float, opacity: float) -> ViewState:
    """Add a point, a surface, a label, or a region at (value, gradient), and choose it."""
    transfer = state.transfer
    if isinstance(transfer, Regions):
        place = clamp(value, *_span(state)), max(opacity, 0.0)
        new = transfer_parts.add_region(transfer, place, _span(state), fields.data(state).joint.top)
    elif isinstance(transfer, LabelFunction):
        new = transfer_parts.add_label(transfer, value, clamp(opacity, 0.0, 1.0))
    else:
        new = transfer_parts.add_row(
            transfer, clamp(value, *_span(state)), clamp(opacity, 0.0, 1.0)
        )
    if new is transfer:
        return state
    old = {part.values for part in transfer_parts.list_parts(transfer)}
    indices = [i for i, part in enumerate(transfer_parts.list_parts(new)) if part.values not in old]
    added = replace(state, transfer=new)
    return with_interface(added, part=indices[0]) if indices else added


@edit
def remove_point(state: ViewState, index: int) -> ViewState:
    """Remove a part; a curve keeps at least two, others one."""
    transfer = state.transfer
    parts = getattr(transfer, transfer_parts.KINDS[type(transfer)])
    minimum = 2 if isinstance(transfer, TransferFunction) else 1
    if len(parts) <= minimum or not 0 <= index < len(parts):
        return state
    if isinstance(transfer, LabelFunction):
        label = list(parts)[index]
        left: Any = {key: look for key, look in parts.items() if key != label}
    else:
        left = [*parts[:index], *parts[index + 1 :]]
    return replace(state, transfer=transfer_parts.with_parts(transfer, left))


@edit
def choose_part(state: ViewState, index: int) -> ViewState:
    """Choose the part whose details are shown."""
    exists = 0 <= index < len(transfer_parts.list_parts(state.transfer))
    return with_interface(state, part=index) if exists else state


@edit
def set_opacity(state: ViewState, index: int, opacity: float) -> ViewState:
    """Set a part's opacity."""
    transfer = transfer_parts.with_look(
        state.transfer, index, lambda _, mix: (clamp(opacity, 0.0, 1.0), mix)
    )
    return _with_transfer(state, transfer)


@edit
def set_material(state: ViewState, index: int, name: str) -> ViewState:
    """Make a part of one material."""
    if name not in state.transfer.materials:
        return state
    return _with_transfer(state, transfer_parts.with_mix(state.transfer, index, name))


@edit
def set_material_weight(state: ViewState, index: int, name: str, weight: float) -> ViewState:
    """Set the weight of a material in a part's mix; the others make room or fill up."""
    parts = transfer_parts.list_parts(state.transfer)
    if not 0 <= index < len(parts) or name not in state.transfer.materials:
        return state
    old = parts[index].mix
    remaining = {other: part for other, part in old.items() if other != name and part > 0}
    if not remaining:  # a part without materials would be black
        return state
    remaining_sum, total = sum(remaining.values()), sum(old.values())
    # A trace of the others stays, so that their proportions can be restored.
    weight = clamp(weight, 0.0, _PUREST * total)
    mix = {other: part * (total - weight) / remaining_sum for other, part in remaining.items()}
    if weight > 0:
        mix[name] = weight
    return _with_transfer(state, transfer_parts.with_mix(state.transfer, index, mix))


@edit
def set_region_values(state: ViewState, index: int, low: float, high: float) -> ViewState:
    """Set the values of a region, no narrower than is visible."""
    start, end = _span(state)
    room = end - start
    low, high = (clamp(v, start - room, end + room) for v in sorted((low, high)))
    return _with_region(state, index, values=(low, max(high, low + _NARROWEST * room)))


@edit
def set_region_gradients(state: ViewState, index: int, low: float, high: float) -> ViewState:
    """Set the gradients of a region; an upper limit at the end of the axis becomes infinite."""
    top = fields.data(state).joint.top
    min_width = _NARROWEST * top
    low, high = sorted((low, high))
    low = clamp(low, 0.0, top - min_width)
    high = max(high, low + min_width)
    return _with_region(state, index, gradients=(low, high if high < top else math.inf))


@edit
def set_softness(state: ViewState, index: int, softness: float) -> ViewState:
    """Set the softness of a region's edges."""
    return _with_region(state, index, softness=clamp(softness, 0.0, 1.0))


def _with_region(state: ViewState, index: int, **changes: Any) -> ViewState:
    transfer = state.transfer
    if not isinstance(transfer, Regions) or not 0 <= index < len(transfer.regions):
        return state
    regions = list(transfer.regions)
    regions[index] = replace(regions[index], **changes)
    return replace(state, transfer=transfer_parts.with_parts(transfer, regions))


@edit
def toggle_gradient_opacity(state: ViewState) -> ViewState:
    """Turn opacity by gradient on, with the scene's own factors if it has any, or off."""
    curve, original = state.transfer, state.document.transfer
    if not isinstance(curve, TransferFunction) or curve.filters:  # these do not go together
        return state
    if curve.gradient_opacity:
        factors = None
    elif isinstance(original, TransferFunction) and original.gradient_opacity:
        factors = original.gradient_opacity
    else:
        top = fields.data(state).joint.top
        factors = ((_RISE[0] * top, 0.0), (_RISE[1] * top, 1.0))
    return replace(state, transfer=replace(curve, gradient_opacity=factors))


@edit
def move_gradient_point(state: ViewState, index: int, gradient: float, factor: float) -> ViewState:
    """Move a point of a curve's factors over gradients, between its neighbours."""
    factors, end = _factors(state)
    if not 0 <= index < len(factors):
        return state
    gap = _FACTOR_GAP * end
    # The last is above 0, or there would be no axis.
    minimum = gap if index == len(factors) - 1 else 0.0
    places = [place for place, _ in factors]
    gradient = transfer_parts.limit_between(places, index, clamp(gradient, minimum, end), gap)
    factors[index] = gradient, clamp(factor, 0.0, 1.0)
    return _with_factors(state, factors)


@edit
def add_gradient_point(state: ViewState, gradient: float, factor: float) -> ViewState:
    """Add a point to a curve's factors over gradients, if there is room between the others."""
    factors, end = _factors(state)
    if not 0 < len(factors) < MAX_FACTORS:
        return state
    gradient = clamp(gradient, 0.0, end)
    if min(abs(place - gradient) for place, _ in factors) < _FACTOR_GAP * end:
        return state
    return _with_factors(state, sorted([*factors, (gradient, clamp(factor, 0.0, 1.0))]))


@edit
def remove_gradient_point(state: ViewState, index: int) -> ViewState:
    """Remove a point of a curve's factors over gradients; two stay."""
    factors, _ = _factors(state)
    if len(factors) <= 2 or not 0 <= index < len(factors):
        return state
    del factors[index]
    return _with_factors(state, factors)


def _factors(state: ViewState) -> tuple[list[tuple[float, float]], float]:
    """Return the (gradient, factor) points of a curve that has some, and the end of their axis."""
    curve = state.transfer
    if not isinstance(curve, TransferFunction) or not curve.gradient_opacity:
        return [], 0.0
    return list(curve.gradient_opacity), transfer_parts.gradient_top(
        curve, fields.data(state).joint.top
    )


def _with_factors(state: ViewState, factors: list[tuple[float, float]]) -> ViewState:
    changes: dict[str, Any] = {"gradient_opacity": factors}
    return replace(state, transfer=replace(state.transfer, **changes))


@edit
def shift(state: ViewState, shift: float) -> ViewState:
    """Set the total shift of all values."""
    low, high = _span(state)
    shift = clamp(shift, low - high, high - low)
    by = shift - state.shift
    shifted = _with_values(
        state, lambda old: transfer_parts.map_values(old, lambda v: v + by, (low, high))
    )
    return state if shifted is state else replace(shifted, shift=shift)


@edit
def thicken(state: ViewState, thickness: float) -> ViewState:
    """Set the total factor of all densities."""
    thickness = clamp(thickness, *THICKNESSES)
    thin, base = _restore_thin(state)
    thicker = transfer_parts.thicken_opacities(thin, thickness / base)
    return replace(state, transfer=thicker, thickness=thickness, unthickened=(thin, base, thicker))


def _restore_thin(state: ViewState) -> tuple[Transfer, float]:
    """Return the transfer function before it was thickened, and its own thickness."""
    transfer = state.transfer
    if state.unthickened is None or type(state.unthickened[2]) is not type(transfer):
        return transfer, state.thickness
    thin, base, thick = state.unthickened
    if thick is transfer:
        return thin, base
    return transfer_parts.undo_thickening(transfer, thick, thin, state.thickness / base), base


def _with_values(state: ViewState, change: Callable[[Transfer], Transfer]) -> ViewState:
    """Change the values of the transfer function, and of the one before thickening."""
    (thin, base), new = _restore_thin(state), change(state.transfer)
    if new is state.transfer:
        return state
    return replace(state, transfer=new, unthickened=(change(thin), base, new))


@edit
def window(state: ViewState, across: float, down: float) -> ViewState:
    """Shift the values by a drag sideways, and spread them by a drag upwards."""
    low, high = _span(state)
    shifted = shift(state, state.shift + across * (high - low))
    factor = math.exp(clamp(-_WIDER * down, -10.0, 10.0))
    return _with_values(
        shifted, lambda old: transfer_parts.stretch_values(old, factor, (low, high))
    )


@edit
def set_limits(state: ViewState, low: float, high: float) -> ViewState:
    """Set the values between which the transfer function lies, its contrast limits."""
    return _with_values(
        state, lambda old: transfer_parts.place_values(old, low, high, _span(state))
    )


@edit
def thicken_by(state: ViewState, _across: float, down: float) -> ViewState:
    """Increase the density by a drag upwards."""
    factor = math.exp(clamp(-_THICKER * down, -10.0, 10.0))
    return thicken(state, state.thickness * factor)


def _span(state: ViewState) -> tuple[float, float]:
    return presets.value_span(fields.data(state).volume)


def _with_new(state: ViewState, transfer: Transfer) -> ViewState:
    """Replace the transfer function by one that is neither shifted nor thickened."""
    new = replace(state, transfer=transfer, shift=0.0, thickness=1.0, unthickened=None)
    return with_interface(new, part=0)


def _preset(preset: presets.Preset) -> Change:
    return lambda state: _with_new(state, _fit_to_volume(state, preset))


def _is_preset(state: ViewState, preset: presets.Preset) -> bool:
    field = fields.data(state)
    return presets.is_preset(state.transfer, preset, field.volume, field.histogram)


def _fit_to_volume(state: ViewState, preset: presets.Preset) -> Transfer:
    basis, field = state.document.transfer.basis, fields.data(state)
    return presets.fit_preset(preset, field.volume, field.histogram, basis.grid, basis.observer_deg)


def _as_labels(state: ViewState) -> Transfer:
    """Return the scene's labels, else those of the volume; raises VolumeError if it has none."""
    document = state.document
    if isinstance(document.transfer, LabelFunction):
        return document.transfer
    basis = document.transfer.basis
    volume = document.volume if document.volume.labels else with_labels(document.volume)
    return label_function(volume, basis.grid, basis.observer_deg)[0]


def _convert_to(kind: transfer_parts.Kind) -> Change:
    @refusable
    def change(state: ViewState) -> ViewState:
        old = state.transfer
        if kind == transfer_convert.transfer_kind(old):
            return state
        if kind == "labels":
            return _with_new(state, _as_labels(state))
        # Labels have no values that another kind could take over.
        if isinstance(old, LabelFunction):
            old = _fit_to_volume(state, presets.BY_NAME[presets.DEFAULT])
            return _with_new(state, transfer_convert.convert(old, kind, _span(state)))
        new = transfer_convert.convert(old, kind, _span(state))
        return with_interface(replace(state, transfer=new), part=0)

    def with_message(state: ViewState) -> Edited:
        new, message, _ = change(state)
        losses = transfer_convert.conversion_losses(state.transfer, kind, _span(state))
        return Edited(new, message or losses)

    return with_message


def _is_kind(kind: transfer_parts.Kind) -> Callable[[ViewState], bool]:
    return lambda state: transfer_convert.transfer_kind(state.transfer) == kind


KIND_TITLES: dict[transfer_parts.Kind, str] = {
    "points": "Curve (1-D)",
    "regions": "Regions (2-D)",
    "surfaces": "Surfaces",
    "labels": "Labels",
}
# Other names of the kinds.
_KIND_WORDS = {
    "points": "opacity transparent transparency transfer function colour map",
    "regions": "gradient 2-D two-dimensional opacity",
    "surfaces": "isosurface contour threshold",
}
COMMANDS = (
    *(
        Command(
            f"preset-{preset.name}",
            "Transfer",
            f"Preset: {preset.title}",
            (),
            _preset(preset),
            partial(_is_preset, preset=preset),
            preset.words,
        )
        for preset in presets.PRESETS
    ),
    *(
        Command(
            f"transfer-{kind}",
            "Transfer",
            f"Kind: {title}",
            (),
            _convert_to(kind),
            _is_kind(kind),
            _KIND_WORDS.get(kind, ""),
        )
        for kind, title in KIND_TITLES.items()
    ),
    Command(
        "reset-transfer",
        "Transfer",
        "The scene's own transfer function",
        (),
        lambda state: _with_new(state, state.document.transfer),
    ),
)
