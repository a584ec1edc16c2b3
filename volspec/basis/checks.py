"""What a basis must be, and what its coefficients must be, to belong together.

SpectralBasis -> [checks] -> read-only matrices
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike, NDArray

from volspec.errors import BasisError

if TYPE_CHECKING:
    from volspec.basis.model import SpectralBasis

Array = NDArray[np.float64]

_WHITE_TOLERANCE = 1e-6


def matrices(basis: SpectralBasis) -> dict[str, Array]:
    """A, B and D by field name: read-only float64 copies that fit together.

    Raises
    ------
    BasisError
        If shapes do not fit, a value is not finite, or flat white is not kept.
    """
    label = f"basis {basis.name!r}"
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
    return found


def channels(basis: SpectralBasis, coefficients: ArrayLike) -> Array:
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
