"""Voxels of a header: where their bytes lie, and the part of them that is read.

    header (nrrd, metaimage, neuro, …) -> [Layout] -> voxels (Z, Y, X)

Axes are counted as in headers, the fastest first. Of the axes that are not of space, time steps and
channels, one index each is read. Missing bytes are refused; surplus ones are remarked on.
"""

from __future__ import annotations

import bz2
import math
import re
import zlib
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager, nullcontext
from dataclasses import dataclass
from pathlib import Path, PurePath
from typing import Any, BinaryIO

import numpy as np
from numpy.typing import NDArray

from volspec._confine import require_inside
from volspec.errors import VolumeError, quote
from volspec.volume.files.presence import require_contents
from volspec.volume.files.query import Query, Stored

TRUNCATED = "truncated, copy or download it again"
_CHUNK = 1 << 22
# Packed bytes that are read at once: what they unpack to stays in the processor's cache.
_PACKED = 1 << 17
# Decompression stops at this many bytes more than the header declares.
_SURPLUS = 1 << 24
# The only conversion in names of slices: slice%03d.raw.
_PATTERN = re.compile(r"[^%]*%0?\d{0,2}d[^%]*")
# Most files of a list or a pattern.
_MAX_FILES = 100_000


@dataclass(frozen=True, slots=True)
class Layout:
    """Location and type of a header's voxels, a run of bytes in one file, or parts in several."""

    path: Path  # the header's file, for messages
    files: tuple[Path, ...]  # often the same one
    dtype: np.dtype[Any]  # byte order included
    shape: tuple[int, ...]
    encoding: str = "raw"  # gzip, zlib (zlib's header or gzip's), bzip2, text, hex
    seek: int = 0  # first byte in each file; -1: the voxels are at its end
    lines: int = 0  # that follow, and are skipped
    skip: int = 0  # bytes before the voxels, counted after decompression
    scaling: tuple[float, float] = (1.0, 0.0)  # slope and intercept of the stored numbers

    @property
    def nbytes(self) -> int:
        """Bytes of all voxels."""
        return math.prod(self.shape) * self.dtype.itemsize

    def read(
        self, picked: Mapping[int, int], query: Query, notes: list[str]
    ) -> Stored | NDArray[Any]:
        """Return the voxels (Z, Y, X) at one index ``picked`` along each other axis."""
        # The block that holds them, of the axes before those that are fixed at the end.
        axes, block = len(self.shape), 0
        while axes - 1 in picked:
            axes -= 1
            block = block * self.shape[axes] + picked[axes]
        shape = self.shape[:axes]
        nbytes = math.prod(shape) * self.dtype.itemsize
        blocks = math.prod(self.shape[axes:])
        with _one_line_for(self.path):
            if is_stored := self.encoding == "raw" and len(self.files) == 1:
                first = self._first_byte()
                actual = max(self.files[0].stat().st_size - first, 0)
                place = first + block * nbytes
                stored = Stored(str(self.files[0]), shape[::-1], self.dtype.str, place)
            else:
                query.reserve(shape, self.dtype.itemsize)
                unpacked, actual = self._unpack_block(nbytes, block, blocks)
        # Bytes after a packed block are not counted, unless it is the last.
        needed = nbytes * (blocks if self.encoding == "raw" else block + 1)
        query.require_held(actual, self.shape, needed)
        notes += query.surplus(actual, self.nbytes)
        inner = tuple(picked.get(axis, slice(None)) for axis in reversed(range(axes)))
        is_complete = all(isinstance(part, slice) for part in inner)
        if is_stored:
            if is_complete and self.scaling == (1.0, 0.0):
                return stored
            query.reserve(shape, self.dtype.itemsize)
            values = stored.read()
        else:
            values = unpacked.view(self.dtype).reshape(shape[::-1])
        return self._scaled(values if is_complete else values[inner])

    def _first_byte(self) -> int:
        """Return the first byte of uncompressed voxels."""
        if self.seek < 0:
            return max(self.files[0].stat().st_size - self.nbytes, 0)
        with self.files[0].open("rb") as file:
            self._go_to_voxels(file)
            return file.tell() + self.skip

    def _go_to_voxels(self, file: BinaryIO) -> None:
        # Compressed voxels at a file's end are of unknown length.
        file.seek(max(self.seek, 0))
        for _ in range(self.lines):
            if not file.readline(_CHUNK):
                break

    def _chunks(self, nbytes: int) -> Iterator[bytes]:
        """Yield the voxels' bytes, not many more than ``nbytes``; fewer if a file ends early."""
        size = self.nbytes // len(self.files)
        left = nbytes + _SURPLUS
        for path in self.files if left > 0 else ():
            room = left if len(self.files) == 1 else min(size, left)
            skip, left = self.skip, left - room
            with path.open("rb") as file:
                self._go_to_voxels(file)
                if self.seek < 0 and self.encoding == "raw":
                    file.seek(max(path.stat().st_size - size, 0))
                for chunk in _decode_chunks(file, self.encoding, self.dtype):
                    part = chunk[skip:][:room]
                    skip, room = max(skip - len(chunk), 0), room - len(part)
                    yield part
                    if room <= 0:
                        break
            if room > 0 and left > 0:
                raise VolumeError(
                    f"{self.path}: {path.name} holds {size - room} of {size} bytes; {TRUNCATED}",
                    code="damaged",
                )

    def _unpack_block(self, nbytes: int, block: int, blocks: int) -> tuple[NDArray[Any], int]:
        """Return a block of voxels' bytes, and the number of bytes up to its end, or a few more."""
        unpacked, length = np.empty(nbytes, np.uint8), 0
        first, end = block * nbytes, (block + 1) * nbytes
        for chunk in self._chunks(end if block == blocks - 1 else end - _SURPLUS):
            part = chunk[max(first - length, 0) :]
            room = unpacked[max(length - first, 0) :][: len(part)]
            room[:] = np.frombuffer(part, np.uint8, room.size)
            length += len(chunk)
        return unpacked, length

    def _scaled(self, values: NDArray[Any]) -> NDArray[Any]:
        """Return values with slope and intercept applied, in float32; in double to be exact."""
        slope, shift = self.scaling
        if (slope, shift) == (1.0, 0.0):
            return np.ascontiguousarray(values)
        scaled = np.empty(values.shape, np.float32)
        with np.errstate(over="ignore"):
            for target, source in zip(scaled, values, strict=True):  # by slice: doubles are wide
                target[...] = source.astype(np.float64) * slope + shift
        return scaled


