"""A scalar volume: values, spacing and orientation, valid at birth.

    [volume] -> transfer -> raycast -> relight -> appearance

Values are stored ``(Z, Y, X)``, x fastest, in the type the file had (8- and 16-bit integers
and float32 stay as they are). Positions are voxel centres: index (i, j, k) along x, y, z lies
at ``world_from_index @ (i, j, k, 1)`` millimetres.
"""

from __future__ import annotations

import warnings
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from volspec.errors import VolspecWarning, VolumeError

if TYPE_CHECKING:
    import pyvista

# What the kernels read as it is; everything else becomes the nearest of these that holds it.
KEPT_DTYPES = (np.uint8, np.uint16, np.int16, np.float32)
_WIDENED = {"b1": np.uint8, "i1": np.int16}


@dataclass(frozen=True, slots=True, eq=False)
class Volume:
    """A scalar field on a regular lattice.

    Parameters
    ----------
    values : (Z, Y, X) array
        NumPy, xarray or Zarr; uint8, uint16, int16 and float32 are kept, other types
        become float32 (int8 becomes int16). NaN and infinities are counted, warned about
        and replaced by the least finite value.
    spacing_mm : (x, y, z), optional
        Distance of neighbouring voxel centres; positive. Read from ``world_from_index``
        where that is given, else 1 mm.
    world_from_index : (4, 4), optional
        Affine map from voxel index (i, j, k) along (x, y, z) to millimetres. Default:
        the spacing on the diagonal, the first voxel at the origin.
    name : str
        Used in messages.

    Raises
    ------
    VolumeError
        If the array is not 3-D, has fewer than two voxels along an axis or no finite value, or
        the geometry is singular.

    Examples
    --------
    >>> volume = Volume(np.zeros((2, 3, 4), np.uint8), spacing_mm=(1, 1, 2.5))
    >>> volume.shape_xyz, volume.world_from_index[2].tolist()
    ((4, 3, 2), [0.0, 0.0, 2.5, 0.0])
    """

    values: NDArray[Any]
    # None is only how the caller leaves them out: both are always set after __post_init__.
    spacing_mm: tuple[float, float, float] = None  # type: ignore[assignment]
    world_from_index: NDArray[np.float64] = None  # type: ignore[assignment]
    name: str = "volume"
    range: tuple[float, float] = field(init=False)

    def __post_init__(self) -> None:
        values = _checked_values(self.values, self.name)
        spacing, world = _checked_geometry(self.spacing_mm, self.world_from_index, self.name)
        object.__setattr__(self, "values", values)
        object.__setattr__(self, "spacing_mm", spacing)
        object.__setattr__(self, "world_from_index", world)
        object.__setattr__(self, "range", (float(values.min()), float(values.max())))

    def __repr__(self) -> str:
        x, y, z = self.shape_xyz
        return f"Volume({self.name!r}, {x}x{y}x{z} {self.values.dtype}, {self.spacing_mm} mm)"

    @property
    def shape_xyz(self) -> tuple[int, int, int]:
        """Voxel counts along x, y, z."""
        z, y, x = self.values.shape
        return x, y, z

    @property
    def index_from_world(self) -> NDArray[Any]:
        """(4, 4) inverse of `world_from_index`."""
        return np.linalg.inv(self.world_from_index)

    @property
    def corners_mm(self) -> NDArray[np.float64]:
        """(8, 3) world positions of the outermost voxel centres."""
        x, y, z = self.shape_xyz
        index = [(i, j, k, 1.0) for k in (0, z - 1) for j in (0, y - 1) for i in (0, x - 1)]
        return (np.array(index) @ self.world_from_index.T)[:, :3]

    def with_spacing(self, spacing_mm: tuple[float, float, float]) -> Volume:
        """The same volume with another spacing; directions and the first voxel stay.

        Raises
        ------
        VolumeError
            If a number is not positive.
        """
        spacing, _ = _checked_geometry(spacing_mm, None, self.name)
        world = self.world_from_index.copy()
        world[:3, :3] *= np.asarray(spacing) / np.asarray(self.spacing_mm)
        return Volume(self.values, world_from_index=world, name=self.name)

    @classmethod
    def of(cls, given: Volume | pyvista.ImageData | ArrayLike) -> Volume:
        """A volume as it is, a pyvista ``ImageData``, or an array (Z, Y, X) of 1 mm voxels."""
        if isinstance(given, cls):
            return given
        if hasattr(given, "point_data"):
            return cls.from_pyvista(given)
        return cls(np.asarray(given))

    @classmethod
    def from_pyvista(cls, grid: pyvista.ImageData, scalars: str | None = None) -> Volume:
        """Take over a pyvista ``ImageData`` (point scalars, or cell scalars where alone)."""
        from volspec.volume.adapt import volume_from_pyvista

        return volume_from_pyvista(grid, scalars)

    def to_pyvista(self) -> pyvista.ImageData:
        """A pyvista ``ImageData`` with the values as point scalars ``"values"``."""
        from volspec.volume.adapt import volume_to_pyvista

        return volume_to_pyvista(self)


