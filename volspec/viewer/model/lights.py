"""Edits and commands of the list of lights: weights, solo, mute, dial, the divide.

mouse, keys, panels -> [lights] -> state
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

from volspec.errors import InputError, SpectrumError
from volspec.relight import LightRig
from volspec.spectra.files import split_address
from volspec.viewer.model import light_states
from volspec.viewer.model.edit import Change, Command, Edited, bind, edit, refusable, with_interface
from volspec.viewer.model.light_mixes import dial_weights, mix_row
from volspec.viewer.model.light_parts import (
    change_row,
    other_names,
    put_row,
    reset_spectrum,
    titles_of,
)
from volspec.viewer.model.light_rows import (
    MOST_ROWS,
    LightRow,
    Rows,
    at_kelvin,
    brightest_row,
    effective_weights,
    only_row,
    rig_of,
    row_at,
    spectrum_of,
    unused_name,
    with_changes,
    without_item,
)
from volspec.viewer.model.state import ViewState
from volspec.viewer.model.view import clamp


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
    return put_row(state, index, new, f"{new.kelvin:g} K")


@edit
def toggle_solo(state: ViewState, index: int) -> ViewState:
    """Turn a light's solo on or off."""
    row = row_at(state.lights, index)
    return change_row(state, index, solo=not row.solo) if row else state


@edit
def toggle_mute(state: ViewState, index: int) -> ViewState:
    """Mute a light, or no longer."""
    row = row_at(state.lights, index)
    return change_row(state, index, muted=not row.muted) if row else state


@edit
def rename(state: ViewState, index: int, name: str) -> ViewState:
    """Give a light another name, also in the palette; numbered if another light has it."""
    row, name = row_at(state.lights, index), " ".join(name.split())
    if row is None or name in ("", row.name):
        return state
    name = unused_name(name, other_names(state, index))
    palette = state.palette.with_light_renamed(row.name, name)
    return replace(change_row(state, index, name=name, named=True), palette=palette)


@refusable
def add(state: ViewState, text: str) -> ViewState:
    """Add a light in `volspec.light`'s notation, alone and chosen.

    It gets as many lux as shine now, if all other lights have some.
    """
    spectrum, text = spectrum_of(text, state.document.grid, state.document.folder)
    name, label, kelvin = titles_of(text)
    if split_address(text) is not None:
        name = spectrum.name or text
    rig = LightRig((spectrum,), illuminance_lux=_present_lux(state.lights))
    return _add_row(state, LightRow(name, label, rig, kelvin=kelvin, texts=(text,)))


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
        "reset-spectrum", "Light", "Undo the drawing of the chosen spectrum", (), reset_spectrum
    ),
    Command("rename-light", "Light", "Rename the chosen light", ("f2",)),
    Command("remove-light", "Light", "Remove the chosen light", (), _remove_chosen),
    *light_states.COMMANDS,
)
