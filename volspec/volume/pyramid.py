"""Volumes larger than memory: the levels of detail of a stored array, read chunk by chunk.

    file -> [pyramid] -> Volume.pyramid -> raycast (volspec.raycast.out_of_core)

A `Volume` with a pyramid holds its coarsest level in memory, by which it is framed, sliced and
previewed; casts read the finer ones.
"""

from __future__ import annotations

import itertools
import math
import threading
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field, fields, replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from volspec.errors import one_line
from volspec.volume.checks import NATIVE_DTYPES, WIDENED

Index = tuple[int, int, int]
Box = tuple[tuple[int, int], tuple[int, int], tuple[int, int]]
"""From and to of voxels, along z, y, x."""
BLOCK = 16
"""Cells along the edge of the blocks whose least and greatest values are known."""
DEFAULT_BYTES = 2**31
"""Most bytes of voxels in memory, unless a budget is given."""
COARSE_BYTES = 2**26
"""Most bytes of the level that is in memory."""
BOX_VOXELS = 2**22
"""About the most voxels of a box that is read, averaged and written at once."""


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
    complete : bool
        True if a chunk that is not stored is damage, False if it holds the fill value.
    """

    array: Any
    axes: Index
    at: tuple[int, ...]
    world_from_index: NDArray[np.float64]
    chunk: Index
    ranges: NDArray[Any] | None = None
    complete: bool = False

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
        root = getattr(getattr(self.array, "store", self.array), "root", None)
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
        return tuple(slice(low // BLOCK, -(-high // BLOCK)) for low, high in box)

    def read(self, box: Box) -> NDArray[Any]:
        """Read voxels (Z, Y, X) from the array; raises what its library raises."""
        index: list[int | slice] = list(self.at)
        for axis, (low, high) in zip(self.axes, box, strict=True):
            index[axis] = slice(low, high)
        values = np.asarray(self.array[tuple(index)])
        order = sorted(self.axes)
        return values.transpose([order.index(axis) for axis in self.axes])

    def chunks_in(self, box: Box) -> list[Index]:
        """Return the numbers of the chunks that hold some of the voxels of a box."""
        ends = zip(box, self.chunk, strict=True)
        z, y, x = (range(low // c, -(-high // c)) for (low, high), c in ends)
        return list(itertools.product(z, y, x))


@dataclass(slots=True)
class ReadCounts:
    """Numbers of chunks and bytes that were read of a pyramid, since it was opened."""

    chunks: int = 0
    voxel_bytes: int = 0
    again: int = 0  # chunks that had been read before, and were dropped for want of memory
    progress: str = ""  # of the cast in progress, in words; empty without one


class ChunkCache:
    """Chunks in memory, up to a number of bytes; threads may share it.

    Callers announce the order in which they need chunks, so that the chunk dropped first is the one
    that is needed last, or not any more.
    """

    def __init__(self, most_bytes: int) -> None:
        self.most_bytes = most_bytes
        self.nbytes = 0
        self._held: dict[Chunk, NDArray[Any]] = {}
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

    def get(self, chunk: Chunk) -> NDArray[Any] | None:
        """Return a chunk that is in memory, else None."""
        with self._lock:
            found = self._held.pop(chunk, None)
            if found is not None:
                self._held[chunk] = found  # used last
            return found

    def put(self, chunk: Chunk, values: NDArray[Any]) -> None:
        """Add a chunk, and drop others for it."""
        with self._lock:
            if chunk in self._held:
                return
            self._held[chunk] = values
            self.nbytes += values.nbytes
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
        while self.nbytes > self.most_bytes and len(self._held) > (last is not None):
            # The first of those that no turn needs is the one that was used longest ago.
            worst, latest = None, -1.0
            for chunk in self._held:
                left = self._turns.get(chunk)
                turn = left[-1] if left else math.inf
                if turn > latest:
                    worst, latest = chunk, turn
                    if turn == math.inf:
                        break
            assert worst is not None
            self.nbytes -= self._held.pop(worst).nbytes


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
    """

    name: str
    levels: tuple[Level, ...]
    dtype: np.dtype[Any]
    range: tuple[float, float]
    missing: float | None = None
    memory_bytes: int = DEFAULT_BYTES
    counts: ReadCounts = field(init=False, default_factory=ReadCounts)
    cache: ChunkCache = field(init=False)
    gaps: dict[Chunk, str] = field(init=False, default_factory=dict)
    _seen: set[Chunk] = field(init=False, default_factory=set)

    def __post_init__(self) -> None:
        object.__setattr__(self, "cache", ChunkCache(self.memory_bytes))

    def __reduce__(self) -> tuple[type[Pyramid], tuple[Any, ...]]:
        """Pickle the levels without what was read of them."""
        return type(self), tuple(getattr(self, each.name) for each in fields(self) if each.init)

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

    def chunk(self, chunk: Chunk) -> NDArray[Any] | None:
        """Return a chunk's voxels as cast, from memory or the file; None if it is damaged.

        A damaged one is then one of the `gaps`.
        """
        found = self.cache.get(chunk)
        if found is not None or chunk in self.gaps:
            return found
        level = self.levels[chunk.level]
        try:
            values = self._as_cast(level.read(level.box_of(chunk[1:])))
        except Exception as error:  # whatever the array's library raises
            self.gaps[chunk] = one_line(error)[:120] or type(error).__name__
            return None
        if fault := self._fault(level, chunk, values):
            self.gaps[chunk] = fault
            return None
        self.counts.chunks += 1
        self.counts.again += chunk in self._seen
        self._seen.add(chunk)
        self.counts.voxel_bytes += values.nbytes
        self.cache.put(chunk, values)
        return values

    def _as_cast(self, values: NDArray[Any]) -> NDArray[Any]:
        if values.dtype.kind == "f":
            finite = np.isfinite(values)
            if not finite.all():
                other = self.range[0] if self.missing is None else self.missing
                values = np.where(finite, values, np.float32(other))
        return np.ascontiguousarray(values, self.dtype)

    def _fault(self, level: Level, chunk: Chunk, values: NDArray[Any]) -> str:
        """Return what is wrong with voxels, by the ranges that are stored of them."""
        box = level.box_of(chunk[1:])
        if values.shape != tuple(high - low for low, high in box):
            return f"it has the shape {values.shape}"
        if level.place is not None and not level.place.exists():
            return "its file or folder is gone"
        if level.ranges is None:
            return ""
        lows, highs = (ends[level.blocks_of(box)] for ends in level.ranges)
        least, most = values.min(), values.max()
        if least < lows.min() or most > highs.max():
            return "its values are not those that were written"
        if level.complete and least == most:
            # Cells of the last blocks have voxels of the next chunk.
            own = tuple(slice(None, -1 if n > 1 else None) for n in lows.shape)
            if min(lows.shape) > 1 and (lows[own].min() < least or highs[own].max() > most):
                return "it is missing"
        return ""

    def read(
        self, number: int, box: Box, needed: Iterable[Index], turn: int, gap: float
    ) -> NDArray[Any]:
        """Return the voxels of a box of a level.

        Those of damaged chunks are ``gap``, and those of chunks that are not ``needed`` a value in
        the stored range of these: where a table shows nothing of that range, it does not between
        two of these values either, as the ranges of neighbours overlap.
        """
        level, wanted = self.levels[number], set(needed)
        values = np.empty([high - low for low, high in box], self.dtype)
        for place in level.chunks_in(box):
            of_chunk = level.box_of(place)
            to, source = [], []
            for (low, high), (first, last) in zip(box, of_chunk, strict=True):
                begin, end = max(low, first), min(high, last)
                to.append(slice(begin - low, end - low))
                source.append(slice(begin - first, end - first))
            if place not in wanted:
                assert level.ranges is not None
                values[tuple(to)] = level.ranges[0][level.blocks_of(of_chunk)].min()
                continue
            chunk = Chunk(number, *place)
            held = self.chunk(chunk)
            values[tuple(to)] = gap if held is None else held[tuple(source)]
            self.cache.done(chunk, turn)
        return values

    def describe_gaps(self) -> str:
        """Return a sentence about damaged chunks, which names the first; empty without any."""
        if not self.gaps:
            return ""
        first, why = next(iter(self.gaps.items()))
        count = len(self.gaps)
        many = f"{count} chunks cannot be read, such as " if count > 1 else ""
        cannot = "" if many else " cannot be read"
        end = "they are left out" if many else "it is left out"
        return (
            f"{self.name}: {many}chunk {'/'.join(map(str, first[1:]))} of level "
            f"{first.level}{cannot} ({why}); {end} of the picture"
        )


