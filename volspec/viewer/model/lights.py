"""Edits and commands of the lights: weights, lux, dial, pen, solo, mute, notations, the divide.

    mouse, keys, panels -> [lights] -> state

Whatever numbers come, no edit makes a rig that gives no light: the row stays as it is.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from volspec.errors import InputError, SpectrumError, VolspecError
from volspec.relight import LightRig
from volspec.spectra import Spectrum, color_matching_functions
from volspec.spectra.files import split_address
from volspec.viewer.model import light_states
from volspec.viewer.model.edit import Change, Command, Edited, bind, edit, refusable, with_interface
from volspec.viewer.model.light_mixes import dial_weights, mix_row
from volspec.viewer.model.light_rows import (
    LUX,
    MOST_ROWS,
    MOST_WEIGHT,
    LightRow,
    Place,
    Rows,
    at_kelvin,
    brightest_row,
    draw_stroke,
    effective_weights,
    kelvin_of,
    only_row,
    rig_of,
    row_at,
    spectrum_of,
    unused_name,
    with_changes,
    with_item,
    without_item,
)
from volspec.viewer.model.state import ViewState
from volspec.viewer.model.view import clamp

# A drawn light must leave as much to the eye, of what a flat one of ones gives.
_LEAST_POWER = 1e-6
_EDITED = " edited"


@edit
def set_weight(state: ViewState, index: int, weight: float) -> ViewState:
    """Set a light's weight in the mix."""
    return _change(state, index, weight=clamp(weight, 0.0, 1.0))


@edit
def set_kelvin(state: ViewState, index: int, kelvin: float) -> ViewState:
    """Set the colour temperature of a Planck radiator."""
    row = row_at(state.lights, index)
    if row is None or row.kelvin is None:
        return state
    new = at_kelvin(row, kelvin)
    return _put(state, index, new, f"{new.kelvin:g} K")


@edit
def toggle_solo(state: ViewState, index: int) -> ViewState:
    """Turn a light's solo on or off."""
    row = row_at(state.lights, index)
    return _change(state, index, solo=not row.solo) if row else state


@edit
def toggle_mute(state: ViewState, index: int) -> ViewState:
    """Mute a light, or no longer."""
    row = row_at(state.lights, index)
    return _change(state, index, muted=not row.muted) if row else state


@edit
def rename(state: ViewState, index: int, name: str) -> ViewState:
    """Give a light another name, also in the palette; numbered if another light has it."""
    row, name = row_at(state.lights, index), " ".join(name.split())
    if row is None or name in ("", row.name):
        return state
    name = unused_name(name, _other_names(state, index))
    palette = state.palette.with_light_renamed(row.name, name)
    return replace(_change(state, index, name=name, named=True), palette=palette)


def _change(state: ViewState, index: int, **changes: Any) -> ViewState:
    """Change fields of a row, if there is such a row."""
    return replace(state, lights=with_changes(state.lights, index, **changes))


def _put(state: ViewState, index: int, row: LightRow, name: str) -> ViewState:
    """Put a row in one's place, under a name unless that one's name was given by hand."""
    old = state.lights[index]
    name = old.name if old.named else unused_name(name, _other_names(state, index))
    return replace(state, lights=with_item(state.lights, index, replace(row, name=name)))


def _other_names(state: ViewState, index: int) -> set[str]:
    return {row.name for row in without_item(state.lights, index)}


@edit
def set_lux(state: ViewState, index: int, lux: float, part: int = 0) -> ViewState:
    """Set the illuminance of one of a light's spectra; at 0 or below none of them has lux."""
    row = row_at(state.lights, index, part)
    if row is None:
        return state
    if not lux > 0:
        return _change_rig(state, index, illuminance_lux=None)
    lux = clamp(lux, *LUX)
    given = row.rig.illuminance_lux or (lux,) * len(row.rig.lights)
    return _change_rig(state, index, illuminance_lux=with_item(given, part, lux))


@edit
def set_part_weight(state: ViewState, index: int, part: int, weight: float) -> ViewState:
    """Set the weight of one of a light's spectra."""
    row = row_at(state.lights, index, part)
    if row is None:
        return state
    weights = row.rig.weights
    weight = clamp(weight, 0.0, max(MOST_WEIGHT, weights[part]))
    return _change_rig(state, index, weights=with_item(weights, part, weight))


@edit
def regroup(state: ViewState, index: int, part: int, group: str) -> ViewState:
    """Have one of a light's spectra shine from another light group; ``""`` is all of them."""
    row = row_at(state.lights, index, part)
    if row is None:
        return state
    return _change_rig(state, index, groups=with_item(row.rig.groups, part, group))


def _change_rig(state: ViewState, index: int, **changes: Any) -> ViewState:
    """Change fields of a row's rig, unless nothing differs or the rig would give no light."""
    rig = state.lights[index].rig
    if all(getattr(rig, name) == value for name, value in changes.items()):
        return state
    try:
        return _change(state, index, rig=replace(rig, **changes))
    except VolspecError:  # no light
        return state


