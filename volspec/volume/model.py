"""A scalar volume: values, spacing and orientation, valid at birth.

    [volume] -> transfer -> raycast -> relight -> appearance

Values are stored ``(Z, Y, X)``, x fastest, in the type the file had (8- and 16-bit integers
and float32 stay as they are). Positions are voxel centres: index (i, j, k) along x, y, z lies
at ``world_from_index @ (i, j, k, 1)`` millimetres.
"""

from __future__ import annotations

import operator
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from volspec.errors import VolumeError
from volspec.volume.checks import checked_geometry, checked_values
from volspec.volume.downsample import block_means, block_modes, downsampled_values
from volspec.volume.foreign import unwrapped

if TYPE_CHECKING:
    import pyvista


@dataclass(frozen=True, slots=True, eq=False)
class Volume:
    """A scalar field on a regular lattice.

    Parameters
    ----------
    values : (Z, Y, X) array
        NumPy, xarray or Zarr; uint8, uint16, int16 and float32 are kept. Wider integers
        become the smallest of these integers that holds them all, other types float32 (int8
        becomes int16). NaN and infinities are counted and warned about: +inf becomes the
        greatest finite value, NaN and -inf the least. An array that is kept as it is stays shared
        and is read-only here: do not change it while the volume is in use, or give a copy.
        An xarray ``DataArray`` with dimensions x, y and z is turned to (Z, Y, X), and stands at
        its coordinates, taken for millimetres, where neither of the next two is given.
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
        If it is no 3-D array of real numbers, has fewer than two voxels along an axis or no
        finite value, or the geometry is singular or, of coordinates, uneven.

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
        given, placed = unwrapped(self.values, self.name)
        values, span = checked_values(given, self.name)
        if self.spacing_mm is None and self.world_from_index is None:
            object.__setattr__(self, "world_from_index", placed)
        spacing, world = checked_geometry(self.spacing_mm, self.world_from_index, self.name)
        object.__setattr__(self, "values", values)
        object.__setattr__(self, "spacing_mm", spacing)
        object.__setattr__(self, "world_from_index", world)
        object.__setattr__(self, "range", span)

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
        spacing, _ = checked_geometry(spacing_mm, None, self.name)
        world = self.world_from_index.copy()
        world[:3, :3] *= np.asarray(spacing) / np.asarray(self.spacing_mm)
        return Volume(self.values, world_from_index=world, name=self.name)

    def downsampled(self, factor: int, *, labels: bool = False) -> Volume:
        """The same volume with one voxel for every block of factor³, of the same type.

        A new voxel stands at its block's centre. The lattice stays regular: where the factor
        does not divide a count, the last block holds fewer voxels, and what it yields stands
        where a whole block's centre would, up to (factor - 1) / 2 old voxels too far out.

        Parameters
        ----------
        factor : int
            Old voxels along a block's edge, from 1.
        labels : bool
            Take a block's most frequent value (of equally frequent ones the least) instead of
            its mean.

        Raises
        ------
        VolumeError
            If the factor is no whole number from 1, or leaves fewer than two voxels along an
            axis.

        Examples
        --------
        >>> half = Volume(np.zeros((4, 6, 7), np.uint8)).downsampled(2)
        >>> half.shape_xyz, half.spacing_mm, half.world_from_index[:3, 3].tolist()
        ((4, 3, 2), (2.0, 2.0, 2.0), [0.5, 0.5, 0.5])
        """
        try:
            step = operator.index(factor)
        except TypeError:
            step = 0
        if step < 1:
            raise VolumeError(
                f"{self.name}: down-sampled by {factor!r:.40}; give a whole number from 1"
            )
        least = min(self.shape_xyz)
        if -(-least // step) < 2:
            raise VolumeError(
                f"{self.name}: down-sampled by {step}, {least} voxels leave one; a volume has at "
                f"least two along each axis, give a factor below {least}"
            )
        index_from_new = np.diag([step, step, step, 1.0])
        index_from_new[:3, 3] = (step - 1) / 2
        return Volume(
            downsampled_values(self.values, step, block_modes if labels else block_means),
            world_from_index=self.world_from_index @ index_from_new,
            name=self.name,
        )

    @classmethod
    def of(cls, given: Volume | pyvista.ImageData | ArrayLike) -> Volume:
        """A volume as it is, a pyvista ``ImageData``, or an array (Z, Y, X).

        Voxels are 1 mm, unless it is an xarray ``DataArray`` with coordinates.
        """
        if isinstance(given, cls):
            return given
        if hasattr(given, "point_data"):
            return cls.from_pyvista(given)
        return cls(given)  # type: ignore[arg-type]

    @classmethod
    def from_pyvista(cls, grid: pyvista.ImageData, scalars: str | None = None) -> Volume:
        """Take over a pyvista ``ImageData`` (point scalars, or cell scalars where alone)."""
        from volspec.volume.adapt import volume_from_pyvista

        return volume_from_pyvista(grid, scalars)

    def to_pyvista(self) -> pyvista.ImageData:
        """A pyvista ``ImageData`` with a copy of the values as point scalars ``"values"``."""
        from volspec.volume.adapt import volume_to_pyvista

        return volume_to_pyvista(self)
