"""What a volume's values and geometry must be: what is kept, converted, replaced or refused."""

from __future__ import annotations

import os
import warnings
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from volspec.errors import VolspecWarning, VolumeError, one_line

# What the kernels read as it is; everything else becomes the nearest of these that holds it.
KEPT_DTYPES = (np.uint8, np.uint16, np.int16, np.float32)
_WIDENED = {"b1": np.uint8, "i1": np.int16}
# Of the range: rounding that no transfer function of 65536 entries can show.
_NEGLIGIBLE = 1e-6


def checked_values(given: ArrayLike, name: str) -> tuple[NDArray[Any], tuple[float, float]]:
    """Values the kernels can read, and their range.

    Parameters
    ----------
    given : (Z, Y, X) array
    name : str
        Used in messages.

    Returns
    -------
    values : (Z, Y, X) array of one of `KEPT_DTYPES`, read-only, C-contiguous, finite
    range : (float, float)

    Raises
    ------
    VolumeError
        If it is not a 3-D array of real numbers, has fewer than two voxels along an axis, no
        finite value, or values beyond float32.
    """
    if isinstance(given, str | os.PathLike):
        raise VolumeError(f"{given!r:.60} is no array; read a file with volspec.load_volume")
    original = _array(given, name)
    values = original
    if original.dtype.newbyteorder("=") not in KEPT_DTYPES:
        values = _converted(original, name)
    values = np.ascontiguousarray(values, dtype=values.dtype.newbyteorder("="))
    low, high = float(values.min()), float(values.max())
    if not np.isfinite([low, high]).all():
        values, low, high = _finite(values, name)
    if original.dtype.kind == "f" and original.dtype.itemsize > 4:
        _tell_lost_digits(original, values, (low, high), name)
    values = values.view()
    values.flags.writeable = False
    return values, (low, high)


def _array(given: ArrayLike, name: str) -> NDArray[Any]:
    try:
        values = np.asarray(given)
    except (TypeError, ValueError) as error:
        raise VolumeError(
            f"{name}: {type(given).__name__} is no array ({one_line(error)}); "
            "give one scalar a voxel, (Z, Y, X)"
        ) from error
    if values.dtype.kind not in "buif":
        raise VolumeError(f"{name}: values of type {values.dtype} are not real numbers")
    if values.ndim != 3:
        raise VolumeError(
            f"{name}: the array has shape {values.shape}; a volume is 3-D (Z, Y, X), "
            "one scalar a voxel. Choose one channel or time step"
        )
    if min(values.shape) < 2:
        raise VolumeError(
            f"{name}: the array has shape {values.shape}; a volume has at least two voxels along "
            "each axis, was a single slice given?"
        )
    return values


def _converted(values: NDArray[Any], name: str) -> NDArray[Any]:
    """As one of `KEPT_DTYPES`: the smallest integer that holds all of them, else float32."""
    kind = values.dtype.kind
    if kind in "iu" and values.dtype.itemsize > 2:  # labels, mostly
        low, high = int(values.min()), int(values.max())
        for narrow in (np.uint8, np.uint16, np.int16):
            if np.iinfo(narrow).min <= low and high <= np.iinfo(narrow).max:
                return values.astype(narrow)
    wider = _WIDENED.get(f"{kind}{values.dtype.itemsize}", np.float32)
    # Doubles beyond float32 become infinite here and are counted below.
    with np.errstate(over="ignore"):
        converted = values.astype(wider)
    if kind == "f" and (np.isfinite(values) & ~np.isfinite(converted)).any():
        raise VolumeError(
            f"{name}: values up to {np.abs(values[np.isfinite(values)]).max():g} exceed "
            "float32; rescale the volume"
        )
    if kind in "iu" and not np.array_equal(converted.astype(values.dtype), values):
        _warn(
            f"{name}: {values.dtype} values beyond 2^24 lose their last digits as float32; "
            "subtract an offset first"
        )
    return converted


