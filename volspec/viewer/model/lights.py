"""Edits and commands of the lights: weights, lux, dial, pen, solo, mute, notations, the divide.

mouse, keys, panels -> [lights_edits] -> rows
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

from volspec.errors import InputError
from volspec.viewer.model import light_mixes, light_parts, light_rows, light_states
from volspec.viewer.model.edit import Change, Command, Edited, edit, refusable
from volspec.viewer.model.state import ViewState


@edit
def set_weight(state: ViewState, index: int, weight: float) -> ViewState:
    """Set a light's weight in the mix."""
    return replace(state, lights=light_rows.with_weight(state.lights, index, weight))


@edit
def set_kelvin(state: ViewState, index: int, kelvin: float) -> ViewState:
    """Set a light's colour temperature."""
    return replace(state, lights=light_rows.with_kelvin(state.lights, index, kelvin))


@edit
def set_lux(state: ViewState, index: int, lux: float, part: int = 0) -> ViewState:
    """Set the illuminance of one of a light's spectra."""
    return replace(state, lights=light_parts.with_lux(state.lights, index, lux, part))


@edit
def set_part_weight(state: ViewState, index: int, part: int, weight: float) -> ViewState:
    """Set the weight of one of a light's spectra."""
    rows = light_parts.with_part_weight(state.lights, index, part, weight)
    return replace(state, lights=rows)


Place = tuple[float, float]


@edit
def draw(state: ViewState, index: int, part: int, start: Place, end: Place) -> ViewState:
    """Draw on a light's spectrum: shares of the wavelengths' range, and power."""
    rows = light_parts.with_stroke(state.lights, index, part, start, end)
    return replace(state, lights=rows)


@edit
def blend(state: ViewState, x: float, y: float) -> ViewState:
    """Blend all lights by a place on the dial."""
    return replace(state, lights=light_mixes.blend_rows(state.lights, x, y))


@edit
def toggle_solo(state: ViewState, index: int) -> ViewState:
    """Solo a light, or no longer."""
    return _toggled(state, index, "solo")


@edit
def toggle_mute(state: ViewState, index: int) -> ViewState:
    """Mute a light, or no longer."""
    return _toggled(state, index, "muted")


def _toggled(state: ViewState, index: int, name: str) -> ViewState:
    if not 0 <= index < len(state.lights):
        return state
    on = not getattr(state.lights[index], name)
    return replace(state, lights=light_rows.with_changes(state.lights, index, **{name: on}))


@edit
def remove(state: ViewState, index: int) -> ViewState:
    """Remove a light, unless it is the last."""
    return _with(state, light_rows.without_row(state.lights, index))


@edit
def choose(state: ViewState, index: int) -> ViewState:
    """Choose a light."""
    if not 0 <= index < len(state.lights):
        return state
    return replace(state, interface=replace(state.interface, light=index))


@edit
def set_divide(state: ViewState, share: float) -> ViewState:
    """Move the divide between the lights that are compared, in shares of the picture's width."""
    return replace(state, divide=min(max(share, 0.02), 0.98))


def _next_light(state: ViewState) -> ViewState:
    return only(state, (light_rows.brightest_row(state.lights) + 1) % len(state.lights))


@edit
def only(state: ViewState, index: int) -> ViewState:
    """Show one light alone, and choose it."""
    if not 0 <= index < len(state.lights):
        return state
    return _chosen_of(state, light_rows.only_row(state.lights, index), index)


def with_last(state: ViewState, rows: light_rows.Rows) -> ViewState:
    """Set lights of which the last is new, and choose it."""
    return _chosen_of(state, rows, len(rows) - 1)


@edit
def rename(state: ViewState, index: int, name: str) -> ViewState:
    """Give a light another name; the palette knows it by that."""
    rows = light_rows.with_name(state.lights, index, name)
    if rows is state.lights:
        return state
    board = state.palette.with_light_renamed(state.lights[index].name, rows[index].name)
    return replace(state, lights=rows, palette=board)


def _chosen_of(state: ViewState, rows: light_rows.Rows, index: int) -> ViewState:
    return replace(state, lights=rows, interface=replace(state.interface, light=index))


def _compare(state: ViewState) -> ViewState:
    """Keep the present lights at the right of a divide, or end that."""
    return replace(state, other=None if state.other else state.lights, divide=0.5)


