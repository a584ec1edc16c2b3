"""Edits of one light's spectra: their lux, weights and light groups, the pen, the notation.

    panels, pen -> [light_parts] -> state

An edit that would leave a rig without any light leaves the row unchanged.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from volspec.relight import LightRig
from volspec.scene.tables import ROOM_LIGHT
from volspec.spectra import Spectrum, colour_matching_functions
from volspec.spectra.library import describe_light, library_names
from volspec.viewer.model import light_rows
from volspec.viewer.model.edit import edit, refusable
from volspec.viewer.model.room import light_names
from volspec.viewer.model.state import ViewState
from volspec.viewer.model.view import clamp

# The least luminous power of a drawn light, relative to an equal-energy one.
_MIN_POWER = 1e-6
_EDITED = " edited"


def change_row(state: ViewState, index: int, **changes: Any) -> ViewState:
    """Change fields of a row, if there is such a row."""
    return replace(state, lights=light_rows.with_changes(state.lights, index, **changes))


def put_row(state: ViewState, index: int, row: light_rows.LightRow, name: str) -> ViewState:
    """Replace a row; the new one gets ``name`` unless the user has named the old one."""
    old = state.lights[index]
    name = old.name if old.named else light_rows.unused_name(name, other_names(state, index))
    return replace(state, lights=light_rows.with_item(state.lights, index, replace(row, name=name)))


def other_names(state: ViewState, index: int) -> set[str]:
    """Return the names of all rows but one."""
    return {row.name for row in light_rows.without_item(state.lights, index)}


@edit
def set_lux(state: ViewState, index: int, lux: float, part: int = 0) -> ViewState:
    """Set the illuminance of one of a light's spectra; 0 or less removes lux from all of them."""
    row = light_rows.row_at(state.lights, index, part)
    if row is None or state.room is not None:  # the room's lamps have the lux of its file
        return state
    if not lux > 0:
        return _change_rig(state, index, illuminance_lux=None)
    lux = clamp(lux, *light_rows.LUX)
    illuminances = row.rig.illuminance_lux or (lux,) * len(row.rig.lights)
    return _change_rig(state, index, illuminance_lux=light_rows.with_item(illuminances, part, lux))


@edit
def set_part_weight(state: ViewState, index: int, part: int, weight: float) -> ViewState:
    """Set the weight of one of a light's spectra."""
    row = light_rows.row_at(state.lights, index, part)
    if row is None:
        return state
    weights = row.rig.weights
    weight = clamp(weight, 0.0, max(light_rows.MAX_WEIGHT, weights[part]))
    return _change_rig(state, index, weights=light_rows.with_item(weights, part, weight))


@edit
def regroup(state: ViewState, index: int, part: int, group: str) -> ViewState:
    """Move one of a light's spectra to another light group; ``""`` means all groups."""
    row = light_rows.row_at(state.lights, index, part)
    if row is None:
        return state
    return _change_rig(state, index, groups=light_rows.with_item(row.rig.groups, part, group))


def _change_rig(state: ViewState, index: int, **changes: Any) -> ViewState:
    """Change fields of a row's rig, if anything differs."""
    rig = state.lights[index].rig
    if all(getattr(rig, name) == value for name, value in changes.items()):
        return state
    return change_row(state, index, rig=replace(rig, **changes))


@edit
def add_part(state: ViewState, index: int, group: str) -> ViewState:
    """Add a copy of a light's first spectrum, with its weight and lux, for a light group."""
    row = light_rows.row_at(state.lights, index)
    if row is None:
        return state
    return _set_parts(
        state, index, [*light_rows.parts_of(row), (0, group, row.rig.weights[0] or 1.0)]
    )


@edit
def remove_part(state: ViewState, index: int, part: int) -> ViewState:
    """Remove one of a light's spectra; the last one stays."""
    row = light_rows.row_at(state.lights, index, part)
    if row is None or len(row.rig.lights) < 2:
        return state
    return _set_parts(state, index, [term for term in light_rows.parts_of(row) if term[0] != part])


@edit
def split_part(state: ViewState, index: int) -> ViewState:
    """Replace a light's spectrum for all light groups with one for each."""
    row = light_rows.row_at(state.lights, index)
    groups = light_names(state)
    if row is None or "" not in row.rig.groups or len(groups) < 2:
        return state
    index_all, parts = row.rig.groups.index(""), light_rows.parts_of(row)
    split = [(index_all, group, parts[index_all][2]) for group in groups]
    return _set_parts(state, index, [*parts[:index_all], *split, *parts[index_all + 1 :]])


