"""What a basis must be, and what its coefficients must be, to belong together.

SpectralBasis -> [checks] -> read-only matrices
"""

from __future__ import annotations

import unicodedata
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from volspec.errors import BasisError, SpectrumError
from volspec.spectra.grid import SpectralGrid
from volspec.spectra.observer import check_observer
from volspec.spectra.values import real_array

if TYPE_CHECKING:
    from volspec.basis.base import StoredBasis
    from volspec.basis.model import SpectralBasis

Array = NDArray[np.float64]

ROUND_TRIP_TOLERANCE = 1e-5
"""Channels lose this much on the way to a spectrum and back: rounding, where B is large."""
_WHITE_TOLERANCE = 1e-6
# Controls, halves of characters, and breaks of lines.
_UNPRINTABLE = ("Cc", "Cs", "Zl", "Zp")


@contextmanager
def basis_errors(label: str = "") -> Iterator[None]:
    """What is wrong with a spectrum inside is wrong with the basis that is made of it."""
    try:
        yield
    except SpectrumError as error:
        raise BasisError(f"{label}: {error}" if label else str(error)) from None


def text(value: Any, what: str) -> str:
    """A name or a note: text without control characters.

    Raises
    ------
    BasisError
    """
    if not isinstance(value, str):
        raise BasisError.refused(what, value, "expected text", "type")
    if any(unicodedata.category(character) in _UNPRINTABLE for character in value):
        raise BasisError.refused(what, value, "leave out its control characters")
    return value


def grid_and_observer(grid: Any, observer_deg: Any, label: str) -> int:
    """Check both; the observer as a plain int.

    Raises
    ------
    BasisError
    """
    if not isinstance(grid, SpectralGrid):
        raise BasisError.refused(
            f"{label}: grid",
            grid,
            "expected a SpectralGrid, such as volspec.SpectralGrid(400, 700, 10)",
            "type",
        )
    with basis_errors(label):
        check_observer(observer_deg)
    return int(observer_deg)


def matrices(basis: SpectralBasis) -> dict[str, Array]:
    """A, B and D by field name: read-only float64 copies that fit together.

    Raises
    ------
    BasisError
        If shapes do not fit, a value is not finite, flat white is not kept, or the synthesis
        is not the analysis' own.
    """
    label = f"basis {basis.name!r}"
    found: dict[str, Array] = {}
    for field in ("analysis", "synthesis", "XYZ_from_channels"):
        try:
            array = real_array(getattr(basis, field), field)
        except SpectrumError:
            raise BasisError(f"{label}: {field} is not an array of numbers") from None
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
    loss = round_trip_loss(found["analysis"], found["synthesis"])
    if loss > ROUND_TRIP_TOLERANCE:
        raise BasisError(
            f"{label}: analysis and synthesis do not belong together (A B differs from the "
            f"identity by {loss:.2g}); were the numbers edited? Fit the basis again"
        )
    return found


def round_trip_loss(A: Array, B: Array) -> float:
    """How far A B is from the identity."""
    return float(np.abs(A @ B - np.eye(len(A))).max())


def channels(basis: StoredBasis, coefficients: ArrayLike) -> Array:
    """(..., m) float64 coefficients of a basis.

    Raises
    ------
    BasisError
        If they are not finite numbers, or their last axis is not the basis' m.
    """
    with basis_errors():
        c = real_array(coefficients, "coefficients")
    if c.ndim == 0 or c.shape[-1] != basis.size:
        raise BasisError(
            f"coefficients have shape {c.shape}, basis {basis.name!r} has {basis.size} channels; "
            "were they made with another basis?"
        )
    if not np.isfinite(c).all():
        raise BasisError("coefficients hold NaN or infinite values; leave those pixels out")
    return c


def materials(given: Any, label: str) -> None:
    """Refuse what is not a mapping of names to something.

    Raises
    ------
    BasisError
    """
    if not isinstance(given, Mapping) or not given:
        raise BasisError(f"{label}: no materials in {given!r:.40}; give {{name: reflectance}}")
