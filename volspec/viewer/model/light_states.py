"""Light states: all lights and the viewing under a name, and the fade between two.

    rows, viewing -> [light_states] -> LightState

A fade is a pure function of a share; its clock is `volspec.viewer.work.fader`.
"""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

from volspec.appearance import Viewing
from volspec.errors import VolspecError
from volspec.relight import LightRig, RelightSpec
from volspec.spectra import Spectrum
from volspec.viewer.model.edit import Change, Command, Edited, edit
from volspec.viewer.model.light_rows import (
    Fade,
    LightRow,
    LightState,
    Rows,
    brightest_row,
    effective_weights,
    with_kelvin,
)
from volspec.viewer.model.state import ViewState

MOST_SECONDS = 10.0
MOST_STATES = 99
# Of what an eye takes by ratios.
_BY_RATIO = ("illuminance_lux", "exposure")
_BY_STEP = ("L_A", "Y_b", "surround", "D", "fov_deg")


def new_state_name(states: tuple[LightState, ...]) -> str:
    """A name that none of them has: ``State 1``, ``State 2``, …"""
    taken = {state.name for state in states}
    return next(name for i in range(1, len(states) + 2) if (name := f"State {i}") not in taken)


def recalled_rows(now: Rows, saved: Rows) -> Rows:
    """A saved state's lights; those that it does not know stay in the list, off."""
    known = {old for old, _ in matching_rows(now, saved) if old is not None}
    rest = [row for i, row in enumerate(now) if i not in known]
    return (*saved, *(replace(row, weight=0.0, solo=False, muted=False) for row in rest))


def matching_rows(start: Rows, end: Rows) -> list[tuple[int | None, int]]:
    """For each light of the end the one of the start that it was.

    By what it shines with and its name, by its name, by what it shines with, by being Planck's.

    Names are those before a spectrum was drawn. None where it is new.
    """
    left = dict(enumerate(start))
    found: dict[int, int] = {}

    def take(at: int, like: Any) -> None:
        match = next((i for i, row in left.items() if like(row)), None)
        if match is not None:
            found[at] = match
            del left[match]

    for at, row in enumerate(end):
        take(at, lambda old, row=row: old.rig is row.rig and old.name == row.name)
    for at, row in enumerate(end):
        if at not in found:
            take(at, lambda old, row=row: _root(old) == _root(row))
    for at, row in enumerate(end):
        if at not in found:  # it was renamed
            take(at, lambda old, row=row: old.rig is row.rig)
    for at, row in enumerate(end):
        if at not in found and row.kelvin is not None:
            take(at, lambda old: old.kelvin is not None)
    return [(found.get(at), at) for at in range(len(end))]


def interpolate_lights(
    start: tuple[Rows, RelightSpec], end: tuple[Rows, RelightSpec], share: float
) -> tuple[Rows, RelightSpec]:
    """What lies between two settings of lights and viewing.

    Weights, lux, spectra and the viewing's numbers go evenly; temperatures and what the eye takes
    by ratios (lux of the viewing, exposure) by equal ratios or mireds; words change at the start.

    Parameters
    ----------
    start, end : (rows, RelightSpec)
    share : float
        0 gives the start itself and 1 the end.
    """
    if not share > 0.0:
        return start
    if share >= 1.0:
        return end
    rows, old = end[0], start[0]
    from_weights, to_weights = effective_weights(old), effective_weights(rows)
    between: list[LightRow] = []
    matched = matching_rows(old, rows)
    for i, at in matched:
        weight = (1 - share) * (from_weights[i] if i is not None else 0.0) + share * to_weights[at]
        row = rows[at] if i is None else _row_between(old[i], rows[at], share)
        between.append(replace(row, weight=weight, solo=False, muted=False))
    known = {i for i, _ in matched if i is not None}
    for i, row in enumerate(old):
        if i not in known:
            weight = (1 - share) * from_weights[i]
            between.append(replace(row, weight=weight, solo=False, muted=False))
    return tuple(between), _relight_between(start[1], end[1], share)


def _root(row: LightRow) -> str:
    return row.before.name if row.before else row.name


