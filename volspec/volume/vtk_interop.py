"""Convert volumes to and from pyvista (VTK).

Cell scalars are used if a grid has no point scalars; their lattice is that of the cell centres.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from volspec.errors import VolumeError
from volspec.volume.model import Volume

if TYPE_CHECKING:
    import pyvista

_RESAMPLE = (
    "resample it to an even grid with pyvista: "
    "pyvista.create_grid(grid, dimensions=(128, 128, 128)).sample(grid).save('even.vti')"
)
# Greatest deviation of a rectilinear grid's steps from their mean, as a fraction: rounding.
_EVEN = 1e-3


def volume_from_pyvista(
    grid: pyvista.ImageData, scalars: str | None = None, *, name: str = "pyvista grid"
) -> Volume:
    """Convert a pyvista ``ImageData``: its scalars, spacing, origin and direction.

    A ``RectilinearGrid`` may be given instead if its planes are evenly spaced.

    Raises VolumeError if ``grid`` is not one, or its array is missing or has several components.
    """
    values, world = values_and_lattice(grid, scalars, name)
    return Volume(values, world_from_index=world, name=name)


def values_and_lattice(
    grid: pyvista.ImageData, scalars: str | None, name: str
) -> tuple[NDArray[Any], NDArray[np.float64]]:
    """Return a grid's scalars (Z, Y, X), not copied, and its world_from_index (4, 4)."""
    if type(grid).__name__ == "RectilinearGrid":
        grid = _evenly_spaced(grid, name)
    if type(grid).__name__ != "ImageData":
        raise VolumeError(f"{name}: is a {type(grid).__name__}; {_RESAMPLE}", code="type")
    cells = _has_cells_alone(grid)
    data = grid.cell_data if cells else grid.point_data
    available = list(data.keys())
    chosen = scalars or data.active_scalars_name or (available[0] if available else None)
    if chosen not in available:
        raise VolumeError(
            f"{name}: no scalars {chosen!r}; the grid has {available}", code="unknown"
        )
    array = np.asarray(data[chosen])
    if array.ndim != 1:
        raise VolumeError(
            f"{name}: {array.shape[-1]} components per voxel in {chosen!r}; a volume has one",
            code="shape",
        )
    shape = tuple(n - 1 if cells else n for n in grid.dimensions)
    if min(shape) < 2:
        raise VolumeError(
            f"{name}: {'x'.join(map(str, shape))} points; a volume is 3-D", code="shape"
        )
    spacing = np.asarray(grid.spacing, dtype=np.float64)
    if not (spacing > 0).all():
        raise VolumeError(
            f"{name}: spacing {tuple(spacing.tolist())} mm; each of x, y, z must be positive",
            code="range",
        )
    world = np.eye(4)
    world[:3, :3] = np.asarray(grid.direction_matrix) * spacing
    centre = np.full(3, 0.5 if cells else 0.0)
    world[:3, 3] = np.asarray(grid.origin) + world[:3, :3] @ centre
    return array.reshape(shape[::-1]), world


def _has_cells_alone(grid: Any) -> bool:
    """Return True if a grid has arrays of cells, and none of points."""
    return not len(grid.point_data) and len(grid.cell_data) > 0


def scalar_names(grid: Any) -> list[str]:
    """Return the names of a grid's arrays of numbers, without VTK's own such as ghost cells."""
    if not hasattr(grid, "point_data"):  # several grids in one
        return []
    data = grid.cell_data if _has_cells_alone(grid) else grid.point_data
    return [
        name
        for name, array in data.items()
        if np.ndim(array) == 1 and array.dtype.kind in "buif" and not name.startswith("vtk")
    ]


def _evenly_spaced(grid: Any, name: str) -> pyvista.ImageData:
    """Return a ``RectilinearGrid`` with evenly spaced planes as an ``ImageData``."""
    import pyvista

    spacing = []
    for axis, places in zip("xyz", (grid.x, grid.y, grid.z), strict=True):
        steps = np.diff(np.asarray(places, np.float64))
        if steps.size and not np.allclose(steps, steps.mean(), rtol=_EVEN):
            raise VolumeError(
                f"{name}: is a RectilinearGrid of uneven spacing, {steps.min():.4g} to "
                f"{steps.max():.4g} mm along {axis}; {_RESAMPLE}",
                code="unsupported",
            )
        spacing.append(float(steps.mean()) if steps.size else 1.0)
    origin = (grid.x[0], grid.y[0], grid.z[0])
    even = pyvista.ImageData(dimensions=grid.dimensions, spacing=spacing, origin=origin)
    even.copy_attributes(grid)
    return even


def volume_to_pyvista(volume: Volume) -> pyvista.ImageData:
    """Return a pyvista ``ImageData`` with a copy of the values as point scalars ``"values"``."""
    import pyvista

    world = volume.world_from_index
    assert world is not None and volume.spacing_mm is not None
    grid = pyvista.ImageData(
        dimensions=volume.shape_xyz, spacing=volume.spacing_mm, origin=world[:3, 3]
    )
    grid.direction_matrix = world[:3, :3] / np.asarray(volume.spacing_mm)
    # A copy, since VTK writes to arrays that NumPy marks as read-only.
    grid.point_data["values"] = volume.nan_if_missing(volume.values).flatten()
    return grid
