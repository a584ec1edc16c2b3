"""Scalars and lattices of pyvista's (VTK's) grids.

Cell scalars are used if a grid has no point scalars; their lattice is that of the cell centres.
"""

from __future__ import annotations

import shlex
import warnings
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray

from volspec.errors import VolspecWarning, VolumeError
from volspec.volume.checks import with_nan
from volspec.volume.files.query import Query

if TYPE_CHECKING:
    import pyvista

# Greatest deviation of a rectilinear grid's steps from their mean, as a fraction: rounding.
_EVEN = 1e-3
# VTK's array of marks, and its bits of hidden points and of hidden cells.
_GHOSTS, _HIDDEN = "vtkGhostType", (2, 32)


def volume_fields(
    grid: pyvista.ImageData, scalars: str | None = None, *, name: str = "pyvista grid"
) -> dict[str, Any]:
    """Return what a `Volume` takes of an ``ImageData``: values, lattice and name.

    A ``RectilinearGrid`` may be given instead if its planes are evenly spaced.

    Raises VolumeError if ``grid`` is not one, or its array is missing or has several components.
    """
    values, world, notes = values_and_lattice(grid, scalars, None, name, None)
    for note in notes:
        warnings.warn(note, VolspecWarning, stacklevel=3)
    return {"values": values, "world_from_index": world, "name": name}


def values_and_lattice(
    grid: pyvista.ImageData,
    scalars: str | None,
    component: int | None,
    name: str,
    query: Query | None,
) -> tuple[NDArray[Any], NDArray[np.float64], list[str]]:
    """Return a grid's scalars (Z, Y, X), its world_from_index (4, 4), and warnings.

    Scalars are not copied unless some are hidden, which become NaN. A spacing of the query replaces
    steps that are zero, and makes uneven ones even.
    """
    data, is_cells = _arrays(grid, name, query)
    available, names, active = list(data.keys()), _own_names(data), data.active_scalars_name
    selected = scalars or (active if active in names else names[0])
    if selected not in available:
        raise VolumeError(
            f"{name}: no scalars {selected!r}; the grid has {available}", code="unknown"
        )
    array = np.asarray(data[selected])
    if array.ndim > 1 and component is None:
        raise VolumeError(
            f"{name}: {array.shape[-1]} components per voxel in {selected!r}",
            f"a volume has one: grid['one'] = grid[{selected!r}][:, 0] makes scalars 'one'",
            code="shape",
        )
    shape = tuple(max(n - is_cells, 1) for n in grid.dimensions)
    spacing = None if query is None else query.spacing_mm
    if type(grid).__name__ == "RectilinearGrid":
        directions, first = np.eye(3), np.zeros(3)
        start = np.array([places[0] for places in (grid.x, grid.y, grid.z)])
        steps = _mean_steps(grid, name, query)
    else:
        # Indices begin at the extent's.
        directions, first = np.asarray(grid.direction_matrix), np.asarray(grid.extent[::2])
        start, steps = np.asarray(grid.origin), np.asarray(grid.spacing)
    is_bad = ~np.isfinite(steps) | (steps == 0)
    if is_bad.any() and spacing is None:
        remedy = f"give it as in {query.example(spacing='1,1,1')}" if query else "set grid.spacing"
        sizes = ", ".join(f"{step:g}" for step in steps)
        raise VolumeError(
            f"{name}: spacing {sizes} mm, of which none may be zero", remedy, code="range"
        )
    world = np.eye(4)
    world[:3, :3] = directions * np.where(is_bad, 1.0 if spacing is None else spacing, steps)
    world[:3, 3] = start + world[:3, :3] @ first
    if is_cells:
        world[:3, 3] += world[:3, :3].sum(axis=1) / 2
    if array.ndim > 1:
        array = array.reshape(len(array), -1)[:, component]
    hidden, notes = _hidden_in(grid, is_cells, name)
    return with_nan(array.reshape(shape[::-1]), hidden), world, notes


