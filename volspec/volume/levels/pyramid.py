"""Volumes larger than memory: the levels of detail of a stored array, read chunk by chunk.

    file -> [pyramid] -> Volume.pyramid -> raycast (volspec.large.level_caster)

A `Volume` with a pyramid holds its coarsest level in memory, by which it is framed, sliced and
previewed; casts read the finer ones.
"""

from __future__ import annotations

import itertools
import math
import threading
import time
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, fields, replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from volspec.errors import one_line
from volspec.volume.channels import Channel
from volspec.volume.checks import NATIVE_DTYPES, WIDENED
from volspec.volume.labels import Labels
from volspec.volume.levels.sample import VoxelSample, VoxelSampler
from volspec.volume.metadata import Metadata

Index = tuple[int, int, int]
Box = tuple[tuple[int, int], tuple[int, int], tuple[int, int]]
"""From and to of voxels, along z, y, x."""
BLOCK = 16
"""Cells along the edge of the blocks whose least and greatest values are known."""
DEFAULT_BYTES = 2**31
"""Most bytes of voxels in memory, unless a budget is given."""
COARSE_BYTES = 2**25
"""Most bytes of the level that is in memory."""
BOX_VOXELS = 2**22
"""About the most voxels of a box that is read, averaged and written at once."""
# Chunks that are read at once take this part of the budget at most, 1/n.
_CHUNKS_SHARE = 32
# Part of a chunk's blocks that are needed from which all are read.
_MAX = 0.75
# Seconds after which a store that did not answer is asked again.
_AGAIN_S = 5.0
_GONE = "its file or folder is gone"
WITHOUT_PARTS, ASK_ANOTHER = "HTTP ranges", "use a server that answers them"
"""Part of the cause if a server answers with whole files alone, and the remedy."""
# Most causes of gaps that a message names.
_MAX_CAUSES = 3


class Chunk(NamedTuple):
    """Place of a stored block of voxels: its level, and its number along z, y, x."""

    level: int
    z: int
    y: int
    x: int


