"""Materials that a transfer function is given: from the library, of a colour, from a file.

notation -> [materials] -> Transfer -> raycast

Materials become the channels of the cast, as they do for presets and palettes: a basis that was
trained on others need not hold the new one, and so its colour is exact.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

from volspec.basis import MaterialBasis
from volspec.errors import SpectrumError, TransferError, quoted
from volspec.spectra import SpectralGrid, Spectrum, reflectance, reflectance_of
from volspec.transfer import MAX_CHANNELS, Transfer
from volspec.transfer.mixes import used
from volspec.viewer.files.as_lights import same_spectrum
from volspec.viewer.palette.spectra import exact
from volspec.viewer.transfer.css import is_colour
from volspec.viewer.transfer.parts import parts_of, with_mix

# One channel is white's.
MOST_MATERIALS = MAX_CHANNELS - 1


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
    return with_mix(exact(more), index, name)


def told(old: Transfer, new: Transfer) -> str:
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
