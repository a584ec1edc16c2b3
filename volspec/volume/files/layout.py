"""Layout of the voxels in NRRD, MetaImage and NIfTI files, and a check that all are there.

    header fields -> [layout] -> Stored | array -> itk

ITK reads some damaged files without complaint: missing voxels become zeros or whatever memory
held, surplus bytes are dropped, NaN in NIfTI become 0.
"""

from __future__ import annotations

import gzip
import math
import struct
import zlib
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, nullcontext
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np
from numpy.typing import NDArray

from volspec.errors import VolumeError, one_line
from volspec.volume.files.headers import HeaderFields, data_field, is_count, is_meta
from volspec.volume.files.query import Query, Stored

NIFTI_SUFFIXES = (".nii", ".nii.gz")
_CHUNK = 1 << 22
# A compressed file that yields so many bytes more than its header declares is not read on.
_SURPLUS = 1 << 24
# Codes of NIfTI-1 for types of numbers; and the least byte at which voxels begin.
_NIFTI_TYPES = {
    2: "u1",
    4: "i2",
    8: "i4",
    16: "f4",
    64: "f8",
    256: "i1",
    512: "u2",
    768: "u4",
    1024: "i8",
    1280: "u8",
}
_NIFTI_HEADER = 348


def _is_true(word: str) -> bool:
    """Return True for what MetaIO takes as true: it looks at the first letter alone."""
    return word[:1] in ("T", "t", "1")