def _finite(values: NDArray[Any], name: str) -> tuple[NDArray[Any], float, float]:
    finite = np.isfinite(values)
    if not finite.any():
        raise VolumeError(f"{name}: none of the {values.size} voxels is a finite float32 number")
    low = values.min(where=finite, initial=np.inf)
    high = values.max(where=finite, initial=-np.inf)
    above = np.count_nonzero(values == np.inf)
    count = values.size - np.count_nonzero(finite)
    _warn(
        f"{name}: {count} of {values.size} voxels are NaN or infinite; {count - above} (NaN, -inf) "
        f"became the minimum, {low:g}, {above} (+inf) the maximum, {high:g}"
    )
    values = np.nan_to_num(values, nan=low, posinf=high, neginf=low)
    return values, float(low), float(high)


def _tell_lost_digits(
    exact: NDArray[Any], kept: NDArray[Any], span: tuple[float, float], name: str
) -> None:
    """Warn where float32 rounds a fine structure away, such as 1e6 … 1e6 + 1."""
    most = float(np.spacing(np.float32(max(map(abs, span))))) / 2
    if most <= _NEGLIGIBLE * (span[1] - span[0]):
        return
    low, high, error = np.inf, -np.inf, 0.0
    for a, b in zip(exact, kept, strict=True):  # slice by slice, to need no second volume
        finite = np.isfinite(a)
        low = min(low, float(a.min(where=finite, initial=np.inf)))
        high = max(high, float(a.max(where=finite, initial=-np.inf)))
        error = max(error, float(np.abs(a - b).max(where=finite, initial=0)))
    if error > _NEGLIGIBLE * (high - low) > 0:
        _warn(
            f"{name}: {exact.dtype} values {low:.9g} … {high:.9g} are rounded by up to "
            f"{error:.2g} as float32; subtract an offset or rescale first"
        )


def _warn(message: str) -> None:
    # To the line that makes the volume: past this, the check, checked_values, __post_init__
    # and __init__.
    warnings.warn(message, VolspecWarning, stacklevel=6)


def checked_geometry(
    spacing: tuple[float, float, float] | None, world: ArrayLike | None, name: str
) -> tuple[tuple[float, float, float], NDArray[np.float64]]:
    """Spacing and affine map of a lattice, each from the other where one is missing.

    Returns
    -------
    spacing_mm : (x, y, z)
    world_from_index : (4, 4) float64, read-only

    Raises
    ------
    VolumeError
        If a number is not finite, a spacing not positive, the matrix singular, or both disagree.
    """
    if spacing is not None:
        spacing_array = _numbers(spacing)
        if spacing_array.shape != (3,):
            raise VolumeError.refused(
                f"{name}: spacing_mm", spacing, "give three numbers (x, y, z)", "type"
            )
        if not (np.isfinite(spacing_array).all() and (spacing_array > 0).all()):
            raise VolumeError(
                f"{name}: spacing {tuple(spacing_array.tolist())} mm; "
                "each of x, y, z must be positive, correct the header or give spacing_mm"
            )
    else:
        spacing_array = np.ones(3)
    if world is None:
        matrix = np.diag([*spacing_array, 1.0])
    else:
        matrix = _numbers(world)
        if matrix.shape != (4, 4) or not np.isfinite(matrix).all():
            raise VolumeError(f"{name}: world_from_index must be a finite (4, 4) matrix")
        lengths = np.linalg.norm(matrix[:3, :3], axis=0)
        if (lengths <= 0).any() or abs(np.linalg.det(matrix[:3, :3] / lengths)) < 1e-6:
            raise VolumeError(
                f"{name}: the orientation matrix {matrix[:3, :3].tolist()} is singular; "
                "its columns must be independent directions"
            )
        if matrix[3].tolist() != [0, 0, 0, 1]:
            raise VolumeError(
                f"{name}: world_from_index ends in the row {matrix[3].tolist()}; an affine map "
                "ends in 0, 0, 0, 1"
            )
        if spacing is not None and not np.allclose(lengths, spacing_array, rtol=1e-4):
            raise VolumeError(
                f"{name}: spacing {tuple(spacing_array.tolist())} mm and world_from_index "
                f"(columns {lengths.round(6).tolist()} mm) disagree; give one of them",
                code="conflict",
            )
        spacing_array = lengths
    matrix.flags.writeable = False
    x, y, z = (float(v) for v in spacing_array)
    return (x, y, z), matrix


def _numbers(given: ArrayLike) -> NDArray[np.float64]:
    """A float64 copy; empty where the input is no array of numbers."""
    try:
        return np.array(given, dtype=np.float64)
    except (TypeError, ValueError):
        return np.empty(0)
