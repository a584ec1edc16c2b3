"""Light states: all lights and the viewing under a name, and the fade between two.

rows, viewing -> [light_states] -> LightState
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any

from volspec.errors import InputError, VolspecError
from volspec.relight import LightRig, RelightSpec
from volspec.spectra import Spectrum
from volspec.viewer.model import light_rows
from volspec.viewer.model.edit import Command, bind, edit, refusable, with_interface, with_values
from volspec.viewer.model.state import ViewState
from volspec.viewer.model.view import clamp

MAX_SECONDS = 10.0
MAX_STATES = 99
# Settings of the viewing that are interpolated by ratio and linearly, respectively.
_BY_RATIO = ("illuminance_lux", "exposure")
_BY_STEP = ("L_A", "Y_b", "surround", "D", "fov_deg")


def recalled_rows(now: light_rows.Rows, saved: light_rows.Rows) -> light_rows.Rows:
    """Return a saved state's lights; current lights that it lacks stay in the list, off."""
    matches = _matching_rows(now, saved)
    unmatched = [row for i, row in enumerate(now) if i not in matches]
    return (*saved, *(replace(row, weight=0.0, solo=False, muted=False) for row in unmatched))


def _matching_rows(start: light_rows.Rows, end: light_rows.Rows) -> list[int | None]:
    """Return, for each light of ``end``, the index of its match in ``start``; None if it is new.

    Lights match by rig and name, else by the name before their spectrum was drawn, else by rig (a
    light that was renamed), else as Planck radiators.
    """
    left = dict(enumerate(start))
    matches: dict[int, int] = {}
    tests: tuple[Callable[[light_rows.LightRow, light_rows.LightRow], bool], ...] = (
        lambda old, new: old.rig is new.rig and old.name == new.name,
        lambda old, new: _root(old) == _root(new),
        lambda old, new: old.rig is new.rig,
        lambda old, new: old.kelvin is not None and new.kelvin is not None,
    )
    for is_match in tests:
        for index, new in enumerate(end):
            if index in matches:
                continue
            match = next((i for i, old in left.items() if is_match(old, new)), None)
            if match is not None:
                matches[index] = match
                del left[match]
    return [matches.get(index) for index in range(len(end))]


def interpolate_lights(
    start: tuple[light_rows.Rows, RelightSpec],
    end: tuple[light_rows.Rows, RelightSpec],
    fraction: float,
) -> tuple[light_rows.Rows, RelightSpec]:
    """Interpolate between two settings of lights and viewing.

    Weights, lux, spectra and the viewing's numbers change linearly, temperatures in mireds, the
    viewing's lux and exposure by ratio; named options switch at the start. A ``fraction`` of 0
    returns the start itself, 1 the end.
    """
    if not fraction > 0.0:
        return start
    if fraction >= 1.0:
        return end
    rows, old = end[0], start[0]
    weights = [(1 - fraction) * weight for weight in light_rows.effective_weights(old)]
    left = dict(enumerate(old))
    between: list[tuple[light_rows.LightRow, float]] = []
    matches = _matching_rows(old, rows)
    for i, row, weight in zip(matches, rows, light_rows.effective_weights(rows), strict=True):
        if i is None:
            between.append((row, fraction * weight))
        else:
            middle = _row_between(left.pop(i), row, fraction)
            between.append((middle, weights[i] + fraction * weight))
    between += [(row, weights[i]) for i, row in left.items()]
    mixed = tuple(replace(row, weight=w, solo=False, muted=False) for row, w in between)
    return mixed, _relight_between(start[1], end[1], fraction)


def _root(row: light_rows.LightRow) -> str:
    return row.before.name if row.before else row.name


def _row_between(
    old: light_rows.LightRow, new: light_rows.LightRow, fraction: float
) -> light_rows.LightRow:
    a, b = old.rig, new.rig
    if a is b:
        return new
    if old.kelvin and new.kelvin:
        # Equal steps of 1/T look alike.
        kelvin = 1.0 / ((1 - fraction) / old.kelvin + fraction / new.kelvin)
        new = light_rows.at_kelvin(new, kelvin)
        b = new.rig
    shapes = [[spectrum.values.shape for spectrum in rig.lights] for rig in (a, b)]
    if shapes[0] != shapes[1] or a.groups != b.groups:
        return new
    lights = b.lights
    if not (old.kelvin and new.kelvin):
        lights = tuple(
            Spectrum(q.wavelengths_nm, _mean(p.values, q.values, fraction), q.name)
            for p, q in zip(a.lights, b.lights, strict=True)
        )
    lux = b.illuminance_lux
    if a.illuminance_lux and lux:
        lux = _means(a.illuminance_lux, lux, fraction)
    return replace(new, rig=LightRig(lights, _means(a.weights, b.weights, fraction), lux, b.groups))