@dataclass(frozen=True, slots=True)
class Layout:
    """A header's voxels: one run of bytes in one file.

    Parameters
    ----------
    path : Path
        The header's file, for messages.
    data : Path
        The file that holds the voxels, often the same.
    start : int
        Their first byte, in what is unpacked if ``whole_packed``.
    encoding : str
        ``raw``, ``gzip``, or ``zlib`` (zlib's header or gzip's).
    order : str
        Byte order, ``<`` or ``>``.
    whole_packed : bool
        The header is in the packed stream, too.
    stored : dtype, optional
        Of a NIfTI file: the type of the numbers in it, of which ITK may make floats.
    rescaled : bool
        These are not yet the values, which only ITK can tell.
    """

    path: Path
    data: Path
    start: int
    encoding: str = "raw"
    order: str = "<"
    whole_packed: bool = False
    stored: np.dtype[Any] | None = None
    rescaled: bool = False

    @classmethod
    def of(cls, path: Path) -> Layout | None:
        """Layout of a file; None if only ITK can tell: text, bzip2, several files.

        Raises
        ------
        VolumeError
            If it is no NIfTI file although its name says so; ITK would take it for Analyze.
        """
        if path.name.lower().endswith(NIFTI_SUFFIXES):
            return cls._of_nifti(path)
        header = HeaderFields.read(path)
        return cls._of_meta(path, header) if is_meta(path) else cls._of_nrrd(path, header)

    @classmethod
    def _of_nrrd(cls, path: Path, header: HeaderFields) -> Layout | None:
        fields = header.named
        encoding = fields.get("encoding", "raw").lower()
        encoding = "gzip" if encoding == "gz" else encoding
        order = ">" if fields.get("endian", "").lower() == "big" else "<"
        # Lines before the voxels, or bytes before packed ones.
        skip = fields.get("byteskip", "0")
        if fields.get("lineskip", "0") != "0" or (encoding == "gzip" and skip != "0"):
            return None
        known = encoding in ("raw", "gzip")
        return cls._at(path, header, skip, encoding, order) if known else None

    @classmethod
    def _of_meta(cls, path: Path, header: HeaderFields) -> Layout | None:
        fields = header.named
        if not _is_true(fields.get("BinaryData", "True")):
            return None
        is_packed = _is_true(fields.get("CompressedData", ""))
        order = fields.get("BinaryDataByteOrderMSB", fields.get("ElementByteOrderMSB", ""))
        skip = fields.get("HeaderSize", "0")
        if is_packed and skip == "-1":  # at the file's end, but of unknown length
            skip = "0"
        if skip != "0":  # of the file itself, too
            header = replace(header, end=0)
        encoding = "zlib" if is_packed else "raw"
        return cls._at(path, header, skip, encoding, ">" if _is_true(order) else "<")

    @classmethod
    def _at(
        cls, path: Path, header: HeaderFields, skip: str, encoding: str, order: str
    ) -> Layout | None:
        """Layout of voxels behind a header or in a file of their own, from a byte on."""
        name = data_field(header.named)
        data, start = (path, header.end) if name.upper() == "LOCAL" else (path.parent / name, 0)
        with _one_line_for(path):
            is_there = data.is_file()
        # Otherwise a pattern of names, or at a file's end.
        if not is_there or not is_count(skip):
            return None
        return cls(path, data, start + int(skip), encoding, order)

    @classmethod
    def _of_nifti(cls, path: Path) -> Layout:
        packed = path.name.lower().endswith(".gz")
        with _one_line_for(path), gzip.open(path) if packed else path.open("rb") as file:
            head = file.read(352)
        order = "<" if head[:4] == struct.pack("<i", 348) else ">"
        if len(head) < 352 or head[:4] != struct.pack(order + "i", 348) or head[344:347] != b"n+1":
            raise VolumeError(
                f"{path}: holds no NIfTI-1 image; is the file complete and of the type its name "
                "says? Save NIfTI-2 and Analyze as NIfTI-1"
            )
        (kind,) = struct.unpack_from(order + "h", head, 70)
        start, slope, shift = struct.unpack_from(order + "3f", head, 108)
        if kind not in _NIFTI_TYPES:
            raise VolumeError(
                f"{path}: its numbers are of NIfTI's type {kind}; known are "
                f"{', '.join(map(str, _NIFTI_TYPES))}, which are integers and floats"
            )
        # As niftilib, whatever the number says.
        first = int(start) if _NIFTI_HEADER <= start < 2**31 else _NIFTI_HEADER
        encoding = "gzip" if packed else "raw"
        stored = np.dtype(order + _NIFTI_TYPES[kind])
        rescaled = (slope, shift) not in ((1, 0), (0, 0))
        return cls(path, path, first, encoding, order, packed, stored, rescaled)

    def holds(self, dtype: np.dtype[Any]) -> bool:
        """Return True if the numbers in the file are the values, of the type that ITK gives."""
        if self.stored is None:
            return True
        return not self.rescaled and self.stored.str[1:] == dtype.str[1:]

    def chunks(self, nbytes: int) -> Iterator[bytes]:
        """Yield the voxels' bytes, not many more than ``nbytes``; fewer if the file ends early.

        Raises
        ------
        VolumeError
            If a packed stream is damaged.
        """
        left = nbytes + _SURPLUS
        with _one_line_for(self.path), self.data.open("rb") as file:
            start = self.start
            if not self.whole_packed:
                file.seek(start)
                start = 0
            for chunk in _unpacked(file, self.encoding):
                if left <= 0:
                    return
                skipped, start = min(start, len(chunk)), max(start - len(chunk), 0)
                left -= len(chunk) - skipped
                yield chunk[skipped:]

    def voxels(
        self, size: Sequence[int], dtype: np.dtype[Any]
    ) -> tuple[Stored | NDArray[Any], int]:
        """Locate or unpack voxels (Z, Y, X) that are not ``rescaled``.

        Parameters
        ----------
        size : (x, y, z)
        dtype : dtype
            Of either byte order.

        Returns
        -------
        voxels : Stored or (Z, Y, X) array
            Not all of them if the file ends early.
        held : int
            Bytes of voxels in the file; of a packed one not many more than are asked for.

        Raises
        ------
        VolumeError
            If a packed stream is damaged.
        """
        shape, code = tuple(size[::-1]), f"{self.order}{dtype.str[1:]}"
        nbytes = math.prod(shape) * dtype.itemsize
        if self.encoding == "raw":
            held = max(self.data.stat().st_size - self.start, 0)
            return Stored(str(self.data), shape, code, self.start), held
        unpacked, held = np.empty(nbytes, np.uint8), 0
        for chunk in self.chunks(nbytes):
            room = unpacked[held : held + len(chunk)]
            room[:] = np.frombuffer(chunk, np.uint8, room.size)
            held += len(chunk)
        return unpacked.view(code).reshape(shape), held

    def non_finite(self, size: Sequence[int], query: Query) -> list[_NonFinite]:
        """Find NaN and infinities, which ITK's NIfTI reader sets to 0.

        Parameters
        ----------
        size : (x, y, z)
        query : Query
            For messages.

        Raises
        ------
        VolumeError
            If a packed stream is damaged, or the file ends early: ITK makes up what is missing.
        """
        assert self.stored is not None
        count, itemsize = math.prod(size), self.stored.itemsize
        found, at, rest = [], 0, b""
        for chunk in self.chunks(count * itemsize):
            rest += chunk
            numbers = np.frombuffer(rest, self.stored, min(len(rest) // itemsize, count - at))
            rest = rest[numbers.nbytes :]
            mask = ~np.isfinite(numbers)
            if mask.any():
                found.append(_NonFinite(at, mask, numbers[mask]))
            at += numbers.size
        query.require_held(at * itemsize + len(rest), size, count * itemsize)
        return found


@dataclass(frozen=True, slots=True, eq=False)
class _NonFinite:
    """NaN and infinities of a run of voxels."""

    start: int
    mask: NDArray[np.bool_]
    numbers: NDArray[Any]

    def put_back(self, flat: NDArray[Any]) -> None:
        """Set them among all voxels."""
        flat[self.start : self.start + self.mask.size][self.mask] = self.numbers


def _unpacked(file: BinaryIO, encoding: str) -> Iterator[bytes]:
    """The bytes of a file from where it stands, unpacked a chunk at a time."""
    if encoding == "zlib":
        inflate = zlib.decompressobj(zlib.MAX_WBITS | 32)  # as MetaIO: zlib's header or gzip's
        while not inflate.eof and (packed := inflate.unconsumed_tail or file.read(_CHUNK)):
            yield inflate.decompress(packed, _CHUNK)
        yield inflate.flush()
        if not inflate.eof:
            raise EOFError("the compressed voxels end early or are damaged")
        return
    with gzip.GzipFile(fileobj=file) if encoding == "gzip" else nullcontext(file) as stream:
        while chunk := stream.read(_CHUNK):
            yield chunk


@contextmanager
def _one_line_for(path: Path) -> Iterator[None]:
    """Turn damage of a packed stream, or a path that is none, into one line."""
    try:
        yield
    except (OSError, EOFError, zlib.error) as error:
        cause = getattr(error, "strerror", None) or one_line(error)
        raise VolumeError(
            f"{path}: cannot be read ({cause}); is the file complete?", code="damaged"
        ) from error