def choose_axes(
    query: Query, shape: Sequence[int], roles: Mapping[int, str], step_s: float | None = None
) -> dict[int, int]:
    """Return the index that the query selects along each axis that is not of space.

    ``roles`` are those axes with their option, ``time`` or ``channel``; ``step_s`` is the time
    between steps. Raises VolumeError unless three axes, or two of a picture, are of space.
    """
    space = [count for axis, count in enumerate(shape) if axis not in roles]
    if len(space) not in (2, 3) or len(shape) > 5:
        raise VolumeError(
            f"{query.path}: is {len(shape)}-D ({'x'.join(map(str, shape))})",
            "a volume is 3-D: give a file of all slices, or a folder of slices"
            if len(space) < 3
            else "save a part of five axes at most, such as with nibabel: image.slicer[..., "
            f"{', '.join('0' * (len(shape) - 4))}]",
            code="shape",
        )
    indices: dict[int, int] = {}
    for option, noun in (("time", "time steps"), ("channel", "channels (components per voxel)")):
        axes = [axis for axis, role in roles.items() if role == option]
        count = math.prod(shape[axis] for axis in axes)
        timed = step_s if option == "time" else None
        names = [f"{k * timed:g} s" for k in range(count)] if timed else ()
        number = query.index(option, count, noun, names)
        for axis in axes:
            number, indices[axis] = divmod(number, shape[axis])
    query.end_choices()
    return indices


def data_files(path: Path, names: Sequence[str]) -> tuple[Path, ...]:
    """Return the separate files of a header's voxels; refuse those elsewhere or missing."""
    if not 0 < len(names) <= _MAX_FILES:
        raise VolumeError(f"{path}: names {len(names)} files of voxels", code="damaged")
    for name in names:
        parts = PurePath(name.replace("\\", "/"))
        if parts.is_absolute() or ".." in parts.parts or ":" in name:
            raise VolumeError(
                f"{path}: its voxels are said to be in {quote(name)}; a data file must lie in the "
                "header's folder or below it, move it there and correct the header",
                code="unsupported",
            )
    for name in names:
        with _one_line_for(path):
            require_data(path, path.parent / name)
    return tuple(path.parent / name for name in names)


def require_data(path: Path, data: Path) -> None:
    """Refuse a header whose file of voxels is not there, or must not be opened."""
    require_inside(data, VolumeError)
    if not (data.is_file() or data.is_symlink()):
        raise VolumeError(
            f"{path}: its voxels are in {data.name}, which is not there",
            f"copy it into {data.parent}, next to the header",
            code="not-found",
        )
    require_contents(data, f"{path}: its voxels are in {data.name}, which")


def named_files(
    path: Path, where: str, listed: Sequence[str], usual: Sequence[str] = ()
) -> tuple[Path, ...]:
    """Return the files of a header's voxels: one, those of a pattern, or a ``LIST`` that follows.

    ``usual`` are the numbers of a pattern that states none.
    """
    if where[:4].upper() == "LIST":
        return data_files(path, listed)
    if "%" not in where:
        return data_files(path, [where])
    pattern, *numbers = where.split()
    return data_files(path, _expand_pattern(path, pattern, [*numbers, *usual[len(numbers) :]]))