@edit
def add_part(state: ViewState, index: int, group: str) -> ViewState:
    """Add a spectrum to a light, for a light group: the first one's, with its weight and lux."""
    row = row_at(state.lights, index)
    if row is None:
        return state
    return _set_parts(state, index, [*_parts(row), (0, group, row.rig.weights[0] or 1.0)])


@edit
def remove_part(state: ViewState, index: int, part: int) -> ViewState:
    """Remove one of a light's spectra; the last one stays."""
    row = row_at(state.lights, index, part)
    if row is None or len(row.rig.lights) < 2:
        return state
    return _set_parts(state, index, [each for each in _parts(row) if each[0] != part])


@edit
def split_part(state: ViewState, index: int) -> ViewState:
    """Give a light a spectrum for each light group of the scene in place of one for all."""
    row = row_at(state.lights, index)
    groups = [group.name for group in state.shading.groups]
    if row is None or "" not in row.rig.groups or len(groups) < 2:
        return state
    at, parts = row.rig.groups.index(""), _parts(row)
    split = [(at, group, parts[at][2]) for group in groups]
    return _set_parts(state, index, [*parts[:at], *split, *parts[at + 1 :]])


def _parts(row: LightRow) -> list[tuple[int, str, float]]:
    """Return number, light group and weight of each of a light's spectra."""
    rig = row.rig
    return list(zip(range(len(rig.lights)), rig.groups, rig.weights, strict=True))


def _set_parts(state: ViewState, index: int, parts: Sequence[tuple[int, str, float]]) -> ViewState:
    """Make a light of its spectra by their numbers, each with a light group and a weight."""
    row = state.lights[index]
    lux = row.rig.illuminance_lux
    try:
        rig = LightRig(
            tuple(row.rig.lights[j] for j, _, _ in parts),
            tuple(weight for _, _, weight in parts),
            tuple(lux[j] for j, _, _ in parts) if lux else None,
            tuple(group for _, group, _ in parts),
        )
    except VolspecError:  # what is left gives no light
        return state
    texts = tuple(row.texts[j] for j, _, _ in parts)
    kelvin = kelvin_of(texts[0]) if len(texts) == 1 else None
    return _change(state, index, rig=rig, texts=texts, kelvin=kelvin, before=None)


@edit
def draw(state: ViewState, index: int, part: int, start: Place, end: Place) -> ViewState:
    """Draw on a light's spectrum as `draw_stroke`, unless nothing visible would be left of it."""
    row = row_at(state.lights, index, part)
    if row is None:
        return state
    old = row.rig.lights[part]
    values = draw_stroke(old.values, start, end)
    V = color_matching_functions(old.grid)[1]
    if np.array_equal(values, old.values) or V @ values < _LEAST_POWER * V.sum():
        return state
    before = row.before or row
    name = f"{before.name.removesuffix(_EDITED)}{_EDITED}"
    drawn = Spectrum(old.wavelengths_nm, values, name)
    rig = replace(row.rig, lights=with_item(row.rig.lights, part, drawn))
    texts = with_item(row.texts, part, None)
    new = replace(row, rig=rig, kelvin=None, texts=texts, before=before)
    return _put(state, index, new, name)


def _reset_spectrum(state: ViewState) -> ViewState:
    """Give the chosen light the spectrum that it had before it was drawn; its weight stays."""
    index = state.interface.light
    row = row_at(state.lights, index)
    if row is None or row.before is None:
        return state
    before = replace(row.before, weight=row.weight, solo=row.solo, muted=row.muted, named=row.named)
    return _put(state, index, before, before.name)


@refusable
def respell(state: ViewState, index: int, part: int, text: str) -> ViewState:
    """Give a part of a light another spectrum, in `volspec.light`'s notation."""
    row = row_at(state.lights, index, part)
    if row is None or text.strip() == (row.texts[part] or ""):
        return state
    spectrum, text = spectrum_of(text, state.document.grid, state.document.folder)
    rig = replace(row.rig, lights=with_item(row.rig.lights, part, spectrum))
    texts = with_item(row.texts, part, text)
    if len(texts) > 1:
        return _change(state, index, rig=rig, texts=texts, kelvin=None, before=None)
    name, label, kelvin = _titles(text)
    new = replace(row, label=label, rig=rig, kelvin=kelvin, texts=texts, before=None)
    return _put(state, index, new, name)


@refusable
def add(state: ViewState, text: str) -> ViewState:
    """Add a light in `volspec.light`'s notation, alone and chosen.

    It gets as many lux as shine now, if all other lights have some.
    """
    spectrum, text = spectrum_of(text, state.document.grid, state.document.folder)
    name, label, kelvin = _titles(text)
    if split_address(text) is not None:
        name = spectrum.name or text
    rig = LightRig((spectrum,), illuminance_lux=_present_lux(state.lights))
    return _add_row(state, LightRow(name, label, rig, kelvin=kelvin, texts=(text,)))


def _titles(text: str) -> tuple[str, str, float | None]:
    """Return name, label and temperature of a light by its notation."""
    kelvin = kelvin_of(text)
    return (text, text, None) if kelvin is None else (f"{kelvin:g} K", "Planck radiator", kelvin)