@dataclass(frozen=True, slots=True, eq=False)
class Level:
    """One resolution of a stored volume.

    Attributes
    ----------
    array
        Reads slices: a NumPy or Zarr array, or `volspec.volume.files.query.Stored` voxels.
    axes : (z, y, x)
        Places of the three axes among the array's.
    at : tuple
        Index along each of the array's axes; those of z, y and x are ignored.
    world_from_index : (4, 4)
        As of a `Volume`.
    chunk : (Z, Y, X)
        Voxels that are read together.
    ranges : (2, ⌈Z/n⌉, ⌈Y/n⌉, ⌈X/n⌉) array, optional
        Least and greatest value in blocks of n = `BLOCK` cells; a cell has voxels of the next
        block.
    by_block : bool
        True if a chunk's blocks can be read by themselves; chunks are then of whole blocks.
    """

    array: Any
    axes: Index
    at: tuple[int, ...]
    world_from_index: NDArray[np.float64]
    chunk: Index
    ranges: NDArray[Any] | None = None
    by_block: bool = False

    @property
    def shape(self) -> Index:
        """Voxel counts (Z, Y, X)."""
        z, y, x = (self.array.shape[axis] for axis in self.axes)
        return z, y, x

    @property
    def dtype(self) -> np.dtype[Any]:
        """Type of its voxels as stored."""
        return np.dtype(self.array.dtype)

    @property
    def nbytes(self) -> int:
        """Bytes of its voxels as stored."""
        return math.prod(self.shape) * self.dtype.itemsize

    @property
    def chunk_bytes(self) -> int:
        """Bytes of a whole chunk."""
        return math.prod(self.chunk) * self.dtype.itemsize

    @property
    def place(self) -> Path | None:
        """File or folder of the array; None if it has none on this machine."""
        root = getattr(self.array, "root", None)
        return None if root is None else Path(root)

    @property
    def grid(self) -> Index:
        """Number of chunks along z, y, x."""
        z, y, x = (-(-n // c) for n, c in zip(self.shape, self.chunk, strict=True))
        return z, y, x

    def box_of(self, number: Sequence[int]) -> Box:
        """Return the voxels of a chunk."""
        ends = zip(number, self.chunk, self.shape, strict=True)
        z, y, x = ((k * c, min((k + 1) * c, n)) for k, c, n in ends)
        return z, y, x

    @staticmethod
    def blocks_of(box: Box) -> tuple[slice, ...]:
        """Return the blocks that hold some of the voxels of a box."""
        return tuple(slice(*ends) for ends in blocks_in(box))

    def within_ranges(self, box: Box) -> NDArray[Any]:
        """Return voxels of a box that are not read, but in the ranges of their blocks.

        Where a table shows nothing of these ranges, it does not between two such values either, as
        the ranges of neighbours overlap.
        """
        assert self.ranges is not None
        values = self.ranges[0][self.blocks_of(box)]
        for axis in range(3):
            values = values.repeat(BLOCK, axis)
        z, y, x = ((BLOCK * first, BLOCK * last) for first, last in blocks_in(box))
        return values[within(box, (z, y, x))]

    def read(self, box: Box) -> NDArray[Any]:
        """Read voxels (Z, Y, X) from the array; raises what its library raises."""
        return self._ordered(self.array[self._index(box)])

    def read_each(self, boxes: Sequence[Box]) -> Iterator[NDArray[Any] | Exception]:
        """Yield the voxels of boxes, or the error of one that cannot be read.

        They are read side by side if the array can.
        """
        indices = [self._index(box) for box in boxes]
        reading = getattr(self.array, "read_each", self._one_by_one)(indices)
        for values in reading:
            yield values if isinstance(values, Exception) else self._ordered(values)

    def fault(self, box: Box, values: NDArray[Any]) -> str:
        """Return what is wrong with voxels that were read of a box; empty if nothing is."""
        if values.shape != tuple(high - low for low, high in box):
            return f"it has the shape {values.shape}"
        if self.ranges is not None:
            lows, highs = (ends[self.blocks_of(box)] for ends in self.ranges)
            if values.min() < lows.min() or values.max() > highs.max():
                return "its values are not those that were written"
        return ""

    def _one_by_one(self, indices: Iterable[Any]) -> Iterator[Any]:
        for index in indices:
            try:
                yield self.array[index]
            except Exception as error:  # whatever the array's library raises
                yield error

    def _index(self, box: Box) -> tuple[int | slice, ...]:
        index: list[int | slice] = list(self.at)
        for axis, (low, high) in zip(self.axes, box, strict=True):
            index[axis] = slice(low, high)
        return tuple(index)

    def _ordered(self, values: Any) -> NDArray[Any]:
        order = sorted(self.axes)
        return np.asarray(values).transpose([order.index(axis) for axis in self.axes])

    def chunks_in(self, box: Box) -> list[Index]:
        """Return the numbers of the chunks that hold some of the voxels of a box."""
        ends = zip(box, self.chunk, strict=True)
        z, y, x = (range(low // c, -(-high // c)) for (low, high), c in ends)
        return list(itertools.product(z, y, x))


@dataclass(frozen=True, slots=True, eq=False)
class Stack:
    """Levels of a file that is larger than memory, finest first, and what the file states of it.

    Attributes
    ----------
    levels : sequence of Level
    channel : Channel, optional
    labels : {number: Label}, optional
        None if not stated.
    notes : sequence of str
        Warnings for the caller of `load_volume`.
    sample : Sample, optional
        Of the finest level; its voxels as stored.
    metadata : Metadata
    """

    levels: Sequence[Level]
    channel: Channel | None = None
    labels: Labels | None = None
    notes: Sequence[str] = ()
    sample: VoxelSample | None = None
    metadata: Metadata = field(default_factory=Metadata)


@dataclass(slots=True)
class ReadCounts:
    """Numbers of chunks and bytes that were read of a pyramid, since it was opened."""

    chunks: int = 0
    voxel_bytes: int = 0
    again_bytes: int = 0  # of these, what had been read before, and was dropped for want of memory
    lost: str = ""  # why the store does not answer; it is not asked again for some seconds
    lost_at: float = 0.0  # when it was asked, as of time.monotonic
    progress: str = ""  # of the cast in progress, in words; empty without one


@dataclass(slots=True, eq=False)
class Held:
    """A chunk in memory.

    Attributes
    ----------
    values : (Z, Y, X)
        Voxels as cast; those of blocks that were not read are within the blocks' ranges.
    there : (z, y, x)
        True for the blocks that were read; a single one if they cannot be read by themselves.
    """

    values: NDArray[Any]
    present: NDArray[np.bool_]


class ChunkCache:
    """Chunks in memory, up to a number of bytes; threads may share it.

    Callers announce the order in which they need chunks, so that the chunk dropped first is the one
    that is needed last, or not any more.
    """

    def __init__(self, most_bytes: int) -> None:
        self.most_bytes = most_bytes
        self.nbytes = 0
        self._entries: dict[Chunk, Held] = {}
        # Turns at which a chunk is needed, the next one last; turns count up.
        self._turns: dict[Chunk, list[int]] = {}
        self._lock = threading.RLock()

    def announce(self, needed: Sequence[Iterable[Chunk]]) -> None:
        """Replace the announced order: of the chunks that each turn needs."""
        turns: dict[Chunk, list[int]] = {}
        for turn in range(len(needed) - 1, -1, -1):
            for chunk in needed[turn]:
                turns.setdefault(chunk, []).append(turn)
        with self._lock:
            self._turns = turns

    def get(self, chunk: Chunk) -> Held | None:
        """Return a chunk that is in memory, else None."""
        with self._lock:
            entry = self._entries.pop(chunk, None)
            if entry is not None:
                self._entries[chunk] = entry  # used last
            return entry

    def put(self, chunk: Chunk, entry: Held) -> None:
        """Add a chunk, and drop others for it."""
        with self._lock:
            if chunk in self._entries:
                return
            self._entries[chunk] = entry
            self.nbytes += entry.values.nbytes
            self._shrink(chunk)

    def done(self, chunk: Chunk, turn: int) -> None:
        """Note that a turn has used a chunk, and no longer needs it."""
        with self._lock:
            left = self._turns.get(chunk, [])
            while left and left[-1] <= turn:
                left.pop()

    def resize(self, most_bytes: int) -> None:
        """Change the number of bytes, and drop what is beyond."""
        with self._lock:
            self.most_bytes = most_bytes
            self._shrink(None)

    def _shrink(self, last: Chunk | None) -> None:
        while self.nbytes > self.most_bytes and len(self._entries) > (last is not None):
            # The first of those that no turn needs is the one that was used longest ago.
            worst, latest = None, -1.0
            for chunk in self._entries:
                left = self._turns.get(chunk)
                turn = left[-1] if left else math.inf
                if turn > latest:
                    worst, latest = chunk, turn
                    if turn == math.inf:
                        break
            assert worst is not None
            self.nbytes -= self._entries.pop(worst).values.nbytes


class _Wanted(NamedTuple):
    """Blocks that are read for a box: of a level, or all, and more of the box."""

    box: Box
    blocks: NDArray[np.bool_] | None
    more: NDArray[np.bool_] | None = None

    def of(self, level: Level, chunk: Box) -> NDArray[np.bool_]:
        """Return a chunk's blocks, as `Held.present`; none if none is in the box.

        Blocks beyond the box are read with those in it: the next box needs them.
        """
        shared, blocks = blocks_in(common(self.box, chunk)), blocks_in(chunk)
        need = np.ones([last - first for first, last in blocks], np.bool_)
        if self.blocks is not None:
            need[:] = self.blocks[level.blocks_of(chunk)]
        inside = need[within(shared, blocks)]
        if self.more is not None:
            inside |= self.more[within(shared, blocks_in(self.box))]
        if not level.by_block:
            return np.full((1, 1, 1), inside.any())
        return need if inside.any() else np.zeros_like(need)


@dataclass(frozen=True, slots=True, eq=False)
class Pyramid:
    """The levels of a volume that is larger than memory, finest first.

    The last level is in memory, as the values of the `Volume` itself.

    Attributes
    ----------
    name : str
        The volume's, for messages.
    levels : tuple of Level
    dtype : numpy.dtype
        Type of the voxels as cast.
    range : (low, high)
        Of all voxels.
    missing : float, optional
        Value of voxels that are NaN or infinite in the file.
    memory_bytes : int
        Most bytes of voxels in memory.
    damaged : mapping
        What is wrong with chunks of the last level.
    sample : Sample, optional
        Of the finest level; its voxels as cast.
    """

    name: str
    levels: tuple[Level, ...]
    dtype: np.dtype[Any]
    range: tuple[float, float]
    missing: float | None = None
    memory_bytes: int = DEFAULT_BYTES
    damaged: Mapping[Chunk, str] = field(default_factory=dict)
    sample: VoxelSample | None = None
    counts: ReadCounts = field(init=False, default_factory=ReadCounts)
    cache: ChunkCache = field(init=False)
    gaps: dict[Chunk, str] = field(init=False, default_factory=dict)
    _read_blocks: dict[Chunk, NDArray[np.bool_]] = field(init=False, default_factory=dict)

    def __post_init__(self) -> None:
        object.__setattr__(self, "cache", ChunkCache(self.memory_bytes))
        self.gaps.update(self.damaged)

    def __reduce__(self) -> tuple[type[Pyramid], tuple[Any, ...]]:
        """Pickle the levels without what was read of them."""
        return type(self), tuple(getattr(self, attr.name) for attr in fields(self) if attr.init)

    def with_spacing(self, factors: Sequence[float]) -> Pyramid:
        """Return the pyramid with voxels that are longer by a factor along x, y, z."""
        scale = np.diag([*factors, 1.0])
        levels = []
        for level in self.levels:
            # The finest level's first voxel stays in its place.
            first = self.levels[0].world_from_index
            offset = np.linalg.inv(first) @ level.world_from_index
            levels.append(replace(level, world_from_index=first @ scale @ offset))
        return replace(self, levels=tuple(levels))

    def retry(self) -> None:
        """Forget which chunks cannot be read, before another picture: they may be there again."""
        self.gaps.clear()
        self.gaps.update(self.damaged)
        if time.monotonic() - self.counts.lost_at > _AGAIN_S:
            self.counts.lost = ""

    def read(
        self, number: int, box: Box, needed: NDArray[np.bool_] | None = None, gap: float = 0.0
    ) -> NDArray[Any]:
        """Return the voxels of a box of a level, from memory or the file.

        Those of blocks that are not ``needed`` (of all of the level; by default all are) are
        `Level.within_ranges`. Those of damaged chunks, which are then in `gaps`, are ``gap``.
        """
        values = np.empty([high - low for low, high in box], self.dtype)
        places = self.levels[number].chunks_in(box)
        self._fill(values, number, box, places, _Wanted(box, needed), gap)
        return values

    def add(
        self,
        values: NDArray[Any],
        number: int,
        box: Box,
        needed: NDArray[np.bool_],
        more: NDArray[np.bool_],
        gap: float,
    ) -> None:
        """Add ``more`` of the blocks of a box to what was read as ``needed``; see `read`."""
        chunk = self.levels[number].chunk
        indices = (np.argwhere(more) + [first for first, _ in blocks_in(box)]) * BLOCK // chunk
        places = [(z, y, x) for z, y, x in np.unique(indices, axis=0).tolist()]
        self._fill(values, number, box, places, _Wanted(box, needed, more), gap)

    def _fill(
        self,
        values: NDArray[Any],
        number: int,
        box: Box,
        places: Sequence[Index],
        needed: _Wanted,
        gap: float,
    ) -> None:
        level = self.levels[number]
        several = max(self.memory_bytes // (_CHUNKS_SHARE * level.chunk_bytes), 1)
        for first in range(0, len(places), several):
            some = places[first : first + several]
            for place, entry in zip(some, self._chunks(number, some, needed), strict=True):
                of_chunk = level.box_of(place)
                shared = common(box, of_chunk)
                to = within(shared, box)
                if Chunk(number, *place) in self.gaps:
                    values[to] = gap
                elif entry is None:
                    values[to] = level.within_ranges(shared)
                else:
                    values[to] = entry.values[within(shared, of_chunk)]

    def _chunks(self, number: int, places: Sequence[Index], needed: _Wanted) -> list[Held | None]:
        """Return chunks with their wanted blocks; what is missing is read at once."""
        level = self.levels[number]
        entries: list[Held | None] = []
        missing: list[tuple[Chunk, Held, list[Box]]] = []
        for place in places:
            chunk, of_chunk = Chunk(number, *place), level.box_of(place)
            need = needed.of(level, of_chunk)
            entry = self.cache.get(chunk) if need.any() else None
            if entry is not None:
                need &= ~entry.present
            if need.any() and self.counts.lost:
                self.gaps.setdefault(chunk, self.counts.lost)
            if need.any() and chunk not in self.gaps:
                entry = entry or Held(np.empty(0, self.dtype), np.zeros_like(need))
                missing.append((chunk, entry, _boxes_of(of_chunk, need)))
            entries.append(entry)
        reading = level.read_each([box for _, _, boxes in missing for box in boxes])
        for chunk, entry, boxes in missing:
            self._take(chunk, entry, boxes, list(itertools.islice(reading, len(boxes))))
        return entries

    def _take(
        self,
        chunk: Chunk,
        entry: Held,
        boxes: Sequence[Box],
        read: Sequence[NDArray[Any] | Exception],
    ) -> None:
        """Add what was read of a chunk, or note that it is damaged."""
        level, of_chunk = self.levels[chunk.level], self.levels[chunk.level].box_of(chunk[1:])
        fault, pieces = "" if entry.present.any() else self._absent(level), []
        for box, values in zip(boxes, read, strict=True):
            if isinstance(values, Exception):
                fault = fault or one_line(values)[:200]
                if isinstance(values, ConnectionError):
                    self.counts.lost, self.counts.lost_at = fault, time.monotonic()
                break
            pieces.append(self._as_cast(values))
            fault = fault or level.fault(box, pieces[-1])
        if fault:
            self.gaps[chunk] = fault
            return
        if not entry.present.any():
            complete = len(boxes) == 1 and boxes[0] == of_chunk
            entry.values = pieces[0] if complete else level.within_ranges(of_chunk)
            self.counts.chunks += 1
        was_read = self._read_blocks.setdefault(chunk, np.zeros_like(entry.present))
        for box, values in zip(boxes, pieces, strict=True):
            if values is not entry.values:
                entry.values[within(box, of_chunk)] = values
            blocks = within(blocks_in(box), blocks_in(of_chunk)) if level.by_block else ()
            entry.present[blocks] = True
            self.counts.voxel_bytes += values.nbytes
            if was_read[blocks].any():
                self.counts.again_bytes += round(values.nbytes * float(was_read[blocks].mean()))
            was_read[blocks] = True
        self.cache.put(chunk, entry)  # at last: another thread would replace values without blocks

    def _as_cast(self, values: NDArray[Any]) -> NDArray[Any]:
        if values.dtype.kind == "f":
            finite = np.isfinite(values)
            if not finite.all():
                other = self.range[0] if self.missing is None else self.missing
                values = np.where(finite, values, np.float32(other))
        return np.ascontiguousarray(values, self.dtype)

    @staticmethod
    def _absent(level: Level) -> str:
        """Return what is wrong if the array's file or folder is not there; empty if it is."""
        place = level.place
        return _GONE if place is not None and not place.exists() else ""

    def describe_gaps(self) -> str:
        """Return a sentence about chunks that cannot be read, and why; empty without any."""
        if not self.gaps:
            return ""
        first: dict[str, Chunk] = {}
        for chunk, why in list(self.gaps.items()):
            first.setdefault(why, chunk)
        named = ", ".join(
            f"chunk {'/'.join(map(str, chunk[1:]))} of level {chunk.level} ({why})"
            for why, chunk in [*first.items()][:_MAX_CAUSES]
        )
        if (count := len(self.gaps)) > 1:
            named = f"{count} chunks cannot be read, such as {named}; they are"
        else:
            named = f"{named.replace(' (', ' cannot be read (', 1)}; it is"
        remedy = "copy the store again"
        if self.counts.lost:
            remedy = "the store is asked again by the next picture"
        elif _GONE in first:
            remedy = "is its disk mounted?"
        elif any(WITHOUT_PARTS in why for why in first):
            remedy = ASK_ANOTHER
        return f"{self.name}: {named} left out of the picture; {remedy}"


def common(one: Box, other: Box) -> Box:
    """Return the voxels that two boxes share.

    >>> common(((0, 4), (0, 4), (2, 9)), ((2, 8), (0, 1), (0, 3)))
    ((2, 4), (0, 1), (2, 3))
    """
    z, y, x = ((max(a, c), min(b, d)) for (a, b), (c, d) in zip(one, other, strict=True))
    return z, y, x


def within(box: Box, outer: Box) -> tuple[slice, ...]:
    """Return the index of a box in an array of one around it.

    >>> within(((2, 4), (0, 1), (2, 3)), ((2, 8), (0, 4), (1, 9)))
    (slice(0, 2, None), slice(0, 1, None), slice(1, 2, None))
    """
    pairs = zip(box, outer, strict=True)
    return tuple(slice(low - first, high - first) for (low, high), (first, _) in pairs)


def blocks_in(box: Box) -> Box:
    """Return the numbers of the blocks that hold some of the voxels of a box.

    >>> blocks_in(((0, 16), (0, 17), (20, 40)))
    ((0, 1), (0, 2), (1, 3))
    """
    z, y, x = ((low // BLOCK, -(-high // BLOCK)) for low, high in box)
    return z, y, x


def _boxes_of(of_chunk: Box, need: NDArray[np.bool_]) -> list[Box]:
    """Return a chunk's needed blocks as boxes; the whole chunk if most of it is needed."""
    if need.mean() >= _MAX:
        return [of_chunk]
    ends = np.argwhere(np.diff(need, axis=2, prepend=False, append=False)).tolist()
    runs = zip(ends[::2], ends[1::2], strict=True)
    boxes: list[Box] = [((z, z + 1), (y, y + 1), (a, b)) for (z, y, a), (_, _, b) in runs]
    pieces = []
    for box in _join_boxes(_join_boxes(boxes, 1), 0):
        pairs = zip(box, of_chunk, strict=True)
        z, y, x = ((low + BLOCK * a, min(low + BLOCK * b, end)) for (a, b), (low, end) in pairs)
        pieces.append((z, y, x))
    return pieces


def _join_boxes(boxes: Sequence[Box], axis: int) -> list[Box]:
    """Join boxes, in ascending order, where one continues another along an axis.

    >>> _join_boxes([((0, 1), (0, 1), (0, 3)), ((0, 1), (1, 2), (0, 3))], 1)
    [((0, 1), (0, 2), (0, 3))]
    """
    joined: dict[Any, Box] = {}
    for box in boxes:
        other_axes, (low, high) = box[:axis] + box[axis + 1 :], box[axis]
        before = joined.pop((other_axes, low), box)
        ends = [*box]
        ends[axis] = before[axis][0], high
        joined[other_axes, high] = ends[0], ends[1], ends[2]
    return list(joined.values())


def cast_dtype(stored: np.dtype[Any]) -> np.dtype[Any]:
    """Return the type of voxels as cast, for those of any type.

    >>> cast_dtype(np.dtype(">i2")).name, cast_dtype(np.dtype("u4")).name
    ('int16', 'float32')
    """
    native = stored.newbyteorder("=")
    if native in NATIVE_DTYPES:
        return np.dtype(native)
    return np.dtype(WIDENED.get(f"{stored.kind}{stored.itemsize}", np.float32))


def size_text(nbytes: float) -> str:
    """Return a number of bytes as text.

    >>> size_text(900), size_text(70000), size_text(2**25), size_text(5 * 2**30)
    ('900 bytes', '68.4 KiB', '32 MiB', '5 GiB')
    """
    power = min(max(int(math.log2(max(nbytes, 1))) // 10, 0), 3)
    unit = ("bytes", "KiB", "MiB", "GiB")[power]
    return f"{nbytes / 1024**power:.3g} {unit}" if power else f"{nbytes:.0f} {unit}"


def coarse_level(levels: Sequence[Level], memory_bytes: int) -> int | None:
    """Return the finest level but level 0 that suits a budget, else the last; None without any.

    It has at most `COARSE_BYTES` and an eighth of the budget.
    """
    max_bytes = min(COARSE_BYTES, memory_bytes // 8)
    small = [k for k, level in enumerate(levels) if k and level.nbytes <= max_bytes]
    return min(small, default=len(levels) - 1 or None)


def block_ranges(values: NDArray[Any]) -> NDArray[Any]:
    """Return the ranges of blocks as in `Level`; ``values`` may have a plane more at each end.

    >>> block_ranges(np.arange(17, dtype=np.uint8).repeat(4).reshape(17, 2, 2)).ravel().tolist()
    [0, 16, 16, 16]
    """
    ranges = []
    for extreme in (np.minimum, np.maximum):
        reduced = values
        for axis in range(3):
            # Cells of a block's end have the next one's first voxels.
            planes = np.moveaxis(reduced, axis, 0)
            count = -(-len(planes) // BLOCK)
            ends = np.empty((count, *planes.shape[1:]), values.dtype)
            for k, end in enumerate(ends):
                extreme.reduce(planes[k * BLOCK : (k + 1) * BLOCK + 1], axis=0, out=end)
            reduced = np.moveaxis(ends, 0, axis)
        ranges.append(reduced)
    return np.stack(ranges)


def boxes_in(shape: Index, deep: int, least_rows: int = 1) -> Iterator[Box]:
    """Yield boxes of whole rows, of at most about `BOX_VOXELS`, that divide an array (Z, Y, X).

    They begin at multiples of ``deep`` along z and y, and have as many rows as are read together.

    >>> list(boxes_in((3, 5, 9), 2))[:2]
    [((0, 2), (0, 5), (0, 9)), ((2, 3), (0, 5), (0, 9))]
    """
    rows = max(BOX_VOXELS // (deep * shape[2]) // deep, -(-least_rows // deep), 1) * deep
    for z, y in itertools.product(range(0, shape[0], deep), range(0, shape[1], rows)):
        yield (z, min(z + deep, shape[0])), (y, min(y + rows, shape[1])), (0, shape[2])


def with_next(box: Box, shape: Index) -> Box:
    """Return a box with the next plane of voxels along each axis, for the cells between boxes."""
    z, y, x = ((low, min(high + 1, n)) for (low, high), n in zip(box, shape, strict=True))
    return z, y, x


def ranges_of(values: NDArray[Any], box: Box) -> NDArray[Any]:
    """Return the ranges of a box's blocks, from its voxels `with_next`.

    Missing voxels, which are NaN or infinite, are below all others.
    """
    if values.dtype.kind == "f":
        values = np.where(np.isfinite(values), values, np.float32(-np.inf))
    counts = tuple(slice(-(-(high - low) // BLOCK)) for low, high in box)
    return block_ranges(values)[(slice(None), *counts)]


def summarise(level: Level) -> tuple[NDArray[np.float32], int, Level, VoxelSample | None]:
    """Read a level once; return block means small enough for memory, it with ranges, its sample.

    The means are of every f³ voxels, f a power of 2, which comes second.
    """
    factor = 2
    while level.nbytes / factor**3 * 4 / level.dtype.itemsize > COARSE_BYTES:
        factor *= 2
    shape = level.shape
    coarse = np.zeros([-(-n // factor) for n in shape], np.float32)
    ranges = np.zeros((2, *(-(-n // BLOCK) for n in shape)), cast_dtype(level.dtype))
    sampler = VoxelSampler(shape, ranges.dtype)
    for box in boxes_in(shape, math.lcm(factor, BLOCK), level.chunk[1]):
        read = level.read(with_next(box, shape)).astype(ranges.dtype, copy=False)
        ranges[(slice(None), *level.blocks_of(box))] = ranges_of(read, box)
        means = read[tuple(slice(high - low) for low, high in box)]
        sampler.add(means, box)
        for _ in range(factor.bit_length() - 1):
            means = halve(means)
        coarse[tuple(slice(low // factor, -(-high // factor)) for low, high in box)] = means
    return coarse, factor, replace(level, ranges=ranges), sampler.sample()


def halve(values: NDArray[Any]) -> NDArray[np.float32]:
    """Return the means of blocks of 2³ voxels as float32; those at the ends may be smaller.

    Infinite voxels and NaN do not count; if half of a block's are, its mean is NaN.

    >>> halve(np.arange(12, dtype=np.uint8).reshape(2, 2, 3)).tolist()
    [[[5.0, 6.5]]]
    """
    finite = np.isfinite(values)
    if finite.all():
        return _halve(values)
    present = _halve(finite)
    sums = _halve(np.where(finite, values, np.float32(0)))
    with np.errstate(invalid="ignore", divide="ignore"):
        sums /= present
    sums[present <= 0.5] = np.nan
    return sums


def _halve(values: NDArray[Any]) -> NDArray[np.float32]:
    sums = values
    for axis in range(3):
        planes = np.moveaxis(sums, axis, 0)
        added = planes[::2].astype(np.float32)
        added[: len(planes) // 2] += planes[1::2]
        if len(planes) % 2:
            added[-1] *= 2
        sums = np.moveaxis(added, 0, axis)
    return np.ascontiguousarray(sums) * np.float32(1 / 8)
