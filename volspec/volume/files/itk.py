"""NRRD, MetaImage and NIfTI files, read with SimpleITK, with a check that no voxel is missing.

    header fields -> Layout -> [itk] -> Reading

ITK reads some damaged files without an error: missing voxels become zeros or uninitialised memory,
surplus bytes are dropped, NaN in NIfTI becomes 0. Voxels are therefore read here if their layout is
known.
"""

from __future__ import annotations

import gzip
import math
import os
import struct
import zlib
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, nullcontext
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np
from numpy.typing import NDArray

from volspec._files import captured_output
from volspec.errors import VolumeError, one_line
from volspec.volume.files.headers import (
    HeaderFields,
    check_itk_header,
    data_field,
    is_count,
    is_meta,
)
from volspec.volume.files.lattice import affine
from volspec.volume.files.query import Query, Reading, Stored

NIFTI_SUFFIXES = (".nii", ".nii.gz")
_CHUNK = 1 << 22
# Decompression stops at this many bytes more than the header declares.
_SURPLUS = 1 << 24
# NIfTI-1's type codes, and the first byte at which voxels can begin.
_NIFTI_TYPES = {2: "u1", 4: "i2", 8: "i4", 16: "f4", 64: "f8"}
_NIFTI_TYPES |= {256: "i1", 512: "u2", 768: "u4", 1024: "i8", 1280: "u8"}
_NIFTI_HEADER = 348
# Run of voxels, a mask of its non-finite voxels, and their values.
_NonFinite = tuple[slice, NDArray[np.bool_], NDArray[Any]]


def _is_true(word: str) -> bool:
    """Return True for a word that MetaIO reads as true, judging by its first letter alone."""
    return word[:1] in ("T", "t", "1")


@dataclass(frozen=True, slots=True)
class Layout:
    """Location of a header's voxels: one run of bytes in one file."""

    path: Path  # the header's file, for messages
    data: Path  # often the same file
    start: int  # first byte, counted after decompression if whole_packed
    encoding: str = "raw"  # gzip, or zlib (zlib's header or gzip's)
    order: str = "<"
    whole_packed: bool = False  # the compressed stream includes the header
    stored: np.dtype[Any] | None = None  # a NIfTI file's type, which ITK may convert to floats
    rescaled: bool = False  # left to ITK

    @classmethod
    def of(cls, path: Path) -> Layout | None:
        """Return a file's layout; None if only ITK can read it: text, bzip2, several files.

        A file named as NIfTI that is not NIfTI is refused; ITK would read it as Analyze.
        """
        if path.name.lower().endswith(NIFTI_SUFFIXES):
            return cls._from_nifti(path)
        header = HeaderFields.read(path)
        return cls._from_meta(path, header) if is_meta(path) else cls._from_nrrd(path, header)

    @classmethod
    def _from_nrrd(cls, path: Path, header: HeaderFields) -> Layout | None:
        fields = header.named
        encoding = fields.get("encoding", "raw").lower()
        encoding = "gzip" if encoding == "gz" else encoding
        order = ">" if fields.get("endian", "").lower() == "big" else "<"
        # Lines before the voxels, or bytes before packed voxels.
        skip = fields.get("byteskip", "0")
        if fields.get("lineskip", "0") != "0" or (encoding == "gzip" and skip != "0"):
            return None
        known = encoding in ("raw", "gzip")
        return cls._at(path, header, skip, encoding, order) if known else None

    @classmethod
    def _from_meta(cls, path: Path, header: HeaderFields) -> Layout | None:
        fields = header.named
        if not _is_true(fields.get("BinaryData", "True")):
            return None
        is_packed = _is_true(fields.get("CompressedData", ""))
        order = fields.get("BinaryDataByteOrderMSB", fields.get("ElementByteOrderMSB", ""))
        skip = fields.get("HeaderSize", "0")
        if is_packed and skip == "-1":  # at the file's end, but of unknown length
            skip = "0"
        if skip != "0":  # bytes of the file itself, too
            header = replace(header, end=0)
        encoding = "zlib" if is_packed else "raw"
        return cls._at(path, header, skip, encoding, ">" if _is_true(order) else "<")

    @classmethod
    def _at(
        cls, path: Path, header: HeaderFields, skip: str, encoding: str, order: str
    ) -> Layout | None:
        """Return the layout of voxels that begin at a byte, after a header or in a data file."""
        name = data_field(header.named)
        data, start = (path, header.end) if name.upper() == "LOCAL" else (path.parent / name, 0)
        with _one_line_for(path):
            is_there = data.is_file()
        # Otherwise a pattern of names, or voxels at a file's end.
        if not is_there or not is_count(skip):
            return None
        return cls(path, data, start + int(skip), encoding, order)

    @classmethod
    def _from_nifti(cls, path: Path) -> Layout:
        packed = path.name.lower().endswith(".gz")
        with _one_line_for(path), gzip.open(path) if packed else path.open("rb") as file:
            head = file.read(352)
        order = "<" if head[:4] == struct.pack("<i", 348) else ">"
        if len(head) < 352 or head[:4] != struct.pack(order + "i", 348) or head[344:347] != b"n+1":
            raise VolumeError(
                f"{path}: not a NIfTI-1 image; is the file complete and of the type its name "
                "says? Save NIfTI-2 and Analyze as NIfTI-1",
                code="damaged",
            )
        (kind,) = struct.unpack_from(order + "h", head, 70)
        start, slope, shift = struct.unpack_from(order + "3f", head, 108)
        if kind not in _NIFTI_TYPES:
            raise VolumeError(
                f"{path}: its values have NIfTI type {kind}; supported are "
                f"{', '.join(map(str, _NIFTI_TYPES))}, which are integers and floats",
                code="unsupported",
            )
        # Clipped as by niftilib.
        first = int(start) if _NIFTI_HEADER <= start < 2**31 else _NIFTI_HEADER
        encoding = "gzip" if packed else "raw"
        stored = np.dtype(order + _NIFTI_TYPES[kind])
        rescaled = (slope, shift) not in ((1, 0), (0, 0))
        return cls(path, path, first, encoding, order, packed, stored, rescaled)

    def holds(self, dtype: np.dtype[Any]) -> bool:
        """Return True if the file's numbers are the values themselves, in ITK's type."""
        if self.stored is None:
            return True
        return not self.rescaled and self.stored.str[1:] == dtype.str[1:]

    def chunks(self, nbytes: int) -> Iterator[bytes]:
        """Yield the voxels' bytes, not many more than ``nbytes``; fewer if the file ends early."""
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
        """Return voxels (Z, Y, X), not ``rescaled``, and the number of their bytes in the file.

        The size is (x, y, z), ``dtype`` has either byte order. Voxels are incomplete if the file
        ends early; in a packed file at most a few bytes more than needed are counted.
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
        """Find NaN and infinities, which ITK's NIfTI reader sets to 0; the size is (x, y, z).

        Raises VolumeError if the file ends early; ITK would invent the rest.
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
                found.append((slice(at, at + numbers.size), mask, numbers[mask]))
            at += numbers.size
        query.require_held(at * itemsize + len(rest), size, count * itemsize)
        return found