def _row_between(old: LightRow, new: LightRow, share: float) -> LightRow:
    a, b = old.rig, new.rig
    if a is b:
        return new
    if old.kelvin and new.kelvin:
        # Equal steps of 1/T look alike.
        kelvin = 1.0 / ((1 - share) / old.kelvin + share / new.kelvin)
        new = replace(with_kelvin((new,), 0, kelvin)[0], name=new.name)
        b = new.rig
    alike = len(a.lights) == len(b.lights) and a.groups == b.groups
    if not alike or any(
        p.values.shape != q.values.shape for p, q in zip(a.lights, b.lights, strict=True)
    ):
        return new
    lights = b.lights
    if not (old.kelvin and new.kelvin):
        lights = tuple(
            Spectrum(q.wavelengths_nm, _mean(p.values, q.values, share), q.name)
            for p, q in zip(a.lights, b.lights, strict=True)
        )
    weights = tuple(_mean(v, w, share) for v, w in zip(a.weights, b.weights, strict=True))
    lux = b.illuminance_lux
    if a.illuminance_lux and b.illuminance_lux:
        both = zip(a.illuminance_lux, b.illuminance_lux, strict=True)
        lux = tuple(_mean(v, w, share) for v, w in both)
    return replace(new, rig=LightRig(lights, weights, lux, b.groups))


def _relight_between(old: RelightSpec, new: RelightSpec, share: float) -> RelightSpec:
    if old is new:
        return new
    a, b = old.viewing, new.viewing
    changes: dict[str, Any] = {
        name: math.exp(_mean(math.log(getattr(a, name)), math.log(getattr(b, name)), share))
        for name in _BY_RATIO
        if min(getattr(a, name), getattr(b, name)) > 0
    }
    for name in _BY_STEP:
        ends = getattr(a, name), getattr(b, name)
        if _are_numbers(*ends):
            changes[name] = _mean(*ends, share)
    backdrop = new.backdrop
    if _are_numbers(old.backdrop, new.backdrop):
        backdrop = _mean(old.backdrop, new.backdrop, share)
    try:
        return replace(new, viewing=_changed(b, changes), backdrop=backdrop)
    except VolspecError:  # the words of one do not go with numbers of the other
        return new


def _changed(viewing: Viewing, changes: dict[str, Any]) -> Viewing:
    different = {name: v for name, v in changes.items() if v != getattr(viewing, name)}
    return replace(viewing, **different) if different else viewing


def _mean(a: Any, b: Any, share: float) -> Any:
    return a if a is b else (1 - share) * a + share * b


def _are_numbers(*values: object) -> bool:
    return all(isinstance(v, int | float) and not isinstance(v, bool) for v in values)


@edit
def save(state: ViewState) -> ViewState:
    """Save the present lights and viewing as a state."""
    if len(state.saved_lights) >= MOST_STATES:
        return state
    new = LightState(new_state_name(state.saved_lights), state.lights, state.relight)
    return replace(state, saved_lights=(*state.saved_lights, new))


def _saved(state: ViewState) -> Edited:
    new = save(state)
    full = f"{MOST_STATES} saved states are the most; delete one first"
    return Edited(new, full if new is state else "")


@edit
def save_over(state: ViewState, index: int) -> ViewState:
    """Replace a saved state by the present lights and viewing."""
    return _with(state, index, lights=state.lights, relight=state.relight)


@edit
def rename(state: ViewState, index: int, name: str) -> ViewState:
    """Rename a saved state, if the name is one and free."""
    name = " ".join(name.split())
    if not name or any(kept.name == name for kept in state.saved_lights):
        return state
    return _with(state, index, name=name)


@edit
def delete(state: ViewState, index: int) -> ViewState:
    """Delete a saved state."""
    if not 0 <= index < len(state.saved_lights):
        return state
    return replace(
        state, saved_lights=(*state.saved_lights[:index], *state.saved_lights[index + 1 :])
    )


@edit
def recall(state: ViewState, index: int) -> ViewState:
    """Take the lights and the viewing of a saved state; the way there is a fade."""
    if not 0 <= index < len(state.saved_lights):
        return state
    saved = state.saved_lights[index]
    fade = Fade(state.lights, state.relight, state.interface.fade_s)
    rows = recalled_rows(state.lights, saved.lights)
    interface = replace(state.interface, light=brightest_row(rows))
    return replace(state, lights=rows, relight=saved.relight, fade=fade, interface=interface)


@edit
def set_fade(state: ViewState, seconds: float) -> ViewState:
    """Set how long fades take, in seconds."""
    seconds = min(max(seconds, 0.0), MOST_SECONDS)
    return replace(state, interface=replace(state.interface, fade_s=seconds))


def _with(state: ViewState, index: int, **changes: Any) -> ViewState:
    if not 0 <= index < len(state.saved_lights):
        return state
    new = replace(state.saved_lights[index], **changes)
    return replace(
        state, saved_lights=(*state.saved_lights[:index], new, *state.saved_lights[index + 1 :])
    )


def _recall(index: int) -> Change:
    return lambda state: recall(state, index)


COMMANDS = (
    Command("save-state", "Light", "Save these lights as a state", ("alt+s",), _saved),
    *(
        Command(f"recall-{i}", "Light", f"Fade to state {i}", (f"alt+{i}",), _recall(i - 1))
        for i in range(1, 10)
    ),
)