def _relight_between(old: RelightSpec, new: RelightSpec, fraction: float) -> RelightSpec:
    if old is new:
        return new
    a, b = old.viewing, new.viewing
    changes: dict[str, Any] = {
        name: math.exp(_mean(math.log(getattr(a, name)), math.log(getattr(b, name)), fraction))
        for name in _BY_RATIO
        if min(getattr(a, name), getattr(b, name)) > 0
    }
    for name in _BY_STEP:
        ends = getattr(a, name), getattr(b, name)
        if _are_numbers(*ends):
            changes[name] = _mean(*ends, fraction)
    backdrop = new.backdrop
    if _are_numbers(old.backdrop, new.backdrop):
        backdrop = _mean(old.backdrop, new.backdrop, fraction)
    changes = {name: value for name, value in changes.items() if value != getattr(b, name)}
    try:
        viewing = replace(b, **changes) if changes else b
        return replace(new, viewing=viewing, backdrop=backdrop)
    except VolspecError:  # the end's named options contradict interpolated numbers
        return new


def _mean(a: Any, b: Any, fraction: float) -> Any:
    return a if a is b else (1 - fraction) * a + fraction * b


def _means(a: Sequence[float], b: Sequence[float], fraction: float) -> tuple[float, ...]:
    return tuple(_mean(v, w, fraction) for v, w in zip(a, b, strict=True))


def _are_numbers(*values: object) -> bool:
    return all(isinstance(v, int | float) and not isinstance(v, bool) for v in values)


@refusable
def save(state: ViewState) -> ViewState:
    """Save the current lights and viewing as a state."""
    saved = state.saved_lights
    if len(saved) >= MAX_STATES:
        raise InputError(f"The limit is {MAX_STATES} saved states; delete one first", code="size")
    taken = {entry.name for entry in saved}
    name = next(name for i in itertools.count(1) if (name := f"State {i}") not in taken)
    return replace(
        state, saved_lights=(*saved, light_rows.LightState(name, state.lights, state.relight))
    )


@edit
def save_over(state: ViewState, index: int) -> ViewState:
    """Overwrite a saved state with the current lights and viewing."""
    now = {"lights": state.lights, "relight": state.relight}
    saved = light_rows.with_changes(state.saved_lights, index, **now)
    return with_values(state, saved_lights=saved)


@edit
def rename(state: ViewState, index: int, name: str) -> ViewState:
    """Rename a saved state, unless the name is empty or taken."""
    name = " ".join(name.split())
    if not name or any(saved.name == name for saved in state.saved_lights):
        return state
    saved = light_rows.with_changes(state.saved_lights, index, name=name)
    return with_values(state, saved_lights=saved)


@edit
def delete(state: ViewState, index: int) -> ViewState:
    """Delete a saved state."""
    return with_values(state, saved_lights=light_rows.without_item(state.saved_lights, index))


@edit
def recall(state: ViewState, index: int) -> ViewState:
    """Fade to the lights and the viewing of a saved state."""
    if not 0 <= index < len(state.saved_lights):
        return state
    saved = state.saved_lights[index]
    fade = light_rows.Fade(state.lights, state.relight, state.interface.fade_s)
    rows = recalled_rows(state.lights, saved.lights)
    recalled = replace(state, lights=rows, relight=saved.relight, fade=fade)
    return with_interface(recalled, light=light_rows.brightest_row(rows))


@edit
def set_fade(state: ViewState, seconds: float) -> ViewState:
    """Set how long fades take, in seconds."""
    return with_interface(state, fade_s=clamp(seconds, 0.0, MAX_SECONDS))


COMMANDS = (
    Command("save-state", "Light", "Save these lights as a state", ("alt+s",), save),
    *(
        Command(f"recall-{i}", "Light", f"Fade to state {i}", (f"alt+{i}",), bind(recall, i - 1))
        for i in range(1, 10)
    ),
)


def during_fade(state: ViewState, elapsed_s: float) -> ViewState:
    """Return the state interpolated to a time since its fade began; unchanged after the fade.

    The state holds the fade's end from the beginning, so that a fade is one undo step.
    """
    fade = state.fade
    if fade is None or elapsed_s >= fade.seconds:
        return state
    start, end = (fade.lights, fade.relight), (state.lights, state.relight)
    lights, spec = interpolate_lights(start, end, elapsed_s / fade.seconds)
    return replace(state, lights=lights, relight=spec)


def after_fade(state: ViewState, faded: ViewState, new: ViewState) -> ViewState:
    """Return the state for the history after an edit turned ``faded`` into ``new`` during a fade.

    An edit of the lights or of the viewing stops the fade there.
    """
    if new.fade is not faded.fade:
        return new
    if new.lights is faded.lights and new.relight is faded.relight:
        return replace(new, lights=state.lights, relight=state.relight)
    return replace(new, fade=None)