def _unpacked(file: BinaryIO, encoding: str) -> Iterator[bytes]:
    """Yield a file's bytes from its current position, decompressed a chunk at a time."""
    if encoding == "zlib":
        inflate = zlib.decompressobj(zlib.MAX_WBITS | 32)  # as in MetaIO: zlib's header or gzip's
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
    """Turn the error of a damaged stream or an invalid path into a one-line error."""
    try:
        yield
    except (OSError, EOFError, zlib.error) as error:
        cause = getattr(error, "strerror", None) or one_line(error)
        raise VolumeError(
            f"{path}: cannot be read ({cause}); is the file complete?", code="damaged"
        ) from error


def read_itk(query: Query) -> Reading:
    """Read a 3-D image with one value per voxel."""
    import SimpleITK as sitk

    path = query.path
    if not path.name.lower().endswith(NIFTI_SUFFIXES):
        check_itk_header(path)
    layout = Layout.of(path)
    output: list[str] = []
    image: Any = sitk.ImageFileReader()
    image.SetFileName(os.fspath(path))
    try:
        with captured_output(output):
            image.ReadImageInformation()
            size, dtype = image.GetSize(), _scalar_type(path, image)
            nbytes = math.prod(size) * dtype.itemsize
            query.reserve(size, dtype.itemsize)
            held = None
            if layout is not None and layout.holds(dtype):
                values, held = layout.voxels(size, dtype)
                query.require_held(held, size, nbytes)
            else:
                non_finite = layout.non_finite(size, query) if layout is not None else []
                image = image.Execute()
                values = sitk.GetArrayViewFromImage(image)
                if non_finite:
                    values = values.copy()
                for run, mask, numbers in non_finite:
                    values.reshape(-1)[run][mask] = numbers
    except RuntimeError as error:
        raise VolumeError(
            f"{path}: cannot be read ({itk_message(error, output)}); is the file complete and of "
            "the type its name says?",
            code="damaged",
        ) from error
    spacing = np.array(image.GetSpacing())
    directions = np.array(image.GetDirection()).reshape(3, 3)
    return Reading(
        values,
        spacing_mm=tuple(spacing.tolist()),
        world_from_index=affine(directions * spacing, image.GetOrigin()),
        remarks=query.surplus(held, nbytes),
        owner=image,
    )


def _scalar_type(path: Path, reader: Any) -> np.dtype[Any]:
    """Return a voxel's type; refuse images that are not 3-D with one value per voxel."""
    import SimpleITK as sitk

    size, components = reader.GetSize(), reader.GetNumberOfComponents()
    if len(size) != 3 or components != 1:
        raise VolumeError(
            f"{path}: is {len(size)}-D ({'x'.join(map(str, size))}) with {components} components "
            "per voxel; a volume is 3-D with one. Choose one channel or time step",
            code="shape",
        )
    dtype: np.dtype[Any] = sitk.GetArrayFromImage(sitk.Image([1, 1, 1], reader.GetPixelID())).dtype
    return dtype


def itk_message(error: RuntimeError, output: list[str]) -> str:
    """Return ITK's innermost message, the last one, such as "expected 7208960 bytes but …"."""
    lines = [line.strip() for line in [*str(error).splitlines(), *output] if line.strip()]
    return lines[-1]
