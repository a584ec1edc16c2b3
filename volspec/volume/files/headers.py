"""Headers of NRRD, MetaImage and NIfTI files, checked against what the file holds.

    path -> [headers] -> itk

ITK reads some damaged files without complaint: missing voxels become zeros or whatever memory
held, surplus bytes are dropped, a negative spacing mirrors an axis, NaN in NIfTI become 0. Its
MetaImage reader also passes ``ElementDataFile`` to C's ``sprintf``, and follows it anywhere.
"""

from __future__ import annotations

import gzip
import math
import re
import struct
import zlib
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, nullcontext
from dataclasses import dataclass, replace
from pathlib import Path, PurePath
from typing import Any, BinaryIO

import numpy as np
from numpy.typing import NDArray

from volspec.errors import VolumeError, one_line, quoted
from volspec.volume.files.query import Query, Stored

NIFTI_SUFFIXES = (".nii", ".nii.gz")
TRUNCATED = "truncated, copy or download it again"
_CHUNK = 1 << 22
# A header's lines and their length, beyond which it is no header.
_MOST_LINES, _MOST_LENGTH = 10_000, 1 << 16
# A compressed file that yields so many bytes more than its header declares is not read on.
_SURPLUS = 1 << 24
# The one conversion that MetaImage defines for names of slices: slice%03d.raw.
_PATTERN, _NUMBER = re.compile(r"[^%]*%0?\d{0,2}d[^%]*"), re.compile(r"-?\d+")
# MetaIO takes a colon, too, and reads on in the next line where there is neither.
_META_LINE = re.compile(r"([^=:\r]+)[=:]([^\r]*)")
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


def check_itk_header(path: Path) -> None:
    """Refuse an NRRD or MetaImage header that ITK would misread.

    Raises
    ------
    VolumeError
        If a spacing is not positive, a size is no positive number, or the voxels are said to be
        outside of the file's folder.
    """
    header = _Fields.read(path)
    fields = header.named
    spacing = fields.get("spacings") or fields.get("ElementSpacing") or ""
    try:
        numbers = [float(word) for word in spacing.split()]
    except ValueError:
        numbers = []  # ITK says what is wrong with it
    if not all(0 < number < np.inf for number in numbers):
        raise VolumeError(
            f"{path}: spacing {spacing}; each of x, y, z must be positive, correct the header"
        )
    sizes = fields.get("sizes") or fields.get("DimSize") or ""
    if not all(_is_count(word) and int(word) > 0 for word in sizes.split()):
        raise VolumeError(
            f"{path}: sizes {quoted(sizes)}; each must be a positive whole "
            "number of less than 20 digits"
        )
    for name in _data_files(path, header):
        parts = PurePath(name.replace("\\", "/"))
        if parts.is_absolute() or ".." in parts.parts or ":" in name:
            raise VolumeError(
                f"{path}: its voxels are said to be in {quoted(name)}; a data file lies in the "
                "header's folder or below it, move it there and correct the header"
            )


def _data_files(path: Path, header: _Fields) -> list[str]:
    """Names of the files of voxels beside a header; none where it holds them itself."""
    named = _data_field(header.named)
    name, *numbers = named.split() or [""]
    if "%" in named and not (_PATTERN.fullmatch(name) and all(map(_NUMBER.fullmatch, numbers))):
        raise VolumeError(
            f"{path}: its voxels are said to be in {quoted(named)}; a pattern of names holds one "
            "number, as slice%03d.raw 1 110 1"
        )
    if name.upper() != "LIST":
        return [] if named.upper() == "LOCAL" else [named]
    lines = path.read_bytes()[header.end :].decode("latin-1").splitlines()
    return [line.strip() for line in lines if line.strip()]


def _data_field(fields: dict[str, str]) -> str:
    keys = ("ElementDataFile", "datafile")
    return next((fields[key] for key in keys if key in fields), "LOCAL")


def _is_meta(path: Path) -> bool:
    return path.suffix.lower() in (".mhd", ".mha")


