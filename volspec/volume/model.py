"""A volume: values, spacing and orientation of one or more fields, validated on construction.

    [volume] -> transfer -> raycast -> relight -> appearance

Values are stored ``(Z, Y, X)``, x fastest, in the file's type (8- and 16-bit integers
and float32 stay as they are). Positions are voxel centres: index (i, j, k) along x, y, z lies
at ``world_from_index @ (i, j, k, 1)`` millimetres.
"""

from __future__ import annotations

import dataclasses
import math
import operator
from bisect import bisect_left
from collections.abc import Callable, Iterable
from copy import copy
from dataclasses import dataclass, field, replace
from types import MappingProxyType
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from volspec._extras import require_extra
from volspec.errors import VolumeError
from volspec.volume.channels import Channel
from volspec.volume.checks import (
    BELOW,
    array_and_lattice,
    checked_geometry,
    checked_values,
    missing_value,
)
from volspec.volume.files.lattice import mm_per_unit
from volspec.volume.files.vtk_grid import volume_fields
from volspec.volume.labels import Labels, renumber_labels
from volspec.volume.levels.pyramid import Pyramid
from volspec.volume.levels.sample import typical_range
from volspec.volume.metadata import Metadata

if TYPE_CHECKING:
    import pyvista

# Voxels along each axis that are looked at for the typical range.
_LOOKED_AT = 40

Summary = Callable[[NDArray[Any]], NDArray[Any]]
"""(N, M) blocks of M voxels -> (N,)"""


