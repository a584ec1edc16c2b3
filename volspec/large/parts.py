"""Parts of a volume, each cast by itself, whose pictures together are that of the whole.

    level of a pyramid, camera -> [parts] -> out_of_core, distributed

A part has the steps of the whole cast whose middles lie in its box (``kernels/include/rays.clh``),
and voxels a little beyond. Parts are boxes of one grid: sorted by their distance from the camera
along each axis, no part hides one before it.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from volspec.camera import NEAR, Camera, Projection
from volspec.raycast import RaycastSpec
from volspec.raycast.launch import BRICK
from volspec.volume import Volume
from volspec.volume.levels import BLOCK, Box, Index, Level

# Cells along a part's edge: many enough that a launch is worth its cost, few enough that two parts
# and the chunks around them are small next to a budget.
SIDE, MIN_SIDE = 256, 32
# Fraction of the budget that two parts, the one that is cast and the next, may take.
_PARTS_SHARE = 0.25
# Fraction of a voxel's edge, projected, that a pixel covers before a coarser level is taken.
_FINE = 1.0

Rect = tuple[int, int, int, int]
"""Columns and rows (x0, y0, x1, y1) of a picture, the last ones not included."""


def view_of(rect: Rect) -> tuple[slice, slice]:
    """Return the index of a rectangle of a picture."""
    x0, y0, x1, y1 = rect
    return slice(y0, y1), slice(x0, x1)


@dataclass(frozen=True, slots=True)
class VolumePart:
    """Box of a level's cells, and the part of the picture that it may cover.

    Attributes
    ----------
    low, high : (z, y, x)
        Index of its first and last voxel planes; cells lie between them.
    stored : Box
        Its voxels with those around it that its samples read.
    margin : int
        Voxels around a brick that its samples read, in whole bricks.
    chunks : tuple
        Numbers of the chunks that may be needed of it, along z, y, x.
    rect : Rect
    visible : int
        Number of its blocks in which something may be seen.
    """

    low: Index
    high: Index
    stored: Box
    margin: int
    chunks: tuple[Index, ...]
    rect: Rect
    visible: int

    @property
    def work(self) -> float:
        """Time that its cast takes, in that of a visible block; measured on sponges and vessels."""
        return self.visible + 0.1 * self.voxels / BLOCK**3

    @property
    def voxels(self) -> int:
        """Number of its voxels, with those around it."""
        return math.prod(high - low for low, high in self.stored)


@dataclass(frozen=True, slots=True)
class Division:
    """A grid of parts: the planes (z, y, x) between them, as voxel indices.

    >>> Division.of((9, 9, 17), (8, 8, 8)).planes[2]
    (0, 8, 16)
    """

    planes: tuple[tuple[int, ...], tuple[int, ...], tuple[int, ...]]

    @classmethod
    def of(cls, shape: Index, sides: Index) -> Division:
        """Divide voxels (Z, Y, X) into parts with a number of cells along each edge."""
        z, y, x = ((*range(0, n - 1, side), n - 1) for n, side in zip(shape, sides, strict=True))
        return cls((z, y, x))

    def front_to_back(self, frame: Volume, camera: Camera, outer: int) -> list[Index]:
        """Return the parts' numbers (z, y, x) such that none hides one before it.

        Parts with the same number along the axis ``outer`` (0 is z) follow one another.
        """
        counts = [len(planes) - 1 for planes in self.planes]
        matrix = frame.index_from_world
        distances = []
        for axis, (planes, count) in enumerate(zip(self.planes, counts, strict=True)):
            row = matrix[2 - axis]
            if camera.height_mm is None:
                position = float(row[:3] @ np.asarray(camera.position_mm) + row[3])
                eye = int(np.clip(np.searchsorted(planes, position, "right") - 1, 0, count - 1))
                distances.append(np.abs(np.arange(count) - eye))
            else:
                direction = float(row[:3] @ camera.frame()[2])
                distances.append(np.arange(count) if direction >= 0 else np.arange(count)[::-1])
        axes = [outer, *(axis for axis in range(3) if axis != outer)]
        z, y, x = map(range, counts)
        numbers = itertools.product(z, y, x)
        return sorted(numbers, key=lambda number: [distances[axis][number[axis]] for axis in axes])

    def box(self, number: Index) -> tuple[Index, Index]:
        """Return the first and the last planes of a part, (z, y, x) each."""
        pairs = [self.planes[axis][k : k + 2] for axis, k in enumerate(number)]
        (z0, z1), (y0, y1), (x0, x1) = pairs
        return (z0, y0, x0), (z1, y1, x1)


def reach(step_mm: float, frame: Volume, ends: bool) -> int:
    """Return the voxels around a part that its samples read, in whole bricks.

    Trilinear samples and their gradients reach two voxels beyond it; if ``ends``, steps are
    sampled at both ends, which lie half a step farther.
    """
    voxels = 2 + (math.ceil(0.5 * step_mm / min(frame.spacing_mm)) if ends else 0)
    return BRICK * -(-voxels // BRICK)


def sides_for(level: Level, itemsize: int, memory_bytes: int) -> Index:
    """Return the cells (z, y, x) along a part's edges that suit a level's chunks and a budget.

    Two parts fit in a quarter of the budget. They are thin along the axis along which the picture
    is swept (`outer_axis`), so that the chunks around a sweep's front are few.
    """
    side = SIDE
    while side > MIN_SIDE and 2 * side**3 * itemsize > _PARTS_SHARE * memory_bytes:
        side //= 2
    outer = outer_axis(level)
    thin = max(MIN_SIDE, min(side, level.chunk[outer] // BRICK * BRICK or side))
    z, y, x = (thin if axis == outer else side for axis in range(3))
    return z, y, x


def outer_axis(level: Level) -> int:
    """Return the axis (0 is z) along which a layer of chunks has the fewest voxels."""
    layers = [
        math.prod(level.shape) / n * min(c, n)
        for n, c in zip(level.shape, level.chunk, strict=True)
    ]
    return int(np.argmin(layers))


def plan(
    frame: Volume,
    level: Level,
    camera: Camera,
    size: tuple[int, int],
    spec: RaycastSpec,
    sides: Index,
    margin: int,
    blocks: NDArray[np.bool_] | None,
) -> list[VolumePart]:
    """Return the parts of a level that a picture may show, front to back.

    Parameters
    ----------
    frame : Volume
        Lattice of the level.
    level : Level
    camera, size, spec
        As of the cast.
    sides : (z, y, x)
        Cells along the parts' edges.
    margin : int
        Voxels around a part that its samples read: a multiple of `BRICK`.
    blocks : (Z, Y, X), optional
        True for the level's blocks in which something may be seen; by default all are read.
    """
    division = Division.of(level.shape, sides)
    low, high = (ends[::-1] for ends in spec.kept(frame))  # z, y, x
    around = None if blocks is None else _dilate_mask(blocks)
    parts = []
    for number in division.front_to_back(frame, camera, outer_axis(level)):
        first, last = division.box(number)
        if any(b <= c or a >= d for a, b, c, d in zip(first, last, low, high, strict=True)):
            continue
        z, y, x = zip(first, last, strict=True)
        part_blocks = level.blocks_of((z, y, x))
        visible = math.prod(span.stop - span.start for span in part_blocks)
        if blocks is not None and not (visible := np.count_nonzero(blocks[part_blocks])):
            continue
        rect = covered_pixels(frame, camera, size, first, last)
        if rect is None:
            continue
        ends = zip(first, last, level.shape, strict=True)
        # From a whole brick on: kernels count bricks from the volume's first voxel.
        z, y, x = (
            (max(a // BRICK * BRICK - margin, 0), min(b + 1 + margin, n)) for a, b, n in ends
        )
        chunks = level.chunks_in((z, y, x))
        if around is not None:
            chunks = [c for c in chunks if around[level.blocks_of(level.box_of(c))].any()]
        parts.append(VolumePart(first, last, (z, y, x), margin, tuple(chunks), rect, visible))
    return parts


def read_by(part: VolumePart, visible: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Return the blocks of a part's voxels that its samples read.

    Parameters
    ----------
    part : Part
    visible : (z, y, x)
        True for the bricks of its voxels in which something may be seen.
    """
    near = np.zeros_like(visible)
    cells = zip(part.low, part.high, part.stored, strict=True)
    box = tuple(slice((a - first) // BRICK, -(-(b - first) // BRICK)) for a, b, (first, _) in cells)
    near[box] = visible[box]
    near = _dilate_mask(near, part.margin // BRICK)
    for axis, (first, _) in enumerate(part.stored):
        begins = np.arange(near.shape[axis]) * BRICK + first
        starts = np.flatnonzero((begins % BLOCK == 0) | (begins == first))
        near = np.logical_or.reduceat(near, starts, axis=axis)
    return near


def _dilate_mask(mask: NDArray[np.bool_], by: int = 1) -> NDArray[np.bool_]:
    """Return what is True or up to some items from where it is, along each axis."""
    spread = mask.copy()
    for axis in range(3):
        before = spread.copy()
        one, other = (np.moveaxis(array, axis, 0) for array in (spread, before))
        for step in range(1, by + 1):
            one[step:] |= other[:-step]
            one[:-step] |= other[step:]
    return spread


def covered_pixels(
    frame: Volume, camera: Camera, size: tuple[int, int], first: Index, last: Index
) -> Rect | None:
    """Return the pixels that see a box of voxels, (z, y, x) each; None if none does."""
    corners = np.array(list(itertools.product(*zip(first, last, strict=True))))[:, ::-1]
    world = frame.world_from_index
    places = corners @ world[:3, :3].T + world[:3, 3]
    width, height = size
    x, y, depth = Projection(camera, (0.0, 0.0, width, height)).to_window(places).T
    if depth.max() <= NEAR:
        return None
    if depth.min() <= NEAR:
        return 0, 0, width, height
    # A pixel's ray passes through its middle; one more for rounding.
    x0, y0 = (max(math.floor(pixels.min() - 1.5), 0) for pixels in (x, y))
    x1, y1 = (min(math.ceil(pixels.max() + 1.5), n) for pixels, n in ((x, width), (y, height)))
    return (x0, y0, x1, y1) if x0 < x1 and y0 < y1 else None


def natural_level(
    lattices: Sequence[Volume], camera: Camera, size: tuple[int, int], spec: RaycastSpec
) -> int:
    """Return the coarsest level whose voxels are no larger than the nearest pixel.

    Parameters
    ----------
    lattices : sequence of Volume
        Of the levels, finest first.
    camera, size, spec
        As of the cast.
    """
    finest = lattices[0]
    pixel_mm = Projection(camera, (0.0, 0.0, *size)).mm_per_px
    if camera.height_mm is None:
        world = finest.index_from_world
        eye = world[:3, :3] @ np.asarray(camera.position_mm) + world[:3, 3]
        low, high = spec.kept(finest)
        nearest = np.clip(eye, low, high)
        depth_mm = (finest.world_from_index[:3, :3] @ (nearest - eye)) @ camera.frame()[2]
        pixel_mm *= max(float(depth_mm), 0.0) / camera.distance_mm
    fine = [k for k, lattice in enumerate(lattices) if min(lattice.spacing_mm) <= _FINE * pixel_mm]
    return max(fine, default=0)