def _hidden_in(
    grid: Any, is_cells: bool, name: str
) -> tuple[NDArray[np.bool_] | np.bool_, list[str]]:
    """Return True for cells, or points, (Z, Y, X) that the grid hides, and warnings of others.

    A cell is hidden with any of its points, a point with all of its cells.
    """
    counts = np.array(grid.dimensions[::-1])
    flags = [grid.point_data.get(_GHOSTS), grid.cell_data.get(_GHOSTS)]
    points, cells = (
        np.zeros(shape, bool) if flag is None else (np.asarray(flag) & bit).reshape(shape) > 0
        for flag, bit, shape in zip(flags, _HIDDEN, (counts, counts - 1), strict=True)
    )
    if not (points.any() or cells.any()):
        return np.False_, []
    if points.all() or cells.all():
        which = "cell" if cells.all() else "point"
        raise VolumeError(
            f"{name}: all of its {which}s are hidden ({_GHOSTS})",
            f"del grid.{which}_data[{_GHOSTS!r}] shows them",
            code="missing",
        )
    if is_cells:
        return cells | _corners(points).any(axis=(3, 4, 5)), []
    points = points | _corners(np.pad(cells, 1, constant_values=True)).all(axis=(3, 4, 5))
    count = np.count_nonzero(cells & ~_corners(points).any(axis=(3, 4, 5)))
    problem = f"{name}: {count} hidden cells are shown, as none of their points is hidden"
    note = f"{problem}; grid.point_data_to_cell_data() gives values to cells"
    return points, [note] if count else []


def _corners(flags: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Return the (2, 2, 2) flags at the corners of each cell between some points."""
    return sliding_window_view(flags, (2, 2, 2))


def _resample(query: Query | None) -> str:
    """Return a remedy for a grid that is no lattice: Python that makes a file of one."""
    grid, read, to = "grid", "grid", "even.vti"
    if query is not None:
        grid, read = "g", f"g := pyvista.read({str(query.path)!r})"
        to = f"{query.path.with_suffix('')}-even.vti"
    return (
        f"resample it in Python: pyvista.create_grid({read}, dimensions=(128, 128, 128))"
        f".sample({grid}).save({to!r})"
    )


def _arrays(grid: Any, name: str, query: Query | None) -> tuple[Any, bool]:
    """Return a grid's arrays of points, or else of cells, and True if they are of cells."""
    kind = type(grid).__name__
    if kind == "PolyData" and query is not None:
        raise VolumeError(
            f"{name}: is a PolyData, a mesh, not a volume",
            f"see it by volspec view {shlex.quote(name)}",
            code="type",
        )
    if kind not in ("ImageData", "RectilinearGrid"):
        raise VolumeError(f"{name}: is a {kind}", _resample(query), code="type")
    is_cells = not _own_names(grid.point_data)
    data = grid.cell_data if is_cells else grid.point_data
    if not _own_names(data):
        raise VolumeError(
            f"{name}: holds no array", "save one with its grid, as point data", code="shape"
        )
    return data, is_cells


def _own_names(data: Any) -> list[str]:
    """Return the names of arrays other than VTK's own."""
    return [key for key in data.keys() if not key.startswith("vtk")]  # noqa: SIM118


def scalar_names(grid: Any, name: str, query: Query) -> list[tuple[str, int | None]]:
    """Return a grid's arrays of numbers, without VTK's own, and their components if several.

    Raises VolumeError if the grid is no lattice, or has none.
    """
    data, _ = _arrays(grid, name, query)
    fields = [
        (key, part)
        for key, array in data.items()
        if array.dtype.kind in "buif" and not key.startswith("vtk")
        for part in ([None] if array.ndim == 1 else range(array[0].size))
    ]
    if not fields:
        raise VolumeError(
            f"{name}: none of its arrays holds numbers; it has {', '.join(data)}", code="type"
        )
    return fields


def _mean_steps(grid: Any, name: str, query: Query | None) -> NDArray[np.float64]:
    """Return the steps along x, y, z of a ``RectilinearGrid``, whose coordinates may descend."""
    means = np.ones(3)
    for axis, places in enumerate((grid.x, grid.y, grid.z)):
        steps = np.diff(np.asarray(places, np.float64))
        is_even = steps.size == 0 or np.allclose(steps, steps.mean(), _EVEN, 0)
        if not is_even and (query is None or query.spacing_mm is None):
            raise VolumeError(
                f"{name}: is a RectilinearGrid of uneven spacing, {steps.min():.4g} to "
                f"{steps.max():.4g} mm along {'xyz'[axis]}",
                _resample(query),
                code="unsupported",
            )
        means[axis] = steps.mean() if steps.size else 1.0
    return means
