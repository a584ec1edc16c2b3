"""Events of a transfer function's materials: one more, by name, colour or file; one less.

panels -> [materials] -> Transfer
"""

from __future__ import annotations

from dataclasses import replace

from volspec.errors import VolspecError, one_line
from volspec.viewer.model.events.event import Event, Reducer, guarded
from volspec.viewer.model.state import ViewState
from volspec.viewer.model.transfer.materials import reflectance_for, with_material, without_material


def refusal(state: ViewState, event: Event) -> str:
    """Why ``add-material`` leaves a state as it is; empty where it does not."""
    try:
        _add(state, event)
    except (VolspecError, OSError) as error:
        return one_line(error)
    return ""


def _add(state: ViewState, event: Event) -> ViewState:
    """A material that one part is then made of, by its name, colour or file."""
    transfer = state.transfer
    grid, observer_deg = transfer.basis.grid, transfer.basis.observer_deg
    spectrum = reflectance_for(event.key, grid, observer_deg, state.document.folder)
    new = with_material(transfer, event.index, event.key.strip(), spectrum)
    return state if new is transfer else replace(state, transfer=new)


def _remove(state: ViewState, event: Event) -> ViewState:
    """Without a material that no part is made of, by its name."""
    new = without_material(state.transfer, event.key)
    return state if new is state.transfer else replace(state, transfer=new)


EVENTS: dict[str, Reducer] = {"add-material": guarded(_add), "remove-material": guarded(_remove)}
