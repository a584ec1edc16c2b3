"""What happened, and what can be asked for by name.

window -> [Event], menus, keys -> [Action] -> state
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from volspec.errors import VolspecError
from volspec.viewer.model.state import ViewState


@dataclass(frozen=True, slots=True)
class Event:
    """Something that happened.

    Parameters
    ----------
    name : str
        One of `volspec.viewer.model.events.EVENTS`.
    x, y : float
        Of a drag: shares of the picture's height to the right and down. Of the dial: the place.
        Of a slider: ``x`` its value. Of the divide: ``x`` its share of the picture's width.
    index : int
        Of the light or the point that is meant.
    key : str
        What else names it.
    part : int
        Of the light's spectra, where it has several.
    start : (x, y), optional
        Of a stroke of the pen: where that was before.
    """

    name: str
    x: float = 0.0
    y: float = 0.0
    index: int = 0
    key: str = ""
    part: int = 0
    start: tuple[float, float] | None = None


Reducer = Callable[[ViewState, Event], ViewState]
Change = Callable[[ViewState], ViewState]


def guarded(reducer: Reducer) -> Reducer:
    """A reducer that leaves a state as it is where something is refused or cannot be read."""

    def total(state: ViewState, event: Event) -> ViewState:
        try:
            return reducer(state, event)
        except (VolspecError, ValueError, OSError):
            return state

    return total


@dataclass(frozen=True, slots=True)
class Action:
    """Something that menus, keys and the command palette offer.

    Parameters
    ----------
    name : str
    menu : str
        Where it stands: one of `volspec.viewer.model.commands.MENUS`; empty where none has it.
    title : str
    keys : tuple of str
        As `volspec.viewer.ui.inputs.Input.key`; the first is shown.
    change : callable, optional
        What it makes of a state; None where the app does it, by its name.
    on : callable, optional
        Whether a menu shows it ticked.
    refusal : callable, optional
        Why it leaves a state as it is; empty where it does not.
    told : callable, optional
        What is to be said of what it does to a state; empty where nothing is.
    """

    name: str
    menu: str
    title: str
    keys: tuple[str, ...] = ()
    change: Change | None = None
    on: Callable[[ViewState], bool] | None = None
    refusal: Callable[[ViewState], str] | None = None
    told: Callable[[ViewState], str] | None = None