def _present_lux(rows: Rows) -> tuple[float] | None:
    """Return the lux that shine now; None unless all lights have some."""
    if any(row.rig.illuminance_lux is None for row in rows):
        return None
    rig = rig_of(rows) or rows[0].rig
    # A surface gets a group's share of that group's light.
    total = max(rig.illuminance_lux or (0.0,)) if any(rig.groups) else rig.total_lux
    return (total,) if total else None


@refusable
def keep_mix(state: ViewState) -> ViewState:
    """Add the mix of all lights as one more light."""
    row = mix_row(state.lights, state.document.grid, state.document.folder)
    if row is None:
        raise InputError("No light is on: there is no mix to keep")
    return _add_row(state, row)


def _add_row(state: ViewState, row: LightRow) -> ViewState:
    """Add a row at the end, alone, chosen, and under a name of its own."""
    rows = state.lights
    if len(rows) >= MOST_ROWS:
        raise SpectrumError(f"{MOST_ROWS} lights are the most; remove one first")
    name = unused_name(row.name, {each.name for each in rows})
    return with_last(state, only_row((*rows, replace(row, name=name)), len(rows)))


def with_last(state: ViewState, rows: Rows) -> ViewState:
    """Set lights of which the last is new, and choose it."""
    return choose(replace(state, lights=rows), len(rows) - 1)


@edit
def remove(state: ViewState, index: int) -> ViewState:
    """Remove a light, unless it is the last; if all others are off, turn one on."""
    if len(state.lights) < 2 or not 0 <= index < len(state.lights):
        return state
    rows = without_item(state.lights, index)
    if not any(effective_weights(rows)):
        rows = only_row(rows, min(index, len(rows) - 1))
    return replace(state, lights=rows)


def _remove_chosen(state: ViewState) -> Edited:
    if len(state.lights) < 2:
        return Edited(state, "The last light stays; add another one first")
    return Edited(remove(state, state.interface.light))


@edit
def choose(state: ViewState, index: int) -> ViewState:
    """Choose a light."""
    if not 0 <= index < len(state.lights):
        return state
    return with_interface(state, light=index)


@edit
def show_alone(state: ViewState, index: int) -> ViewState:
    """Show one light alone; the chosen one stays."""
    if not 0 <= index < len(state.lights):
        return state
    return replace(state, lights=only_row(state.lights, index))


@edit
def only(state: ViewState, index: int) -> ViewState:
    """Show one light alone, and choose it."""
    return choose(show_alone(state, index), index)


def _next_light(state: ViewState) -> ViewState:
    return only(state, (brightest_row(state.lights) + 1) % len(state.lights))


@edit
def blend(state: ViewState, x: float, y: float) -> ViewState:
    """Blend all lights by a place on the dial: the strongest at weight 1, none solo or muted."""
    weights = dial_weights(len(state.lights), x, y)
    most = max(weights, default=1.0)
    rows = tuple(
        replace(row, weight=weight / most, solo=False, muted=False)
        for row, weight in zip(state.lights, weights, strict=True)
    )
    return replace(state, lights=rows)


def _chosen(change: Callable[[ViewState, int], ViewState]) -> Change:
    """Return an edit of the chosen light."""
    return lambda state: change(state, state.interface.light)


@edit
def set_divide(state: ViewState, share: float) -> ViewState:
    """Move the divide between the lights that are compared, in shares of the picture's width."""
    return replace(state, divide=clamp(share, 0.02, 0.98))


def _compare(state: ViewState) -> ViewState:
    """Keep the present lights at the right of a divide, or end that."""
    return replace(state, other=None if state.other else state.lights, divide=0.5)


def _swap(state: ViewState) -> ViewState:
    """Exchange the lights of both sides of the divide."""
    if state.other is None:
        return state
    return replace(state, lights=state.other, other=state.lights)


COMMANDS = (
    Command("next-light", "Light", "Next light alone", ("space",), _next_light),
    Command(
        "compare",
        "Light",
        "Compare: keep these lights at the right",
        ("b",),
        _compare,
        lambda state: state.other is not None,
    ),
    Command("swap", "Light", "Swap the two sides", ("x",), _swap),
    Command("alone", "Light", "The chosen light alone", (), _chosen(only)),
    Command("solo", "Light", "Solo the chosen light", (), _chosen(toggle_solo)),
    Command("mute", "Light", "Mute the chosen light", (), _chosen(toggle_mute)),
    Command("blend-all", "Light", "All lights alike", (), bind(blend, 0.0, 0.0)),
    Command("keep-mix", "Light", "Keep this mix as a light", ("k",), keep_mix),
    Command(
        "reset-spectrum", "Light", "Undo the drawing of the chosen spectrum", (), _reset_spectrum
    ),
    Command("rename-light", "Light", "Rename the chosen light", ("f2",)),
    Command("remove-light", "Light", "Remove the chosen light", (), _remove_chosen),
    *light_states.COMMANDS,
)
