"""Check and convert a volume's values and geometry, from any library.

    NumPy, xarray, Zarr -> [checks] -> Volume

xarray and Zarr need not be installed: their objects are recognised by their attributes.
"""

from __future__ import annotations

import os
import warnings
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from volspec.errors import VolspecWarning, VolumeError, one_line

NATIVE_DTYPES = (np.uint8, np.uint16, np.int16, np.float32)
"""Types that kernels can read; others are converted to the smallest that fits their values."""
WIDENED = {"b1": np.uint8, "i1": np.int16}
# Fraction of the range: smaller rounding errors are invisible with 65536 table entries.
_NEGLIGIBLE = 1e-6
# Distance of the missing value from the others, in ranges: values interpolated with it fall below
# the range within a thousandth of a voxel, and float32 still resolves the others next to it.
BELOW = 1024.0
# Fraction of a step by which coordinates may be uneven, as in float32 and decimal files.
_UNEVEN = 1e-3


def checked_values(
    array: ArrayLike, name: str, missing: float | None
) -> tuple[NDArray[Any], tuple[float, float], float | None]:
    """Return values that the kernels can read, (Z, Y, X), their range, and the missing value.

    The array has one of `NATIVE_DTYPES` and is read-only, C-contiguous and finite. Voxels that are
    NaN or infinite, or ``missing`` already, hold the missing value; None if there are none. Raises
    VolumeError if it is not a 3-D array of real numbers, has fewer than two voxels along an axis,
    no finite value, or values beyond float32.
    """
    if isinstance(array, str | os.PathLike):
        raise VolumeError(
            f"{array!r:.60} is not an array; read a file with volspec.load_volume", code="type"
        )
    original = _real_array(array, name)
    values = original
    if original.dtype.newbyteorder("=") not in NATIVE_DTYPES:
        values = _convert(original, name)
    values = np.ascontiguousarray(values, dtype=values.dtype.newbyteorder("="))
    low, high = float(values.min()), float(values.max())
    if missing is not None and low == missing and np.isfinite(high):
        low = float(values.min(where=values != missing, initial=np.inf))
    elif not np.isfinite([low, high]).all():
        values, low, high, missing = _replace_non_finite(values, name)
    else:
        missing = None
    if original.dtype.kind == "f" and original.dtype.itemsize > 4:
        _warn_of_lost_digits(original, values, (low, high), name)
    values = values.view()
    values.flags.writeable = False
    return values, (low, high), missing


def _real_array(array: ArrayLike, name: str) -> NDArray[Any]:
    try:
        if isinstance(array, list | tuple) and any(map(np.ma.isMaskedArray, array)):
            array = np.ma.stack(array)
        if np.ma.isMaskedArray(getattr(array, "_meta", None)):  # Dask's
            array = array.compute()  # type: ignore[union-attr]  # Dask's, as tested
        values = np.asanyarray(array)
        masked, values = np.ma.getmask(values), np.asarray(values)
    except (TypeError, ValueError) as error:
        raise VolumeError(
            f"{name}: {type(array).__name__} is not an array ({one_line(error)}); "
            "give one scalar per voxel, (Z, Y, X)",
            code="type",
        ) from error
    if values.dtype.kind not in "buif":
        raise VolumeError(
            f"{name}: values of type {values.dtype} are not real numbers", code="type"
        )
    if values.ndim != 3:
        remedy = "choose one channel or time step, such as array[0]"
        if values.ndim < 3:
            remedy = (
                "give all slices, as numpy.stack(slices), or one twice: numpy.stack([array] * 2)"
            )
        raise VolumeError(
            f"{name}: the array has shape {values.shape}",
            f"a volume has three axes (Z, Y, X): {remedy}",
            code="shape",
        )
    if min(values.shape) < 2:
        raise VolumeError(
            f"{name}: is {' × '.join(map(str, values.shape[::-1]))} voxels (x × y × z); a volume "
            "has at least two along each axis",
            f"give one slice twice: numpy.repeat(array, 2, axis={values.shape.index(1)})"
            if 1 in values.shape
            else "was the right array given?",
            code="shape",
        )
    return with_nan(values, masked)


def with_nan(values: NDArray[Any], masked: NDArray[np.bool_] | np.bool_) -> NDArray[Any]:
    """Return values with NaN where they are masked, as floats that hold them, if any is.

    >>> with_nan(np.array([1, 2], np.int16), np.array([True, False]))
    array([nan,  2.], dtype=float32)
    """
    return np.where(masked, np.float32(np.nan), values) if masked.any() else values


