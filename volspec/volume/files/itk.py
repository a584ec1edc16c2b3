"""NRRD and MetaImage files, read with SimpleITK, with a check that no voxel is missing.

    header fields -> Layout -> [itk] -> Reading

ITK reads some damaged files without an error: missing voxels become zeros or uninitialised memory,
surplus bytes are dropped. Voxels are therefore read here if their layout is known.

Of several time steps (a fourth axis, or Slicer's sequences) or components per voxel (channels) one
is read.
"""

from __future__ import annotations

import gzip
import math
import os
import re
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
    TRUNCATED,
    HeaderFields,
    check_itk_header,
    component_axes,
    data_field,
    is_count,
    is_meta,
)
from volspec.volume.files.label_tables import labels_in_nrrd
from volspec.volume.files.lattice import affine
from volspec.volume.files.query import Query, Reading, Stored
from volspec.volume.labels import Label

_CHUNK = 1 << 22
# Decompression stops at this many bytes more than the header declares.
_SURPLUS = 1 << 24
# Beginning of ITK's messages: the object, with its address.
_SENDER = re.compile(r"(?:ITK )?ERROR: \w+\(0x[0-9a-f]+\): ")
# Custom keys of NRRD in which Slicer states what its sequences are indexed by.
_INDEX = "axis 0 index"


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
    stored: np.dtype[Any] | None = None  # the type, if it is not ITK's
    scaling: tuple[float, float] = (1.0, 0.0)  # slope and intercept of the stored numbers
    planar: bool = False  # components are volumes one after another, not neighbours

    @classmethod
    def of(cls, path: Path) -> Layout | None:
        """Return a file's layout; None if only ITK can read it: text, bzip2, several files."""
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
        count, components = len(fields.get("kinds", "").split()), component_axes(fields)
        planar = components == [count - 1] and count > 1
        is_ordered = planar or components in ([], [0])
        known = encoding in ("raw", "gzip") and is_ordered
        layout = cls._at(path, header, skip, encoding, order) if known else None
        return layout and replace(layout, planar=planar)

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
        self, extent: Extent, dtype: np.dtype[Any], query: Query, remarks: list[str]
    ) -> Stored | NDArray[Any]:
        """Return the chosen voxels (Z, Y, X); ``dtype`` is ITK's, of either byte order.

        Raises VolumeError if the file ends early; remarks on bytes that the header does not
        declare.
        """
        kind = self.stored or dtype
        code = f"{self.order}{kind.str[1:]}"
        # A block holds the chosen voxels, and the other components if they are neighbours.
        beside = 1 if self.planar else extent.components
        shape = (*extent.size[::-1], beside)
        nbytes = math.prod(shape) * kind.itemsize
        block = extent.block(self.planar)
        blocks = extent.steps * extent.components // beside
        if self.encoding == "raw":
            held = max(self.data.stat().st_size - self.start, 0)
            stored = Stored(str(self.data), shape, code, self.start + block * nbytes)
        else:
            unpacked, held = self._unpack_block(nbytes, block, blocks)
        declared = (*extent.size, *(n for n in (extent.steps, extent.components) if n > 1))
        # Bytes after a packed block are not counted, unless it is the last.
        needed = nbytes * (blocks if self.encoding == "raw" else block + 1)
        query.require_held(held, declared, needed)
        remarks += query.surplus(held, nbytes * blocks)
        if self.encoding == "raw" and beside == 1 and self.scaling == (1.0, 0.0):
            return replace(stored, shape=shape[:3])
        values = stored.read() if self.encoding == "raw" else unpacked.view(code).reshape(shape)
        return self._scaled(values[..., extent.channel if beside > 1 else 0])

    def _unpack_block(self, nbytes: int, block: int, blocks: int) -> tuple[NDArray[Any], int]:
        """Return a block of packed voxels, and the number of bytes up to its end, or a few more."""
        unpacked, held = np.empty(nbytes, np.uint8), 0
        first, end = block * nbytes, (block + 1) * nbytes
        for chunk in self.chunks(end if block == blocks - 1 else end - _SURPLUS):
            part = chunk[max(first - held, 0) :]
            room = unpacked[max(held - first, 0) :][: len(part)]
            room[:] = np.frombuffer(part, np.uint8, room.size)
            held += len(chunk)
        return unpacked, held

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


