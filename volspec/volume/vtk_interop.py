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
    """Convert a pyvista ``ImageData``: its scalars, spacing, origin, extent and direction.

    A ``RectilinearGrid`` may be given instead if its planes are evenly spaced.

    Raises VolumeError if ``grid`` is not one, or its array is missing or has several components.
    """
    values, world = values_and_lattice(grid, scalars, None, name)
    return Volume(values, world_from_index=world, name=name)


def values_and_lattice(
    grid: pyvista.ImageData, scalars: str | None, component: int | None, name: str
) -> tuple[NDArray[Any], NDArray[np.float64]]:
    """Return a grid's scalars (Z, Y, X), not copied, and its world_from_index (4, 4)."""
    data, is_cells = _arrays(grid, name)
    available = list(data.keys())
    chosen = scalars or data.active_scalars_name or available[0]
    if chosen not in available:
        raise VolumeError(
            f"{name}: no scalars {chosen!r}; the grid has {available}", code="unknown"
        )
    array = np.asarray(data[chosen])
    if array.ndim > 1 and component is None:
        raise VolumeError(
            f"{name}: {array.shape[-1]} components per voxel in {chosen!r}",
            f"a volume has one: grid['one'] = grid[{chosen!r}][:, 0] makes scalars 'one'",
            code="shape",
        )
    shape = tuple(n - is_cells for n in grid.dimensions)
    if min(shape) < 2:
        raise VolumeError(
            f"{name}: {'x'.join(map(str, shape))} points; a volume is 3-D", code="shape"
        )
    if type(grid).__name__ == "RectilinearGrid":
        world = _even_planes(grid, name)
    else:
        world = np.eye(4)
        world[:3, :3] = np.asarray(grid.direction_matrix) * grid.spacing
        # Indices begin at the extent's.
        world[:3, 3] = np.asarray(grid.origin) + world[:3, :3] @ grid.extent[::2]
    if not (np.linalg.norm(world[:3, :3], axis=0) > 0).all():
        raise VolumeError(
            f"{name}: spacing {tuple(grid.spacing)} mm; none of x, y, z may be zero", code="range"
        )
    if is_cells:
        world[:3, 3] += world[:3, :3].sum(axis=1) / 2
    if array.ndim > 1:
        array = array.reshape(len(array), -1)[:, component]
    return array.reshape(shape[::-1]), world


def _arrays(grid: Any, name: str) -> tuple[Any, bool]:
    """Return a grid's arrays of points, or else of cells, and True if they are of cells."""
    kind = type(grid).__name__
    if kind not in ("ImageData", "RectilinearGrid"):
        raise VolumeError(f"{name}: is a {kind}; {_RESAMPLE}", code="type")
    is_cells = not len(grid.point_data)
    data = grid.cell_data if is_cells else grid.point_data
    if not len(data):
        raise VolumeError(
            f"{name}: holds no array", "save one with its grid, as point data", code="shape"
        )
    return data, is_cells


def scalar_names(grid: Any, name: str) -> list[tuple[str, int | None]]:
    """Return a grid's arrays of numbers, without VTK's own, and their components if several.

    Raises VolumeError if the grid is no lattice, or has none.
    """
    data, _ = _arrays(grid, name)
    found = [
        (key, part)
        for key, array in data.items()
        if array.dtype.kind in "buif" and not key.startswith("vtk")
        for part in ([None] if array.ndim == 1 else range(array[0].size))
    ]
    if not found:
        raise VolumeError(
            f"{name}: none of its arrays holds numbers; it has {', '.join(data)}", code="type"
        )
    return found


def _even_planes(grid: Any, name: str) -> NDArray[np.float64]:
    """Return world_from_index of a ``RectilinearGrid``, whose coordinates may descend."""
    world = np.eye(4)
    for axis, places in enumerate((grid.x, grid.y, grid.z)):
        steps = np.diff(np.asarray(places, np.float64))
        if steps.size and not np.allclose(steps, steps.mean(), rtol=_EVEN):
            raise VolumeError(
                f"{name}: is a RectilinearGrid of uneven spacing, {steps.min():.4g} to "
                f"{steps.max():.4g} mm along {'xyz'[axis]}; {_RESAMPLE}",
                code="unsupported",
            )
        world[axis, axis] = steps.mean() if steps.size else 1.0
        world[axis, 3] = places[0]
    return world


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
