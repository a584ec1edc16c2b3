"""Launch ``kernels/light_volume.cl``: what has not changed since the last call stays.

    volume -> transfer -> [light volume] -> raycast -> relight

The twin is ``volspec/raycast/light_volume/reference.py``.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from volspec._gpu.opencl import Compute
from volspec._gpu.prelude import C_TYPES, Struct, prelude
from volspec._gpu.sources import assemble
from volspec.raycast.camera import Camera
from volspec.raycast.light_volume.spec import (
    CUT_TOLERANCE,
    OCCLUSION_GAIN,
    SHADOW_BIAS,
    LightGrid,
    LightLayer,
    extinction_per_mm,
    light_layers,
    occlusion_steps,
    shadow_steps,
    sphere_directions,
)
from volspec.raycast.spec import MAX_PLANES, RaycastSpec
from volspec.transfer import SurfaceTable, TransferTable
from volspec.volume import Volume

_BY_VALUE, _BY_GRADIENT, _BY_LABEL, _BY_SURFACE = range(4)
_LOCAL = 64
# The voxels of a node along one axis.
_SPAN = Struct(
    "Span",
    (("int", "first, count", ""), ("float", "weight, slope", "voxel n weighs weight + n slope")),
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
        ("int", "last_entry, last_row", "of the table; of surfaces the last"),
        ("int", "plane_count", ""),
    ),
)
STRUCTS = _SPAN, _STEP, _GRID


@dataclass(frozen=True, slots=True, eq=False)
class _Made:
    """What the extinction on the device was made of."""

    table: TransferTable | SurfaceTable
    cells: int
    cuts: tuple[Any, ...]

    def serves(self, table: TransferTable | SurfaceTable, spec: RaycastSpec) -> bool:
        return (
            self.table is table and self.cells == spec.light_cells and self.cuts == _cuts_of(spec)
        )


class LightVolume:
    """The light volume of a volume that is on an OpenCL device.

    Parameters
    ----------
    compute : Compute
    volume : Volume
    voxels : buffer
        ``volume.values`` on the device.
    lanes : int, optional
        Nodes followed together by a work-item: 1, 4 or 8. Default 8 on CPUs, 1 on GPUs.
    """

    def __init__(
        self, compute: Compute, volume: Volume, voxels: Any, *, lanes: int | None = None
    ) -> None:
        self._compute, self._volume, self._voxels = compute, volume, voxels
        self._lanes = lanes or (8 if compute.info.is_cpu else 1)
        self._made: _Made | None = None
        self._sigma: Any = None
        self._layers: Any = compute.output(4)
        self._room = 0
        self._lights: list[tuple[Any, ...]] = []

    def layers(
        self, table: TransferTable | SurfaceTable, spec: RaycastSpec, camera: Camera
    ) -> tuple[Any, LightGrid, tuple[LightLayer, ...]]:
        """Bring the layers up to date.

        The extinction is kept while the table (the very object: an equal one baked anew is
        another), the cuts and the grid stay; a layer while its light stays too.

        Returns
        -------
        buffer
            ushort[layer][nz][ny][nx] on the device, in order of `light_layers`; 65535 where all
            light arrives. Good until the next call.
        grid : LightGrid
        layers : tuple of LightLayer
            Whose they are. Where there are none nothing is computed.

        Raises
        ------
        OpenCLError
            If the device has no room for the grid.
        RaycastError
            If the table's values are too close for float32.
        """
        grid = LightGrid.of(self._volume, spec.light_cells)
        wanted = light_layers(spec, self._volume, camera)
        if not wanted:
            return self._layers, grid, wanted
        if self._made is None or not self._made.serves(table, spec):
            self._made, self._lights = None, []
            self._sigma = self._raw = None
            self._gather(table, spec, grid)
            self._made = _Made(table, spec.light_cells, _cuts_of(spec))
        if self._room < len(wanted) * grid.nodes * 2:
            self._lights = []
            self._layers = self._compute.output(len(wanted) * grid.nodes * 2)
            self._room = len(wanted) * grid.nodes * 2
        kept = self._lights
        self._lights = []
        for number, layer in enumerate(wanted):
            if kept[number : number + 1] != [layer.light]:
                self._follow(layer, number, grid)
            self._lights.append(layer.light)
        return self._layers, grid, wanted

    def _gather(
        self, table: TransferTable | SurfaceTable, spec: RaycastSpec, grid: LightGrid
    ) -> None:
        """Fill the padded grid with extinction."""
        x, y, z = grid.shape_xyz
        padded = (x + 2 * self._lanes) * (y + 2) * (z + 2)
        self._compute.require(
            padded * 4, f"a light volume of {x}x{y}x{z} nodes", "lower light_cells"
        )
        axes = zip(self._volume.shape_xyz, grid.shape_xyz, strict=True)
        spans = np.concatenate([_spans(voxels, nodes) for voxels, nodes in axes])
        constants, rows, kind = _constants(self._volume, table, spec, grid)
        self._sigma = self._compute.output(padded * 4)
        upload = self._compute.upload
        arguments = (self._voxels, upload(spans), upload(rows), constants, self._sigma)
        self._launch("extinction", padded, arguments, kind)

    def _follow(self, layer: LightLayer, number: int, grid: LightGrid) -> None:
        """Fill one layer."""
        x, y, z = grid.shape_xyz
        packets = -(-x // self._lanes) * y * z
        end = np.array([x, y, z, 0], np.int32), np.int32(number), self._layers
        if layer.kind == "point":
            world = np.linalg.inv(grid.grid_from_world[:3, :3]) / grid.cell_mm
            place = grid.grid_from_world @ [*layer.vector, 1.0]
            light = *_float4s(place[:3], *world), np.float32(SHADOW_BIAS)
            self._launch("converging", packets, (self._sigma, *light, *end))
        else:
            light = self._parallel(layer, grid)
            self._launch("parallel", packets, (self._sigma, *light, *end))

    def _parallel(self, layer: LightLayer, grid: LightGrid) -> tuple[Any, ...]:
        """The steps of all directions, where each one's end, their number, and the gain."""
        if layer.kind == "directional":
            ways, gain = np.array([layer.vector]), 1.0
            middles, lengths = shadow_steps(grid)
        else:
            ways, gain = sphere_directions(), OCCLUSION_GAIN
            middles, lengths = occlusion_steps(grid, layer.radius_mm)
        rows = self._compute.upload(_steps(grid, ways, middles, lengths, self._lanes))
        ends = (np.arange(len(ways), dtype=np.int32) + 1) * np.int32(len(middles))
        return rows, self._compute.upload(ends), np.int32(len(ways)), np.float32(gain)

    def _launch(
        self, name: str, items: int, arguments: tuple[Any, ...], kind: int = _BY_VALUE
    ) -> None:
        constants: dict[str, Any] = {
            "LANES": self._lanes,
            "KIND": kind,
            "VOXEL": C_TYPES[self._volume.values.dtype.name],
        }
        text = prelude(constants, "opencl") + "".join(each.declaration for each in STRUCTS)
        source = assemble("kernels/light_volume.cl", text)
        kernel = self._compute.kernel(source, name)
        kernel(self._compute.queue, (-(-items // _LOCAL) * _LOCAL,), (_LOCAL,), *arguments)


def _cuts_of(spec: RaycastSpec) -> tuple[Any, ...]:
    return spec.crop_voxels, spec.clip_planes


def _float4s(*threes: NDArray[np.float64]) -> list[NDArray[np.float32]]:
    return [np.array([*three, 0.0], np.float32) for three in threes]


def _spans(voxels: int, nodes: int) -> NDArray[np.void]:
    """The voxels along an axis that make each node: those nearest to it, or the two around."""
    spans = np.zeros(nodes, _SPAN.dtype)
    # Whole numbers, since halves must round alike everywhere.
    nearest = (2 * np.arange(voxels) * (nodes - 1) + voxels - 1) // (2 * (voxels - 1))
    spans["first"] = np.searchsorted(nearest, np.arange(nodes))
    spans["count"] = np.bincount(nearest, minlength=nodes)
    spans["weight"] = 1 / np.maximum(spans["count"], 1)
    bare = np.flatnonzero(spans["count"] == 0)
    at = bare * (voxels - 1) / (nodes - 1)
    first = np.minimum(at.astype(int), voxels - 2)
    spans["first"][bare], spans["count"][bare] = first, 2
    spans["weight"][bare], spans["slope"][bare] = 1 - (at - first), 2 * (at - first) - 1
    return spans


def _steps(
    grid: LightGrid,
    directions: NDArray[np.float64],
    middles: NDArray[np.float64],
    lengths: NDArray[np.float64],
    lanes: int,
) -> NDArray[np.void]:
    """Every direction's steps, one direction after the other."""
    ways = np.stack([grid.per_step(direction) for direction in directions])
    at = (ways[:, None] * middles[:, None]).reshape(-1, 3)
    cell = np.floor(at)
    f = at - cell
    rows = np.zeros(max(len(at), 1), _STEP.dtype)
    if not len(at):
        return rows
    rows["x"], rows["y"], rows["z"] = cell.T
    x, y, _ = grid.shape_xyz
    row = x + 2 * lanes
    rows["at"] = cell @ [1, row, row * (y + 2)]
    share = np.stack([1 - f, f], axis=-1)
    corners = np.einsum("nk,nj,ni->nkji", share[:, 2], share[:, 1], share[:, 0]).reshape(-1, 8)
    rows["weight"] = corners * np.tile(lengths, len(directions))[:, None]
    return rows


def _constants(
    volume: Volume, table: TransferTable | SurfaceTable, spec: RaycastSpec, grid: LightGrid
) -> tuple[NDArray[np.void], NDArray[np.float32], int]:
    """The kernel's constants, its table and which kind that is."""
    constants = np.zeros((), _GRID.dtype)
    constants["nodes"][:3], constants["voxels"][:3] = grid.shape_xyz, volume.shape_xyz
    constants["edge"][:3] = grid.cell_mm / np.array(volume.spacing_mm)
    top = np.array(volume.shape_xyz)
    crop = np.array(spec.crop_voxels or [(0, n - 1) for n in top])
    constants["low"][:3] = np.clip(np.ceil(crop[:, 0] - CUT_TOLERANCE), 0, top)
    constants["high"][:3] = np.clip(np.floor(crop[:, 1] + CUT_TOLERANCE) + 1, 0, top)
    for place, plane in zip(constants["planes"], spec.clip_planes, strict=False):
        normal = np.array(plane.normal) / min(volume.spacing_mm)
        place[:] = normal @ volume.world_from_index[:3]
        place[3] += CUT_TOLERANCE - normal @ plane.point_mm
    constants["plane_count"] = len(spec.clip_planes)
    if isinstance(table, SurfaceTable):
        # Differences of values are only compared with each other: any scale serves.
        span = volume.range[1] - volume.range[0]
        constants["domain_scale"] = 1 / max(span, float(np.finfo(np.float32).tiny))
        constants["last_entry"] = len(table.values) - 1
        depth = extinction_per_mm(table.opacity, 1.0)
        return constants, np.stack([table.values, depth], axis=1).astype(np.float32), _BY_SURFACE
    return constants, *_with_table(constants, volume, table, grid)


def _with_table(
    constants: NDArray[np.void], volume: Volume, table: TransferTable, grid: LightGrid
) -> tuple[NDArray[np.float32], int]:
    entries = extinction_per_mm(table.opacity, table.reference_step_mm / grid.cell_mm)
    rows = np.stack([entries, np.diff(entries, append=entries[..., -1:])], axis=-1)
    last = entries.shape[-1] - 1
    constants["last_entry"], constants["domain_low"] = last, table.domain[0]
    constants["domain_scale"] = table.entries_per_value
    if table.labels:
        return rows.astype(np.float32), _BY_LABEL
    if table.gradient_top is None:
        return rows.astype(np.float32), _BY_VALUE
    constants["last_row"] = len(entries) - 1
    per_row = (len(entries) - 1) / table.gradient_top / 2
    constants["gradient"][:, :3] = volume.index_from_world[:3, :3] * per_row
    return rows.astype(np.float32), _BY_GRADIENT
