"""Spectra of a state changed in place: reflectances without a new cast, lights in their rows.

    Design -> [palette_spectra] -> Transfer, rows -> relight

If a transfer function's basis is one of its materials, the cast holds how much of each material a
ray met, and a reflectance is only read when the picture is lit.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import fields, replace

import numpy as np

from volspec.basis import MaterialBasis
from volspec.relight import LightRig
from volspec.spectra import Spectrum
from volspec.transfer import MAX_CHANNELS, Transfer, TransferFunction
from volspec.viewer.model import lights
from volspec.viewer.model.lights import LightRow, Rows

_SPECTRA = ("materials", "basis")


def repainted(old: Transfer, new: Transfer) -> bool:
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


def exact(transfer: Transfer) -> Transfer:
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


def physical(spectrum: Spectrum, most: float | None = None) -> Spectrum:
    """Without what a solver leaves beyond its bounds by rounding."""
    return replace(spectrum, values=np.clip(spectrum.values, 0.0, most))


def columns(rows: Rows) -> tuple[str, ...]:
    """What a palette calls the lights: their names, numbered where two have one."""
    names: list[str] = []
    for row in rows:
        name, number = row.name, 2
        while name in names:
            name, number = f"{row.name} ({number})", number + 1
        names.append(name)
    return tuple(names)


def with_lights(rows: Rows, changes: Mapping[str, Spectrum]) -> Rows:
    """Lights with other spectra, by their `columns`; their lux and weights stay."""
    for index, name in enumerate(columns(rows)):
        if name in changes and len(rows[index].rig.lights) == 1:
            rig = replace(rows[index].rig, lights=(changes[name],))
            rows = lights.changed(rows, index, rig=rig, kelvin=None)
    return rows


def with_new_light(rows: Rows, name: str, label: str, spectrum: Spectrum) -> Rows:
    """One more light, which then shines alone; as they are where there is no room."""
    if len(rows) >= lights.MOST_ROWS:
        return rows
    row = LightRow(name, label, LightRig((spectrum,)))
    return lights.alone((*rows, row), len(rows))
