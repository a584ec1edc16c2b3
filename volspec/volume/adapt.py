"""Volumes to and from pyvista (VTK).

Cell scalars are taken where a grid has no point scalars; their lattice is the cells' centres.
"""

from __future__ import annotations

import logging
import warnings
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from volspec.errors import VolumeError
from volspec.volume.headers import check_vtk_length
from volspec.volume.model import Volume

if TYPE_CHECKING:
    import pyvista


def read_vtk_image(path: Path) -> Volume:
    """Read ``.vti`` or ``.vtk`` image data.

    Raises
    ------
    VolumeError
        If VTK reports an error, the file ends early or holds something other than image data.
    """
    import pyvista
    from pyvista.core.utilities.observers import VtkErrorCatcher
    from vtkmodules.vtkCommonCore import vtkLogger, vtkObject

    check_vtk_length(path)
    # VTK prints its complaints, pyvista logs them again; what the user needs is one line.
    before = vtkLogger.GetCurrentVerbosityCutoff()
    # Where another library has switched VTK's warnings off, its errors would not reach us either.
    told = vtkObject.GetGlobalWarningDisplay()
    vtkObject.SetGlobalWarningDisplay(1)
    vtkLogger.SetStderrVerbosity(vtkLogger.VERBOSITY_OFF)
    logging.disable(logging.ERROR)
    try:
        with (
            VtkErrorCatcher(raise_errors=True, send_to_logging=False),
            warnings.catch_warnings(),
        ):
            # pyvista warns of errors that it caught itself.
            warnings.filterwarnings("error", ".*raised an error while reading", UserWarning)
            grid = pyvista.read(path)
    except (OSError, ValueError, RuntimeError, TypeError, UserWarning) as error:
        raise VolumeError(
            f"{path}: not readable as VTK image data; is the file complete and of the type its "
            "name says?"
        ) from error
    finally:
        logging.disable(logging.NOTSET)
        vtkLogger.SetStderrVerbosity(before)
        vtkObject.SetGlobalWarningDisplay(told)
    return volume_from_pyvista(grid, name=str(path))


def volume_from_pyvista(
    grid: pyvista.ImageData,
    scalars: str | None = None,
    *,
    name: str = "pyvista grid",
) -> Volume:
    """Take over a pyvista ``ImageData``: its scalars, spacing, origin and direction.

    Raises
    ------
    VolumeError
        If it is not an ``ImageData``, has no such array, or the array is not one scalar a point.
    """
    if type(grid).__name__ != "ImageData":
        raise VolumeError(
            f"{name}: is a {type(grid).__name__}; volspec casts regular grids, "
            "resample it to ImageData first"
        )
    cells = scalars is None and not len(grid.point_data) and len(grid.cell_data) > 0
    data = grid.cell_data if cells else grid.point_data
    available = list(data.keys())
    chosen = scalars or data.active_scalars_name or (available[0] if available else None)
    if chosen not in available:
        raise VolumeError(f"{name}: no scalars {chosen!r}; the grid has {available}")
    array = np.asarray(data[chosen])
    if array.ndim != 1:
        raise VolumeError(
            f"{name}: {array.shape[-1]} components a voxel in {chosen!r}; a volume has one"
        )
    shape = tuple(n - 1 if cells else n for n in grid.dimensions)
    if min(shape) < 2:
        raise VolumeError(f"{name}: {'x'.join(map(str, shape))} points; a volume is 3-D")
    spacing = np.asarray(grid.spacing, dtype=np.float64)
    if not (spacing > 0).all():
        raise VolumeError(
            f"{name}: spacing {tuple(spacing.tolist())} mm; each of x, y, z must be positive"
        )
    world = np.eye(4)
    world[:3, :3] = np.asarray(grid.direction_matrix) * spacing
    centre = np.full(3, 0.5 if cells else 0.0)
    world[:3, 3] = np.asarray(grid.origin) + world[:3, :3] @ centre
    return Volume(array.reshape(shape[::-1]), world_from_index=world, name=name)


def volume_to_pyvista(volume: Volume) -> pyvista.ImageData:
    """A pyvista ``ImageData`` with a copy of the values as point scalars ``"values"``."""
    import pyvista

    world = volume.world_from_index
    assert world is not None and volume.spacing_mm is not None
    grid = pyvista.ImageData(
        dimensions=volume.shape_xyz, spacing=volume.spacing_mm, origin=world[:3, 3]
    )
    grid.direction_matrix = world[:3, :3] / np.asarray(volume.spacing_mm)
    # A copy: VTK writes where NumPy says read-only.
    grid.point_data["values"] = volume.values.flatten()
    return grid
