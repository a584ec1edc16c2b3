"""What other libraries give for a volume: arrays with named axes, and collections that are none.

    xarray, Zarr, pyvista -> [foreign] -> Volume

Nothing is imported here: xarray and Zarr are known by what their objects offer, since neither has
to be installed.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from volspec.errors import VolumeError

# Of a step: how far coordinates may be from even, as float32 and decimal files leave them.
_UNEVEN = 1e-3


def unwrapped(given: Any, name: str) -> tuple[Any, NDArray[np.float64] | None]:
    """What to take the values from, and where the array's own coordinates put them.

    Parameters
    ----------
    given : array or anything else
        An xarray ``DataArray`` with dimensions x, y and z, in any order and case, is turned to
        (Z, Y, X); with other names its order counts. Everything else stays as it is.
    name : str
        Used in messages.

    Returns
    -------
    values
        For `numpy.asarray`.
    world_from_index : (4, 4) float64 or None
        From a ``DataArray``'s coordinates, which count as millimetres; None without them.

    Raises
    ------
    VolumeError
        If it holds several arrays, or coordinates are not evenly spaced numbers.
    """
    kind = type(given).__name__
    if hasattr(given, "point_data") or hasattr(given, "n_blocks"):
        which = "Volume.from_pyvista takes an ImageData"
        if hasattr(given, "n_blocks"):
            which += f", such as one of its {given.n_blocks} blocks"
        raise VolumeError(f"{name}: is a pyvista {kind}; {which}")
    if hasattr(given, "keys") and not hasattr(given, "dtype"):
        names = ", ".join(map(repr, given)) or "nothing"
        raise VolumeError(f"{name}: is a {kind} of {names:.60}; give one array of it")
    if not (hasattr(given, "dims") and hasattr(given, "coords")):
        return given, None
    return _labelled(given, name)


def _labelled(array: Any, name: str) -> tuple[Any, NDArray[np.float64] | None]:
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
    """First coordinate and distance of two; a step below 0 where they fall."""
    try:
        at = np.asarray(coordinates).astype(np.float64, casting="same_kind")
    except (TypeError, ValueError):
        at = np.full(2, np.nan)
    if at.size < 2:  # one slice: refused with the shape
        return 0.0, 1.0
    step = (at[-1] - at[0]) / (at.size - 1) if np.isfinite(at).all() else 0.0
    even = at[0] + step * np.arange(at.size)
    if not (step and (np.abs(at - even) <= _UNEVEN * abs(step)).all()):
        raise VolumeError(
            f"{name}: the coordinates along {str(dim)!r} are not evenly spaced numbers; "
            f"interpolate to a regular lattice, or leave them out: drop_vars({str(dim)!r})",
            code="conflict",
        )
    return float(at[0]), float(step)