def _convert(values: NDArray[Any], name: str) -> NDArray[Any]:
    """Convert to the smallest native integer type that holds all values, else to float32."""
    kind = values.dtype.kind
    if kind in "iu" and values.dtype.itemsize > 2:  # mostly labels
        low, high = int(values.min()), int(values.max())
        for narrow in (np.uint8, np.uint16, np.int16):
            if np.iinfo(narrow).min <= low and high <= np.iinfo(narrow).max:
                return values.astype(narrow)
    wider = WIDENED.get(f"{kind}{values.dtype.itemsize}", np.float32)
    # Doubles beyond float32 become infinite here and are counted below.
    with np.errstate(over="ignore"):
        converted = values.astype(wider)
    if kind == "f" and (np.isfinite(values) & ~np.isfinite(converted)).any():
        raise VolumeError(
            f"{name}: values up to {np.abs(values[np.isfinite(values)]).max():g} exceed "
            "float32; rescale the volume",
            code="range",
        )
    if kind in "iu" and not np.array_equal(converted.astype(values.dtype), values):
        _warn(
            f"{name}: {values.dtype} values beyond 2^24 lose their last digits as float32; "
            "subtract an offset first"
        )
    return converted


def _replace_non_finite(
    values: NDArray[Any], name: str
) -> tuple[NDArray[Any], float, float, float]:
    """Return values without NaN and infinities, the others' least and greatest, and the missing."""
    finite = np.isfinite(values)
    if not finite.any():
        raise VolumeError(
            f"{name}: none of the {values.size} voxels is a finite float32 number; was the right "
            "file or channel given? If so, export it again",
            code="range",
        )
    low = float(values.min(where=finite, initial=np.inf))
    high = float(values.max(where=finite, initial=-np.inf))
    count = values.size - np.count_nonzero(finite)
    missing = missing_value(low, high)
    _warn(
        f"{name}: {count} of {values.size} voxels are NaN, infinite or masked; they are transparent"
    )
    return np.where(finite, values, np.float32(missing)), low, high, missing


def logarithms(values: NDArray[Any], name: str) -> tuple[NDArray[Any], float | None, str]:
    """Return decimal logarithms of values, the value of those without one, and a note on these.

    Raises VolumeError if none is above 0.
    """
    with np.errstate(divide="ignore", invalid="ignore"):
        logs = np.log10(_real_array(values, name)).astype(np.float32)
    finite = np.isfinite(logs)
    if finite.all():
        return logs, None, ""
    if not finite.any():
        raise VolumeError(f"{name}: no value is above 0", "leave out scale=log", code="range")
    low, high = (float(end(logs[finite])) for end in (np.min, np.max))
    logs[~finite] = missing = missing_value(low, high)
    count = finite.size - np.count_nonzero(finite)
    why = "have no logarithm, as they are not above 0, or not finite; they are transparent"
    return logs, missing, f"{name}: {count} of {finite.size} voxels {why}"


def missing_value(low: float, high: float) -> float:
    """Return the value of missing voxels where the others lie within a range.

    >>> missing_value(0.0, 1.0)
    -1024.0
    """
    missing = low - BELOW * ((high - low) or max(abs(low), 1.0))
    return float(np.float32(max(missing, float(np.finfo(np.float32).min))))


def _warn_of_lost_digits(
    exact: NDArray[Any], rounded: NDArray[Any], span: tuple[float, float], name: str
) -> None:
    """Warn if float32 rounds a fine structure away, such as 1e6 … 1e6 + 1."""
    max_error = float(np.spacing(np.float32(max(map(abs, span))))) / 2
    if max_error <= _NEGLIGIBLE * (span[1] - span[0]):
        return
    low, high, error = np.inf, -np.inf, 0.0
    for a, b in zip(exact, rounded, strict=True):  # by slice, without a second volume
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
    # Blame the line that makes the volume, above this function, the check, checked_values,
    # __post_init__ and __init__.
    warnings.warn(message, VolspecWarning, stacklevel=6)