def _set_parts(state: ViewState, index: int, parts: Sequence[tuple[int, str, float]]) -> ViewState:
    """Rebuild a light from the given (spectrum index, light group, weight) parts."""
    row = light_rows.with_parts(state.lights[index], parts)
    return replace(state, lights=light_rows.with_item(state.lights, index, row))


@edit
def draw(
    state: ViewState, index: int, part: int, start: light_rows.Place, end: light_rows.Place
) -> ViewState:
    """Draw on a light's spectrum with `draw_stroke`, unless nothing visible would remain."""
    row = light_rows.row_at(state.lights, index, part)
    if row is None:
        return state
    old = row.rig.lights[part]
    values = light_rows.draw_stroke(old.values, start, end)
    V = colour_matching_functions(old.grid)[1]
    if np.array_equal(values, old.values) or V @ values < _MIN_POWER * V.sum():
        return state
    before = row.before or row
    name = f"{before.name.removesuffix(_EDITED)}{_EDITED}"
    drawn = Spectrum(old.wavelengths_nm, values, name)
    rig = replace(row.rig, lights=light_rows.with_item(row.rig.lights, part, drawn))
    texts = light_rows.with_item(row.texts, part, None)
    new = replace(row, rig=rig, kelvin=None, texts=texts, before=before)
    return put_row(state, index, new, name)


def reset_spectrum(state: ViewState) -> ViewState:
    """Restore the chosen light's spectrum from before it was drawn; its weight stays."""
    index = state.interface.light
    row = light_rows.row_at(state.lights, index)
    if row is None or row.before is None:
        return state
    before = replace(row.before, weight=row.weight, solo=row.solo, muted=row.muted, named=row.named)
    return put_row(state, index, before, before.name)


@refusable
def respell(state: ViewState, index: int, part: int, text: str) -> ViewState:
    """Give a part of a light another spectrum, in `volspec.light`'s notation."""
    row = light_rows.row_at(state.lights, index, part)
    if row is None or text.strip() == (row.texts[part] or ""):
        return state
    if state.room is not None and text.strip() == ROOM_LIGHT:
        spectra = state.room.own_spectra(row.rig.groups[part])
        return _with_own_spectra(state, index, part, spectra)
    spectrum, text = light_rows.light_from_text(text, state.document.grid, state.document.folder)
    rig = replace(row.rig, lights=light_rows.with_item(row.rig.lights, part, spectrum))
    texts = light_rows.with_item(row.texts, part, text)
    if len(texts) > 1:
        return change_row(state, index, rig=rig, texts=texts, kelvin=None, before=None)
    name, label, kelvin = titles_from_text(text)
    new = replace(row, label=label, rig=rig, kelvin=kelvin, texts=texts, before=None)
    return put_row(state, index, new, name)


def _with_own_spectra(
    state: ViewState, index: int, part: int, spectra: Mapping[str, Spectrum]
) -> ViewState:
    """Replace a part of a light by spectra of the room's lamps, by group."""
    row = state.lights[index]
    parts = [
        (spectrum, row.texts[j], group, weight)
        for (j, group, weight), spectrum in zip(
            light_rows.parts_of(row), row.rig.lights, strict=True
        )
    ]
    weight = row.rig.weights[part]
    lamps = [(spectrum, ROOM_LIGHT, group, weight) for group, spectrum in spectra.items()]
    lights, texts, groups, weights = zip(*parts[:part], *lamps, *parts[part + 1 :], strict=True)
    rig = LightRig(lights, weights, groups=groups)
    new = replace(row, rig=rig, texts=texts, kelvin=None, before=None)
    return put_row(state, index, new, ROOM_LIGHT if len(parts) == 1 else row.name)


def titles_from_text(text: str) -> tuple[str, str, float | None]:
    """Return a light's name, label and temperature from its notation."""
    kelvin = light_rows.kelvin_from_text(text)
    if kelvin is not None:
        return f"{kelvin:g} K", "Planck radiator", kelvin
    return text, describe_light(text) if text in library_names() else text, None