@dataclass(frozen=True, slots=True, eq=False)
class Volume:
    """A scalar field on a regular lattice, and further fields in the same space.

    Parameters
    ----------
    values : (Z, Y, X) array
        NumPy, xarray or Zarr; uint8, uint16, int16 and float32 are used without conversion. Wider
        integers become the smallest of these integer types that can represent all values, other
        types float32 (int8 becomes int16). NaN, infinities and what a ``numpy.ma`` array masks are
        missing voxels, which are transparent; there is a warning, and they hold the value
        ``missing``. An array that needs no conversion is shared and read-only here: do not change
        it while the volume is in use, or pass a copy. An xarray ``DataArray`` with dimensions x, y
        and z is transposed to (Z, Y, X); its coordinates, in millimetres, define the geometry if
        neither of the next two parameters is given.
    spacing_mm : (x, y, z), optional
        Distance between neighbouring voxel centres; positive. Default: from ``world_from_index``,
        or 1 mm.
    world_from_index : (4, 4), optional
        Affine map from voxel index (i, j, k) along (x, y, z) to millimetres. Default:
        the spacing on the diagonal, the first voxel at the origin.
    name : str
        Used in messages.
    missing : float, optional
        Value of missing voxels, below all others; None if there are none. Given only with the
        values of another volume.
    labels : {number: Label}, optional
        Labels of a segmentation with names and colours, without the background; empty if the
        values are not labels. If some are above 65535, voxels hold consecutive numbers instead.
    numbers : sequence of int, optional
        The labels' own numbers, by the value that voxels hold instead. Given only with the values
        of another volume.
    channel : Channel, optional
        What a microscope's file says of the channel, such as its colour.
    fields : sequence of Volume, optional
        Further fields, such as a microscope's other channels or a PET in its CT: each has a name,
        a type and a lattice of its own, and none has further ones.
    pyramid : Pyramid, optional
        Finer levels of a volume that is larger than memory; ``values`` are its coarsest. Casts read
        those that the picture shows (`volspec.load_volume`).
    metadata : Metadata
        What its file states: the unit of the values, whether the axes are a patient's.

    Raises
    ------
    VolumeError
        If ``values`` is not a 3-D array of real numbers, has fewer than two voxels along an axis or
        no finite value, the geometry is singular, coordinates are uneven, or two fields have
        the same name.

    Examples
    --------
    >>> volume = Volume(np.zeros((2, 3, 4), np.uint8), spacing_mm=(1, 1, 2.5))
    >>> volume.shape_xyz, volume.world_from_index[2].tolist()
    ((4, 3, 2), [0.0, 0.0, 2.5, 0.0])
    """

    values: NDArray[Any]
    # None only as constructor arguments: __post_init__ always sets both.
    spacing_mm: tuple[float, float, float] = None  # type: ignore[assignment]
    world_from_index: NDArray[np.float64] = None  # type: ignore[assignment]
    name: str = "volume"
    missing: float | None = None
    labels: Labels = field(default_factory=dict)
    numbers: tuple[int, ...] = ()
    channel: Channel = field(default_factory=Channel)
    fields: tuple[Volume, ...] = ()
    pyramid: Pyramid | None = None
    metadata: Metadata = field(default_factory=Metadata)
    range: tuple[float, float] = field(init=False)
    typical_range: tuple[float, float] = field(init=False)

    def __post_init__(self) -> None:
        array, lattice = array_and_lattice(self.values, self.name)
        if self.labels and not self.numbers:
            array, numbers = renumber_labels(np.asarray(array), certain=True)
            object.__setattr__(self, "numbers", numbers)
        values, span, missing = checked_values(array, self.name, self.missing)
        if self.pyramid is not None:
            span, missing = self.pyramid.range, self.pyramid.missing
        if self.spacing_mm is None and self.world_from_index is None:
            object.__setattr__(self, "world_from_index", lattice)
        spacing, world = checked_geometry(self.spacing_mm, self.world_from_index, self.name)
        object.__setattr__(self, "labels", MappingProxyType(dict(self.labels)))
        object.__setattr__(self, "missing", missing)
        object.__setattr__(self, "values", values)
        object.__setattr__(self, "spacing_mm", spacing)
        object.__setattr__(self, "world_from_index", world)
        object.__setattr__(self, "range", span)
        object.__setattr__(self, "typical_range", self._typical_range())
        object.__setattr__(self, "fields", checked_fields(self))

    def __setstate__(self, state: list[Any]) -> None:
        for attribute, value in zip(dataclasses.fields(self), state, strict=True):
            object.__setattr__(self, attribute.name, value)
        for array in (self.values, self.world_from_index):  # a pickled array can be written to
            array.flags.writeable = False

    def __repr__(self) -> str:
        x, y, z = self.shape_xyz
        more = f" and {len(self.fields)} more" if self.fields else ""
        return f"Volume({self.name!r}, {x}x{y}x{z} {self.values.dtype}{more}, {self.spacing_mm} mm)"

    def _typical_range(self) -> tuple[float, float]:
        if self.values.dtype == np.uint8:  # has no values to spare for what was not measured
            return self.range
        voxels: Any = self.values
        minimum, maximum = self.range
        if self.pyramid is not None and self.pyramid.sample is not None:
            voxels = self.pyramid.sample.voxels
        sampled = tuple(slice(None, None, -(-n // _LOOKED_AT)) for n in voxels.shape)
        low, high = typical_range(voxels[sampled], self.range)
        # Of all voxels, not of those that were looked at.
        if low > minimum:
            low = float(voxels.min(where=voxels > minimum, initial=voxels.dtype.type(low)))
        if high < maximum:
            high = float(voxels.max(where=voxels < maximum, initial=voxels.dtype.type(high)))
        return low, high

    @property
    def shape_xyz(self) -> tuple[int, int, int]:
        """Voxel counts along x, y, z."""
        z, y, x = self.values.shape
        return x, y, z

    @property
    def title(self) -> str:
        """Name for people: that of its channel, or its own without folders."""
        return self.channel.name or self.file_name

    @property
    def file_name(self) -> str:
        """Its own name without folders, for what is meant to be sent."""
        place, mark, query = self.name.replace("\\", "/").partition("?")
        return place.rpartition("/")[2] + mark + query

    @property
    def by_name(self) -> dict[str, Volume]:
        """All fields by name, its own first."""
        return {volume.name: volume for volume in (self, *self.fields)}

    @property
    def by_role(self) -> dict[str, Volume]:
        """All fields by name, its own, whatever it is called, as ``""`` first."""
        return {"": self} | {volume.name: volume for volume in self.fields}

    @property
    def finest_mm(self) -> float:
        """Smallest spacing of all fields, in mm."""
        return min(min(volume.spacing_mm) for volume in (self, *self.fields))

    @property
    def smallest_mm(self) -> float:
        """Smallest spacing of its own field, in mm; of its finest level, if it has several."""
        return min(self.finest.spacing_mm)

    @property
    def finest(self) -> Volume:
        """The lattice of its finest level, if it has several: its values are not there."""
        return self if self.pyramid is None else self.at_level(0)

    def has_lattice_of(self, other: Volume) -> bool:
        """Return True if the voxels of two fields lie at the same places."""
        return self.shape_xyz == other.shape_xyz and np.allclose(
            self.world_from_index, other.world_from_index, rtol=1e-9, atol=1e-6 * self.finest_mm
        )

    def nan_if_missing(self, values: NDArray[Any]) -> NDArray[Any]:
        """Return some of the values, with NaN for missing voxels."""
        return values if self.missing is None else np.where(values == self.missing, np.nan, values)

    def stated(self, values: ArrayLike) -> NDArray[Any]:
        """Return some of the values as given, if voxels hold other numbers of labels or logarithms.

        >>> from volspec.volume.labels import Label
        >>> atlas = Volume(np.full((2, 2, 2), 614454277), labels={614454277: Label("SCs")})
        >>> atlas.range, atlas.stated(atlas.range).tolist()
        ((1.0, 1.0), [614454277, 614454277])
        """
        voxels = np.asarray(values)
        if self.metadata.is_log:
            return np.asarray(10.0 ** voxels.astype(np.float64))
        return np.asarray(self.numbers)[voxels.astype(np.intp)] if self.numbers else voxels

    def value_of(self, number: int) -> int:
        """Return the value of the voxels of a label's number; one of none if there are none."""
        if not self.numbers:
            return number
        value = bisect_left(self.numbers, number)
        exists = value < len(self.numbers) and self.numbers[value] == number
        return value if exists else len(self.numbers) + number

    @property
    def least_present(self) -> float:
        """Value below which voxels, and values interpolated with them, are missing; −inf if none.

        It is a range below the least voxel.
        """
        low = self.range[0]
        return -math.inf if self.missing is None else low - (low - self.missing) / BELOW

    @property
    def index_from_world(self) -> NDArray[Any]:
        """(4, 4) inverse of `world_from_index`."""
        return np.linalg.inv(self.world_from_index)

    @property
    def corners_mm(self) -> NDArray[np.float64]:
        """(8, 3) world positions of the outermost voxel centres."""
        finest = self.finest
        x, y, z = finest.shape_xyz
        index = [(i, j, k, 1.0) for k in (0, z - 1) for j in (0, y - 1) for i in (0, x - 1)]
        return (np.array(index) @ finest.world_from_index.T)[:, :3]

    def scaled(self, factor: float) -> Volume:
        """Return the field with float values multiplied by a power of two; further fields stay."""
        low, high, begin, end = (bound * factor for bound in (*self.range, *self.typical_range))
        values, missing = self.values * np.float32(factor), None
        if self.missing is not None:  # float32 may have had no room for it
            missing = missing_value(low, high)
            values[self.values == self.missing] = missing
        changes = {"missing": missing, "range": (low, high), "typical_range": (begin, end)}
        return self._changed(values=values, **changes)

    def at_level(self, number: int) -> Volume:
        """Return the lattice of a level of the pyramid, 0 the finest: its values are not there."""
        assert self.pyramid is not None
        level = self.pyramid.levels[number]
        spacing, world = checked_geometry(None, level.world_from_index, self.name)
        nothing = np.broadcast_to(np.zeros((), self.pyramid.dtype), level.shape)
        changes = {"values": nothing, "spacing_mm": spacing, "world_from_index": world}
        return self._changed(**changes)

    def _changed(self, **changes: Any) -> Volume:
        """Return a copy with other attributes, which are not checked."""
        volume = copy(self)
        for key, value in changes.items():
            object.__setattr__(volume, key, value)
        return volume

    @property
    def finest_from_index(self) -> NDArray[np.float64]:
        """(4, 4) map to the indices of the pyramid's finest level, in which crops are given."""
        if self.pyramid is None:
            return np.eye(4)
        return np.linalg.inv(self.pyramid.levels[0].world_from_index) @ self.world_from_index

    def with_fields(self, fields: Iterable[Volume]) -> Volume:
        """Return this volume with other further fields.

        Raises
        ------
        VolumeError
            If two have the same name, or one has fields of its own.
        """
        volume = copy(self)
        object.__setattr__(volume, "fields", tuple(fields))
        object.__setattr__(volume, "fields", checked_fields(volume))
        return volume

    def of_series(
        self,
        name: str,
        dtype: np.dtype[Any],
        low: float,
        high: float,
        missing: bool,
        typical: tuple[float, float],
        labels: Labels,
    ) -> Volume:
        """Return this volume as a time step, with the name, type, ranges and labels of all.

        ``missing`` is True if some step has missing voxels, which then have one value in all.

        >>> step = Volume(np.eye(2)[None].repeat(2, 0))
        >>> step.of_series("beat", np.dtype("f4"), 0, 9, False, (0, 9), {}).range
        (0, 9)
        """
        values = self.values.astype(dtype, copy=False)
        below = missing_value(low, high) if missing else None
        if below is not None and self.missing is not None:
            values = np.where(values == self.missing, np.float32(below), values)
        values.flags.writeable = False
        changes = {"missing": below, "range": (low, high), "typical_range": typical}
        return self._changed(name=name, values=values, labels=labels, **changes)

    def is_step_of(self, other: Volume) -> bool:
        """Return True if two volumes may be steps of one series: only their values differ."""
        if self.by_role.keys() != other.by_role.keys():
            return False
        return all(
            (one.name, one.range, one.missing, one.labels, one.numbers)
            == (two.name, two.range, two.missing, two.labels, two.numbers)
            and one.has_lattice_of(two)
            for one, two in zip(self.by_role.values(), other.by_role.values(), strict=True)
        )

    def with_spacing(self, spacing_mm: tuple[float, float, float]) -> Volume:
        """Return this volume with another spacing; directions and the first voxel's position stay.

        Fields on the same lattice follow; others stay.

        Raises
        ------
        VolumeError
            If a number is not positive.
        """
        spacing, _ = checked_geometry(spacing_mm, None, self.name)
        pyramid, details = self.pyramid, self.metadata.given(None, True)
        if pyramid is not None:
            finest = self.at_level(0).spacing_mm
            pyramid = pyramid.with_spacing(np.divide(spacing, finest).tolist())
            world = pyramid.levels[-1].world_from_index
            return replace(
                self,
                spacing_mm=None,  # type: ignore[arg-type]
                world_from_index=world,
                pyramid=pyramid,
                metadata=details,
            )
        world = self.world_from_index.copy()
        world[:3, :3] *= np.asarray(spacing) / np.asarray(self.spacing_mm)
        fields = [
            volume.with_spacing(spacing) if volume.has_lattice_of(self) else volume
            for volume in self.fields
        ]
        return replace(
            self, spacing_mm=spacing, world_from_index=world, fields=tuple(fields), metadata=details
        )

    def downsampled(self, factor: int, *, labels: bool = False) -> Volume:
        """Return this volume with one voxel, of the same type, for every block of factor³.

        A new voxel lies at its block's centre. The lattice stays regular: if the factor does not
        divide a count, the last block holds fewer voxels, but its new voxel lies at a whole
        block's centre, up to (factor - 1) / 2 old voxels too far out.

        Parameters
        ----------
        factor : int
            Old voxels along a block's edge, from 1.
        labels : bool
            Use a block's most frequent value (the least, if tied) instead of its mean.

        Raises
        ------
        VolumeError
            If the factor is not a whole number from 1, or leaves fewer than two voxels along an
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
                f"{self.name}: downsampled by {factor!r:.40}",
                "give a whole number from 1",
                code="range",
                given=factor,
            )
        if self.pyramid is not None and step > 1:
            raise VolumeError(
                f"{self.name}: is larger than memory, so that it cannot be downsampled by {step}",
                "give a level of detail: ?level=1 after its name, or level = 1 in [raycast]",
                code="conflict",
                given=factor,
            )
        shortest = min(self.shape_xyz)
        if -(-shortest // step) < 2:
            raise VolumeError(
                f"{self.name}: downsampled by {step}, {shortest} voxels leave one",
                f"a volume has at least two along each axis, give a factor below {shortest}",
                code="range",
                given=factor,
            )
        index_from_new = np.diag([step, step, step, 1.0])
        index_from_new[:3, 3] = (step - 1) / 2
        summary: Summary = block_modes if labels else block_means
        if self.missing is not None:
            summary = present_means(self.missing)
        return replace(
            self,
            values=downsample(self.values, step, summary),
            spacing_mm=None,  # type: ignore[arg-type]
            world_from_index=self.world_from_index @ index_from_new,
            fields=tuple(
                volume.downsampled(factor, labels=bool(volume.labels)) for volume in self.fields
            ),
        )

    @classmethod
    def of(cls, source: Volume | pyvista.ImageData | ArrayLike) -> Volume:
        """Return a given volume, or make one of a pyvista grid, napari layer or array (Z, Y, X).

        An array's spacing is 1 mm, unless it is an xarray ``DataArray`` with coordinates.
        """
        if isinstance(source, cls):
            return source
        if hasattr(source, "point_data"):
            return cls.from_pyvista(source)
        if hasattr(source, "data_to_world"):
            return cls.from_layer(source)
        return cls(source)  # type: ignore[arg-type]  # the constructor checks it

    @classmethod
    def empty(cls, low_mm: ArrayLike, high_mm: ArrayLike) -> Volume:
        """Return a volume with nothing in it between two corners (3,), for meshes alone.

        Sides of no length become a twentieth of the longest.

        Examples
        --------
        >>> Volume.empty((-1, -1, 0), (1, 1, 0)).spacing_mm
        (2.0, 2.0, 0.1)
        """
        low, high = np.asarray(low_mm, np.float64), np.asarray(high_mm, np.float64)
        sides = high - low
        thin = np.maximum(sides, (sides.max() or 1.0) / 20.0) - sides
        world_from_index = np.diag([*(sides + thin), 1.0])
        world_from_index[:3, 3] = low - thin / 2.0
        values = np.zeros((2, 2, 2), np.uint8)
        return cls(values, world_from_index=world_from_index, name="empty volume")

    @property
    def is_empty(self) -> bool:
        """True if it is as `empty` makes it: least in size, and all 0."""
        return self.values.size == 8 and self.range == (0.0, 0.0)

    @classmethod
    def from_pyvista(cls, grid: pyvista.ImageData, scalars: str | None = None) -> Volume:
        """Convert a pyvista ``ImageData``: its point scalars, or cell scalars if it has no others.

        Hidden points and cells (``vtkGhostType``) are missing voxels.

        Raises
        ------
        VolumeError
            If ``grid`` is not one, has no such array, or the array has several components.
        """
        return cls(**volume_fields(grid, scalars))

    @classmethod
    def from_layer(cls, layer: Any) -> Volume:
        """Convert a napari layer of an image or labels with three axes, placed as napari has it.

        Of a multiscale layer the finest level is taken. Units other than pixels become millimetres.

        Raises
        ------
        VolumeError
            If the layer is of another kind, or has more axes or colours.
        """
        data = layer.data[0] if getattr(layer, "multiscale", False) else layer.data
        if getattr(layer, "rgb", False) or not 3 == layer.ndim == np.ndim(data):
            raise VolumeError(
                f"{layer.name}: is a napari layer {type(layer).__name__} of {np.shape(data)}",
                "give an Image or Labels of three axes, such as a channel's or a time step's",
                code="type",
            )
        mm = np.array([mm_per_unit(str(unit)) or 1.0 for unit in layer.units])
        start, *ends = (np.array(layer.data_to_world(corner)) for corner in np.eye(4, 3, -1))
        world = np.eye(4)
        # From (z, y, x) to (x, y, z).
        world[:3, :3] = (mm * (ends - start)).T[::-1, ::-1]
        world[:3, 3] = (mm * start)[::-1]
        return cls(np.asarray(data), world_from_index=world, name=str(layer.name))

    def to_pyvista(self) -> pyvista.ImageData:
        """Return a pyvista ``ImageData`` with a copy of the values as point scalars "values"."""
        require_extra("vtk", "to_pyvista")
        import pyvista

        world, spacing_mm = self.world_from_index, self.spacing_mm
        grid = pyvista.ImageData(dimensions=self.shape_xyz, spacing=spacing_mm, origin=world[:3, 3])
        grid.direction_matrix = world[:3, :3] / np.asarray(spacing_mm)
        # A copy, since VTK writes to arrays that NumPy marks as read-only.
        grid.point_data["values"] = self.stated(self.nan_if_missing(self.values)).flatten()
        return grid


def checked_fields(volume: Volume) -> tuple[Volume, ...]:
    """Return a volume's further fields. Raises VolumeError if they cannot be distinguished."""
    fields = tuple(volume.fields)
    if not all(isinstance(extra, Volume) for extra in fields):
        remedy = "give a list of volspec.Volume"
        raise VolumeError.refused(f"{volume.name}: fields", fields, remedy, "type")
    names = [volume.name, *(extra.name for extra in fields)]
    if twice := next((name for name in names if names.count(name) > 1), None):
        raise VolumeError(
            f"{volume.name}: two fields are named {twice!r}",
            "name each, Volume(values, name=…)",
            code="duplicate",
            given=twice,
        )
    if nested := next((extra for extra in fields if extra.fields), None):
        raise VolumeError(
            f"{volume.name}: the field {nested.name!r} has fields of its own",
            "give all fields in one list",
            code="conflict",
        )
    return fields


def block_means(blocks: NDArray[Any]) -> NDArray[Any]:
    """Return the mean of every row, rounded for integer types.

    >>> block_means(np.array([[1, 2, 4, 4], [9, 9, 9, 9]], np.uint8)).tolist()
    [3.0, 9.0]
    """
    means = blocks.mean(axis=1, dtype=np.float64)
    return np.rint(means) if blocks.dtype.kind in "ui" else means


def present_means(missing: float) -> Summary:
    """Return the mean of the voxels in a block that are not missing; missing if half of them are.

    >>> present_means(-9.0)(np.array([[1.0, 2, 3, -9], [5, 6, -9, -9]])).tolist()
    [2.0, -9.0]
    """

    def means(blocks: NDArray[Any]) -> NDArray[Any]:
        valid = blocks != missing
        count = valid.sum(axis=1)
        sums = blocks.sum(axis=1, where=valid, dtype=np.float64)
        averages = sums / np.maximum(count, 1)
        return np.where(2 * count > blocks.shape[1], averages, missing)

    return means


def block_modes(blocks: NDArray[Any]) -> NDArray[Any]:
    """Return the most frequent value of every row, the least if tied.

    >>> block_modes(np.array([[7, 2, 7, 3], [5, 4, 5, 4]])).tolist()
    [7, 4]
    """
    ordered = np.sort(blocks, axis=1)
    best, longest = ordered[:, 0].copy(), np.ones(len(ordered), np.int32)
    run = np.ones(len(ordered), np.int32)
    for column, before in zip(ordered.T[1:], ordered.T[:-1], strict=True):
        run = np.where(column == before, run + 1, 1)
        longer = run > longest
        best[longer], longest[longer] = column[longer], run[longer]
    return best


def downsample(values: NDArray[Any], factor: int, summary: Summary) -> NDArray[Any]:
    """Summarise blocks of factor³ voxels; those at the far ends may be smaller.

    ``summary`` is `block_means` or `block_modes`; the type stays.

    >>> downsample(np.arange(12, dtype=np.uint8).reshape(2, 2, 3), 2, block_means).tolist()
    [[[5, 6]]]
    """
    tops = range(0, values.shape[0], factor)
    small = np.empty((len(tops), *(-(-n // factor) for n in values.shape[1:])), values.dtype)
    # One layer of blocks at a time keeps the rearranged copy small.
    for layer, top in zip(small, tops, strict=True):
        slab = values[top : top + factor]
        for ys, block_y, y in _block_runs(slab.shape[1], factor):
            for xs, block_x, x in _block_runs(slab.shape[2], factor):
                part = slab[:, ys, xs]
                shape = (len(slab), part.shape[1] // block_y, block_y, -1, block_x)
                blocks = part.reshape(shape).transpose(1, 3, 0, 2, 4)
                rows = blocks.reshape(blocks.shape[0] * blocks.shape[1], -1)
                layer[y, x] = summary(rows).reshape(blocks.shape[:2])
    return small


def _block_runs(count: int, factor: int) -> list[tuple[slice, int, slice]]:
    """Return (source, block length, target) of the whole blocks and of the last, smaller one."""
    complete = count // factor
    parts = [(slice(0, complete * factor), factor, slice(0, complete))]
    if remainder := count - complete * factor:
        parts.append((slice(complete * factor, None), remainder, slice(complete, None)))
    return [part for part in parts if part[0].stop != 0]
