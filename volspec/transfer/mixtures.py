"""Materials of transfer functions: mixes, filters, and their channels in the basis.

    materials, basis -> [mixes] -> points, regions, labels, surfaces

A filter is the transmission spectrum of a material at opacity 1: a reference step of opacity α
transmits 1 − α (1 − filter), channel by channel. A material without a filter transmits 1 − α at
every wavelength, as if the filter were 0.
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
from volspec.transfer.table import MAX_CHANNELS, MAX_MATERIALS

Mix = str | Mapping[str, float]
# (value, opacity, material or mix): a point of a curve, or a surface.
Point = tuple[float, float, Mix]
# Filters in a signed basis may leave 0…1 by this much without a warning.
_UNSEEN = 0.02


def check_materials(who: str, materials: Mapping[str, Spectrum], basis: Basis) -> None:
    """Refuse a basis that cannot be cast, and materials that are not reflectances.

    Call it from ``__post_init__``, so that a warning points at the constructor's caller.
    """
    if not isinstance(basis, SpectralBasis | MaterialBasis):
        raise TransferError.refused(
            f"{who}.basis",
            basis,
            "expected a SpectralBasis, such as SpectralBasis.load('general-7'), or a MaterialBasis",
            "type",
        )
    of_materials = isinstance(basis, MaterialBasis)
    most = MAX_MATERIALS if of_materials else MAX_CHANNELS
    if basis.size - of_materials > most:
        problem = f"{basis.size - of_materials} {'materials' if of_materials else 'channels'}"
        raise TransferError(
            f"{problem}, at most {most} can be cast",
            "use a SpectralBasis with fewer channels",
            code="size",
            field=f"{who}.basis",
            given=basis,
        )
    for name, spectrum in materials.items():
        field = f"{who}.materials[{name!r}]"
        if not isinstance(spectrum, Spectrum):
            raise TransferError.refused(
                field, spectrum, "expected a Spectrum, such as reflectance('copper')", "type"
            )
        worst = spectrum.values.min()
        if worst < 0:
            raise TransferError(
                f"reflects {worst:g} at {spectrum.wavelengths_nm[spectrum.values.argmin()]:g} nm",
                "give 0…1",
                code="range",
                field=field,
                given=spectrum,
            )
        if spectrum.values.max() > 1 + 1e-6:
            warnings.warn(
                f"{field} reflects up to {spectrum.values.max():g}; only fluorescent "
                "materials exceed 1, check that it is not a light",
                VolspecWarning,
                stacklevel=4,
            )


def checked_step(who: str, step_mm: float | None) -> float | None:
    """Return a reference step in millimetres, above 0, or None."""
    if step_mm is None:
        return None
    step = checked_number(f"{who}.reference_step_mm", step_mm)
    if not (math.isfinite(step) and step > 0):
        raise TransferError.refused(f"{who}.reference_step_mm", step_mm, "give mm above 0", "range")
    return step


def checked_list(field: str, values: Iterable[Any], item: str) -> tuple[Any, ...]:
    """Return a sequence as a tuple; refuse an empty one; ``item`` describes an element."""
    items = tuple(values)
    if not items:
        raise TransferError.refused(field, values, f"give at least one {item}", "missing")
    return items


def checked_parts(field: str, values: Iterable[Any], expected: str) -> tuple[Any, ...]:
    """Return a sequence with as many parts as ``expected``, such as ``"(low, high)"``."""
    parts = tuple(values)
    if len(parts) != expected.count(",") + 1:
        raise TransferError.refused(field, values, f"expected {expected}", "type")
    return parts


def checked_number(field: str, value: Any) -> float:
    """Return a number as float; refuse text and booleans."""
    if isinstance(value, bool) or not isinstance(value, Real):
        raise TransferError.refused(field, value, "expected a number", "type")
    return float(value)


def checked_fraction(field: str, value: Any) -> float:
    """Return an opacity or another number within 0…1."""
    fraction = checked_number(field, value)
    if not 0 <= fraction <= 1:
        raise TransferError.refused(field, value, "give 0…1", "range")
    return fraction


def checked_mix(field: str, mix: Any, materials: Mapping[str, Spectrum] | None) -> Mix:
    """Return a mix as {material: weight}; check names only if ``materials`` are given."""
    if not isinstance(mix, str | Mapping):
        raise TransferError.refused(field, mix, "expected a name or {name: weight}", "type")
    weights = {}
    for name, weight in mix_weights(mix).items():
        if materials is not None:
            _require_known(field, name, materials)
        weights[name] = checked_number(f"{field}[{name!r}]", weight)
        if not (math.isfinite(weights[name]) and weights[name] >= 0):
            raise TransferError.refused(f"{field}[{name!r}]", weight, "give 0…1", "range")
    total = sum(weights.values())
    if not 0 < total <= 1 + 1e-6:
        raise TransferError(
            f"weights sum to {total:g}",
            "give above 0 and at most 1",
            code="range",
            field=field,
            given=mix,
        )
    return weights


def _require_known(field: str, name: str, materials: Mapping[str, Spectrum]) -> None:
    if name not in materials:
        names = ", ".join(sorted(materials)) or "none"
        raise TransferError(
            f"no material {name!r}",
            f"{nearest(name, materials)}known: {names}",
            code="unknown",
            field=field,
            given=name,
        )


MAX_VALUE = float(np.finfo(np.float32).max)
"""Greatest value, as of voxels."""


def checked_point(field: str, point: Any, materials: Mapping[str, Spectrum]) -> Point:
    """Return (value, opacity, {material: weight}) for (value, opacity, material or mix)."""
    value, opacity, mix = checked_parts(field, point, "(value, opacity, material or mix)")
    value = checked_number(f"{field}.value", value)
    if not abs(value) <= MAX_VALUE:
        raise TransferError.refused(f"{field}.value", value, "give a number of float32", "range")
    opacity = checked_fraction(f"{field}.opacity", opacity)
    return value, opacity, checked_mix(f"{field}.material", mix, materials)


def mix_weights(mix: Mix) -> Mapping[str, float]:
    """Return a mix as {material: weight}."""
    return {mix: 1.0} if isinstance(mix, str) else mix


def used_materials(mixes: Iterable[Mix]) -> list[str]:
    """Return the sorted names of the materials with a weight above 0."""
    return sorted({name for mix in mixes for name, w in mix_weights(mix).items() if w > 0})


def weight_matrix(mixes: Sequence[Mix], names: Sequence[str]) -> NDArray[np.float64]:
    """Return the (P, K) weights of K materials in P mixes."""
    return np.array([[mix_weights(mix).get(name, 0.0) for name in names] for mix in mixes])


def weights_and_channels(
    mixes: Sequence[Mix], materials: Mapping[str, Spectrum], basis: Basis
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return a table's (P, K) weights and (K, M) channels with as few rows as possible.

    The raycaster gathers one number per row at each sample. There is one row for each of the K
    materials in the mixes. If K exceeds the number of channels, M, the weights are the mixes'
    channels instead, and the channels are the identity.
    """
    names = used_materials(mixes)
    channels = basis.channels_for_materials({name: materials[name] for name in names})
    weights = weight_matrix(mixes, names)
    if len(names) > basis.size:
        return weights @ channels, np.eye(basis.size)
    return weights, channels


