"""MRC, CCP4 and EM maps of electron microscopy, by mrcfile.

    header -> [mrc] -> Reading

References
----------
[1] MRC2014, A. Cheng et al., J. Struct. Biol. 192 (2015), 146-150: cell in Å, `mapc mapr maps` are
    the axes of columns, rows and sections, ORIGIN is the first voxel's place.
"""

from __future__ import annotations

import numpy as np

from volspec._extras import require_extra
from volspec.errors import VolumeError, one_line
from volspec.volume.files.lattice import affine
from volspec.volume.files.query import Query, Reading, Stored
from volspec.volume.metadata import NO_SPACING, Metadata

SUFFIXES = (".mrc", ".map", ".ccp4", ".st", ".ali", ".mrcs")
MAGIC = 208, b"MAP"
_ANGSTROM_MM = 1e-7
_HEADER = 1024


def read_mrc(query: Query) -> Reading:
    """Read a map, or one volume of a stack."""
    path = query.path
    require_extra("mrc", str(path))
    import mrcfile

    query.allow("time")
    try:
        with mrcfile.open(path, "r", permissive=True, header_only=True) as file:
            header = file.header
            dtype = mrcfile.utils.data_dtype_from_header(header)
            shape = mrcfile.utils.data_shape_from_header(header)
    except Exception as error:  # of whatever kind mrcfile raises for a damaged header
        raise VolumeError(
            f"{path}: its header cannot be read ({one_line(error):.120}); is the file complete?",
            code="damaged",
        ) from error
    if dtype.kind == "c":
        raise VolumeError(
            f"{path}: holds a transform of complex numbers",
            "give the map itself",
            code="unsupported",
        )
    steps, *size = shape if len(shape) == 4 else (1, *shape)
    step = query.index("time", steps, "volumes")
    query.end_choices()
    nbytes = int(np.prod(size)) * dtype.itemsize
    first = _HEADER + int(header.nsymbt)
    actual = path.stat().st_size - first
    query.require_held(actual, shape[::-1], steps * nbytes)
    values = Stored(str(path), tuple(size), dtype.str, first + step * nbytes)
    notes: list[str] = []
    world, assumed = _world_from_index(query, header, notes)
    return Reading(
        values,
        world_from_index=world,
        notes=[*notes, *query.surplus(actual, steps * nbytes)],
        metadata=Metadata(assumed=assumed),
    )


def _world_from_index(
    query: Query, header: np.recarray, notes: list[str]
) -> tuple[np.ndarray, tuple[str, ...]]:
    """Return the map to millimetres, and what is assumed if no size of a voxel is stated."""
    cell = np.array([header.cella.x, header.cella.y, header.cella.z], np.float64)
    counts = np.array([header.mx, header.my, header.mz], np.float64)
    axes = np.array([header.mapc, header.mapr, header.maps], int) - 1
    if sorted(axes) != [0, 1, 2]:
        axes = np.arange(3)
    with np.errstate(divide="ignore", invalid="ignore"):
        spacing = cell / counts * _ANGSTROM_MM
    assumed: tuple[str, ...] = ()
    if header.nz == 1 and not (np.isfinite(spacing[2]) and spacing[2] > 0):
        spacing[2] = spacing[0]
    if not (np.isfinite(spacing).all() and (spacing > 0).all()):
        spacing, assumed = np.ones(3), (NO_SPACING,)
        if query.spacing_mm is None:
            example = query.example(spacing="1e-7,1e-7,1e-7")
            notes.append(
                f"{query.path}: states no size of a voxel, 1 mm is assumed; {example} is 1 Å"
            )
    columns = np.zeros((3, 3))
    columns[axes, [0, 1, 2]] = spacing[axes]
    start = np.array([header.nxstart, header.nystart, header.nzstart], np.float64)
    origin = np.array([header.origin.x, header.origin.y, header.origin.z], np.float64)
    if np.isfinite(origin).all() and origin.any():
        return affine(columns, origin * _ANGSTROM_MM), assumed
    return affine(columns, columns @ start), assumed  # ``nxstart`` and its like, in voxels
