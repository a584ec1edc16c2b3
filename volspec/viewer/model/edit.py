"""Edits of a state, and the commands by which menus, keys and the command palette ask for them.

    input, panels -> [edit] -> state

An edit is a typed function of a state, such as ``lights_edits.set_weight(state, index, weight)``;
it is total: what makes no sense leaves the state as it is.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from functools import wraps
from typing import Concatenate, NamedTuple, ParamSpec

from volspec.errors import VolspecError, one_line
from volspec.viewer.model.state import ViewState

P = ParamSpec("P")


class Edited(NamedTuple):
    """Result of an edit that has something to say.

    Parameters
    ----------
    state : ViewState
    message : str
        Why the edit is refused, or what it left out; empty if there is nothing to say.
    """

    state: ViewState
    message: str = ""


Change = Callable[[ViewState], ViewState | Edited]


def after(change: Change, state: ViewState) -> Edited:
    """Return what comes of a change, with its message if it has one."""
    found = change(state)
    return found if isinstance(found, Edited) else Edited(found)


def edit(
    function: Callable[Concatenate[ViewState, P], ViewState],
) -> Callable[Concatenate[ViewState, P], ViewState]:
    """Make an edit ignore NaN and infinities: the state stays as it is."""

    @wraps(function)
    def total(state: ViewState, /, *given: P.args, **named: P.kwargs) -> ViewState:
        return function(state, *given, **named) if _finite(given, named.values()) else state

    return total


def tolerant(
    function: Callable[Concatenate[ViewState, P], ViewState],
) -> Callable[Concatenate[ViewState, P], ViewState]:
    """Make an edit leave the state as it is if it is refused, as `refusable` without a word."""
    checked = refusable(function)

    @wraps(function)
    def total(state: ViewState, /, *given: P.args, **named: P.kwargs) -> ViewState:
        return checked(state, *given, **named).state

    return total


def refusable(
    function: Callable[Concatenate[ViewState, P], ViewState],
) -> Callable[Concatenate[ViewState, P], Edited]:
    """Make an edit return why it is refused instead of raising it."""

    @wraps(function)
    def total(state: ViewState, /, *given: P.args, **named: P.kwargs) -> Edited:
        if not _finite(given, named.values()):
            return Edited(state)
        try:
            return Edited(function(state, *given, **named))
        except (VolspecError, ValueError, OSError) as error:
            return Edited(state, one_line(error))

    return total


def _finite(*groups: Iterable[object]) -> bool:
    """Return True if no number among arguments, or in tuples of them, is NaN or infinite."""
    for group in groups:
        for value in group:
            if isinstance(value, tuple):
                if not _finite(value):
                    return False
            elif isinstance(value, float) and not math.isfinite(value):
                return False
    return True


@dataclass(frozen=True, slots=True)
class Command:
    """Something that menus, keys and the command palette offer.

    Parameters
    ----------
    name : str
    menu : str
        One of `volspec.viewer.model.commands.MENUS`; empty if it is in none.
    title : str
    keys : tuple of str
        As `volspec.viewer.ui.inputs.Input.key`; the first is shown.
    change : callable, optional
        Its edit; None if the app does it, by its name.
    on : callable, optional
        Whether a menu shows it ticked.
    """

    name: str
    menu: str
    title: str
    keys: tuple[str, ...] = ()
    change: Change | None = None
    on: Callable[[ViewState], bool] | None = None