@dataclass(frozen=True, slots=True)
class Extent:
    """Size of an image of several time steps or components, and those that are read."""

    size: tuple[int, int, int]  # x, y, z
    steps: int
    components: int
    time: int
    channel: int

    @classmethod
    def of(
        cls,
        query: Query,
        size: Sequence[int],
        components: int,
        step_s: float | None,
        is_sequence: bool,
    ) -> Extent:
        """Choose a time step and a channel; refuse images of fewer than 3 axes or too many.

        The components of a sequence are its time steps.
        """
        steps, *more = (*size[3:], 1)
        # NIfTI's fifth axis, or one that a fourth of length 1 precedes.
        components *= more[0] if len(more) > 1 else 1
        if len(size) < 3 or len(more) > 2:
            raise VolumeError(
                f"{query.path}: is {len(size)}-D ({'x'.join(map(str, size))})",
                "a volume is 3-D: give a file of all slices, or a folder of TIFF or PNG slices"
                if len(size) < 3
                else "save a 3-D or 4-D part of it, such as with nibabel: image.slicer[..., 0]",
                code="shape",
            )
        x, y, z = size[:3]
        if is_sequence:
            component = query.index("time", components, "time steps")
            return cls((x, y, z), steps, components, 0, component)
        times = [] if step_s is None else [f"{k * step_s:g} s" for k in range(steps)]
        time = query.index("time", steps, "time steps", times)
        channel = query.index("channel", components, "channels (components per voxel)")
        return cls((x, y, z), steps, components, time, channel)

    def block(self, planar: bool) -> int:
        """Return the number of 3-D blocks before the chosen one."""
        return self.time + self.steps * self.channel if planar else self.time


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
    except EOFError as error:
        raise VolumeError(f"{path}: {TRUNCATED}", code="damaged") from error
    except (OSError, zlib.error) as error:
        cause = getattr(error, "strerror", None) or one_line(error)
        raise VolumeError(
            f"{path}: cannot be read ({cause}); is the file complete?", code="damaged"
        ) from error


def read_itk(query: Query) -> Reading:
    """Read a 3-D image, or one time step and one component of it."""
    import SimpleITK as sitk

    path = query.path
    query.allow("time", "channel")
    check_itk_header(path)
    layout = Layout.of(path)
    output: list[str] = []
    remarks: list[str] = []
    image: Any = sitk.ImageFileReader()
    image.SetFileName(os.fspath(path))
    image.SetImageIO("MetaImageIO" if is_meta(path) else "NrrdImageIO")
    try:
        with captured_output(output):
            image.ReadImageInformation()
            size, dtype = image.GetSize(), _scalar_type(image)
            components = image.GetNumberOfComponents()
            extent = Extent.of(query, size, components, None, is_sequence(path))
            query.end_choices()
            beside = 1 if layout is not None and layout.planar else components
            query.reserve((*extent.size, *((beside,) if beside > 1 else ())), dtype.itemsize)
            if layout is not None:
                values = layout.voxels(extent, dtype, query, remarks)
            else:
                query.reserve((*size, components), dtype.itemsize)
                image = image.Execute()
                whole = sitk.GetArrayViewFromImage(image)
                values = whole.reshape(extent.steps, *extent.size[::-1], components)
                values = values[extent.time, ..., extent.channel]
    except RuntimeError as error:
        raise VolumeError(
            f"{path}: cannot be read ({itk_message(error, output)}); is the file complete and of "
            "the type its name says?",
            code="damaged",
        ) from error
    axes = len(size)
    spacing = np.array(image.GetSpacing())[:3]
    directions = np.array(image.GetDirection()).reshape(axes, axes)[:3, :3]
    return Reading(
        values,
        spacing_mm=tuple(spacing.tolist()),
        world_from_index=affine(directions * spacing, image.GetOrigin()[:3]),
        remarks=remarks,
        labels=_segments(path, extent.channel),
        owner=image,
    )


def is_sequence(path: Path) -> bool:
    """Return True for a sequence of Slicer's, an NRRD whose first axis is time."""
    if not path.name.lower().endswith((".nrrd", ".nhdr")):
        return False
    header = HeaderFields.read(path)
    first = header.named.get("kinds", "").lower().split()[:1]
    return first == ["list"] and any(key.startswith(_INDEX) for key in header.pairs)


def _segments(path: Path, layer: int) -> dict[int, Label] | None:
    """Return the segments of Slicer's NRRD in a layer; None if the header states none."""
    return None if is_meta(path) else labels_in_nrrd(HeaderFields.read(path).pairs, layer)


def _scalar_type(reader: Any) -> np.dtype[Any]:
    """Return the type of a voxel's components."""
    import SimpleITK as sitk

    scalar = sitk.Image([1, 1, 1], reader.GetPixelID())
    dtype: np.dtype[Any] = sitk.GetArrayFromImage(scalar).dtype
    return dtype


def itk_message(error: RuntimeError, output: list[str]) -> str:
    """Return ITK's innermost message, the last one, such as "expected 7208960 bytes but …"."""
    lines = [line.strip() for line in [*str(error).splitlines(), *output] if line.strip()]
    return _SENDER.sub("", lines[-1])
