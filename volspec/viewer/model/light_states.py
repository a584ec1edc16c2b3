"""Light states: all lights and the viewing under a name, and the fade between two.

    rows, viewing -> [light_states] -> LightState

A fade is a pure function of a share; its clock is `volspec.viewer.work.fader`.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Any

from volspec.appearance import Viewing
from volspec.errors import VolspecError
from volspec.relight import LightRig, RelightSpec
from volspec.spectra import Spectrum
from volspec.viewer.model.lights import LightRow, Rows, heated, shining

MOST_SECONDS = 10.0
MOST_STATES = 99
# Of what an eye takes by ratios.
_BY_RATIO = ("illuminance_lux", "exposure")
_BY_STEP = ("L_A", "Y_b", "surround", "D", "fov_deg")


@dataclass(frozen=True, slots=True)
class LightState:
    """Lights as they were when they were saved.

    Parameters
    ----------
    name : str
    lights : tuple of LightRow
    seen : RelightSpec
        Viewing, mode, backdrop and level.
    """

    name: str
    lights: Rows
    seen: RelightSpec


@dataclass(frozen=True, slots=True, eq=False)
class Fade:
    """The way to the state's lights from those that were before.

    Parameters
    ----------
    lights : tuple of LightRow
    seen : RelightSpec
        Where it starts.
    seconds : float
        How long it takes.
    """

    lights: Rows
    seen: RelightSpec
    seconds: float


def named_anew(states: tuple[LightState, ...]) -> str:
    """A name that none of them has: ``State 1``, ``State 2``, …"""
    taken = {state.name for state in states}
    return next(name for i in range(1, len(states) + 2) if (name := f"State {i}") not in taken)


def recalled(now: Rows, saved: Rows) -> Rows:
    """A saved state's lights; those that it does not know stay in the list, off."""
    known = {old for old, _ in pairs(now, saved) if old is not None}
    rest = [row for i, row in enumerate(now) if i not in known]
    return (*saved, *(replace(row, weight=0.0, solo=False, muted=False) for row in rest))


def pairs(start: Rows, end: Rows) -> list[tuple[int | None, int]]:
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


def faded(
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
    from_weights, to_weights = shining(old), shining(rows)
    between: list[LightRow] = []
    matched = pairs(old, rows)
    for i, at in matched:
        weight = (1 - share) * (from_weights[i] if i is not None else 0.0) + share * to_weights[at]
        row = rows[at] if i is None else _row_between(old[i], rows[at], share)
        between.append(replace(row, weight=weight, solo=False, muted=False))
    known = {i for i, _ in matched if i is not None}
    for i, row in enumerate(old):
        if i not in known:
            weight = (1 - share) * from_weights[i]
            between.append(replace(row, weight=weight, solo=False, muted=False))
    return tuple(between), _seen_between(start[1], end[1], share)


def _root(row: LightRow) -> str:
    return row.before.name if row.before else row.name


def _row_between(old: LightRow, new: LightRow, share: float) -> LightRow:
    a, b = old.rig, new.rig
    if a is b:
        return new
    if old.kelvin and new.kelvin:
        # Equal steps of 1/T look alike.
        kelvin = 1.0 / ((1 - share) / old.kelvin + share / new.kelvin)
        new = replace(heated((new,), 0, kelvin)[0], name=new.name)
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


def _seen_between(old: RelightSpec, new: RelightSpec, share: float) -> RelightSpec:
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
