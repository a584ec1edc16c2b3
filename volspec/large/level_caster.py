"""Cast a level of a pyramid part by part, front to back, in a bounded amount of memory.

    Volume.pyramid -> [out_of_core] -> Result

Each part's picture is what it adds to those in front of it, whose transmittance it is given: rays
end where those of the whole volume would, and their sum is its picture. While a part is cast, the
next is read. Parts in which nothing can be seen, or behind opaque ones, are not read.
"""

from __future__ import annotations

import math
import warnings
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from volspec._checks import checked_size
from volspec._gpu import Sharing
from volspec.camera import Camera
from volspec.errors import CastCancelled, RaycastError, VolspecWarning, VolumeError
from volspec.large.parts import (
    Rect,
    VolumePart,
    covered_pixels,
    natural_level,
    plan,
    reach,
    read_by,
    sides_for,
    view_of,
)
from volspec.raycast import RaycastSpec, VolumeCaster
from volspec.raycast.launch import (
    BRICK,
    GROUPS,
    TILES,
    Cancel,
    LightVolume,
    Progress,
    Receiver,
    Result,
    RowBatches,
    Transmittance,
    Visibility,
    VoxelBox,
    brick_codes,
    brick_ranges,
    cast_kernel,
    check_reach,
    clip_rays,
    kernel_arguments,
    visible_by_table,
    world_rays,
)
from volspec.transfer import FieldTables, SurfaceTable, Table, Tables, Transfers
from volspec.volume import Volume
from volspec.volume.levels import COARSE_BYTES, Box, Chunk, Level, common, size_text

# Pixels of a part's first launch; launches grow from there.
_FIRST_PIXELS = 1 << 16
# Pixels of a stripe by which gaps are marked.
_HATCH = 5


@dataclass(frozen=True, slots=True, eq=False)
class LoadedPart:
    """A part's voxels, the least and greatest values of their bricks, and damaged chunks' boxes."""

    part: VolumePart
    values: NDArray[Any]
    low: NDArray[Any]
    high: NDArray[Any]
    gaps: tuple[Box, ...] = ()