def _expand_pattern(path: Path, pattern: str, numbers: Sequence[str]) -> list[str]:
    """Return the names of a pattern such as ``slice%03d.raw``, with first, last and step."""
    try:
        first, last, step = (int(word) for word in numbers[:3])
        if not _PATTERN.fullmatch(pattern) or not step:
            raise ValueError
        sequence = range(first, last + (1 if step > 0 else -1), step)
        return [pattern % number for number in sequence[: _MAX_FILES + 1]]
    except (ValueError, TypeError) as error:
        raise VolumeError(
            f"{path}: its voxels are said to be in {quote(' '.join((pattern, *numbers)))}; a "
            "pattern of names has one number, such as slice%03d.raw 1 110 1",
            code="syntax",
        ) from error


def counts(path: Path, words: Sequence[str]) -> tuple[int, ...]:
    """Return the sizes of a header. Raises VolumeError if one is no positive number."""
    if not all(word.isdecimal() and len(word) < 20 and int(word) > 0 for word in words):
        raise VolumeError(
            f"{path}: sizes {quote(' '.join(words))}; each must be a positive whole number of "
            "fewer than 20 digits",
            code="range",
        )
    return tuple(int(word) for word in words)


def dimensions(path: Path, word: str, maximum: int = 16) -> int:
    """Return the number of axes of a header. Raises VolumeError if it is none."""
    if not (word.isdecimal() and len(word) < 20 and 1 <= int(word) <= maximum):
        raise VolumeError(
            f"{path}: {quote(word)} dimensions; expected 3, correct the header", code="shape"
        )
    return int(word)


def damage_error(path: Path, problem: str) -> VolumeError:
    """Return the error of a header that cannot be read."""
    return VolumeError(
        f"{path}: {problem}; is the file complete and of the type its name says?", code="damaged"
    )


def _decode_chunks(file: BinaryIO, encoding: str, dtype: np.dtype[Any]) -> Iterator[bytes]:
    """Yield a file's bytes from its current position, decoded a chunk at a time."""
    if encoding in ("zlib", "gzip"):
        yield from _inflate_chunks(file, many=encoding == "gzip")
    elif encoding in ("text", "hex"):
        yield from _decoded_text(file, None if encoding == "hex" else dtype)
    else:
        with bz2.open(file) if encoding == "bzip2" else nullcontext(file) as stream:
            while chunk := stream.read(_CHUNK):
                yield chunk


def _inflate_chunks(file: BinaryIO, many: bool) -> Iterator[bytes]:
    """Yield what zlib or gzip packed, also of several gzip members: faster than by gzip itself."""
    packed = file.read(_PACKED)
    while packed:
        inflate = zlib.decompressobj(zlib.MAX_WBITS | 32)  # zlib's header or gzip's
        while not inflate.eof:
            yield inflate.decompress(packed, 4 * _PACKED) if packed else inflate.flush()
            if not (packed or inflate.eof):
                raise EOFError
            packed = inflate.unconsumed_tail or (b"" if inflate.eof else file.read(_PACKED))
        remainder = inflate.unused_data.lstrip(b"\0") or file.read(_PACKED).lstrip(b"\0")
        packed = remainder if many else b""


def _decoded_text(file: BinaryIO, dtype: np.dtype[Any] | None) -> Iterator[bytes]:
    """Yield bytes written as numbers of a type; or as hexadecimal digits, without a type."""
    remainder = b""
    while chunk := file.read(_CHUNK // 4):
        text = remainder + chunk.replace(b",", b" ")
        if dtype is None:
            digits = b"".join(text.split())
            even = len(digits) & ~1
            remainder = digits[even:]
            yield bytes.fromhex(digits[:even].decode("ascii"))
        else:
            end = max(text.rfind(mark) for mark in b" \n\t") + 1
            remainder = text[end:]
            yield _numbers(text[:end], dtype)
    if dtype is not None:
        yield _numbers(remainder, dtype)


def _numbers(text: bytes, dtype: np.dtype[Any]) -> bytes:
    number = float if dtype.kind == "f" else int
    return np.array([number(word) for word in text.split()], dtype).tobytes()


@contextmanager
def _one_line_for(path: Path) -> Iterator[None]:
    """Turn the error of a damaged stream or an invalid path into a one-line error."""
    try:
        yield
    except VolumeError:
        raise
    except EOFError as error:
        raise VolumeError(f"{path}: {TRUNCATED}", code="damaged") from error
    except (OSError, zlib.error, ValueError, OverflowError) as error:
        cause = getattr(error, "strerror", None) or "its voxels are damaged"
        raise VolumeError(
            f"{path}: cannot be read ({cause}); is the file complete?", code="damaged"
        ) from error