def _swap(state: ViewState) -> ViewState:
    """The lights of both sides of the divide change places."""
    if state.other is None:
        return state
    return replace(state, lights=state.other, other=state.lights)


@refusable
def keep_mix(state: ViewState) -> ViewState:
    """Keep the mix of all lights as one more light."""
    rows = light_mixes.with_mix(state.lights, state.document.grid, state.document.folder)
    if rows is state.lights:
        raise InputError("No light is on: there is no mix to keep")
    return with_last(state, rows)


def _remove_chosen(state: ViewState) -> Edited:
    if len(state.lights) < 2:
        return Edited(state, "The last light stays; add another one first")
    return Edited(remove(state, state.interface.light))


def _blend_all(state: ViewState) -> ViewState:
    return replace(state, lights=light_mixes.blend_rows(state.lights, 0.0, 0.0))


def _reset_spectrum(state: ViewState) -> ViewState:
    """The chosen light's spectrum as it was before it was drawn."""
    return replace(state, lights=light_parts.without_strokes(state.lights, state.interface.light))


def _alone(state: ViewState) -> ViewState:
    return only(state, state.interface.light)


def _chosen(change: Callable[[ViewState, int], ViewState]) -> Change:
    """An edit of the chosen light."""
    return lambda state: change(state, state.interface.light)


def _mark(state: ViewState) -> ViewState:
    """Hatch what the display cannot show, or no longer."""
    spec = state.relight
    display = replace(spec.viewing.display, mark=not spec.viewing.display.mark)
    return replace(state, relight=replace(spec, viewing=replace(spec.viewing, display=display)))


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
    Command(
        *("mark", "View", "Mark what the display cannot show", ("m",), _mark),
        lambda s: s.relight.viewing.display.mark,
    ),
    Command("swap", "Light", "Swap the two sides", ("x",), _swap),
    Command("alone", "Light", "The chosen light alone", (), _alone),
    Command("solo", "Light", "Solo the chosen light", (), _chosen(toggle_solo)),
    Command("mute", "Light", "Mute the chosen light", (), _chosen(toggle_mute)),
    Command("blend-all", "Light", "All lights alike", (), _blend_all),
    Command("keep-mix", "Light", "Keep this mix as a light", ("k",), keep_mix),
    Command(
        "reset-spectrum", "Light", "Undo the drawing of the chosen spectrum", (), _reset_spectrum
    ),
    Command("rename-light", "Light", "Rename the chosen light", ("f2",)),
    Command("remove-light", "Light", "Remove the chosen light", (), _remove_chosen),
    *light_states.COMMANDS,
)


def _with(state: ViewState, rows: light_rows.Rows) -> ViewState:
    return state if rows is state.lights else replace(state, lights=rows)


@refusable
def add(state: ViewState, text: str) -> ViewState:
    """Add a light in `volspec.light`'s notation, alone and chosen."""
    document = state.document
    rows = light_rows.with_new_light(state.lights, text, document.grid, document.folder)
    return with_last(state, rows)


@refusable
def respell(state: ViewState, index: int, part: int, text: str) -> ViewState:
    """Give a part of a light another spectrum, in the same notation."""
    document = state.document
    place = document.grid, document.folder
    return _with(state, light_parts.with_part_spectrum(state.lights, index, part, text, *place))


@edit
def show_alone(state: ViewState, index: int) -> ViewState:
    """Show one light alone; the chosen one stays."""
    if not 0 <= index < len(state.lights):
        return state
    return replace(state, lights=light_rows.only_row(state.lights, index))


@edit
def split_part(state: ViewState, index: int) -> ViewState:
    """Give a light a spectrum for each light group of the scene in place of one for all."""
    groups = tuple(group.name for group in state.shading.groups)
    return _with(state, light_parts.split_by_group(state.lights, index, groups))


@edit
def regroup(state: ViewState, index: int, part: int, group: str) -> ViewState:
    """Have one of a light's spectra shine on another light group."""
    return _with(state, light_parts.with_part_group(state.lights, index, part, group))


@edit
def add_part(state: ViewState, index: int, group: str) -> ViewState:
    """Add a spectrum to a light, for a light group."""
    return _with(state, light_parts.with_part(state.lights, index, group))


@edit
def remove_part(state: ViewState, index: int, part: int) -> ViewState:
    """Remove one of a light's spectra."""
    return _with(state, light_parts.without_part(state.lights, index, part))
