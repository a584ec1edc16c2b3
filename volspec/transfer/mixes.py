"""What every kind of transfer function shares: materials, mixes of them, rows of channels.

materials, basis -> [mixes] -> points, regions, labels, surfaces
"""

from __future__ import annotations

import math
import warnings
from collections.abc import Iterable, Mapping, Sequence
from numbers import Real
from typing import Any

import numpy as np
from numpy.typing import NDArray

from volspec.basis import Basis, MaterialBasis, SpectralBasis
from volspec.errors import TransferError, VolspecWarning, nearest
from volspec.spectra import Spectrum
from volspec.transfer.table import MAX_CHANNELS

Mix = str | Mapping[str, float]
# (value, opacity, material or mix): of a curve's point and of a surface.
Point = tuple[float, float, Mix]


def check_materials(who: str, materials: Any, basis: Any) -> None:
    """Refuse what is no basis that can be cast and no mapping of reflectances.

    Called from ``__post_init__``, so that a warning points at the maker of the object.

    Raises
    ------
    TransferError
    """
    if not isinstance(basis, SpectralBasis | MaterialBasis):
        raise TransferError.refused(
            f"{who}: basis",
            basis,
            "expected a SpectralBasis, such as SpectralBasis.load('general-7'), or a MaterialBasis",
            "type",
        )
    if basis.size > MAX_CHANNELS:
        what = f"{basis.size} channels"
        if isinstance(basis, MaterialBasis):
            what = f"{len(basis.materials)} materials and white are {what}"
        raise TransferError(
            f"{who}: {what}, at most {MAX_CHANNELS} can be cast; "
            "take a SpectralBasis of fewer channels"
        )
    if not isinstance(materials, Mapping):
        raise TransferError(f"{who}: materials must be {{name: Spectrum}}")
    for name, spectrum in materials.items():
        label = f"{who}: material {name!r}"
        if not isinstance(spectrum, Spectrum):
            raise TransferError.refused(
                label, spectrum, "expected a Spectrum, such as reflectance('copper')", "type"
            )
        worst = spectrum.values.min()
        if worst < 0:
            raise TransferError(
                f"{label} reflects {worst:g} at "
                f"{spectrum.wavelengths_nm[spectrum.values.argmin()]:g} nm; give 0…1"
            )
        if spectrum.values.max() > 1 + 1e-6:
            warnings.warn(
                f"{label} reflects up to {spectrum.values.max():g}; more than 1 only "
                "fluorescent matter does, was a light given?",
                VolspecWarning,
                stacklevel=4,
            )


def checked_step(who: str, step_mm: Any) -> float | None:
    """A reference step: None, or millimetres above 0."""
    if step_mm is None:
        return None
    step = number(who, "reference_step_mm", step_mm)
    if not (math.isfinite(step) and step > 0):
        raise TransferError.refused(
            f"{who}: reference_step_mm", step_mm, "give mm above 0", "range"
        )
    return step


def listed(who: str, what: str, given: Any, one: str) -> tuple[Any, ...]:
    """A sequence of at least one; ``one`` says what it is of."""
    try:
        found = tuple(given)
    except TypeError:
        raise TransferError.refused(f"{who}: {what}", given, f"give a list of {one}") from None
    if not found:
        raise TransferError(f"{who}: no {what}; give at least one {one}")
    return found


def number(where: str, what: str, given: Any) -> float:
    """A number as float; text and truth values are none."""
    if isinstance(given, bool) or not isinstance(given, Real):
        raise TransferError.refused(f"{where}: {what}", given, "expected a number", "type")
    return float(given)


def fraction(where: str, what: str, given: Any) -> float:
    """An opacity or another number of 0…1."""
    found = number(where, what, given)
    if not 0 <= found <= 1:
        raise TransferError(f"{where} has {what} {found:g}; give 0…1")
    return found


def checked_mix(where: str, given: Any, materials: Mapping[str, Spectrum] | None) -> Mix:
    """A mix as {material: share}; without materials the names are left for later."""
    if not isinstance(given, str | Mapping):
        raise TransferError.refused(
            f"{where}: material", given, "expected a name or {name: share}", "type"
        )
    shares = {}
    for name, share in shares_of(given).items():
        if materials is not None and name not in materials:
            known = ", ".join(sorted(materials)) or "none"
            raise TransferError(
                f"{where}: no material {name!r}; {nearest(name, materials)}known: {known}",
                code="unknown",
            )
        shares[name] = number(where, f"share of {name!r}", share)
        if not (math.isfinite(shares[name]) and shares[name] >= 0):
            raise TransferError(f"{where}: share {share} of {name!r}; give 0…1")
    total = sum(shares.values())
    if not 0 < total <= 1 + 1e-6:
        raise TransferError(f"{where}: shares sum to {total:g}; give above 0 and at most 1")
    return shares


def checked_point(where: str, given: Any, materials: Mapping[str, Spectrum]) -> Point:
    """(value, opacity, {material: share}) of (value, opacity, material or mix)."""
    try:
        value, opacity, mix = given
    except (TypeError, ValueError):
        raise TransferError.refused(
            where, given, "expected (value, opacity, material or mix)"
        ) from None
    value = number(where, "value", value)
    if not math.isfinite(value):
        raise TransferError(f"{where} has value {value}; give a finite number")
    opacity = fraction(f"{where} (value {value:g})", "opacity", opacity)
    return value, opacity, checked_mix(where, mix, materials)


def shares_of(mix: Mix) -> Mapping[str, float]:
    """A mix as {material: share}."""
    return {mix: 1.0} if isinstance(mix, str) else mix


def used(mixes: Iterable[Mix]) -> list[str]:
    """The names of the materials that mixes hold any of, sorted."""
    return sorted({name for mix in mixes for name, share in shares_of(mix).items() if share > 0})


def share_matrix(mixes: Sequence[Mix], names: Sequence[str]) -> NDArray[np.float64]:
    """(P, K) shares of K materials in P mixes."""
    return np.array([[shares_of(mix).get(name, 0.0) for name in names] for mix in mixes])


def rows_of_channels(
    mixes: Sequence[Mix], materials: Mapping[str, Spectrum], basis: Basis
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """What a table mixes, of no more rows than needed: the cast gathers one number a row.

    Parameters
    ----------
    mixes : P mixes, at least one
    materials : {name: Spectrum}
    basis : Basis

    Returns
    -------
    shares : (P, K)
    channels : (K, M)
        Of the K materials that the mixes hold; where these are more than the M channels, the
        mixes' channels themselves are the shares, of the identity.
    """
    names = used(mixes)
    channels = basis.channels_for_materials({name: materials[name] for name in names})
    shares = share_matrix(mixes, names)
    if len(names) > basis.size:
        return shares @ channels, np.eye(basis.size)
    return shares, channels
