"""What a basis must be, and what its coefficients must be, to belong together.

SpectralBasis -> [checks] -> read-only matrices
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike, NDArray

from volspec.errors import BasisError, SpectrumError
from volspec.spectra.photometry import check_observer

if TYPE_CHECKING:
    from volspec.basis.materials import MaterialBasis
    from volspec.basis.model import SpectralBasis

Array = NDArray[np.float64]

_WHITE_TOLERANCE = 1e-6
# Channels lose this much on the way to a spectrum and back: rounding, where B is large.
_ROUND_TRIP_TOLERANCE = 1e-5


def matrices(basis: SpectralBasis) -> dict[str, Array]:
    """A, B and D by field name: read-only float64 copies that fit together.

    Raises
    ------
    BasisError
        If shapes do not fit, a value is not finite, flat white is not kept, or the synthesis
        is not the analysis' own.
    """
    label = f"basis {basis.name!r}"
    try:
        check_observer(basis.observer_deg)
    except SpectrumError as error:
        raise BasisError(f"{label}: {error}") from None
    found: dict[str, Array] = {}
    for field in ("analysis", "synthesis", "XYZ_from_channels"):
        try:
            array = np.array(getattr(basis, field), dtype=np.float64)
        except (TypeError, ValueError) as error:
            raise BasisError(f"{label}: {field} is not an array of numbers: {error}") from error
        if array.ndim != 2 or not np.isfinite(array).all():
            raise BasisError(f"{label}: {field} is not a matrix of finite numbers")
        array.flags.writeable = False
        found[field] = array
    m, N = found["analysis"].shape[0], basis.grid.size
    for field, expected in zip(found, ((m, N), (N, m), (3, m)), strict=True):
        shape = found[field].shape
        if shape != expected or m < 1:
            raise BasisError(
                f"{label}: {field} has shape {shape}, expected {expected} on {basis.grid}"
            )
    off = float(np.abs(found["analysis"].sum(1) - 1).max())
    if off > _WHITE_TOLERANCE:
        raise BasisError(
            f"{label}: flat white does not analyse to ones (a row sums to 1 +- {off:.2g}); "
            "scale the channels by A 1"
        )
    loss = float(np.abs(found["analysis"] @ found["synthesis"] - np.eye(m)).max())
    if loss > _ROUND_TRIP_TOLERANCE:
        raise BasisError(
            f"{label}: analysis and synthesis do not belong together (A B differs from the "
            f"identity by {loss:.2g}); were the numbers edited? Fit the basis again"
        )
    return found


def channels(basis: SpectralBasis | MaterialBasis, coefficients: ArrayLike) -> Array:
    """(..., m) float64 coefficients of a basis.

    Raises
    ------
    BasisError
        If their last axis is not the basis' m.
    """
    c = np.asarray(coefficients, dtype=np.float64)
    if c.ndim == 0 or c.shape[-1] != basis.size:
        raise BasisError(
            f"coefficients have shape {c.shape}, basis {basis.name!r} has {basis.size} channels; "
            "were they made with another basis?"
        )
    return c
