"""The light volume: the fraction of each source's light that arrives, on a coarse grid of nodes.

    volume -> transfer -> [light volume] -> raycast -> relight

Extinction is averaged onto the nodes of a coarse grid [1]; from every node a ray towards the light
is marched through it [2]. Ambient occlusion marches rays in all directions of the sphere [3], up to
the source's radius. Lookups are offset along surface normals to avoid self-shadowing [4].
Absorption is grey, so that the result needs no spectrum and pictures can be relit.

The kernel is ``kernels/light_volume.cl``, its twin `volspec.raycast.reference`.

References
----------
[1] Behrens & Ratering (1998), "Adding shadows to a texture-based volume renderer",
    IEEE Symposium on Volume Visualization, 39-46.
[2] Kajiya & Von Herzen (1984), "Ray tracing volume densities", SIGGRAPH, 165-174.
[3] Hernell, Ljung & Ynnerman (2010), "Local ambient occlusion in direct volume rendering",
    IEEE TVCG 16(4), 548-559.
[4] Holbert (2011), "Saying 'goodbye' to shadow acne", Game Developers Conference, poster.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Any, Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from volspec._checks import Vector
from volspec._gpu import C_TYPES, Compute, Struct, assemble, prelude
from volspec.camera import Camera
from volspec.image import OCCLUSION_GAIN
from volspec.raycast.launch.kernel_arguments import (
    CURVE,
    CUT_TOLERANCE,
    LIGHT_MARGIN,
    MASK,
    numbered_sources,
    source_rows,
)
from volspec.raycast.launch.masks import MIXED
from volspec.raycast.launch.sampling import trilinear
from volspec.raycast.lights import Ambient, Directional, Point, lamp_points
from volspec.raycast.spec import MAX_PLANES, RaycastSpec
from volspec.transfer import SurfaceTable, Table, Tables, TransferTable
from volspec.volume import Volume

MIN_CELLS = 4
# −log(1 − opacity) is infinite at 1.
OPAQUE = 1 - 1e-4
# In cells: distance from the node at which rays begin, to avoid self-shadowing.
SHADOW_BIAS, OCCLUSION_BIAS = 1.0, 0.5
# The same where light is physical: a voxel, and the half by which extinction that is interpolated
# between voxels reaches farther than that of interpolated values.
PHYSICAL_BIAS = 1.5
MAX_CELLS = 512
DIRECTIONS = 24
# Places on a lamp with a radius: each takes as long as a point. Between nodes, steps are smoothed.
LAMP_POINTS = 32
# In cells or larger voxels: distance in front of surfaces, along the normal, at which light is
# read; nodes within and behind them are dark. Without a gradient (in homogeneous media) the
# distance falls to 0.
LIFT = 2.0
# In cells: the same where light is physical, in front of opaque matter.
PHYSICAL_LIFT = 3.0
# Of depths with ``split``: at the whole, what is dark is rounded to 0.
HALF = 0.5
# In mm or cells, whichever is longer: as far as directional lights are away.
FAR = 1e7
# (K, 3) starts, ends -> (K,): nothing opaque is between them.
Visibility = Callable[[NDArray[np.float64], NDArray[np.float64]], NDArray[Any]]


@dataclass(frozen=True, slots=True, eq=False)
class LightGrid:
    """Nodes spaced evenly along each axis of a volume, `LIGHT_MARGIN` more at each end."""

    shape_xyz: tuple[int, int, int]  # nodes
    cell_mm: float  # length of a light ray's step: a cell along the longest axis
    per_index: Vector  # nodes per voxel: a grid position is index * per_index + LIGHT_MARGIN
    grid_from_world: NDArray[np.float64]  # (4, 4)
    physical: bool = False  # in matter that is not opaque, light is read where samples are

    @classmethod
    def for_spec(cls, volume: Volume, spec: RaycastSpec) -> LightGrid:
        """Make the grid that settings ask for."""
        if not spec.physical_light:
            return cls.of(volume, spec.light_cells)
        sides = (np.array(volume.shape_xyz) - 1) * np.array(volume.spacing_mm)
        cells = round(float(sides.max()) / min(volume.spacing_mm)) + 1
        return replace(cls.of(volume, min(max(cells, MIN_CELLS), MAX_CELLS)), physical=True)

    @classmethod
    def of(cls, volume: Volume, cells: int) -> LightGrid:
        """Make a grid of ``cells`` nodes along the longest side, equally dense along the others.

        >>> LightGrid.of(Volume(np.zeros((5, 9, 17), np.uint8)), 9).shape_xyz
        (17, 13, 12)
        """
        voxels = np.array(volume.shape_xyz)
        sides = (voxels - 1) * np.array(volume.spacing_mm)
        cell = sides.max() / (cells - 1)
        nodes = np.maximum(np.rint(sides / cell).astype(int) + 1, MIN_CELLS)
        per_index = (nodes - 1) / (voxels - 1)
        x, y, z = (int(n) + 2 * LIGHT_MARGIN for n in nodes)
        fx, fy, fz = (float(f) for f in per_index)
        matrix = np.diag([fx, fy, fz, 1.0]) @ volume.index_from_world
        matrix[:3, 3] += LIGHT_MARGIN
        return cls((x, y, z), float(cell), (fx, fy, fz), matrix)

    def alike(self, volume: Volume) -> LightGrid:
        """Return a grid of another volume, with cells about as long."""
        sides = (np.array(volume.shape_xyz) - 1) * np.array(volume.spacing_mm)
        cells = round(float(sides.max()) / self.cell_mm) + 1
        return replace(self.of(volume, max(cells, MIN_CELLS)), physical=self.physical)

    def resampled(self, values: NDArray[Any], other: LightGrid) -> NDArray[Any]:
        """Return values (nz, ny, nx) of another grid at this one's nodes; 0 beyond it."""
        # Imported late: it takes a quarter of a second, and few fields differ in lattice.
        from scipy.ndimage import affine_transform

        other_from_self = other.grid_from_world @ np.linalg.inv(self.grid_from_world)
        return np.asarray(
            affine_transform(
                values,
                other_from_self[:3, :3][::-1, ::-1],
                other_from_self[:3, 3][::-1],
                output_shape=self.shape_xyz[::-1],
                order=1,
                mode="grid-constant",
            )
        )

    def inside_crop(self, spec: RaycastSpec) -> NDArray[np.bool_]:
        """Return (nz, ny, nx) True for nodes inside the crop, which is in voxels."""
        inside = [np.ones(n, bool) for n in self.shape_xyz]
        if spec.crop_voxels is not None:
            for axis, (low, high) in enumerate(spec.crop_voxels):
                index = (np.arange(self.shape_xyz[axis]) - LIGHT_MARGIN) / self.per_index[axis]
                inside[axis] = (index >= low - CUT_TOLERANCE) & (index <= high + CUT_TOLERANCE)
        x, y, z = inside
        return z[:, None, None] & y[:, None] & x

    @property
    def nodes(self) -> int:
        """Number of nodes."""
        return math.prod(self.shape_xyz)

    @property
    def diagonal_steps(self) -> int:
        """Number of one-cell steps after which a ray in any direction has left the grid."""
        world_from_grid = np.linalg.inv(self.grid_from_world[:3, :3])
        corners = np.array([(i, j, k) for i in (-1, 1) for j in (-1, 1) for k in (-1, 1)])
        across = world_from_grid @ (corners * (np.array(self.shape_xyz) + 1)).T
        return math.ceil(np.linalg.norm(across, axis=0).max() / self.cell_mm) + 1

    def lift_mm(self, table: Tables) -> float:
        """Return the distance in front of surfaces at which light is read, as `LIFT` says.

        Where light is physical it is that of opaque matter, and of isosurfaces as ever.
        """
        if self.physical and not isinstance(table, SurfaceTable):
            return PHYSICAL_LIFT * self.cell_mm
        return LIFT * self.cell_mm * max(1.0, *self.per_index)

    @property
    def shadow_bias(self) -> float:
        """Distance from nodes at which rays towards lights begin, in cells."""
        return PHYSICAL_BIAS if self.physical else SHADOW_BIAS

    @property
    def occlusion_bias(self) -> float:
        """Distance from nodes at which rays of ambient occlusion begin, in cells."""
        return PHYSICAL_BIAS if self.physical else OCCLUSION_BIAS

    def lattice(self, volume: Volume) -> tuple[int, ...]:
        """Return the numbers along x, y, z of a volume's voxels, or of nodes if there are more.

        Light that is physical needs the extinction of values between voxels, not of their mean: in
        thick slices, that of the next voxel reaches too far.
        """
        inner = (n - 2 * LIGHT_MARGIN if self.physical else 0 for n in self.shape_xyz)
        return tuple(map(max, volume.shape_xyz, inner))

    def positions(self) -> NDArray[np.float64]:
        """(nodes, 3) places of the nodes in the world, mm, x fastest."""
        x, y, z = self.shape_xyz
        indices = np.mgrid[0:z, 0:y, 0:x].reshape(3, -1)[::-1].T
        matrix = np.linalg.inv(self.grid_from_world)
        return np.asarray(indices @ matrix[:3, :3].T + matrix[:3, 3])

    def per_step(self, direction: Vector | NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the (3,) offset in the grid of one cell along a unit direction of the world."""
        return self.grid_from_world[:3, :3] @ np.asarray(direction) * self.cell_mm


@dataclass(frozen=True, slots=True)
class LightLayer:
    """One source's layer of a light volume, for one camera."""

    source: int  # index in `volspec.raycast.launch.kernel_arguments.numbered_sources`
    kind: Literal["directional", "point", "occlusion"]
    # In the world: unit direction towards a directional light, or a point light's position in mm.
    vector: Vector = (0.0, 0.0, 0.0)
    radius_mm: float = 0.0  # matter occludes up to this distance; of a lamp, its own

    def steps(self, grid: LightGrid) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return midpoints and lengths, in cells, of the steps along a ray from a node.

        They end at the occlusion radius, or at the grid's border, beyond which there is no matter.
        """
        if self.kind != "occlusion":
            return steps(grid.shadow_bias, grid.shadow_bias + grid.diagonal_steps)
        begin = grid.occlusion_bias
        return steps(begin, min(self.radius_mm / grid.cell_mm, begin + grid.diagonal_steps))

    def lamps_mm(self, grid: LightGrid) -> NDArray[np.float64]:
        """Return places (K, 3) of a point light: one, or a disc's, which faces the grid."""
        if not self.radius_mm:
            return np.array([self.vector])
        middle = (np.array(grid.shape_xyz) - 1.0) / 2.0
        to_world = np.linalg.inv(grid.grid_from_world[:3, :3])
        middle_mm = to_world @ (middle - grid.grid_from_world[:3, 3])
        points = lamp_points(self.vector, self.radius_mm, middle_mm, LAMP_POINTS)
        return np.concatenate(list(points))

    @property
    def key(self) -> tuple[str, Vector, float]:
        """Everything except the extinction that the layer's content depends on."""
        return self.kind, self.vector, self.radius_mm


def light_layers(spec: RaycastSpec, volume: Volume, camera: Camera) -> tuple[LightLayer, ...]:
    """Return the layers of all sources with shadows or occlusion, in the sources' order.

    Projections have no layers, since nothing is shaded.
    """
    if spec.mode != "composite":
        return ()
    layers = []
    for number, (_, source) in enumerate(numbered_sources(spec)):
        if isinstance(source, Directional) and source.shadows:
            x, y, z = camera.to_world(source.towards, source.frame).tolist()
            layers.append(LightLayer(number, "directional", (x, y, z)))
        elif isinstance(source, Point) and source.shadows:
            x, y, z = camera.place_mm(source.position_mm, source.frame).tolist()
            layers.append(LightLayer(number, "point", (x, y, z), source.radius_mm or 0.0))
        elif isinstance(source, Ambient) and source.occlusion:
            sides = np.multiply(np.array(volume.shape_xyz) - 1, volume.spacing_mm)
            radius = source.radius_mm or float(np.linalg.norm(sides)) / 10
            layers.append(LightLayer(number, "occlusion", radius_mm=radius))
    return tuple(layers)


def upsample_values(
    values: NDArray[Any],
    voxels: Sequence[int],
    lattice: Sequence[int],
    first: Sequence[int] = (0, 0, 0),
    labels: bool = False,
) -> tuple[NDArray[Any], list[int]]:
    """Return values (Z, Y, X) at the points of a denser lattice, and where they begin in it.

    Both lattices have the same ends; of labels it is the nearest. The values begin at voxel
    ``first`` of all ``voxels``. Numbers are along x, y, z.
    """
    begin = list(first)
    for a, (count, dense) in enumerate(zip(voxels, lattice, strict=True)):
        if dense == count:
            continue
        axis, step = 2 - a, (count - 1) / (dense - 1)
        last = values.shape[axis] - 1
        begin[a] = math.ceil(first[a] / step - CUT_TOLERANCE)
        end = math.floor((first[a] + last) / step + CUT_TOLERANCE)
        position = np.clip(np.arange(begin[a], end + 1) * step - first[a], 0, last)
        if labels:
            values = values.take(np.floor(position + 0.5).astype(int), axis)
            continue
        j = np.minimum(position.astype(int), last - 1)
        low, high = (values.take(index, axis).astype(np.float32) for index in (j, j + 1))
        f = (position - j).astype(np.float32).reshape([-1 if b == axis else 1 for b in range(3)])
        values = low + f * (high - low)
    return values, begin


# (K, 3) points in mm -> (K,) fraction of a source's light.
Transmittance = Callable[[NDArray[np.float64]], NDArray[np.float64]]


def sample_light(
    layer: LightLayer, grid: LightGrid, nodes: NDArray[np.float64], points: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Return the fraction (K,) of a source's light that a volume lets pass to points, mm.

    Outside of the grid it is that where the way to the light enters it, and 1 if it passes by.
    """
    last = np.array(grid.shape_xyz) - 1.0
    matrix = grid.grid_from_world
    position = points @ matrix[:3, :3].T + matrix[:3, 3]
    met = np.asarray(((position >= 0.0) & (position <= last)).all(axis=1))
    if layer.kind != "occlusion" and not met.all():
        out = np.flatnonzero(~met)
        to = np.array(layer.vector) if layer.kind == "point" else _far(layer, grid)
        to = to + (points[out] if layer.kind == "directional" else 0.0)
        ray = to @ matrix[:3, :3].T + matrix[:3, 3] - position[out]
        ray = np.where(ray == 0.0, 1e-30, ray)
        one, other = -position[out] / ray, (last - position[out]) / ray
        enter = np.maximum(np.minimum(one, other).max(axis=1), 0.0)
        met[out] = enter <= np.minimum(np.maximum(one, other).min(axis=1), 1.0)
        position[out] += np.where(met[out], enter, 0.0)[:, None] * ray
    x, y, z = grid.shape_xyz
    sampled = trilinear(nodes.reshape(z, y, x), np.clip(position, 0.0, last))
    return np.where(met, sampled, 1.0)


def _far(layer: LightLayer, grid: LightGrid) -> NDArray[np.float64]:
    """Return the way (3,) in mm to a directional light."""
    return FAR * max(grid.cell_mm, 1.0) * np.array(layer.vector)


def unblocked_part(layer: LightLayer, grid: LightGrid, clear: Visibility) -> NDArray[np.float64]:
    """Return the part (nodes,) of a source's light that surfaces let pass to each node."""
    nodes = grid.positions()
    if layer.kind == "point":
        lamps = layer.lamps_mm(grid)
        total = sum(clear(nodes, np.broadcast_to(lamp, nodes.shape)) for lamp in lamps)
        return np.asarray(total, np.float64) / len(lamps)
    if layer.kind == "directional":
        return clear(nodes, nodes + _far(layer, grid)).astype(np.float64)
    free = [clear(nodes, nodes + layer.radius_mm * vector) for vector in sphere_directions()]
    return np.asarray(np.minimum(OCCLUSION_GAIN * np.mean(free, axis=0), 1.0))


def sphere_directions() -> NDArray[np.float64]:
    """Return (DIRECTIONS, 3) unit vectors spread over the sphere along a Fibonacci spiral."""
    i = np.arange(DIRECTIONS)
    z = 1 - (2 * i + 1) / DIRECTIONS
    angle = i * math.pi * (3 - math.sqrt(5))
    across = np.sqrt(1 - z**2)
    return np.stack([across * np.cos(angle), across * np.sin(angle), z], axis=1)


def steps(begin: float, end: float) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return midpoints and lengths of one-cell steps from ``begin`` to ``end``; the last is cut.

    >>> [a.tolist() for a in steps(0.5, 3.0)]
    [[1.0, 2.0, 2.75], [1.0, 1.0, 0.5]]
    """
    edges = np.append(np.arange(begin, end, 1.0), max(begin, end))
    return (edges[:-1] + edges[1:]) / 2, np.diff(edges)


def split_width(table: Tables, blocked: bool = False) -> int:
    """Return the numbers of a node that `LightVolume.layers` adds for each layer with ``split``.

    They are read as one vector, of 4 or 8.
    """
    return 4 if len(table.channels) + blocked <= 2 else 8


def extinction_per_mm(opacity: NDArray[np.float64], length_mm: float) -> NDArray[np.float64]:
    """Return −log(1 − opacity) / length; opacity is clipped to `OPAQUE`."""
    return -np.log1p(-np.minimum(opacity, OPAQUE)) / length_mm


def material_tables(table: TransferTable) -> list[TransferTable]:
    """Return a table of each material by itself: its part of every entry's optical depth."""

    def alone(side: TransferTable, k: int) -> NDArray[np.float64]:
        return -np.expm1(-extinction_per_mm(side.opacity, 1.0) * side.material_weights[..., k])

    tables = []
    for k in range(len(table.channels)):
        left = None
        if table.left is not None:
            left = table.left._replace(opacity=alone(table.left_limits, k))
        tables.append(replace(table, opacity=alone(table, k), left=left))
    return tables


_BY_VALUE, _BY_GRADIENT, _BY_LABEL, _BY_SURFACE, _BY_MASK = range(5)
_LOCAL = 64
# A node's voxels along one axis.
_SPAN = Struct(
    "Span",
    (
        ("int", "first, count", ""),
        ("float", "weight, slope", "voxel n weighs weight + n slope"),
        ("float", "of_first, of_last", "part of that: 1, or 1/2 of a voxel between two nodes"),
    ),
)
# A step along a direction, the same for all nodes: its cell of the grid, counted from the node.
_STEP = Struct(
    "Step",
    (
        ("int", "x, y, z, at", ""),
        ("float", "weight[8]", "of the cell's corners, x fastest, times the length in cells"),
    ),
)
_GRID = Struct(
    "Grid",
    (
        ("float4", f"planes[{MAX_PLANES}]", "voxel (i, j, k) is cut if a i + b j + c k + d < 0"),
        ("float4", "gradient[3]", "rows: difference of voxels two apart -> rows of the table"),
        ("float4", "edge", "cells per spacing along x, y, z"),
        ("int4", "nodes, voxels", "number of them along x, y, z"),
        ("int4", "low, high", "crop: first voxel inside, first one beyond"),
        ("float", "domain_low, domain_scale", "value of entry 0, entries per value"),
        ("float", "least", "voxels below are missing"),
        ("int", "last_entry, last_row", "of the table; of surfaces the last"),
        ("int", "plane_count", ""),
        ("int", "adds", "1: the extinction is added to what is there"),
    ),
)
STRUCTS = _SPAN, _STEP, _GRID, CURVE, MASK


class VoxelBox(NamedTuple):
    """Voxels of a part of a volume, in order (z, y, x)."""

    values: NDArray[Any]
    first: tuple[int, ...]  # index of the first one in the volume
    low: tuple[int, ...]  # index of the first that is the part's own
    high: tuple[int, ...]  # index after the last


class LightVolume:
    """The light volume of a volume whose ``voxels`` are on an OpenCL device.

    Or of ``fields`` and their voxels, by name: the volume is the lattice around them; ``masks`` are
    the codes and structs `MASK` of those that have one. Without either, voxels are those of
    ``boxes``, which returns them for a table. ``lanes`` are the nodes per work-item, 1, 4 or 8; by
    default 8 on CPUs, 1 on GPUs.
    """

    def __init__(
        self,
        compute: Compute,
        volume: Volume,
        voxels: Any = None,
        *,
        lanes: int | None = None,
        fields: Mapping[str, tuple[Volume, Any]] | None = None,
        masks: Mapping[str, tuple[Any, NDArray[np.void]]] | None = None,
        boxes: Callable[[Any], Iterable[VoxelBox]] | None = None,
    ) -> None:
        self._compute, self.volume, self._boxes = compute, volume, boxes
        self._fields = fields or {volume.name: (volume, voxels)}
        self._masks = masks or {}
        self._lanes = lanes or (8 if compute.info.is_cpu else 1)
        # The table that the extinction was computed from, the cells and the cuts.
        self._extinction: tuple[Any, ...] = (None,)
        self._sigma: Any = None
        self._by_material: list[Any] = []  # the extinction of each by itself
        self._layers: Any = compute.output(4)
        self._capacity = 0
        self._keys: list[tuple[Any, ...]] = []
        self._split_keys: list[tuple[Any, ...]] = []
        self._alone: dict[int, NDArray[np.uint16]] = {}
        self._parts: dict[int, Any] = {}  # what surfaces let pass

    def layers(
        self,
        table: Tables,
        spec: RaycastSpec,
        camera: Camera,
        clear: Visibility | None = None,
        split: bool = False,
    ) -> tuple[Any, LightGrid, tuple[LightLayer, ...]]:
        """Update the layers; return their buffer, the grid and their descriptions.

        The extinction is reused while the table (by identity, not equality), the cuts and the grid
        are the same; a layer, while its light is the same, too. The buffer is
        ushort[layer][nz][ny][nx] in order of `light_layers`, 65535 if all light arrives, valid
        until the next call. ``clear`` is what surfaces keep from the nodes. With ``split``, for
        each layer ushort[nz][ny][nx][`split_width`] follows: of all materials, with `HALF` of
        their depths and with the whole, and of each by itself with half; occlusion is there the
        plain mean of directions. They are without what surfaces keep; if there are some, the part
        that these let pass is last. Raises OpenCLError if the device has no room for the grid.
        """
        grid = LightGrid.for_spec(self.volume, spec)
        layers = light_layers(spec, self.volume, camera)
        if not layers:
            return self._layers, grid, layers
        settings = grid.shape_xyz, grid.physical, spec.crop_voxels, spec.clip_planes
        if self._extinction[0] is not table or self._extinction[1:] != settings:
            self.forget()
            self._sigma, self._by_material = None, []
            self._fill_extinction(table, spec, grid)
            self._extinction = table, *settings
        count = len(layers) * (1 + (split_width(table, clear is not None) if split else 0))
        if self._capacity < count * grid.nodes * 2:
            self._keys, self._split_keys = [], []
            self._layers, self._capacity = self._compute.output(4), 0
            self._require(count * grid.nodes * 2, f"{count} light volumes", grid)
            self._layers = self._compute.output(count * grid.nodes * 2)
            self._capacity = count * grid.nodes * 2
        previous = self._keys
        if len(previous) != len(layers):  # the rest of the buffer is elsewhere
            self._split_keys = []
        self._keys = []
        for number, layer in enumerate(layers):
            key = *layer.key, clear
            if previous[number : number + 1] != [key]:
                self._fill_layer(layer, (number, 1, 0), grid)
                if clear is not None:
                    self._block(layer, number, grid, clear)
            self._keys.append(key)
        if split:
            self._fill_split(table, spec, layers, grid, clear)
        return self._layers, grid, layers

    def _fill_split(
        self,
        table: Tables,
        spec: RaycastSpec,
        layers: Sequence[LightLayer],
        grid: LightGrid,
        clear: Visibility | None,
    ) -> None:
        """Fill the layers of materials by themselves."""
        assert isinstance(table, TransferTable)
        keys = [(*layer.key, clear) for layer in layers]
        if self._split_keys == keys:
            return
        self._split_keys = []
        if not self._by_material:
            self._by_material = [
                self._extinction_of(*self._fields[self.volume.name], [single], spec, grid)
                for single in material_tables(table)
            ]
        parts = [(self._sigma, HALF), (self._sigma, 1.0)]
        parts += [(sigma, HALF) for sigma in self._by_material]
        width = split_width(table, clear is not None)
        for n, layer in enumerate(layers):
            for number, (sigma, part) in enumerate(parts):
                place = len(layers) + n * width, width, number
                self._fill_layer(layer, place, grid, sigma, part, gain=1.0)
            if clear is not None:
                place = len(layers) + n * width, width, len(parts)
                self._fill_layer(layer, place, grid, self._sigma, 0.0, gain=1.0)
                self._multiply(self._parts[n], place, grid)
        self._split_keys = keys

    def _require(self, nbytes: int, field: str, grid: LightGrid) -> None:
        x, y, z = grid.shape_xyz
        remedy = "leave out physical_light" if grid.physical else "lower light_cells"
        self._compute.require(nbytes, f"{field} of {x}x{y}x{z} nodes", remedy)

    def extinction(
        self, table: Table, spec: RaycastSpec, boxes: Iterable[VoxelBox]
    ) -> NDArray[np.float32]:
        """Return the extinction (nz, ny, nx) of some boxes of voxels at the grid's nodes."""
        grid, sigma = LightGrid.for_spec(self.volume, spec), None
        for box in boxes:
            sigma = self._extinction_of(self.volume, None, [table], spec, grid, sigma, box)
        if sigma is None:
            return np.zeros(grid.shape_xyz[::-1], np.float32)
        return self._nodes(sigma, grid)

    def forget(self) -> None:
        """Forget the voxels' extinction, which the next cast then finds again."""
        self._extinction, self._keys, self._split_keys = (None,), [], []

    def set_extinction(self, nodes: NDArray[np.float32], table: Table, spec: RaycastSpec) -> None:
        """Set the extinction (nz, ny, nx) for a table and settings, as made by `extinction`."""
        grid = LightGrid.for_spec(self.volume, spec)
        key = table, grid.shape_xyz, grid.physical, spec.crop_voxels, spec.clip_planes
        if self._extinction[0] is not table or self._extinction != key:
            self._sigma = self._compute.upload(np.pad(nodes, ((1, 1), (1, 1), (self._lanes,) * 2)))
            self._extinction, self._keys = key, []

    def _fill_extinction(self, table: Tables, spec: RaycastSpec, grid: LightGrid) -> None:
        """Fill the padded grid with extinction."""
        fields = table.by_field(self.volume.name)
        if self._boxes is not None:
            one = fields[self.volume.name][0]
            self.set_extinction(self.extinction(one, spec, self._boxes(one)), one, spec)
            return
        self._sigma, total = None, np.zeros(grid.shape_xyz[::-1], np.float32)
        separate = False  # some fields have lattices, and so grids, of their own
        for name, rows in fields.items():
            (volume, voxels), field_spec = self._fields[name], spec.for_field(name)
            if volume.has_lattice_of(self.volume):
                self._sigma = self._extinction_of(
                    volume, voxels, rows, field_spec, grid, self._sigma
                )
                continue
            separate, other = True, grid.alike(volume)
            uncropped = replace(field_spec, crop_voxels=None)
            sigma = self._extinction_of(volume, voxels, rows, uncropped, other)
            per_cell = self._nodes(sigma, other) * (grid.cell_mm / other.cell_mm)
            total += grid.resampled(per_cell, other)
        if not separate:
            return
        total *= grid.inside_crop(spec)
        if self._sigma is not None:
            total += self._nodes(self._sigma, grid)
        self._sigma = self._compute.upload(np.pad(total, ((1, 1), (1, 1), (self._lanes,) * 2)))

    def _nodes(self, padded: Any, grid: LightGrid) -> NDArray[np.float32]:
        """Return a padded grid's nodes (nz, ny, nx)."""
        x, y, z = grid.shape_xyz
        values = np.empty((z + 2, y + 2, x + 2 * self._lanes), np.float32)
        self._compute.download(padded, values)
        return values[1:-1, 1:-1, self._lanes : -self._lanes]

    def _extinction_of(
        self,
        volume: Volume,
        voxels: Any,
        tables: Sequence[Table],
        spec: RaycastSpec,
        grid: LightGrid,
        added_to: Any = None,
        box: VoxelBox | None = None,
    ) -> Any:
        """Return a padded grid with a field's extinction per cell, added to another's if given.

        It has a table, or one by row of its mask. Of a box of voxels, the box's own are counted.
        """
        x, y, z = grid.shape_xyz
        padded = (x + 2 * self._lanes) * (y + 2) * (z + 2)
        self._require(padded * 4, "a light volume", grid)
        lattice = grid.lattice(volume)
        spans = np.concatenate(list(map(_spans, lattice, grid.shape_xyz)))
        constants, rows, kind = _constants(volume, tables[0], spec, grid)
        constants["adds"] = added_to is not None
        dtype = volume.values.dtype
        is_temporary = box is not None or lattice != volume.shape_xyz
        if is_temporary:
            stored = box or VoxelBox(volume.values, (0, 0, 0), (0, 0, 0), volume.values.shape)
            values, begin = upsample_values(
                stored.values, volume.shape_xyz, lattice, stored.first[::-1], kind == _BY_LABEL
            )
            voxels, dtype = self._compute.upload(values, share=True), values.dtype
            first = np.array(begin)
            for axis, nodes in enumerate(np.split(spans, np.cumsum(grid.shape_xyz)[:2])):
                nodes["first"] -= first[axis]
            constants["voxels"][:3] = values.shape[::-1]
            low, high = (_on_lattice(edge, volume, lattice) for edge in (stored.low, stored.high))
            constants["low"][:3] = np.maximum(constants["low"][:3], low) - first
            constants["high"][:3] = np.minimum(constants["high"][:3], high) - first
            constants["planes"][:, 3] += constants["planes"][:, :3] @ first
        sigma = added_to or self._compute.output(padded * 4)
        upload = self._compute.upload
        by_label: tuple[Any, ...] = ()
        if volume.name in self._masks:
            codes, mask = self._masks[volume.name]
            rows, curves = _by_row(tables, grid)
            kind, mask = _BY_MASK, mask.copy()
            for row in ("index_x", "index_y", "index_z"):
                mask[row][:3] /= _per_voxel(volume, lattice)
            by_label = codes, upload(curves), mask
        arguments = (voxels, upload(spans), upload(rows), constants, sigma, *by_label)
        self._launch("extinction", padded, arguments, kind, dtype)
        if is_temporary:
            self._compute.queue.finish()  # it reads memory that is given back
        return sigma

    def _fill_layer(
        self,
        layer: LightLayer,
        place: tuple[int, int, int],
        grid: LightGrid,
        sigma: Any = None,
        part: float = 1.0,
        gain: float = OCCLUSION_GAIN,
    ) -> None:
        """Fill one layer, with a part of an extinction's depths; occlusion's mean has a gain.

        ``place`` is the number of the layer, of values of a node, and of the one that is filled.
        """
        x, y, z = grid.shape_xyz
        packets = -(-x // self._lanes) * y * z
        nodes, target = (np.array([*triple, 0], np.int32) for triple in ((x, y, z), place))
        end = np.float32(part), nodes, target, self._layers
        sigma = sigma or self._sigma
        if layer.kind == "point":
            world = np.linalg.inv(grid.grid_from_world[:3, :3]) / grid.cell_mm
            matrix, places = grid.grid_from_world, layer.lamps_mm(grid)
            lamps = np.zeros((len(places), 4), np.float32)
            lamps[:, :3] = places @ matrix[:3, :3].T + matrix[:3, 3]
            light = *_float4s(*world), np.float32(grid.shadow_bias)
            lit_from = self._compute.upload(lamps), np.int32(len(lamps))
            self._launch("converging", packets, (sigma, *lit_from, *light, *end))
        else:
            light = self._parallel(layer, grid, gain)
            self._launch("parallel", packets, (sigma, *light, *end))

    def _block(self, layer: LightLayer, number: int, grid: LightGrid, clear: Visibility) -> None:
        """Keep a layer as the volume alone makes it, then take what surfaces keep from it."""
        filled = np.empty(self._capacity // 2, np.uint16)
        self._compute.download(self._layers, filled)
        self._alone[number] = filled[number * grid.nodes : (number + 1) * grid.nodes]
        parts = np.rint(65535.0 * unblocked_part(layer, grid, clear)).astype(np.uint16)
        self._parts[number] = self._compute.upload(parts)
        self._multiply(self._parts[number], (number, 1, 0), grid)

    def _multiply(self, parts: Any, place: tuple[int, int, int], grid: LightGrid) -> None:
        """Multiply the numbers of a place, as of `_fill_layer`, by parts of 65535."""
        target = np.array([*place, 0], np.int32)
        self._launch("blocked", grid.nodes, (parts, np.int32(grid.nodes), target, self._layers))

    def attach(
        self,
        struct: NDArray[np.void],
        table: Tables,
        spec: RaycastSpec,
        camera: Camera,
        clear: Visibility | None,
        split: int = 0,
    ) -> tuple[Any, Any, bool]:
        """Set the members of a `CAST` for the light volume.

        Return the buffer of sources, that of the light volume, and True if it has layers. Arguments
        are those of `layers`, but ``split`` is 0 or the `split_width`.
        """
        buffer, grid, layers = self.layers(table, spec, camera, clear, split > 0)
        struct["light_x"], struct["light_y"], struct["light_z"] = grid.shape_xyz
        struct["light_scale"][:3] = grid.per_index
        struct["light_lift"] = grid.lift_mm(table) / min(self.volume.spacing_mm)
        numbers = [-1] * len(numbered_sources(spec))
        for number, layer in enumerate(layers):
            numbers[layer.source] = number
        sources = source_rows(self.volume, camera, spec, numbers, split)
        return self._compute.upload(sources), buffer, bool(layers)

    def transmittances(
        self,
        table: Tables,
        spec: RaycastSpec,
        camera: Camera,
        clear: Visibility,
    ) -> dict[int, Transmittance]:
        """Return what the volume lets pass to points (K, 3), mm, by `numbered_sources`."""
        _, grid, layers = self.layers(table, spec, camera, clear)
        return {
            layer.source: partial(sample_light, layer, grid, self._alone[number] / 65535.0)
            for number, layer in enumerate(layers)
        }

    def split_transmittances(
        self, table: Tables, spec: RaycastSpec, camera: Camera, clear: Visibility
    ) -> list[dict[int, Transmittance]]:
        """Return `transmittances` past half of all depths, the whole, and each material's half."""
        buffer, grid, layers = self.layers(table, spec, camera, clear, split=True)
        width = split_width(table, blocked=True)
        numbers = np.empty((len(layers) * (1 + width), grid.nodes), np.uint16)
        self._compute.download(buffer, numbers)
        split = numbers[len(layers) :].reshape(len(layers), grid.nodes, width)
        return [
            {
                layer.source: partial(sample_light, layer, grid, split[number, :, n] / 65535.0)
                for number, layer in enumerate(layers)
            }
            for n in range(2 + len(table.channels))
        ]

    def _parallel(self, layer: LightLayer, grid: LightGrid, gain: float) -> tuple[Any, ...]:
        """Return the steps of all directions, the end of each, their number and the gain."""
        if layer.kind == "directional":
            directions, gain = np.array([layer.vector]), 1.0
        else:
            directions = sphere_directions()
        middles, lengths = layer.steps(grid)
        rows = self._compute.upload(_steps(grid, directions, middles, lengths, self._lanes))
        ends = (np.arange(len(directions), dtype=np.int32) + 1) * np.int32(len(middles))
        return rows, self._compute.upload(ends), np.int32(len(directions)), np.float32(gain)

    def _launch(
        self,
        name: str,
        items: int,
        arguments: tuple[Any, ...],
        kind: int = _BY_VALUE,
        dtype: np.dtype[Any] | None = None,
    ) -> None:
        constants: dict[str, Any] = {
            "LANES": self._lanes,
            "KIND": kind,
            "VOXEL": C_TYPES[(dtype or self.volume.values.dtype).name],
            "MIXED": MIXED,
        }
        text = prelude(constants, "opencl") + "".join(struct.declaration for struct in STRUCTS)
        source = assemble("kernels/light_volume.cl", text)
        kernel = self._compute.kernel(source, name)
        kernel(self._compute.queue, (-(-items // _LOCAL) * _LOCAL,), (_LOCAL,), *arguments)


def _float4s(*threes: NDArray[np.float64]) -> list[NDArray[np.float32]]:
    return [np.array([*three, 0.0], np.float32) for three in threes]


def _spans(voxels: int, nodes: int) -> NDArray[np.void]:
    """Return each node's voxels along an axis: the nearest ones, or the two around denser nodes.

    A voxel in the middle between two nodes is half of each. Those of the margin have none.
    """
    nodes -= 2 * LIGHT_MARGIN
    spans = np.zeros(nodes, _SPAN.dtype)
    spans["of_first"] = spans["of_last"] = 1.0
    number = np.arange(nodes)
    if nodes >= voxels:
        position = number * (voxels - 1) / (nodes - 1)
        first = np.minimum(position.astype(int), voxels - 2)
        spans["first"], spans["count"] = first, 2
        spans["weight"], spans["slope"] = 1 - (position - first), 2 * (position - first) - 1
        return np.pad(spans, LIGHT_MARGIN)
    # In integers, so that halves are found everywhere.
    places = 2 * np.arange(voxels) * (nodes - 1) + voxels - 1
    nearest, remainder = np.divmod(places, 2 * (voxels - 1))
    first, end = (np.searchsorted(nearest, number, side) for side in ("left", "right"))
    halves = np.append(remainder == 0, False)
    spans["first"], spans["count"] = first, end - first + halves[end]
    spans["of_first"][halves[first]] = spans["of_last"][halves[end]] = 0.5
    spans["weight"] = 1 / (end - first - 0.5 * halves[first] + 0.5 * halves[end])
    return np.pad(spans, LIGHT_MARGIN)


def _steps(
    grid: LightGrid,
    directions: NDArray[np.float64],
    middles: NDArray[np.float64],
    lengths: NDArray[np.float64],
    lanes: int,
) -> NDArray[np.void]:
    """Return every direction's steps, one direction after the other."""
    offsets = np.stack([grid.per_step(direction) for direction in directions])
    points = (offsets[:, None] * middles[:, None]).reshape(-1, 3)
    cell = np.floor(points)
    f = points - cell
    rows = np.zeros(max(len(points), 1), _STEP.dtype)
    if not len(points):
        return rows
    rows["x"], rows["y"], rows["z"] = cell.T
    x, y, _ = grid.shape_xyz
    row = x + 2 * lanes
    rows["at"] = cell @ [1, row, row * (y + 2)]
    weight = np.stack([1 - f, f], axis=-1)
    corners = np.einsum("nk,nj,ni->nkji", weight[:, 2], weight[:, 1], weight[:, 0]).reshape(-1, 8)
    rows["weight"] = corners * np.tile(lengths, len(directions))[:, None]
    return rows


def _per_voxel(volume: Volume, lattice: Sequence[int]) -> NDArray[np.float64]:
    """Return (3,) points of a lattice per voxel, along x, y, z."""
    return np.asarray((np.array(lattice) - 1) / (np.array(volume.shape_xyz) - 1))


def _on_lattice(
    voxel: Sequence[int], volume: Volume, lattice: Sequence[int]
) -> NDArray[np.float64]:
    """Return the first points (x, y, z) of a lattice that are at voxels (z, y, x) or beyond."""
    corner = np.array(voxel[::-1])
    nodes = np.ceil(corner * _per_voxel(volume, lattice) - CUT_TOLERANCE)
    return np.asarray(np.where(corner == volume.shape_xyz, lattice, nodes))


def _constants(
    volume: Volume, table: Table, spec: RaycastSpec, grid: LightGrid
) -> tuple[NDArray[np.void], NDArray[np.float32], int]:
    """Return the struct `_GRID`, the kernel's table and its KIND."""
    constants = np.zeros((), _GRID.dtype)
    top = grid.lattice(volume)
    per_voxel = _per_voxel(volume, top)
    constants["nodes"][:3], constants["voxels"][:3] = grid.shape_xyz, top
    constants["least"] = volume.least_present
    constants["edge"][:3] = grid.cell_mm / np.array(volume.spacing_mm) * per_voxel
    crop = np.array(spec.crop_voxels or [(0, n - 1) for n in volume.shape_xyz])
    crop = crop * per_voxel[:, None]
    constants["low"][:3] = np.clip(np.ceil(crop[:, 0] - CUT_TOLERANCE), 0, top)
    constants["high"][:3] = np.clip(np.floor(crop[:, 1] + CUT_TOLERANCE) + 1, 0, top)
    for row, plane in zip(constants["planes"], spec.clip_planes, strict=False):
        normal = np.array(plane.normal) / min(volume.spacing_mm)
        row[:] = normal @ volume.world_from_index[:3]
        row[:3] /= per_voxel
        row[3] += CUT_TOLERANCE - normal @ plane.point_mm
    constants["plane_count"] = len(spec.clip_planes)
    if isinstance(table, SurfaceTable):
        # Differences of values are only compared with each other, so any scale will do.
        span = volume.range[1] - volume.range[0]
        constants["domain_scale"] = 1 / max(span, float(np.finfo(np.float32).tiny))
        constants["last_entry"] = len(table.values) - 1
        depth = extinction_per_mm(table.opacity, 1.0)
        return constants, np.stack([table.values, depth], axis=1).astype(np.float32), _BY_SURFACE
    return constants, *_with_table(constants, volume, table, grid)


def _entries(table: TransferTable, grid: LightGrid) -> NDArray[np.float64]:
    """Return extinctions per cell of a table's entries, with the differences to the next ones."""
    entries, limits = (
        extinction_per_mm(side.opacity, table.reference_step_mm / grid.cell_mm)
        for side in (table, table.left_limits)
    )
    rows = np.stack([entries, np.zeros_like(entries)], axis=-1)
    rows[..., :-1, 1] = limits[..., 1:] - entries[..., :-1]
    return rows


def _by_row(
    tables: Sequence[Table], grid: LightGrid
) -> tuple[NDArray[np.float32], NDArray[np.void]]:
    """Return the entries of a mask's tables, one after the other, and their structs `CURVE`."""
    rows, curves, first = [], np.zeros(len(tables), CURVE.dtype), 0
    for curve, table in zip(curves, tables, strict=True):
        assert isinstance(table, TransferTable)
        entries = _entries(table, grid)
        curve["opacity"], curve["last_entry"] = first, len(entries) - 1
        curve["domain_rest"] = table.domain[0]
        curve["domain_scale"] = table.entries_per_value
        rows.append(entries)
        first += len(entries)
    return np.concatenate(rows).astype(np.float32), curves


def _with_table(
    constants: NDArray[np.void], volume: Volume, table: TransferTable, grid: LightGrid
) -> tuple[NDArray[np.float32], int]:
    rows = _entries(table, grid)
    last = rows.shape[-2] - 1
    constants["last_entry"], constants["domain_low"] = last, table.domain[0]
    constants["domain_scale"] = table.entries_per_value
    if table.labels:
        return rows.astype(np.float32), _BY_LABEL
    if table.gradient_top is None:
        return rows.astype(np.float32), _BY_VALUE
    constants["last_row"] = len(rows) - 1
    per_row = (len(rows) - 1) / table.gradient_top / 2
    per_voxel = _per_voxel(volume, grid.lattice(volume))[:, None]
    constants["gradient"][:3, :3] = volume.index_from_world[:3, :3] * per_voxel * per_row
    return rows.astype(np.float32), _BY_GRADIENT
