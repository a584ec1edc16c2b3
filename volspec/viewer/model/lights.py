"""Edits and commands of the list of lights: weights, solo, mute, mixes, dial, the divide.

mouse, keys, panels -> [lights] -> state
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import cache

from volspec.errors import InputError, SpectrumError, VolspecError
from volspec.relight import LightRig
from volspec.scene.tables import ROOM_LIGHT
from volspec.spectra import SpectralGrid, Spectrum, light
from volspec.spectra.files import split_address
from volspec.spectra.library import light_terms
from volspec.viewer.model import light_parts, light_states
from volspec.viewer.model.edit import Command, Edited, bind, edit, refusable, with_interface
from volspec.viewer.model.light_rows import (
    MAX_ROWS,
    LightRow,
    Rows,
    at_kelvin,
    brightest_row,
    effective_weights,
    light_from_text,
    light_rig,
    merge_groups,
    only_row,
    own_light,
    row_at,
    unused_name,
    with_changes,
    without_item,
)
from volspec.viewer.model.state import ViewState
from volspec.viewer.model.view import clamp

_DIGITS = 4


def mix_row(rows: Rows, grid: SpectralGrid, folder: str = ".") -> LightRow | None:
    """Return the current mix as a single light; None if every light is off."""
    rig = light_rig(rows)
    if rig is None:
        return None
    mixture = merge_groups(rig, grid)
    spectra: list[Spectrum] = []
    texts: list[str | None] = []
    for group, mixed in zip(mixture.groups, mixture.lights, strict=True):
        text = _mix_text(rows, rig.total_lux, group, folder)
        try:
            spectrum = light(text, grid, folder=folder) if text else mixed
        except VolspecError:  # a name that cannot be in a mix
            text, spectrum = None, mixed
        spectra.append(spectrum)
        texts.append(text)
    label = texts[0] if len(texts) == 1 and texts[0] else "saved mix"
    return LightRow("Mix", label, replace(mixture, lights=tuple(spectra)), texts=tuple(texts))


def _mix_text(rows: Rows, total_lux: float | None, group: str, folder: str) -> str | None:
    """Return a light group's mix in `volspec.light`'s notation.

    Weights are fractions of ``total_lux`` if that is given. None if nothing shines or a
    spectrum was drawn by hand.
    """
    sums: dict[str, float] = {}
    for row, weight in zip(rows, effective_weights(rows), strict=True):
        for j, text in enumerate(row.texts):
            amount = weight * row.rig.weights[j]
            if row.rig.groups[j] != group or amount <= 0:
                continue
            if text is None:
                return None
            if total_lux and row.rig.illuminance_lux:
                amount *= row.rig.illuminance_lux[j] / total_lux
            terms = light_terms(text, folder)
            # With lux, weights are relative to the mix: they need not sum to 1.
            total = sum(part for _, part in terms) if total_lux else 1.0
            for name, part in terms:
                sums[name] = sums.get(name, 0.0) + amount * part / total
    rounded = [(name, f"{value:.{_DIGITS}g}") for name, value in sums.items() if value > 0]
    return "+".join(name if value == "1" else f"{name}*{value}" for name, value in rounded) or None


@cache
def rim_places(count: int) -> tuple[tuple[float, float], ...]:
    """Return the lights' places on the dial's rim, clockwise from the top; y runs down."""
    angles = [2 * math.pi * i / count for i in range(count)]
    return tuple((math.sin(angle), -math.cos(angle)) for angle in angles)


def dial_weights(count: int, x: float, y: float) -> tuple[float, ...]:
    """Return the weights of a place on the dial, whose rim has radius 1; they sum to 1.

    The polygon of the lights is a fan of triangles around the centre, where all weights are
    equal; in each triangle weights are linear. Places outside are moved to its edge.

    >>> dial_weights(4, 0.0, -1.0)
    (1.0, 0.0, 0.0, 0.0)
    >>> dial_weights(3, 0.0, 0.0)
    (0.333..., 0.333..., 0.333...)
    """
    if count < 2:
        return (1.0,) * count
    rim = rim_places(count)
    if count == 2:
        upper = clamp((1.0 - y) / 2, 0.0, 1.0)
        return (upper, 1.0 - upper)
    sector = int(math.atan2(x, -y) % (2 * math.pi) / (2 * math.pi / count)) % count
    after = (sector + 1) % count
    (ax, ay), (bx, by) = rim[sector], rim[after]
    area = ax * by - bx * ay
    first, second = max((x * by - bx * y) / area, 0.0), max((ax * y - x * ay) / area, 0.0)
    total = first + second
    if total > 1.0:
        first, second, total = first / total, second / total, 1.0
    weights = [(1.0 - total) / count] * count
    weights[sector] += first
    weights[after] += second
    return tuple(weights)


def dial_place(weights: Sequence[float]) -> tuple[float, float]:
    """Return the place of weights on the dial, the inverse of `dial_weights`: a weighted mean."""
    total = sum(weights)
    if total <= 0:
        return 0.0, 0.0
    rim = rim_places(len(weights))
    x, y = (sum(w * p[k] for w, p in zip(weights, rim, strict=True)) / total for k in (0, 1))
    return x, y


@edit
def set_weight(state: ViewState, index: int, weight: float) -> ViewState:
    """Set a light's weight in the mix."""
    rows = with_changes(state.lights, index, weight=clamp(weight, 0.0, 1.0))
    return replace(state, lights=rows)


@edit
def set_kelvin(state: ViewState, index: int, kelvin: float) -> ViewState:
    """Set the colour temperature of a Planck radiator."""
    row = row_at(state.lights, index)
    if row is None or row.kelvin is None:
        return state
    new = at_kelvin(row, kelvin)
    return light_parts.put_row(state, index, new, f"{new.kelvin:g} K")