def checked_filters(
    who: str, filters: Mapping[str, Spectrum], materials: Mapping[str, Spectrum], basis: Basis
) -> dict[str, Spectrum]:
    """Return filters within 0…1; refuse unknown materials and a basis of materials."""
    if filters and isinstance(basis, MaterialBasis):
        raise TransferError(
            "filters need spectral channels, but the channels of a MaterialBasis are materials",
            'use a SpectralBasis, not [basis] method = "materials"',
            code="conflict",
            field=f"{who}.filters",
            given=filters,
        )
    for name, spectrum in filters.items():
        _require_known(f"{who}.filters", name, materials)
        field = f"{who}.filters[{name!r}]"
        if not isinstance(spectrum, Spectrum):
            raise TransferError.refused(field, spectrum, "expected a Spectrum within 0…1", "type")
        low, high = spectrum.values.min(), spectrum.values.max()
        if low < 0 or high > 1 + 1e-6:
            raise TransferError(
                f"transmits {low:g} to {high:g}",
                "give 0…1",
                code="range",
                field=field,
                given=spectrum,
            )
    return dict(filters)


def filter_rows(
    mixes: Sequence[Mix], filters: Mapping[str, Spectrum], basis: SpectralBasis
) -> NDArray[np.float64]:
    """Return (P, M + 1): weighted filter channels of P mixes, and the sums of the weights.

    Divide by the sum after interpolation.

    >>> glass = Spectrum([390, 710], [0.5, 0.5])
    >>> basis = SpectralBasis.load("general-5")
    >>> filter_rows([{"glass": 0.5}], {"glass": glass}, basis).round(6).tolist()
    [[0.25, 0.25, 0.25, 0.25, 0.25, 0.5]]
    """
    names = used_materials(mixes)
    channels = np.zeros((len(names), basis.size))
    for row, name in zip(channels, names, strict=True):
        if name not in filters:
            continue
        exact = basis.analyse(filters[name])
        row[:] = exact.clip(0, 1)
        clipped = float(np.abs(row - exact).max())
        if clipped > _UNSEEN:
            warnings.warn(
                f"transfer function: filter of {name!r} leaves 0…1 by {clipped:.2g} in basis "
                f"{basis.name!r} and is clipped; smooth it, or use a positive basis",
                VolspecWarning,
                stacklevel=3,
            )
    weights = weight_matrix(mixes, names)
    return np.column_stack([weights @ channels, weights.sum(axis=1)])
