"""Edits of the list of fields: show, weight, and the one whose transfer function is edited.

panel -> [fields] -> state -> cast, SCENE.toml
"""

from __future__ import annotations

from dataclasses import replace
from functools import lru_cache, partial
from typing import Any

from volspec.errors import TransferError, VolspecError, one_line
from volspec.transfer import FieldFunctions, Transfer, TransferFunction, Transfers
from volspec.viewer.model.document import FieldData, FieldLook
from volspec.viewer.model.edit import (
    Edited,
    edit,
    with_interface,
    with_row_field,
    with_values,
)
from volspec.viewer.model.materials import other_functions, with_materials
from volspec.viewer.model.state import ViewState

WEIGHTS = 0.0, 10.0


def all_fields(state: ViewState) -> list[FieldLook]:
    """Return all fields with their present transfer functions."""
    return _present(state.transfer, state.fields, state.chosen_field)


def _present(transfer: Transfer, looks: tuple[FieldLook, ...], index: int) -> list[FieldLook]:
    materials, basis = transfer.materials, transfer.basis
    return [
        replace(look, transfer=transfer)
        if number == index
        else replace(look, transfer=replace(look.transfer, materials=materials, basis=basis))
        for number, look in enumerate(looks)
    ]


def shown_transfer(state: ViewState) -> Transfers:
    """Return what is cast: the transfer function, or those of all fields.

    Equal fields have the same object, so that tables and light volumes are made once.

    Raises TransferError if one is of a kind that cannot be cast with others.
    """
    if not state.fields:
        return state.transfer
    return _join_fields(state.transfer, state.fields, state.chosen_field)


@lru_cache(maxsize=4)
def _join_fields(transfer: Transfer, fields: tuple[FieldLook, ...], index: int) -> FieldFunctions:
    looks = _present(transfer, fields, index)
    functions: dict[str, TransferFunction] = {}
    for look in looks:
        if not isinstance(look.transfer, TransferFunction):
            problem, remedy = "this kind is cast alone", "remove the other fields first"
            raise TransferError(problem, remedy, code="conflict", field="transfer function")
        functions[look.name] = look.transfer
    weights = {look.name: look.weight if look.shown else 0.0 for look in looks}
    changed = partial(replace, materials=transfer.materials, basis=transfer.basis)
    masks = {look.name: look.mask.changed(changed) for look in looks if look.mask is not None}
    return FieldFunctions(functions, weights, masks)


def with_all_fields(old: ViewState, new: ViewState) -> Edited:
    """Return a state whose fields can be cast together.

    Materials that the other fields and the masks use stay.
    """
    if new.transfer is old.transfer:
        return Edited(new)
    materials, functions = new.transfer.materials, other_functions(new).values()
    used = {
        name for function in functions for name in _materials_in(function) if name not in materials
    }
    try:
        if used:
            added = {name: s for name, s in old.transfer.materials.items() if name in used}
            new = replace(new, transfer=with_materials(new.transfer, {**materials, **added}))
        shown_transfer(new)
    except VolspecError as error:
        new = replace(new, transfer=old.transfer, shift=old.shift, thickness=old.thickness)
        return Edited(replace(new, unthickened=old.unthickened), one_line(error))
    return Edited(new)


def _materials_in(transfer: Transfer) -> set[str]:
    assert isinstance(transfer, TransferFunction)
    return {name for _, _, mix in transfer.points for name in mix}


def data(state: ViewState) -> FieldData:
    """Return the values and histograms of the field whose transfer function is edited."""
    if not state.fields:
        return state.document.data[""]
    return state.document.data[state.fields[state.chosen_field].name]


def title(state: ViewState, look: FieldLook) -> str:
    """Return a field's name as it is listed."""
    return state.document.data[look.name].volume.title


@edit
def choose(state: ViewState, number: int) -> ViewState:
    """Choose the field whose transfer function is edited."""
    if number == state.chosen_field or not 0 <= number < len(state.fields):
        return state
    looks = tuple(all_fields(state))
    unscaled = replace(state, shift=0.0, thickness=1.0, unthickened=None)
    switched = replace(unscaled, transfer=looks[number].transfer, fields=looks, chosen_field=number)
    return with_interface(switched, part=0)


@edit
def set_look(state: ViewState, name: str, value: Any, number: int) -> ViewState:
    """Show or hide a field, or set the factor of its extinction."""
    return with_values(state, fields=with_row_field(state.fields, number, name, value, WEIGHTS))


@edit
def solo(state: ViewState, number: int) -> ViewState:
    """Show one field alone, or all if it is."""
    show_all = is_alone(state, number)
    looks = [replace(look, shown=show_all or i == number) for i, look in enumerate(state.fields)]
    return replace(state, fields=tuple(looks))


def is_alone(state: ViewState, number: int) -> bool:
    """Return True if one field is shown alone."""
    return [i for i, look in enumerate(state.fields) if look.shown] == [number]
