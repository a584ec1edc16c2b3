"""Materials that a transfer function is given, by name, colour or file, and that are taken out.

    notation -> [materials] -> Transfer -> raycast

Materials become the channels of the cast, as they do for presets and palettes: a basis that was
trained on others need not hold the new one, and so its colour is exact.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import fields, replace
from functools import lru_cache
from typing import Any

import numpy as np

from volspec.basis import MaterialBasis
from volspec.errors import SpectrumError, TransferError, quoted
from volspec.spectra import SpectralGrid, Spectrum, reflectance, reflectance_of
from volspec.transfer import (
    MAX_CHANNELS,
    Isosurfaces,
    LabelFunction,
    Transfer,
    TransferFunction,
    TransferFunction2D,
)
from volspec.transfer.mixes import used
from volspec.viewer.model.edit import refusable, tolerant
from volspec.viewer.model.scene_file import same_spectrum
from volspec.viewer.model.state import ViewState
from volspec.viewer.model.transfer_parts import parts_of, with_mix

# One channel is white's.
MOST_MATERIALS = MAX_CHANNELS - 1
# What parts are called, and how many of them a sentence names.
_PARTS: dict[type, str] = {
    TransferFunction: "point",
    TransferFunction2D: "region",
    Isosurfaces: "surface",
    LabelFunction: "label",
}
_MOST_NAMED = 6
# Of CSS Color 4; `volspec.reflectance_of` knows those of CSS Color 3.
_LATER = frozenset(["rebeccapurple"])


@lru_cache(maxsize=1)
def colour_names() -> tuple[str, ...]:
    """The names of CSS Color 3.

    >>> len(colour_names()), colour_names()[:2]
    (147, ('aliceblue', 'antiquewhite'))
    """
    from PIL import ImageColor

    return tuple(name for name in ImageColor.colormap if name not in _LATER)


def is_colour(text: str) -> bool:
    """Whether a text is meant as a colour.

    >>> is_colour("#c08040"), is_colour("Steel Blue"), is_colour("PMC/Banana")
    (True, True, False)
    """
    word = "".join(text.split()).casefold()
    return word.startswith("#") or word in colour_names()


def reflectance_for(text: str, grid: SpectralGrid, observer_deg: int, folder: str) -> Spectrum:
    """A reflectance by its name, of a colour, or from a file, on a grid.

    Parameters
    ----------
    text : str
        As `volspec.reflectance` takes it, else a CSS colour or ``#rrggbb`` under D65: ``gold`` is
        the metal.
    grid : SpectralGrid
    observer_deg : {2, 10}
        Whose colours.
    folder : str
        What a file's relative name starts from.

    Raises
    ------
    SpectrumError
        If it is none of these.
    """
    try:
        return reflectance(text, grid, folder=folder)
    except SpectrumError:
        if not is_colour(text):
            raise
    return reflectance_of(text, observer_deg=observer_deg, grid=grid)


def with_material(transfer: Transfer, index: int, name: str, spectrum: Spectrum) -> Transfer:
    """One part of a material alone, which is added where it is not there yet.

    Parameters
    ----------
    transfer : Transfer
    index : int
        The part's; of no such part the transfer function is as it was.
    name : str
        What the material is called; numbered where another one is called so.
    spectrum : Spectrum
        On the basis' grid.

    Returns
    -------
    Transfer
        Its materials are channels, unless filters or their number forbid it. Where they have no
        room as such, those make it that no part is made of.

    Raises
    ------
    TransferError
        If there is no room for one more.
    """
    if not 0 <= index < len(parts_of(transfer)):
        return transfer
    name = _called(transfer.materials, spectrum.name or name, spectrum)
    if name in transfer.materials:
        return with_mix(transfer, index, name)
    basis, materials = transfer.basis, transfer.materials
    if isinstance(basis, MaterialBasis):
        if len(materials) >= MOST_MATERIALS:
            materials = _in_use(transfer, name)
        materials = {**materials, name: spectrum}
        basis = MaterialBasis(materials, basis.name, basis.grid, basis.observer_deg)
    more = replace(transfer, materials={**materials, name: spectrum}, basis=basis)
    return with_mix(with_material_basis(more), index, name)


def without_material(transfer: Transfer, name: str) -> Transfer:
    """The same without a material, and without its channel where materials are the channels.

    Parameters
    ----------
    transfer : Transfer
    name : str
        Of no such material the transfer function is as it was.

    Raises
    ------
    TransferError
        If a part is made of it: then nothing else says how that looks.
    """
    if name not in transfer.materials:
        return transfer
    if why := uses_of_material(transfer, name):
        raise TransferError(f"{quoted(name)}: {why}")
    for index, part in enumerate(parts_of(transfer)):
        if name in part.mix:  # a share of 0
            rest = {other: share for other, share in part.mix.items() if other != name}
            transfer = with_mix(transfer, index, rest)
    materials = {other: own for other, own in transfer.materials.items() if other != name}
    changes: dict[str, Any] = {"materials": materials}
    basis = transfer.basis
    if isinstance(basis, MaterialBasis):
        changes["basis"] = MaterialBasis(materials, basis.name, basis.grid, basis.observer_deg)
    if isinstance(transfer, TransferFunction) and transfer.filters:
        filters = {other: own for other, own in transfer.filters.items() if other != name}
        changes["filters"] = filters or None
    return replace(transfer, **changes)


def uses_of_material(transfer: Transfer, name: str) -> str:
    """Why a material cannot be taken out, in words: which parts are made of it; empty if none is.

    >>> from volspec.basis import SpectralBasis
    >>> metals = {name: reflectance(name) for name in ("copper", "gold")}
    >>> points = [(0.0, 0.1, "copper"), (0.5, 0.1, "copper"), (1.0, 0.2, "copper")]
    >>> curve = TransferFunction(points, metals, SpectralBasis.load("general-7"))
    >>> uses_of_material(curve, "copper"), uses_of_material(curve, "gold")
    ('points 1, 2 and 3 are made of it; give them another material first', '')
    """
    numbers = _users(transfer).get(name, ())
    if not numbers:
        return ""
    what = _PARTS[type(transfer)]
    if len(numbers) == 1:
        return f"{what} {numbers[0]} is made of it; give it another material first"
    named, rest = numbers[:_MOST_NAMED], len(numbers) - _MOST_NAMED
    last = f"{rest} more" if rest > 0 else named.pop()
    listed = f"{', '.join(named)} and {last}"
    return f"{what}s {listed} are made of it; give them another material first"


# Looked up for every material in every frame in which their list is open.
@lru_cache(maxsize=4)
def _users(transfer: Transfer) -> Mapping[str, list[str]]:
    """The parts that hold some of each material, as panels number them; a label by itself."""
    labels = isinstance(transfer, LabelFunction)
    users: dict[str, list[str]] = {}
    for number, part in enumerate(parts_of(transfer), 1):
        for name in used([part.mix]):
            users.setdefault(name, []).append(f"{part.values[0]:g}" if labels else f"{number}")
    return users


def material_message(old: Transfer, new: Transfer) -> str:
    """What adding a material has done, in words; empty where it was there already."""
    added = [name for name in new.materials if name not in old.materials]
    if not added:
        return ""
    name, said = added[0], f"Added {added[0]}"
    if not isinstance(new.basis, MaterialBasis):
        why = "materials are too many" if len(new.materials) > MOST_MATERIALS else "filters need it"
        said += f": basis {quoted(new.basis.name)} shows it nearly and stays, as {why}"
    elif not isinstance(old.basis, MaterialBasis):
        said += f": materials are the channels now, in place of basis {quoted(old.basis.name)}"
    if gone := [each for each in old.materials if each not in new.materials]:
        said += f". Left out, as nothing is made of them: {', '.join(gone)}"
    if new.materials[name].notes.get("constructed") == "nearest":
        said += ". No surface has this colour; the nearest is taken"
    return said


def _called(materials: Mapping[str, Spectrum], name: str, spectrum: Spectrum) -> str:
    """The name of a reflectance among others; that which it has there already."""
    called, number = name, 2
    while called in materials and not same_spectrum(materials[called], spectrum):
        called, number = f"{name} ({number})", number + 1
    return called


def _in_use(transfer: Transfer, name: str) -> dict[str, Spectrum]:
    """The materials that parts are made of, where those leave room for one more."""
    names = used(part.mix for part in parts_of(transfer))
    if len(names) >= MOST_MATERIALS:
        raise TransferError(
            f"{quoted(name)}: {MOST_MATERIALS} materials are in use, and no more can be cast; "
            "give parts of one material another first"
        )
    return {each: transfer.materials[each] for each in names}


@refusable
def add_material(state: ViewState, index: int, text: str) -> ViewState:
    """Make one part of a material, given by its name, colour or file."""
    transfer = state.transfer
    grid, observer_deg = transfer.basis.grid, transfer.basis.observer_deg
    spectrum = reflectance_for(text, grid, observer_deg, state.document.folder)
    new = with_material(transfer, index, text.strip(), spectrum)
    return state if new is transfer else replace(state, transfer=new)


@tolerant
def remove_material(state: ViewState, name: str) -> ViewState:
    """Remove a material that no part is made of."""
    new = without_material(state.transfer, name)
    return state if new is state.transfer else replace(state, transfer=new)


_SPECTRA = ("materials", "basis")


def differ_in_spectra(old: Transfer, new: Transfer) -> bool:
    """Whether two transfer functions differ in their materials' spectra alone, as channels of a
    `MaterialBasis`: a cast of one then serves the other."""
    if type(old) is not type(new) or not same_channels(old.basis, new.basis):
        return False
    names = (each.name for each in fields(old) if each.name not in _SPECTRA)
    return all(getattr(old, name) == getattr(new, name) for name in names)


def same_channels(one: object, other: object) -> bool:
    """Whether two bases are of the same materials by name, in one order, on one grid."""
    if not (isinstance(one, MaterialBasis) and isinstance(other, MaterialBasis)):
        return False
    same = one.grid == other.grid and one.observer_deg == other.observer_deg
    return same and list(one.materials) == list(other.materials)


def can_be_exact(transfer: Transfer) -> bool:
    """Whether it can be cast by its materials: these are few, and none absorbs by wavelength."""
    filtered = isinstance(transfer, TransferFunction) and bool(transfer.filters)
    return not filtered and len(transfer.materials) < MAX_CHANNELS


def with_material_basis(transfer: Transfer) -> Transfer:
    """The same with its materials as channels; as it is where it is so already, or cannot be."""
    basis = transfer.basis
    if isinstance(basis, MaterialBasis) or not can_be_exact(transfer):
        return transfer
    own = MaterialBasis(transfer.materials, basis.name, basis.grid, basis.observer_deg)
    return replace(transfer, basis=own)


def with_reflectances(transfer: Transfer, changes: Mapping[str, Spectrum]) -> Transfer:
    """The same with other reflectances of some of its materials; other names are left out."""
    own = {name: s for name, s in changes.items() if name in transfer.materials}
    if not own:
        return transfer
    materials = {**transfer.materials, **own}
    if isinstance(transfer.basis, MaterialBasis):
        known = {name: s for name, s in own.items() if name in transfer.basis.materials}
        basis = transfer.basis.with_reflectances(known)
        return replace(transfer, materials=materials, basis=basis)
    return replace(transfer, materials=materials)


def clip_spectrum(spectrum: Spectrum, most: float | None = None) -> Spectrum:
    """Without what a solver leaves beyond its bounds by rounding."""
    return replace(spectrum, values=np.clip(spectrum.values, 0.0, most))