@dataclass(frozen=True, slots=True)
class _Fields:
    """An NRRD's or MetaImage's fields.

    Parameters
    ----------
    named : {str: str}
        NRRD's names in lower case and without spaces, as ``byteskip``; MetaImage's as they are.
    end : int
        The byte behind the header, or behind the line after which files are listed.
    """

    named: dict[str, str]
    end: int = 0

    @classmethod
    def read(cls, path: Path) -> _Fields:
        """Read a header.

        Raises
        ------
        VolumeError
            If a line of a MetaImage header is no field: MetaIO takes the next one for its value.
        """
        read_line = cls._meta_field if _is_meta(path) else cls._nrrd_field
        named: dict[str, str] = {}
        with path.open("rb") as file:
            if not _is_meta(path) and not file.readline(80).startswith(b"NRRD"):
                return cls({})
            for number in range(_MOST_LINES):
                read = file.readline(_MOST_LENGTH)
                line = read.strip().decode("latin-1")
                if not read or not (line or _is_meta(path)):
                    break
                try:
                    field = read_line(line)
                except ValueError as error:
                    raise VolumeError(
                        f"{path}: line {number + 1} of its header, {quoted(line)}, is not "
                        "written as Name = value; correct or delete it"
                    ) from error
                if field is None:
                    continue
                key, value = field
                named[key] = value
                is_list = value.upper().startswith("LIST")
                if key == "ElementDataFile" or (key == "datafile" and is_list):  # the last
                    break
            return cls(named, file.tell())

    @staticmethod
    def _meta_field(line: str) -> tuple[str, str] | None:
        if not line:
            return None
        if (match := _META_LINE.fullmatch(line)) is None:
            raise ValueError(line)
        return match[1].rstrip(" \t"), match[2].lstrip("=: \t")

    @staticmethod
    def _nrrd_field(line: str) -> tuple[str, str] | None:
        key, found, value = line.partition(":")
        if not found or key.startswith("#") or value.startswith("="):
            return None  # a comment, or a pair of its own
        return key.strip().lower().replace(" ", ""), value.strip()


def _is_count(word: str) -> bool:
    """Return True for a whole number that a file may have bytes for."""
    return word.isdecimal() and len(word) < 20


def _is_true(word: str) -> bool:
    """Return True for what MetaIO takes as true, which is told by the first letter."""
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
        header = _Fields.read(path)
        return cls._of_meta(path, header) if _is_meta(path) else cls._of_nrrd(path, header)

    @classmethod
    def _of_nrrd(cls, path: Path, header: _Fields) -> Layout | None:
        fields = header.named
        encoding = fields.get("encoding", "raw").lower()
        encoding = "gzip" if encoding == "gz" else encoding
        order = ">" if fields.get("endian", "").lower() == "big" else "<"
        # Lines before the voxels, or bytes before packed ones.
        skip = fields.get("byteskip", "0")
        if fields.get("lineskip", "0") != "0" or encoding not in ("raw", "gzip"):
            return None
        return (
            None
            if encoding == "gzip" and skip != "0"
            else cls._at(path, header, skip, encoding, order)
        )

    @classmethod
    def _of_meta(cls, path: Path, header: _Fields) -> Layout | None:
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
        cls, path: Path, header: _Fields, skip: str, encoding: str, order: str
    ) -> Layout | None:
        """Layout of voxels behind a header or in a file of their own, from a byte on."""
        name = _data_field(header.named)
        data, start = (path, header.end) if name.upper() == "LOCAL" else (path.parent / name, 0)
        with _told(path):
            is_there = data.is_file()
        # Otherwise a pattern of names, or at a file's end.
        if not is_there or not _is_count(skip):
            return None
        return cls(path, data, start + int(skip), encoding, order)

    @classmethod
    def _of_nifti(cls, path: Path) -> Layout:
        packed = path.name.lower().endswith(".gz")
        with _told(path), gzip.open(path) if packed else path.open("rb") as file:
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
        with _told(self.path), self.data.open("rb") as file:
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
def _told(path: Path) -> Iterator[None]:
    """Turn damage of a packed stream, or a path that is none, into one line."""
    try:
        yield
    except (OSError, EOFError, zlib.error) as error:
        cause = getattr(error, "strerror", None) or one_line(error)
        raise VolumeError(f"{path}: cannot be read ({cause}); is the file complete?") from error