@edit
def toggle_solo(state: ViewState, index: int) -> ViewState:
    """Turn a light's solo on or off."""
    row = row_at(state.lights, index)
    return light_parts.change_row(state, index, solo=not row.solo) if row else state


@edit
def toggle_mute(state: ViewState, index: int) -> ViewState:
    """Turn a light's mute on or off."""
    row = row_at(state.lights, index)
    return light_parts.change_row(state, index, muted=not row.muted) if row else state


@edit
def rename(state: ViewState, index: int, name: str) -> ViewState:
    """Rename a light, also in the palette; a name that is taken gets a number."""
    row, name = row_at(state.lights, index), " ".join(name.split())
    if row is None or name in ("", row.name):
        return state
    name = unused_name(name, light_parts.other_names(state, index))
    palette = state.palette.with_light_renamed(row.name, name)
    return replace(light_parts.change_row(state, index, name=name, named=True), palette=palette)


@refusable
def add(state: ViewState, text: str) -> ViewState:
    """Add a light from `volspec.light`'s notation, show it alone, and choose it.

    It gets the current total lux if all other lights have lux.
    """
    if state.room is not None and text.strip() == ROOM_LIGHT:
        return _add_row(state, own_light(state.room))
    spectrum, text = light_from_text(text, state.document.grid, state.document.folder)
    name, label, kelvin = light_parts.titles_from_text(text)
    if split_address(text) is not None:
        name = spectrum.name or text
    rig = LightRig((spectrum,), illuminance_lux=_present_lux(state.lights))
    return _add_row(state, LightRow(name, label, rig, kelvin=kelvin, texts=(text,)))


def _present_lux(rows: Rows) -> tuple[float] | None:
    """Return the current total lux; None unless all lights have lux."""
    if any(row.rig.illuminance_lux is None for row in rows):
        return None
    rig = light_rig(rows) or rows[0].rig
    # A surface gets only its group's fraction of the light.
    total = max(rig.illuminance_lux or (0.0,)) if any(rig.groups) else rig.total_lux
    return (total,) if total else None


@refusable
def keep_mix(state: ViewState) -> ViewState:
    """Add the mix of all lights as another light."""
    row = mix_row(state.lights, state.document.grid, state.document.folder)
    if row is None:
        raise InputError("No light is on, so there is no mix to add", code="missing")
    return _add_row(state, row)


def _add_row(state: ViewState, row: LightRow) -> ViewState:
    """Add a row at the end under an unused name, show it alone, and choose it."""
    rows = state.lights
    if len(rows) >= MAX_ROWS:
        raise SpectrumError(f"The limit is {MAX_ROWS} lights; remove one first", code="size")
    name = unused_name(row.name, {other.name for other in rows})
    return with_last(state, only_row((*rows, replace(row, name=name)), len(rows)))


def with_last(state: ViewState, rows: Rows) -> ViewState:
    """Set the lights, and choose the last, which is new."""
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
        return Edited(state, "The last light cannot be removed; add another one first")
    return Edited(remove(state, state.interface.light))


@edit
def choose(state: ViewState, index: int) -> ViewState:
    """Choose a light."""
    if not 0 <= index < len(state.lights):
        return state
    return with_interface(state, light=index)


@edit
def show_alone(state: ViewState, index: int) -> ViewState:
    """Show one light alone without choosing it."""
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
    """Blend all lights by a place on the dial; the strongest gets weight 1, solo and mute end."""
    weights = dial_weights(len(state.lights), x, y)
    strongest = max(weights, default=1.0)
    rows = tuple(
        replace(row, weight=weight / strongest, solo=False, muted=False)
        for row, weight in zip(state.lights, weights, strict=True)
    )
    return replace(state, lights=rows)


@edit
def set_divide(state: ViewState, fraction: float) -> ViewState:
    """Move the divide between the lights that are compared, in fractions of the width."""
    return replace(state, divide=clamp(fraction, 0.02, 0.98))


def _is_comparing(state: ViewState) -> bool:
    return state.other is not None


def _compare(state: ViewState) -> ViewState:
    """Start to compare with the current lights, shown to the right of a divide, or stop."""
    return replace(state, other=None if state.other else state.lights, divide=0.5)


def _swap(state: ViewState) -> ViewState:
    """Swap the lights on the two sides of the divide."""
    return replace(state, lights=state.other, other=state.lights) if state.other else state


def _on_chosen(name: str, title: str, change: Callable[[ViewState, int], ViewState]) -> Command:
    """Return the command that edits the chosen light."""
    return Command(name, "Light", title, (), lambda state: change(state, state.interface.light))


COMMANDS = (
    Command("next-light", "Light", "Next light alone", ("space",), _next_light),
    Command("compare", "Light", "Compare with these lights", ("b",), _compare, _is_comparing),
    Command("swap", "Light", "Swap the two sides", ("x",), _swap),
    _on_chosen("alone", "The chosen light alone", only),
    _on_chosen("solo", "Solo the chosen light", toggle_solo),
    _on_chosen("mute", "Mute the chosen light", toggle_mute),
    Command("blend-all", "Light", "All lights at equal weights", (), bind(blend, 0.0, 0.0)),
    Command("keep-mix", "Light", "Add this mix as a light", ("k",), keep_mix),
    Command("reset-spectrum", "Light", "Reset the chosen spectrum", (), light_parts.reset_spectrum),
    Command("rename-light", "Light", "Rename the chosen light", ("f2",)),
    Command("remove-light", "Light", "Remove the chosen light", (), _remove_chosen),
    *light_states.COMMANDS,
)