def _checked_values(given: ArrayLike, name: str) -> NDArray[Any]:
    values = np.asarray(given)
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
    if values.dtype.kind not in "buif":
        raise VolumeError(f"{name}: values of type {values.dtype} are not real numbers")
    if values.dtype.newbyteorder("=") not in KEPT_DTYPES:
        wider = _WIDENED.get(f"{values.dtype.kind}{values.dtype.itemsize}", np.float32)
        # Doubles beyond float32 become infinite here and are counted below.
        with np.errstate(over="ignore"):
            widened = values.astype(wider)
        if values.dtype.kind == "f" and (np.isfinite(values) & ~np.isfinite(widened)).any():
            raise VolumeError(
                f"{name}: values up to {np.abs(values[np.isfinite(values)]).max():g} exceed "
                "float32; rescale the volume"
            )
        if values.dtype.kind in "iu" and not np.array_equal(widened.astype(values.dtype), values):
            warnings.warn(
                f"{name}: {values.dtype} values beyond 2^24 lose their last digits as float32; "
                "subtract an offset first",
                VolspecWarning,
                stacklevel=4,
            )
        values = widened
    values = np.ascontiguousarray(values, dtype=values.dtype.newbyteorder("="))
    if values.dtype.kind == "f":
        values = _finite(values, name)
    values = values.view()
    values.flags.writeable = False
    return values


def _finite(values: NDArray[Any], name: str) -> NDArray[Any]:
    bad = ~np.isfinite(values)
    count = int(bad.sum())
    if not count:
        return values
    if count == values.size:
        raise VolumeError(f"{name}: none of the {count} voxels is a finite float32 number")
    least = values[~bad].min()
    warnings.warn(
        f"{name}: {count} of {values.size} voxels are NaN or infinite; "
        f"treated as the minimum, {least:g}",
        VolspecWarning,
        stacklevel=5,
    )
    return np.where(bad, least, values)


def _checked_geometry(
    spacing: tuple[float, float, float] | None,
    world: ArrayLike | None,
    name: str,
) -> tuple[tuple[float, float, float], NDArray[np.float64]]:
    if spacing is not None:
        spacing_array = np.asarray(spacing, dtype=np.float64)
        if spacing_array.shape != (3,):
            raise VolumeError(f"{name}: spacing_mm is {spacing}; give three numbers (x, y, z)")
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
        matrix = np.array(world, dtype=np.float64)
        if matrix.shape != (4, 4) or not np.isfinite(matrix).all():
            raise VolumeError(f"{name}: world_from_index must be a finite (4, 4) matrix")
        lengths = np.linalg.norm(matrix[:3, :3], axis=0)
        if (lengths <= 0).any() or abs(np.linalg.det(matrix[:3, :3] / lengths)) < 1e-6:
            raise VolumeError(
                f"{name}: the orientation matrix {matrix[:3, :3].tolist()} is singular; "
                "its columns must be independent directions"
            )
        if spacing is not None and not np.allclose(lengths, spacing_array, rtol=1e-4):
            raise VolumeError(
                f"{name}: spacing {tuple(spacing_array.tolist())} mm and world_from_index "
                f"(columns {lengths.round(6).tolist()} mm) disagree; give one of them"
            )
        spacing_array = lengths
    matrix.flags.writeable = False
    x, y, z = (float(v) for v in spacing_array)
    return (x, y, z), matrix
