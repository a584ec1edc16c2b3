"""Edits of one light's spectra: their lux, weights and light groups, the pen, the notation.

    panels, pen -> [light_parts] -> state

Whatever numbers come, no edit makes a rig that gives no light: the row stays as it is.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from volspec.errors import VolspecError
from volspec.relight import LightRig
from volspec.spectra import Spectrum, colour_matching_functions
from volspec.viewer.model.edit import edit, refusable
from volspec.viewer.model.light_rows import (
    LUX,
    MOST_WEIGHT,
    LightRow,
    Place,
    draw_stroke,
    kelvin_of,
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


def change_row(state: ViewState, index: int, **changes: Any) -> ViewState:
    """Change fields of a row, if there is such a row."""
    return replace(state, lights=with_changes(state.lights, index, **changes))


def put_row(state: ViewState, index: int, row: LightRow, name: str) -> ViewState:
    """Put a row in one's place, under a name unless that one's name was given by hand."""
    old = state.lights[index]
    name = old.name if old.named else unused_name(name, other_names(state, index))
    return replace(state, lights=with_item(state.lights, index, replace(row, name=name)))


def other_names(state: ViewState, index: int) -> set[str]:
    """Return the names of all rows but one."""
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
        return change_row(state, index, rig=replace(rig, **changes))
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
    return change_row(state, index, rig=rig, texts=texts, kelvin=kelvin, before=None)


@edit
def draw(state: ViewState, index: int, part: int, start: Place, end: Place) -> ViewState:
    """Draw on a light's spectrum as `draw_stroke`, unless nothing visible would be left of it."""
    row = row_at(state.lights, index, part)
    if row is None:
        return state
    old = row.rig.lights[part]
    values = draw_stroke(old.values, start, end)
    V = colour_matching_functions(old.grid)[1]
    if np.array_equal(values, old.values) or V @ values < _LEAST_POWER * V.sum():
        return state
    before = row.before or row
    name = f"{before.name.removesuffix(_EDITED)}{_EDITED}"
    drawn = Spectrum(old.wavelengths_nm, values, name)
    rig = replace(row.rig, lights=with_item(row.rig.lights, part, drawn))
    texts = with_item(row.texts, part, None)
    new = replace(row, rig=rig, kelvin=None, texts=texts, before=before)
    return put_row(state, index, new, name)


def reset_spectrum(state: ViewState) -> ViewState:
    """Give the chosen light the spectrum that it had before it was drawn; its weight stays."""
    index = state.interface.light
    row = row_at(state.lights, index)
    if row is None or row.before is None:
        return state
    before = replace(row.before, weight=row.weight, solo=row.solo, muted=row.muted, named=row.named)
    return put_row(state, index, before, before.name)


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
        return change_row(state, index, rig=rig, texts=texts, kelvin=None, before=None)
    name, label, kelvin = titles_of(text)
    new = replace(row, label=label, rig=rig, kelvin=kelvin, texts=texts, before=None)
    return put_row(state, index, new, name)


def titles_of(text: str) -> tuple[str, str, float | None]:
    """Return name, label and temperature of a light by its notation."""
    kelvin = kelvin_of(text)
    return (text, text, None) if kelvin is None else (f"{kelvin:g} K", "Planck radiator", kelvin)
