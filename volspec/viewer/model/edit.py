"""Edits of a state, and the commands by which menus, keys and the command palette run them.

    input, panels -> [edit] -> state

An edit is a typed function of a state, such as ``lights.set_weight(state, index, weight)``; it is
total: arguments that make no sense leave the state as it is.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import wraps
from operator import attrgetter
from typing import Any, Concatenate, NamedTuple, ParamSpec, TypeVar

from volspec.errors import VolspecError, one_line
from volspec.settings import hints, number_limits
from volspec.viewer.model.light_rows import with_item
from volspec.viewer.model.state import ViewState
from volspec.viewer.model.view import clamp

P = ParamSpec("P")
Spec = TypeVar("Spec")


class Edited(NamedTuple):
    """Result of an edit, with a message if it was refused or left something out.

    The ``hint`` names a next step.
    """

    state: ViewState
    message: str = ""
    hint: str = ""


Change = Callable[[ViewState], ViewState | Edited]


def after(change: Change, state: ViewState) -> Edited:
    """Apply a change, and return its message if it has one."""
    result = change(state)
    return result if isinstance(result, Edited) else Edited(result)


def bind(change: Callable[..., ViewState | Edited], *args: Any, **named: Any) -> Change:
    """Bind all arguments of an edit except the state."""
    return lambda state: change(state, *args, **named)


def with_interface(state: ViewState, **changes: Any) -> ViewState:
    """Change fields of the state's `Interface`."""
    return replace(state, interface=replace(state.interface, **changes))


def edit(
    function: Callable[Concatenate[ViewState, P], ViewState],
) -> Callable[Concatenate[ViewState, P], ViewState]:
    """Make an edit total: NaN, infinities and refusals leave the state as it is."""

    @wraps(function)
    def total(state: ViewState, /, *args: P.args, **named: P.kwargs) -> ViewState:
        if not _is_finite((args, *named.values())):
            return state
        try:
            return function(state, *args, **named)
        except VolspecError:
            return state

    return total


def refusable(
    function: Callable[Concatenate[ViewState, P], ViewState],
) -> Callable[Concatenate[ViewState, P], Edited]:
    """Make a refused edit return its message instead of raising an error."""

    @wraps(function)
    def total(state: ViewState, /, *args: P.args, **named: P.kwargs) -> Edited:
        if not _is_finite((args, *named.values())):
            return Edited(state)
        try:
            return Edited(function(state, *args, **named))
        except (VolspecError, ValueError, OSError) as error:
            return Edited(state, one_line(error))

    return total


def _is_finite(value: object) -> bool:
    """Return True unless a value, or one in a tuple of them, is NaN or infinite."""
    if isinstance(value, tuple):
        return all(map(_is_finite, value))
    return not isinstance(value, float) or math.isfinite(value)


def with_values(state: ViewState, **changes: Any) -> ViewState:
    """Change fields of a state, which is the same object if they are."""
    same = all(getattr(state, name) is value for name, value in changes.items())
    return state if same else replace(state, **changes)


def with_field(
    spec: Spec, name: str, value: Any, limits: tuple[float, float] | None = None
) -> Spec:
    """Return settings with another value of a field, numbers as near as its range allows.

    The range may be given by ``limits``. They are the same object if nothing changes, or if there
    is no such field. Raises their error if the value is refused.
    """
    cls: Any = type(spec)
    hint = hints(cls).get(name)
    if hint is None:
        return spec
    value = _within(value, *(limits or number_limits(hint)))
    return spec if getattr(spec, name) == value else replace(spec, **{name: value})  # type: ignore[type-var]  # a dataclass


def _within(value: Any, low: float, high: float) -> Any:
    """Return a number, or those in a tuple, as near as a range allows."""
    if isinstance(value, tuple):
        return tuple(_within(number, low, high) for number in value)
    is_number = isinstance(value, int | float) and not isinstance(value, bool)
    return clamp(value, low, high) if is_number else value


def with_row_field(rows: tuple[Spec, ...], index: int, *field: Any) -> tuple[Spec, ...]:
    """Return rows with a field of one set, by its name, value and limits as for `with_field`."""
    if not 0 <= index < len(rows):
        return rows
    row = with_field(rows[index], *field)
    return rows if row is rows[index] else with_item(rows, index, row)


@dataclass(frozen=True, slots=True)
class Command:
    """Command of a menu, of the command palette or of a key."""

    name: str
    menu: str  # one of `volspec.viewer.model.commands.MENUS`; empty if it is in none
    title: str
    keys: tuple[str, ...] = ()  # as `volspec.viewer.ui.inputs.Input.key`; menus show the first
    change: Change | None = None  # None if the app carries it out by its name
    on: Callable[[ViewState], bool] | None = None  # True if menus tick it
    words: str = ""  # other names by which the command palette finds it


def switch(
    path: str, name: str, menu: str, title: str, keys: tuple[str, ...] = (), words: str = ""
) -> Command:
    """Return the command that turns a field on or off, such as ``interface.dark`` of the state."""

    def flipped(spec: Any, path: str) -> Any:
        first, _, others = path.partition(".")
        now = getattr(spec, first)
        return replace(spec, **{first: flipped(now, others) if others else not now})

    return Command(
        name, menu, title, keys, lambda state: flipped(state, path), attrgetter(path), words
    )
