"""Spectral absorption: what colour of light passes a material.

    filters, basis -> [filters] -> transfer function

A filter is the transmission spectrum of a material at opacity 1: a reference step of opacity α
lets 1 − α (1 − filter) through, channel by channel. A material without one passes 1 − α of
every wavelength, its filter is 0.
"""

from __future__ import annotations

import warnings
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from volspec.basis import MaterialBasis, SpectralBasis
from volspec.errors import TransferError, VolspecWarning, nearest
from volspec.spectra import Spectrum
from volspec.transfer.mixes import Mix, share_matrix, used

# Channels of a signed basis may leave 0…1 by this much before anyone is told.
_UNSEEN = 0.02


def checked_filters(
    who: str, filters: Any, materials: Mapping[str, Spectrum], basis: Any
) -> dict[str, Spectrum]:
    """Filters of known materials, 0…1, in a basis of wavelengths.

    Raises
    ------
    TransferError
    """
    if not isinstance(filters, Mapping):
        raise TransferError.refused(f"{who}: filters", filters, "give {material: Spectrum}")
    if filters and isinstance(basis, MaterialBasis):
        raise TransferError(
            f"{who}: filters need channels of wavelengths, those of a MaterialBasis are "
            "materials; take a SpectralBasis"
        )
    for name, spectrum in filters.items():
        if name not in materials:
            known = ", ".join(sorted(materials))
            raise TransferError(
                f"{who}: filter of no material {name!r}; {nearest(name, materials)}known: {known}",
                code="unknown",
            )
        if not isinstance(spectrum, Spectrum):
            raise TransferError.refused(
                f"{who}: filter of {name!r}", spectrum, "expected a Spectrum of 0…1", "type"
            )
        low, high = spectrum.values.min(), spectrum.values.max()
        if low < 0 or high > 1 + 1e-6:
            raise TransferError(
                f"{who}: filter of {name!r} lets {low:g} to {high:g} through; give 0…1"
            )
    return dict(filters)


def filter_rows(
    mixes: Sequence[Mix], filters: Mapping[str, Spectrum], basis: SpectralBasis
) -> NDArray[np.float64]:
    """The filters' channels in each mix, and what to divide them by once interpolated.

    Parameters
    ----------
    mixes : P mixes
    filters : {material: Spectrum}
        0…1.
    basis : SpectralBasis

    Returns
    -------
    (P, M + 1) float64
        Channels times shares; the sum of the shares comes last.

    Examples
    --------
    >>> glass = Spectrum([390, 710], [0.5, 0.5])
    >>> basis = SpectralBasis.load("general-5")
    >>> filter_rows([{"glass": 0.5}], {"glass": glass}, basis).round(6).tolist()
    [[0.25, 0.25, 0.25, 0.25, 0.25, 0.5]]
    """
    names = used(mixes)
    channels = np.zeros((len(names), basis.size))
    for row, name in zip(channels, names, strict=True):
        if name not in filters:
            continue
        exact = basis.analyse(filters[name])
        row[:] = exact.clip(0, 1)
        moved = float(np.abs(row - exact).max())
        if moved > _UNSEEN:
            warnings.warn(
                f"transfer function: filter of {name!r} leaves 0…1 by {moved:.2g} in basis "
                f"{basis.name!r} and is clipped; smooth it, or take a positive basis",
                VolspecWarning,
                stacklevel=3,
            )
    shares = share_matrix(mixes, names)
    return np.column_stack([shares @ channels, shares.sum(axis=1)])
