"""Materials of a transfer function: adding them by name, colour or file, and removing them.

    notation -> [materials] -> Transfer -> raycast

Materials become the channels of the cast, as with presets and palettes: a basis trained on other
materials may not represent a new one, whereas a channel of its own is exact.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import fields, replace
from functools import lru_cache
from typing import TypeVar

import numpy as np

from volspec.basis import MaterialBasis
from volspec.errors import SpectrumError, TransferError, quote
from volspec.scene.tables import MeshSpec
from volspec.spectra import Observer, SpectralGrid, Spectrum, reflectance, reflectance_from_colour
from volspec.transfer import (
    MAX_MATERIALS,
    Isosurfaces,
    LabelFunction,
    Transfer,
    TransferFunction,
    TransferFunction2D,
    used_materials,
)
from volspec.viewer.model.edit import edit, refusable
from volspec.viewer.model.light_rows import unused_name
from volspec.viewer.model.state import ViewState
from volspec.viewer.model.transfer_parts import list_parts, with_mix

Value = TypeVar("Value")
# Names of parts, and how many of them a message lists.
_PARTS: dict[type, str] = {
    TransferFunction: "point",
    TransferFunction2D: "region",
    Isosurfaces: "surface",
    LabelFunction: "label",
}
_MAX_NAMED = 6


@lru_cache(maxsize=1)
def colour_names() -> tuple[str, ...]:
    """Return the names of CSS Color 3, which `volspec.reflectance_from_colour` accepts.

    >>> len(colour_names()), colour_names()[:2]
    (147, ('aliceblue', 'antiquewhite'))
    """
    from PIL import ImageColor

    return tuple(name for name in ImageColor.colormap if name != "rebeccapurple")  # CSS Color 4


def is_colour(text: str) -> bool:
    """Return True if a text names a colour.

    >>> is_colour("#c08040"), is_colour("Steel Blue"), is_colour("PMC/Banana")
    (True, True, False)
    """
    word = "".join(text.split()).casefold()
    return word.startswith("#") or word in colour_names()


def reflectance_for(text: str, grid: SpectralGrid, observer_deg: Observer, folder: str) -> Spectrum:
    """Return a reflectance on a grid from a name or file that `volspec.reflectance` accepts.

    Other text is a CSS colour or ``#rrggbb`` under D65; ``gold`` is the metal, not the colour.
    Raises SpectrumError if the text is none of these.
    """
    try:
        return reflectance(text, grid, folder=folder)
    except SpectrumError:
        if not is_colour(text):
            raise
    return reflectance_from_colour(text, observer_deg=observer_deg, grid=grid)


def with_material(
    transfer: Transfer, index: int, name: str, spectrum: Spectrum, used: Iterable[str] = ()
) -> Transfer:
    """Make one part of a single material, which is added if it is new.

    Materials become channels, unless filters or their number forbid it. If there are too many,
    unused ones are removed. ``name`` is used if the spectrum has no name. Raises TransferError if
    there is no room for another one.
    """
    if not 0 <= index < len(list_parts(transfer)):
        return transfer
    materials = transfer.materials
    taken = {key for key, sample in materials.items() if not same_spectrum(sample, spectrum)}
    name = unused_name(spectrum.name or name, taken)
    if name in materials:
        return with_mix(transfer, index, name)
    if isinstance(transfer.basis, MaterialBasis) and len(materials) >= MAX_MATERIALS:
        names = {*used_materials(part.mix for part in list_parts(transfer)), *used}
        if len(names) >= MAX_MATERIALS:
            raise TransferError(
                f"{quote(name)}: {MAX_MATERIALS} materials are in use, and no more can be cast; "
                "give the parts of one of them another material first",
                code="size",
            )
        materials = {key: materials[key] for key in names}
    more = with_materials(transfer, {**materials, name: spectrum})
    return with_mix(with_material_basis(more), index, name)


def without_material(transfer: Transfer, name: str) -> Transfer:
    """Remove a material, and its channel if materials are the channels.

    Raises TransferError if a part is made of it.
    """
    if name not in transfer.materials:
        return transfer
    if why := uses_of_material(transfer, name):
        raise TransferError(f"{quote(name)}: {why}", code="conflict")
    for index, part in enumerate(list_parts(transfer)):
        if name in part.mix:  # with weight 0
            transfer = with_mix(transfer, index, _without(part.mix, name))
    if isinstance(transfer, TransferFunction) and transfer.filters:
        transfer = replace(transfer, filters=_without(transfer.filters, name) or None)
    return with_materials(transfer, _without(transfer.materials, name))


def _without(by_name: Mapping[str, Value], name: str) -> dict[str, Value]:
    return {other: value for other, value in by_name.items() if other != name}


def with_materials(transfer: Transfer, materials: Mapping[str, Spectrum]) -> Transfer:
    """Replace the materials, and the channels too if they are the materials."""
    basis = transfer.basis
    if isinstance(basis, MaterialBasis):
        basis = replace(basis, materials=materials)
    else:
        basis = basis.with_samples(materials.values())
    return replace(transfer, materials=materials, basis=basis)


def uses_of_material(
    transfer: Transfer,
    name: str,
    rows: Sequence[MeshSpec] = (),
    fields: Mapping[str, Transfer] | None = None,
) -> str:
    """Return why a material cannot be removed: what is made of it; empty if there is nothing.

    >>> from volspec.basis import SpectralBasis
    >>> metals = {name: reflectance(name) for name in ("copper", "gold")}
    >>> points = [(0.0, 0.1, "copper"), (0.5, 0.1, "copper"), (1.0, 0.2, "copper")]
    >>> curve = TransferFunction(points, metals, SpectralBasis.load("general-7"))
    >>> uses_of_material(curve, "copper"), uses_of_material(curve, "gold")
    ('points 1, 2 and 3 are made of it; give them another material first', '')
    """
    numbers = _users(transfer).get(name, ())
    if not numbers:
        users = [(f"mesh {row.name}", row.used) for row in rows]
        users += [(user, tuple(_users(function))) for user, function in (fields or {}).items()]
        user = next((user for user, used in users if name in used), None)
        return f"{user} is made of it; give it another material first" if user else ""
    part = _PARTS[type(transfer)]
    if len(numbers) == 1:
        return f"{part} {numbers[0]} is made of it; give it another material first"
    named, unnamed = numbers[:_MAX_NAMED], len(numbers) - _MAX_NAMED
    last = f"{unnamed} more" if unnamed > 0 else named.pop()
    listed = f"{', '.join(named)} and {last}"
    return f"{part}s {listed} are made of it; give them another material first"


# Read for every material in every frame while their list is open.
@lru_cache(maxsize=4)
def _users(transfer: Transfer) -> Mapping[str, list[str]]:
    """Map each material to the parts that contain it: their numbers in panels, or their labels."""
    labels = isinstance(transfer, LabelFunction)
    users: dict[str, list[str]] = {}
    for number, part in enumerate(list_parts(transfer), 1):
        for name in used_materials([part.mix]):
            users.setdefault(name, []).append(f"{part.values[0] if labels else number}")
    return users


def material_message(old: Transfer, new: Transfer) -> str:
    """Return a message on what adding a material changed; empty if it was there already."""
    added = [name for name in new.materials if name not in old.materials]
    if not added:
        return ""
    name, message = added[0], f"Added {added[0]}"
    if not isinstance(new.basis, MaterialBasis):
        why = "too many materials" if len(new.materials) > MAX_MATERIALS else "the filters"
        message += f": basis {quote(new.basis.name)} stays and approximates it, because of {why}"
    elif not isinstance(old.basis, MaterialBasis):
        message += f": materials are the channels now, instead of basis {quote(old.basis.name)}"
    if gone := [material for material in old.materials if material not in new.materials]:
        message += f". Removed as unused: {', '.join(gone)}"
    if new.materials[name].notes.get("constructed") == "nearest":
        message += ". No surface has this colour; the nearest is used"
    return message


@refusable
def add_material(state: ViewState, index: int, text: str) -> ViewState:
    """Make one part of a material, given by its name, colour or file."""
    transfer = state.transfer
    grid, observer_deg = transfer.basis.grid, transfer.basis.observer_deg
    spectrum = reflectance_for(text, grid, observer_deg, state.document.folder)
    used = [name for function in other_functions(state).values() for name in _users(function)]
    new = with_material(transfer, index, text.strip(), spectrum, used)
    return state if new is transfer else replace(state, transfer=new)


def other_functions(state: ViewState) -> dict[str, Transfer]:
    """Return the transfer functions that are not edited now, of fields and masks, by their name."""
    named: dict[str, Transfer] = {
        f"field {look.name}": look.transfer
        for number, look in enumerate(state.fields)
        if number != state.chosen_field
    }
    for look in state.fields:
        if look.mask is not None:
            of = look.mask.field
            pairs = look.mask.functions.items()
            named |= {f"label {label} of {of}": func for label, func in pairs if func is not None}
    return named


@edit
def remove_material(state: ViewState, name: str) -> ViewState:
    """Remove a material that no part and no mesh is made of."""
    if uses_of_material(state.transfer, name, state.meshes, other_functions(state)):
        return state
    new = without_material(state.transfer, name)
    return state if new is state.transfer else replace(state, transfer=new)


def differ_in_spectra(old: Transfer, new: Transfer) -> bool:
    """Return True if two transfer functions differ at most in spectra of the same channels.

    A cast of one then serves the other.
    """
    if type(old) is not type(new) or not same_channels(old.basis, new.basis):
        return False
    names = {field.name for field in fields(old)} - {"materials", "basis"}
    return all(getattr(old, name) == getattr(new, name) for name in names)


def same_channels(one: object, other: object) -> bool:
    """Return True if two bases have the same materials by name, in the same order and grid."""
    if not (isinstance(one, MaterialBasis) and isinstance(other, MaterialBasis)):
        return False
    same = one.grid == other.grid and one.observer_deg == other.observer_deg
    return same and list(one.materials) == list(other.materials)


def same_spectrum(one: Spectrum, other: Spectrum) -> bool:
    """Return True if two spectra are equal to the last bit."""
    return one is other or (
        np.array_equal(one.wavelengths_nm, other.wavelengths_nm)
        and np.array_equal(one.values, other.values)
    )


def can_be_exact(transfer: Transfer) -> bool:
    """Return True if materials can be the channels.

    They are few enough, none has a filter, and the bands are not the channels, which are as exact
    and hold what gratings diffract, too.
    """
    filtered = isinstance(transfer, TransferFunction) and bool(transfer.filters)
    few = len(transfer.materials) <= MAX_MATERIALS
    return few and not filtered and transfer.basis.method != "bands"


def with_material_basis(transfer: Transfer) -> Transfer:
    """Make the materials the channels, if they can be and are not yet."""
    basis = transfer.basis
    if isinstance(basis, MaterialBasis) or not can_be_exact(transfer):
        return transfer
    material_basis = MaterialBasis(transfer.materials, basis.name, basis.grid, basis.observer_deg)
    return replace(transfer, basis=material_basis)


def with_reflectances(transfer: Transfer, changes: Mapping[str, Spectrum]) -> Transfer:
    """Replace reflectances of materials by name; unknown names are ignored."""
    existing = {name: spectrum for name, spectrum in changes.items() if name in transfer.materials}
    if not existing:
        return transfer
    basis = transfer.basis
    if isinstance(basis, MaterialBasis):
        basis = basis.with_reflectances({k: s for k, s in existing.items() if k in basis.materials})
    else:
        basis = basis.with_samples({**transfer.materials, **existing}.values())
    return replace(transfer, materials={**transfer.materials, **existing}, basis=basis)


def clip_spectrum(spectrum: Spectrum, high: float | None = None) -> Spectrum:
    """Clip to 0 to ``high`` a spectrum that a solver's rounding left slightly outside."""
    return replace(spectrum, values=np.clip(spectrum.values, 0.0, high))