def checked_geometry(
    spacing: tuple[float, float, float] | None, world: ArrayLike | None, name: str
) -> tuple[tuple[float, float, float], NDArray[np.float64]]:
    """Return spacing_mm and world_from_index, (4, 4) read-only, each from the other if missing.

    Raises VolumeError if a number is not finite, a spacing not positive, the matrix singular, or
    the two disagree.
    """
    if spacing is not None:
        spacing_array = _numbers(spacing)
        if spacing_array.shape != (3,):
            raise VolumeError.refused(
                f"{name}: spacing_mm", spacing, "give three numbers (x, y, z)", "type"
            )
        if not (np.isfinite(spacing_array).all() and (spacing_array > 0).all()):
            raise VolumeError(
                f"{name}: spacing {tuple(spacing_array.tolist())} mm",
                "each of x, y, z must be positive; correct the header or give spacing_mm",
                code="range",
                given=spacing,
            )
    else:
        spacing_array = np.ones(3)
    if world is None:
        matrix = np.diag([*spacing_array, 1.0])
    else:
        matrix = _numbers(world)
        if matrix.shape != (4, 4) or not np.isfinite(matrix).all():
            raise VolumeError(
                f"{name}: world_from_index must be a finite (4, 4) matrix",
                code="shape",
                given=world,
            )
        lengths = np.linalg.norm(matrix[:3, :3], axis=0)
        if (lengths <= 0).any() or abs(np.linalg.det(matrix[:3, :3] / lengths)) < 1e-6:
            raise VolumeError(
                f"{name}: the orientation matrix {matrix[:3, :3].tolist()} is singular; "
                "its columns must be independent directions",
                code="range",
                given=world,
            )
        if matrix[3].tolist() != [0, 0, 0, 1]:
            raise VolumeError(
                f"{name}: the last row of world_from_index is {matrix[3].tolist()}; "
                "in an affine map it is 0, 0, 0, 1",
                code="range",
                given=world,
            )
        if spacing is not None and not np.allclose(lengths, spacing_array, 1e-4, 0):
            raise VolumeError(
                f"{name}: spacing {tuple(spacing_array.tolist())} mm and world_from_index "
                f"(columns {lengths.tolist()} mm) disagree; give one of them",
                code="conflict",
            )
        spacing_array = lengths
    matrix.flags.writeable = False
    x, y, z = (float(v) for v in spacing_array)
    return (x, y, z), matrix


def _numbers(values: ArrayLike) -> NDArray[np.float64]:
    """Return a float64 copy; an empty array if the input is not an array of numbers."""
    try:
        return np.array(values, dtype=np.float64)
    except (TypeError, ValueError):
        return np.empty(0)


def array_and_lattice(array: Any, name: str) -> tuple[Any, NDArray[np.float64] | None]:
    """Return the array to convert, and world_from_index from its coordinates, or None without any.

    An xarray ``DataArray`` with dimensions x, y and z, in any order and case, is transposed to (Z,
    Y, X); with other names its order is kept. Its coordinates are millimetres. Anything else is
    returned unchanged. Raises VolumeError for several arrays, or uneven coordinates.
    """
    kind = type(array).__name__
    if hasattr(array, "point_data") or hasattr(array, "n_blocks"):
        which = "Volume.from_pyvista takes an ImageData"
        if hasattr(array, "n_blocks"):
            which += f", such as one of its {array.n_blocks} blocks"
        raise VolumeError(f"{name}: is a pyvista {kind}; {which}", code="type")
    if hasattr(array, "keys") and not hasattr(array, "dtype"):
        names = ", ".join(map(repr, array)) or "nothing"
        raise VolumeError(f"{name}: is a {kind} of {names:.60}; choose one of them", code="type")
    if not (hasattr(array, "dims") and hasattr(array, "coords")):
        return array, None
    return _xarray_lattice(array, name)


def _xarray_lattice(array: Any, name: str) -> tuple[Any, NDArray[np.float64] | None]:
    axes = {str(dim).lower(): dim for dim in array.dims}
    if set(axes) == {"x", "y", "z"}:
        array = array.transpose(axes["z"], axes["y"], axes["x"])
    if len(array.dims) != 3 or not any(dim in array.coords for dim in array.dims):
        return array, None
    world = np.eye(4)
    for axis, dim in enumerate(reversed(array.dims)):
        if dim in array.coords:
            world[axis, 3], world[axis, axis] = _start_and_step(array.coords[dim], dim, name)
    return array, world


def _start_and_step(coordinates: Any, dim: Any, name: str) -> tuple[float, float]:
    """Return the first coordinate and the step, which is negative if coordinates decrease."""
    try:
        points = np.asarray(coordinates).astype(np.float64, casting="same_kind")
    except (TypeError, ValueError):
        points = np.full(2, np.nan)
    if points.size < 2:  # one slice: refused with the shape
        return 0.0, 1.0
    step = (points[-1] - points[0]) / (points.size - 1) if np.isfinite(points).all() else 0.0
    even = points[0] + step * np.arange(points.size)
    if not (step and (np.abs(points - even) <= _UNEVEN * abs(step)).all()):
        raise VolumeError(
            f"{name}: the coordinates along {str(dim)!r} are not evenly spaced numbers; "
            f"interpolate to a regular lattice, or leave them out: drop_vars({str(dim)!r})",
            code="range",
        )
    return float(points[0]), float(step)
