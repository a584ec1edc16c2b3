"""The light volume's truth: NumPy, float64, every step.

    volume -> transfer -> [light volume] -> raycast -> relight

    σ(node) = mean of −log(1 − opacity(v)) / reference step over the voxels nearest to it
    T(node) = exp(−∫ σ ds) towards the light
    open(node) = min(1, 2 · mean of T over the sphere)

σ is trilinear between nodes and falls to 0 within a cell beyond the outermost ones. The integral
takes steps of a cell, sampled at their middles.

The twin is ``kernels/light_volume.cl``.
"""

from __future__ import annotations

from functools import partial

import numpy as np
from numpy.typing import NDArray

from volspec.raycast.camera import Camera
from volspec.raycast.light_volume.spec import (
    CUT_TOLERANCE,
    OCCLUSION_GAIN,
    SHADOW_BIAS,
    LightGrid,
    extinction_per_mm,
    light_layers,
    occlusion_steps,
    shadow_steps,
    sphere_directions,
)
from volspec.raycast.sampling import Array, Arrives, trilinear
from volspec.raycast.spec import RaycastSpec
from volspec.transfer import SurfaceTable, TransferTable
from volspec.volume import Volume


def layers(
    volume: Volume, table: TransferTable | SurfaceTable, spec: RaycastSpec, camera: Camera
) -> Array:
    """(L, nz, ny, nx) share of the light that arrives, 0…1, for each of `light_layers`."""
    grid = LightGrid.of(volume, spec.light_cells)
    sigma = extinction(volume, table, spec, grid)
    found = []
    for layer in light_layers(spec, volume, camera):
        if layer.kind == "directional":
            found.append(_along(sigma, grid, np.array(layer.vector), *shadow_steps(grid)))
        elif layer.kind == "point":
            found.append(_towards(sigma, grid, np.array(layer.vector)))
        else:
            middles, lengths = occlusion_steps(grid, layer.radius_mm)
            rays = [_along(sigma, grid, d, middles, lengths) for d in sphere_directions()]
            found.append(np.minimum(OCCLUSION_GAIN * np.mean(rays, axis=0), 1))
    return np.reshape(found, (-1, *sigma.shape))


def arrivals(
    volume: Volume, table: TransferTable | SurfaceTable, spec: RaycastSpec, camera: Camera
) -> dict[int, Arrives]:
    """Shadows and occlusion, by number of the source in `sources_of`."""
    wanted = light_layers(spec, volume, camera)
    if not wanted:
        return {}
    grid = LightGrid.of(volume, spec.light_cells)
    return {
        layer.source: partial(light_at, values, grid)
        for layer, values in zip(wanted, layers(volume, table, spec, camera), strict=True)
    }


def light_at(layer: Array, grid: LightGrid, index: Array) -> Array:
    """(P,) trilinear samples of a layer (nz, ny, nx) at voxel indices (P, 3) x, y, z."""
    return trilinear(layer, index * np.array(grid.per_index))


def extinction(
    volume: Volume, table: TransferTable | SurfaceTable, spec: RaycastSpec, grid: LightGrid
) -> Array:
    """(nz, ny, nx) σ of each node, 1/mm."""
    if isinstance(table, SurfaceTable):
        sigma = _surface_extinction(volume, table)
    else:
        sigma = _table_extinction(volume, table)
    sigma = np.where(_kept(volume, spec), sigma, 0.0)
    x, y, z = (_weights(n, c) for n, c in zip(volume.shape_xyz, grid.shape_xyz, strict=True))
    return np.einsum("zk,kji,yj,xi->zyx", z, sigma, y, x, optimize=True)


def _table_extinction(volume: Volume, table: TransferTable) -> Array:
    """(Z, Y, X) σ of voxels: the table's, linear between entries; of labels, the label's own."""
    entries = extinction_per_mm(table.opacity, table.reference_step_mm)
    values = volume.values.astype(np.float64)
    last = entries.shape[-1] - 1
    if table.labels:
        known = (values >= 0) & (values < last + 1)
        return np.where(known, entries[np.where(known, values, 0).astype(int)], 0.0)
    low, high = table.domain
    at = np.clip((values - low) / (high - low) * last, 0, last)
    j = np.minimum(at.astype(int), last - 1)
    f = at - j
    if table.gradient_top is None:
        return entries[j] + f * (entries[j + 1] - entries[j])
    rows = np.clip(_gradient(volume) / table.gradient_top, 0, 1) * (len(entries) - 1)
    r = np.minimum(rows.astype(int), len(entries) - 2)
    g = rows - r
    below = entries[r, j] + f * (entries[r, j + 1] - entries[r, j])
    above = entries[r + 1, j] + f * (entries[r + 1, j + 1] - entries[r + 1, j])
    return below + g * (above - below)