def cast_dtype(stored: np.dtype[Any]) -> np.dtype[Any]:
    """Return the type of voxels as cast, for those of any type.

    >>> cast_dtype(np.dtype(">i2")).name, cast_dtype(np.dtype("u4")).name
    ('int16', 'float32')
    """
    native = stored.newbyteorder("=")
    if native in NATIVE_DTYPES:
        return np.dtype(native)
    return np.dtype(WIDENED.get(f"{stored.kind}{stored.itemsize}", np.float32))


def coarse_level(levels: Sequence[Level], memory_bytes: int) -> int | None:
    """Return the finest level but level 0 that suits a budget, else the last; None without any.

    It has at most `COARSE_BYTES` and an eighth of the budget.
    """
    most = min(COARSE_BYTES, memory_bytes // 8)
    small = [k for k, level in enumerate(levels) if k and level.nbytes <= most]
    return min(small, default=len(levels) - 1 or None)


def block_ranges(values: NDArray[Any]) -> NDArray[Any]:
    """Return the ranges of blocks as in `Level`; ``values`` may have a plane more at each end.

    >>> block_ranges(np.arange(17, dtype=np.uint8).repeat(4).reshape(17, 2, 2)).ravel().tolist()
    [0, 16, 16, 16]
    """
    found = []
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
        found.append(reduced)
    return np.stack(found)


def boxes_in(shape: Index, deep: int) -> Iterator[Box]:
    """Yield boxes of whole rows, of at most about `BOX_VOXELS`, that divide an array (Z, Y, X).

    They begin at multiples of ``deep`` along z and y.

    >>> list(boxes_in((3, 5, 9), 2))[:2]
    [((0, 2), (0, 5), (0, 9)), ((2, 3), (0, 5), (0, 9))]
    """
    rows = max(BOX_VOXELS // (deep * shape[2]) // deep, 1) * deep
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


def summarise(level: Level) -> tuple[NDArray[np.float32], int, Level]:
    """Read a level once; return block means small enough for memory, and it with its ranges.

    The means are of every f³ voxels, f a power of 2, which comes second.
    """
    factor = 2
    while level.nbytes / factor**3 * 4 / level.dtype.itemsize > COARSE_BYTES:
        factor *= 2
    shape = level.shape
    coarse = np.zeros([-(-n // factor) for n in shape], np.float32)
    ranges = np.zeros((2, *(-(-n // BLOCK) for n in shape)), cast_dtype(level.dtype))
    for box in boxes_in(shape, math.lcm(factor, BLOCK)):
        read = level.read(with_next(box, shape)).astype(ranges.dtype, copy=False)
        ranges[(slice(None), *level.blocks_of(box))] = ranges_of(read, box)
        means = read[tuple(slice(high - low) for low, high in box)]
        for _ in range(factor.bit_length() - 1):
            means = halve(means)
        coarse[tuple(slice(low // factor, -(-high // factor)) for low, high in box)] = means
    return coarse, factor, replace(level, ranges=ranges)


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