class LevelCaster:
    """Casts a level of a volume's pyramid; made by `Raycaster.at`.

    Its interface is that of a `VolumeCaster`.

    Parameters
    ----------
    base : VolumeCaster
        Of the volume: its device, tables and coarsest level are used.
    number : int
        Of the level, 0 for the finest.
    reads_ahead : bool
        Read the next part while one is cast, in a thread of its own.
    """

    def __init__(self, base: VolumeCaster, number: int, *, reads_ahead: bool = True) -> None:
        pyramid = base.volume.pyramid
        assert pyramid is not None
        self.base, self.reads_ahead = base, reads_ahead
        self._number, self._pyramid = number, pyramid
        self._level: Level = pyramid.levels[number]
        self.volume: Volume = base.volume.at_level(number)
        self.lights = LightVolume(base.compute, self.volume, None, boxes=self._voxel_boxes)
        self._blocks: tuple[Table, NDArray[np.bool_] | None] | None = None
        self._has_lit_gaps = False

    @property
    def device(self) -> str:
        """Name of the device."""
        return self.base.device

    @property
    def sharing(self) -> Sharing | None:
        """None: pictures are made on the host."""
        return None

    def bake(self, transfer: Transfers, opacities: Mapping[str, float] | None = None) -> Tables:
        """Bake a transfer function into a table, as `VolumeCaster.bake`."""
        return self.base.bake(transfer, opacities)

    def with_step(
        self,
        table: Tables,
        camera: Camera,
        size: tuple[int, int],
        spec: RaycastSpec,
        cancel: Cancel | None = None,
    ) -> RaycastSpec:
        """Return settings with the step that their quality asks for in a picture.

        It is chosen by casts of the coarsest level, in voxels, and taken in those of this one.
        """
        if spec.step_mm is None:
            step_mm = self.base.with_step(table, camera, size, spec, cancel).step_mm
            assert step_mm is not None
            of_voxel = step_mm / self.base.volume.finest_mm
            spec = replace(spec, step_mm=of_voxel * self.volume.finest_mm)
        spec.step_of(self.volume)
        return spec

    def cast(
        self,
        table: Tables,
        camera: Camera,
        size: tuple[int, int],
        spec: RaycastSpec,
        progress: Progress | None = None,
        cancel: Cancel | None = None,
        receiver: Receiver | None = None,
        span_mm: NDArray[np.float32] | None = None,
        clear: Visibility | None = None,
    ) -> Result:
        """Cast a picture; arguments and errors are those of `VolumeCaster.cast`.

        Chunks that cannot be read are left out, marked in the picture, and warned of.
        """
        checked_table = check_supported(table, spec, self.volume)
        size = checked_size(size)
        spec = spec.for_lattice(self.volume)
        check_reach(self.volume, camera, spec)
        if self._has_lit_gaps:
            self.lights.forget()
            self._has_lit_gaps = False
        parts = self.plan(checked_table, camera, size, spec)
        arguments = checked_table, camera, size, spec, parts, progress, cancel, span_mm, clear
        result = self._cast_parts(*arguments)
        if gaps := self._pyramid.describe_gaps():
            warnings.warn(gaps, VolspecWarning, stacklevel=4)
        return result

    def _cast_parts(
        self,
        table: Table,
        camera: Camera,
        size: tuple[int, int],
        spec: RaycastSpec,
        parts: Sequence[VolumePart],
        progress: Progress | None,
        cancel: Cancel | None,
        span_mm: NDArray[np.float32] | None,
        clear: Visibility | None,
    ) -> Result:
        with self.base.locked():
            picture = PartPicture.of(self, table, camera, size, spec, span_mm, clear)
            for done, loaded in enumerate(self.stream(table, spec, parts, picture.sees, cancel), 1):
                if loaded is not None:
                    picture.add(loaded, cancel)
                if progress is not None:
                    progress(done / len(parts))
        if progress is not None and not parts:
            progress(1.0)
        return picture.result()

    def plan(
        self, table: Table, camera: Camera, size: tuple[int, int], spec: RaycastSpec
    ) -> list[VolumePart]:
        """Return the parts that a picture may show, front to back."""
        ends = isinstance(table, SurfaceTable) or spec.preintegrated
        margin = reach(spec.step_of(self.volume), self.volume, ends)
        return self._plan(table, camera, size, spec, margin)

    def light_parts(self, table: Table) -> list[VolumePart]:
        """Return the parts in which something may be seen, from anywhere."""
        everything = Camera.orbit(self.volume, orthographic=True)
        return self._plan(table, everything, (8, 8), RaycastSpec(), BRICK)

    def _plan(
        self, table: Table, camera: Camera, size: tuple[int, int], spec: RaycastSpec, margin: int
    ) -> list[VolumePart]:
        sides = sides_for(self._level, self._pyramid.dtype.itemsize, self._pyramid.memory_bytes)
        blocks, level = self.visible_blocks(table, spec), self._level
        parts = plan(self.volume, level, camera, size, spec, sides, margin, blocks)
        if spec.mode == "maximum" and level.ranges is not None:
            parts.sort(key=self.greatest, reverse=True)  # the others may not be needed
        return parts

    def greatest(self, part: VolumePart) -> float:
        """Return a value that no sample of a part exceeds."""
        if self._level.ranges is None:
            return np.inf
        z, y, x = zip(part.low, part.high, strict=True)
        return float(self._level.ranges[1][self._level.blocks_of((z, y, x))].max())

    def visible_blocks(self, table: Table, spec: RaycastSpec) -> NDArray[np.bool_] | None:
        """Return the blocks (z, y, x) in which a table shows something; None if all may count."""
        if spec.mode != "composite":
            return None
        if self._blocks is None or self._blocks[0] is not table:
            blocks, level = None, self._level
            if level.ranges is not None:
                blocks = visible_by_table(level.ranges[0], level.ranges[1], table)
            self._blocks = table, blocks
        return self._blocks[1]

    def stream(
        self,
        table: Table,
        spec: RaycastSpec,
        parts: Sequence[VolumePart],
        predicate: Callable[[VolumePart], bool] = lambda part: True,
        cancel: Cancel | None = None,
    ) -> Iterator[LoadedPart | None]:
        """Yield the parts' voxels for a table and settings, None for unwanted ones.

        Each is read while the one before is in use, if the caster `reads_ahead`. Raises VolumeError
        if the pyramid's budget is less than a part and its chunks take.
        """
        self.reserve(parts)
        needed = [[Chunk(self._number, *number) for number in part.chunks] for part in parts]
        self._pyramid.cache.announce(needed)
        gap = transparent_value(table, self._pyramid.range)
        if spec.mode == "maximum":
            gap = self._pyramid.range[0]
        blocks = self.visible_blocks(table, spec)

        def read(turn: int) -> NDArray[Any] | None:
            part = parts[turn]
            if not predicate(part):
                return None
            return self._pyramid.read(self._number, part.stored, blocks, gap)

        counts = self._pyramid.counts
        with ThreadPoolExecutor(1, thread_name_prefix="volspec-read") as reader:
            coming: Future[NDArray[Any] | None] | None = None
            try:
                for turn in range(len(parts)):
                    if cancel is not None and cancel():
                        raise CastCancelled("raycast: cancelled", code="state")
                    counts.progress = f"level {self._number}: part {turn + 1} of {len(parts)}"
                    values = (coming or reader.submit(read, turn)).result()
                    more = self.reads_ahead and turn + 1 < len(parts)
                    coming = reader.submit(read, turn + 1) if more else None
                    part = parts[turn]
                    loaded = None
                    if values is not None:
                        loaded = self._loaded(part, values, table, blocks, gap)
                    for chunk in needed[turn]:
                        self._pyramid.cache.done(chunk, turn)
                    yield loaded
            finally:
                counts.progress = ""
                if coming is not None:
                    coming.cancel()

    def _loaded(
        self,
        part: VolumePart,
        values: NDArray[Any],
        table: Table,
        blocks: NDArray[np.bool_] | None,
        gap: float,
    ) -> LoadedPart:
        """Add to a part's visible ``blocks`` what their samples read of those around them."""
        pyramid = self._pyramid
        low, high = brick_ranges(values, alone=not self.reads_ahead)
        if blocks is not None:
            # What is added lies in the ranges of its blocks: the bricks' visibility stays.
            stored = blocks[self._level.blocks_of(part.stored)]
            more = read_by(part, visible_by_table(low, high, table)) > stored
            pyramid.add(values, self._number, part.stored, blocks, more, gap)
        z, y, x = zip(part.low, part.high, strict=True)
        gaps = tuple(
            common(self._level.box_of(place), (z, y, x))
            for place in part.chunks
            if Chunk(self._number, *place) in pyramid.gaps
        )
        return LoadedPart(part, values, low, high, gaps)

    def reserve(self, parts: Sequence[VolumePart]) -> None:
        """Give the cache what parts in use leave of the budget; VolumeError if that is none."""
        if not parts:  # nothing is visible, and nothing read
            return
        pyramid, level = self._pyramid, self._level
        largest = max(part.voxels for part in parts) * pyramid.dtype.itemsize
        left = pyramid.memory_bytes - self._needed(largest, pyramid.memory_bytes)
        if left < 0:
            needed = math.ceil(self._least_bytes(parts[0].margin) / 2**20 * 10) / 10
            raise VolumeError(
                f"{size_text(pyramid.memory_bytes)} are too few for parts of {size_text(largest)} "
                f"and chunks of {size_text(level.chunk_bytes)}",
                f"give at least {needed:g}MiB (--memory, or ?memory= after the name), or a coarser "
                "level",
                code="size",
                field="memory",
                given=pyramid.memory_bytes,
            )
        pyramid.cache.resize(left)

    def _needed(self, largest: int, budget: int) -> int:
        """Return the bytes without the cache's, with parts of up to ``largest`` bytes."""
        pyramid = self._pyramid
        ranges = sum(0 if level.ranges is None else level.ranges.nbytes for level in pyramid.levels)
        fixed = self.base.volume.values.nbytes + ranges
        # Two parts, with the ranges of their bricks (a tenth), and chunks that are being read.
        return fixed + int(2.1 * largest) + max(2 * self._level.chunk_bytes, budget // 16)

    def _least_bytes(self, margin: int) -> int:
        """Return the least budget with which any picture of the level can be cast."""
        level, itemsize, budget = self._level, self._pyramid.dtype.itemsize, 0
        while True:
            # Parts and the level in memory grow with the budget.
            sides = sides_for(level, itemsize, budget)
            pairs = zip(sides, level.shape, strict=True)
            largest = math.prod(min(side + 1 + 2 * margin, n) for side, n in pairs) * itemsize
            coarse = min(COARSE_BYTES, budget // 8) - self.base.volume.values.nbytes
            needed = self._needed(largest, budget) + max(coarse, 0)
            if needed <= budget:
                return budget
            budget = needed

    def transmittances(
        self, table: Tables, spec: RaycastSpec, camera: Camera, clear: Visibility
    ) -> dict[int, Transmittance]:
        """Return the part of each source's light that the volume lets pass; see `VolumeCaster`."""
        with self.base.locked():
            return self.lights.transmittances(table, spec.for_lattice(self.volume), camera, clear)

    def _voxel_boxes(self, table: Table) -> Iterator[VoxelBox]:
        """Yield the voxels of all parts in which something may be seen, for the light volume."""
        return self.boxes_of(table, self.light_parts(table))

    def boxes_of(self, table: Table, parts: Sequence[VolumePart]) -> Iterator[VoxelBox]:
        """Yield the voxels of parts, for the light volume."""
        for loaded in self.stream(table, RaycastSpec(), parts):
            if loaded is not None:
                part = loaded.part
                self._has_lit_gaps |= bool(loaded.gaps)
                ends = zip(part.high, self._level.shape, strict=True)
                # Voxels of a part are those of its cells; the last plane is the last part's.
                z, y, x = (n if high == n - 1 else high for high, n in ends)
                first = tuple(low for low, _ in part.stored)
                yield VoxelBox(loaded.values, first, part.low, (z, y, x))


def level_for(volume: Volume, camera: Camera, size: tuple[int, int], spec: RaycastSpec) -> int:
    """Return the level of a pyramid that a cast asks for, or raise RaycastError if it has none.

    The last level is in memory.
    """
    pyramid = volume.pyramid
    assert pyramid is not None
    count = len(pyramid.levels)
    if spec.level is None:
        lattices = [volume.at_level(number) for number in range(count)]
        return natural_level(lattices, camera, checked_size(size), spec)
    if spec.level >= count:
        raise RaycastError(
            f"is {spec.level}, {volume.name} has levels 0 to {count - 1}",
            "give one of them",
            code="range",
            field="RaycastSpec.level",
            given=spec.level,
        )
    return spec.level


def check_supported(table: Tables, spec: RaycastSpec, volume: Volume) -> Table:
    """Return the table, or raise RaycastError if it cannot be cast part by part."""
    if isinstance(table, FieldTables):
        case, remedy = "several fields", "show one"
    elif table.filters is not None:
        case, remedy = "spectral absorption", "leave out the materials' filters"
    elif spec.adaptive > 0:
        case, remedy = "adaptive steps", "give adaptive=0"
    else:
        return table
    raise RaycastError(
        f"raycast: {volume.name} is larger than memory, and {case} cannot be cast part by part",
        f"{remedy}, or read a coarser level into memory: ?level=N after its name",
        code="unsupported",
    )


def transparent_value(table: Table, span: tuple[float, float]) -> float:
    """Return a value within a range that a table does not show; its low end if it shows all."""
    low, high = span
    if isinstance(table, SurfaceTable):
        return low
    opacity = np.atleast_2d(table.opacity).max(axis=0)
    values = np.linspace(*table.domain, len(opacity))
    clear = values[(opacity == 0) & (values >= low) & (values <= high)]
    return float(clear[0]) if len(clear) else low


@dataclass(frozen=True, slots=True, eq=False)
class PartPicture:
    """A picture to which parts are added, front to back."""

    caster: LevelCaster
    table: Table
    camera: Camera
    spec: RaycastSpec
    size: tuple[int, int]
    struct: NDArray[np.void]
    kernel: Any
    inputs: tuple[Any, ...]  # buffers of tables, sources and light
    spans: NDArray[np.float32] | None
    coefficients: NDArray[np.float32]
    alpha: NDArray[np.float32]
    depth: NDArray[np.float32]  # times alpha
    first: NDArray[np.float32]
    transmittance: NDArray[np.float32]
    # Of a projection (kernels/projection.cl); and its gaps, which are marked at last.
    so_far: NDArray[np.float32] | None
    gaps: list[tuple[Box, Rect]]

    @classmethod
    def of(
        cls,
        caster: LevelCaster,
        table: Table,
        camera: Camera,
        size: tuple[int, int],
        spec: RaycastSpec,
        span_mm: NDArray[np.float32] | None,
        clear: Visibility | None,
    ) -> PartPicture:
        """Return an empty picture."""
        frame, compute = caster.volume, caster.base.compute
        program = kernel_arguments.Program.of(table, spec, spec.step_of(frame))
        struct = kernel_arguments.cast_struct(frame, table, camera, size, spec)
        sources, light, is_lit = caster.lights.attach(struct, table, spec, camera, clear)
        tables = map(compute.upload, map(np.ascontiguousarray, program.tables))
        inputs = *tables, sources, light
        kernel = cast_kernel(
            compute,
            caster.base.packet,
            program,
            spec,
            frame.values.dtype,
            missing=frame.missing is not None,
            is_lit=is_lit,
            spans=span_mm is not None,
            parts=True,
        )
        width, height = size
        spans, transmittance = None, np.ones((height, width), np.float32)
        if span_mm is not None:
            spans = np.divide(span_mm, min(frame.spacing_mm), dtype=np.float32)
            # No part is read for pixels that see none.
            transmittance[spans[..., 0] >= spans[..., 1]] = 0.0
        layers = len(spec.groups) * table.size
        so_far = None
        if spec.mode != "composite":
            so_far = np.zeros((height, width, 2), np.float32)
            so_far[..., 0] = -np.inf if spec.mode == "maximum" else 0.0
        return cls(
            caster,
            table,
            camera,
            spec,
            size,
            struct,
            kernel,
            inputs,
            spans,
            np.zeros((height, width, layers), np.float32),
            np.zeros((height, width), np.float32),
            np.zeros((height, width), np.float32),
            np.full((height, width), np.inf, np.float32),
            transmittance,
            so_far,
            [],
        )

    def sees(self, part: VolumePart) -> bool:
        """Return True if what was added so far lets a part be seen."""
        x0, y0, x1, y1 = part.rect
        if self.so_far is not None:
            # Values are counted from the table's first.
            greatest = self.caster.greatest(part) - float(self.struct["domain_low"])
            best = self.so_far[y0:y1, x0:x1, 0]
            return self.spec.mode != "maximum" or bool((best < greatest).any())
        return bool((self.transmittance[y0:y1, x0:x1] > self.spec.least_transmittance).any())

    def add(self, loaded: LoadedPart, cancel: Cancel | None) -> None:
        """Cast a part behind those before it."""
        part, spec = loaded.part, self.spec
        step_mm = spec.step_of(self.caster.volume)
        codes = brick_codes(loaded.low, loaded.high, [self.table], spec, step_mm)
        if self.so_far is not None:
            self._project(loaded, codes, cancel)
            self.gaps.extend((gap, part.rect) for gap in loaded.gaps)
            return
        if codes.min() == 0:
            self._composite(loaded, codes, cancel)
        for gap in loaded.gaps:
            self._mark(gap, part.rect)

    def _composite(self, loaded: LoadedPart, codes: NDArray[Any], cancel: Cancel | None) -> None:
        view = view_of(loaded.part.rect)
        clear = np.ascontiguousarray(self.transmittance[view])
        adds = self._cast(loaded, codes, self.caster.base.compute.upload(clear), cancel)
        self.coefficients[view] += adds.coefficients
        self.alpha[view] += adds.alpha
        self.transmittance[view] -= adds.alpha
        hit = adds.alpha > 0.0
        self.depth[view][hit] += adds.alpha[hit] * adds.depth_mm[hit]
        np.minimum(self.first[view], adds.first_mm, out=self.first[view])

    def _project(self, loaded: LoadedPart, codes: NDArray[Any], cancel: Cancel | None) -> None:
        view, compute = view_of(loaded.part.rect), self.caster.base.compute
        assert self.so_far is not None
        so_far = np.ascontiguousarray(self.so_far[view])
        buffer = compute.output(so_far.nbytes, so_far, filled=True)
        image = self._cast(loaded, codes, buffer, cancel)
        compute.download(buffer, so_far)
        self.so_far[view] = so_far
        self.coefficients[view], self.alpha[view] = image.coefficients, image.alpha
        np.multiply(image.alpha, image.depth_mm, out=self.depth[view], where=image.alpha > 0.0)
        self.first[view] = image.first_mm
        self.transmittance[view] = 1.0 - image.alpha

    def _cast(
        self, loaded: LoadedPart, codes: NDArray[Any], before: Any, cancel: Cancel | None
    ) -> Result:
        """Cast a part; ``before`` is the buffer of what those before it leave."""
        part, spec = loaded.part, self.spec
        compute, base = self.caster.base.compute, self.caster.base
        x0, y0, x1, y1 = part.rect
        view = view_of(part.rect)
        shape = y1 - y0, x1 - x0
        struct = self.struct.copy()
        self._place(struct, loaded)
        adds = Result(
            np.empty((*shape, self.coefficients.shape[2]), np.float32),
            *(np.empty(shape, np.float32) for _ in range(3)),
        )
        upload = compute.upload
        spans = np.zeros(2, np.float32) if self.spans is None else self.spans[view]
        arguments = (
            upload(loaded.values, share=True),
            upload(codes),
            *self.inputs,
            upload(np.ascontiguousarray(spans)),
            struct,
            before,
        )
        tile, group = TILES[base.packet.lanes], GROUPS[base.packet.lanes]
        rows = max(_FIRST_PIXELS // (shape[1] * tile[1] * group[1]), 1)
        bands = RowBatches(compute, adds, tile, group, spec.tile_ms, rows=rows)
        bands.run(self.kernel, arguments, None, cancel)
        return adds

    def _mark(self, gap: Box, rect: Rect) -> None:
        """Hatch what is visible of a box whose voxels cannot be read."""
        frame = self.caster.volume
        first, last = zip(*gap, strict=True)
        bounds = covered_pixels(frame, self.camera, self.size, first, last)
        if bounds is None:
            return
        (x0, y0), (x1, y1) = np.maximum(rect[:2], bounds[:2]), np.minimum(rect[2:], bounds[2:])
        if not (self.transmittance[y0:y1, x0:x1] > self.spec.least_transmittance).any():
            return
        y, x = np.mgrid[y0:y1, x0:x1]
        points = np.stack([x.ravel(), y.ravel()], axis=1).astype(np.float64)
        origin, direction = world_rays(self.camera, *self.size, points)
        matrix = frame.index_from_world
        low, high = np.array(gap, np.float64)[::-1].T
        near, far, _ = clip_rays(
            origin @ matrix[:3, :3].T + matrix[:3, 3], direction @ matrix[:3, :3].T, low, high
        )
        met = (near < far).reshape(y.shape)
        adds = self.transmittance[y0:y1, x0:x1] * np.where((x + y) // _HATCH % 2, 0.1, 0.6) * met
        view = slice(y0, y1), slice(x0, x1)
        white = np.concatenate([part * self.table.white for part in self.spec.strengths().values()])
        self.coefficients[view] += 0.5 * adds[..., None] * white
        self.alpha[view] += adds
        self.transmittance[view] -= adds
        depth = (near / min(frame.spacing_mm)).reshape(y.shape)
        self.depth[view] += np.where(met, adds * depth, 0.0)
        nearest = np.where(met & (adds > 0.0), depth, np.inf).astype(np.float32)
        np.minimum(self.first[view], nearest, out=self.first[view])

    def _place(self, struct: NDArray[np.void], loaded: LoadedPart) -> None:
        """Set the members of a `CAST` that describe a part and its rectangle of the picture."""
        part, shape = loaded.part, self.caster.volume.values.shape
        x0, y0, x1, y1 = part.rect
        struct["width"], struct["height"] = x1 - x0, y1 - y0
        struct["corner_x"], struct["corner_y"] = x0, y0
        struct["middle_x"] -= x0
        struct["middle_y"] -= y0
        ends = zip(part.low, part.high, shape, strict=True)
        planes = [(low or -np.inf, np.inf if high == n - 1 else high) for low, high, n in ends]
        struct["part_low"][:3] = [low for low, _ in planes[::-1]]
        struct["part_high"][:3] = [high for _, high in planes[::-1]]
        struct["first"][:3] = [low for low, _ in part.stored[::-1]]
        struct["last"][:3] = [high - 1 for _, high in part.stored[::-1]]
        _, rows, columns = loaded.values.shape
        struct["row"], struct["slice"] = columns, rows * columns
        struct["bricks_x"], struct["bricks_y"] = loaded.low.shape[2], loaded.low.shape[1]

    def result(self) -> Result:
        """Return the picture of the parts so far."""
        while self.gaps:
            self._mark(*self.gaps.pop())
        unit = min(self.caster.volume.spacing_mm)
        arrays = self.coefficients, self.alpha, self.depth, self.first
        return normalise(*arrays, unit, self.spec.half)


def normalise(
    coefficients: NDArray[np.float32],
    alpha: NDArray[np.float32],
    depth: NDArray[np.float32],
    first: NDArray[np.float32],
    unit_mm: float,
    half: bool,
) -> Result:
    """Return a picture whose depths are in smallest spacings, the expected ones times alpha."""
    depth_mm = np.full(alpha.shape, np.inf, np.float32)
    np.divide(depth * np.float32(unit_mm), alpha, out=depth_mm, where=alpha > 0.0)
    channels: NDArray[np.floating] = coefficients
    if half:
        limit = float(np.finfo(np.float16).max)
        channels = np.clip(coefficients, -limit, limit).astype(np.float16)
    return Result(channels, alpha, depth_mm, first * np.float32(unit_mm))