def _gradient(volume: Volume) -> Array:
    """(Z, Y, X) length of the gradient at voxels, value per mm, as rays see it there."""
    padded = np.pad(volume.values.astype(np.float64), 1, mode="edge")
    inner = slice(1, -1)
    z = (padded[2:, inner, inner] - padded[:-2, inner, inner]) / 2
    y = (padded[inner, 2:, inner] - padded[inner, :-2, inner]) / 2
    x = (padded[inner, inner, 2:] - padded[inner, inner, :-2]) / 2
    world = np.stack([x, y, z], axis=-1) @ volume.index_from_world[:3, :3]
    return np.linalg.norm(world, axis=-1)


def _surface_extinction(volume: Volume, table: SurfaceTable) -> Array:
    """(Z, Y, X) σ of voxels: −log(1 − opacity) times the surface's area in the voxel's volume.

    Where a level lies between a voxel and the next along an axis, a surface passes through the
    edge, and counts by the share of the axis in its normal: all edges together have its area.
    """
    values = volume.values.astype(np.float64)
    sigma = np.zeros(values.shape)
    rises = []
    for axis, spacing in zip((2, 1, 0), volume.spacing_mm, strict=True):
        rises.append(np.diff(values, axis=axis, append=values.take([-1], axis)) / spacing)
    steepness = np.sqrt(sum(rise**2 for rise in rises))
    for level, opacity in zip(table.values.astype(np.float32), table.opacity, strict=True):
        below = values < level
        for axis, spacing, rise in zip((2, 1, 0), volume.spacing_mm, rises, strict=True):
            crossed = np.diff(below, axis=axis, append=below.take([-1], axis))
            area = np.abs(rise[crossed]) / steepness[crossed]
            sigma[crossed] += area * extinction_per_mm(opacity, spacing)
    return sigma


def _kept(volume: Volume, spec: RaycastSpec) -> NDArray[np.bool_]:
    """(Z, Y, X) whether the crop and the planes leave a voxel."""
    kept = np.ones(volume.values.shape, bool)
    axes = [np.arange(n) for n in volume.shape_xyz]
    if spec.crop_voxels is not None:
        for axis, (low, high) in enumerate(spec.crop_voxels):
            inside = (axes[axis] >= low - CUT_TOLERANCE) & (axes[axis] <= high + CUT_TOLERANCE)
            kept &= inside.reshape([-1 if a == 2 - axis else 1 for a in range(3)])
    z, y, x = np.meshgrid(*axes[::-1], indexing="ij", sparse=True)
    for plane in spec.clip_planes:
        normal = np.array(plane.normal)
        i, j, k, offset = normal @ volume.world_from_index[:3]
        inside_mm = i * x + j * y + k * z + offset - normal @ plane.point_mm
        kept &= inside_mm >= -CUT_TOLERANCE * min(volume.spacing_mm)
    return kept


def _weights(voxels: int, nodes: int) -> Array:
    """(nodes, voxels) what each voxel along an axis counts for each node."""
    nearest = np.floor(np.arange(voxels) * (nodes - 1) / (voxels - 1) + 0.5).astype(int)
    weights = np.zeros((nodes, voxels))
    weights[nearest, np.arange(voxels)] = 1 / np.bincount(nearest)[nearest]
    # A node that is nearest to no voxel lies between two.
    for node in np.flatnonzero(~weights.any(axis=1)):
        at = node * (voxels - 1) / (nodes - 1)
        j = min(int(at), voxels - 2)
        weights[node, j], weights[node, j + 1] = 1 - (at - j), at - j
    return weights


def _along(
    sigma: Array, grid: LightGrid, direction: Array, middles: Array, lengths: Array
) -> Array:
    """(nz, ny, nx) transmittance from every node along one direction, in steps of a cell."""
    nodes, padded = _positions(grid), np.pad(sigma, 1)
    way = grid.per_step(direction)
    depth = np.zeros(len(nodes))
    for middle, length in zip(middles, lengths, strict=True):
        depth += length * grid.cell_mm * trilinear(padded, nodes + 1 + middle * way)
    return np.exp(-depth).reshape(sigma.shape)


def _towards(sigma: Array, grid: LightGrid, light_mm: Array) -> Array:
    """(nz, ny, nx) transmittance from every node to a place."""
    nodes, padded = _positions(grid), np.pad(sigma, 1)
    way = grid.grid_from_world[:3, :3] @ light_mm + grid.grid_from_world[:3, 3] - nodes
    world = way @ np.linalg.inv(grid.grid_from_world[:3, :3]).T
    cells = np.linalg.norm(world, axis=1, keepdims=True) / grid.cell_mm
    way = way / np.maximum(cells, 1e-30)
    depth = np.zeros(len(nodes))
    for k in range(grid.diagonal_steps):
        begin = SHADOW_BIAS + k
        length = np.clip(cells - begin, 0, 1)
        at = nodes + 1 + (begin + length / 2) * way
        depth += length[:, 0] * grid.cell_mm * trilinear(padded, at)
    return np.exp(-depth).reshape(sigma.shape)


def _positions(grid: LightGrid) -> Array:
    """(nodes, 3) grid positions x, y, z of all nodes, x fastest."""
    x, y, z = grid.shape_xyz
    k, j, i = np.mgrid[0:z, 0:y, 0:x].reshape(3, -1).astype(np.float64)
    return np.stack([i, j, k], axis=1)
