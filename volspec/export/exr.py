"""Frames as OpenEXR, row by row: linear half floats, the primaries told, spectra where asked for.

    pixels -> [exr]

From Python OpenEXR's own library takes whole pictures (but for an interface that it is to lose);
this writer takes rows as they come, so that a picture may be larger than memory. Blocks of lines
know nothing of each other: all cores pack those of a picture that comes in rows. Opacity is
multiplied into the colours, as compositors expect of this format.

References
----------
[1] "OpenEXR File Layout", openexr.com: header, attributes, scan line blocks, ZIP compression.
"""

from __future__ import annotations

import io
import os
import struct
import zlib
from collections import deque
from collections.abc import Iterator, Mapping
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import contextmanager
from dataclasses import dataclass, field
from typing import Any, BinaryIO

import numpy as np
from numpy.typing import NDArray

from volspec._exr import chromaticities, to_half
from volspec._files import write_whole
from volspec.appearance.spaces import ColourSpace
from volspec.export.encoders import workers
from volspec.spectra.spectral_image import spectral_channels, spectral_header

_MAGIC, _VERSION = 20000630, 2
_HALF, _ZIP, _RISING = 1, 3, 0  # pixel type, compression, order of lines
# Lines of a block, which ZIP packs at once; and zlib's level, that of OpenEXR's own library.
_LINES, _LEVEL = 16, 4
# Of blocks that may wait for cores.
_WAITING_BYTES = 2**27


@dataclass(frozen=True, slots=True, eq=False)
class ExrBands:
    """The spectral channels of a picture: radiances in the layout of `spectral_image`.

    Parameters
    ----------
    wavelengths_nm : (N,) array
    units : str
        What 1 is.
    """

    wavelengths_nm: NDArray[np.float64]
    units: str


@dataclass(frozen=True, slots=True, eq=False)
class ExrHeader:
    """What an OpenEXR picture says beside its pixels.

    Parameters
    ----------
    size : (width, height)
    space : ColourSpace
        Its primaries and white are told.
    text : {name: text}
        Kept as ``volspec:name``.
    has_alpha : bool
    bands : ExrBands, optional
        Behind the colours (and opacity) a pixel has a spectrum.
    """

    size: tuple[int, int]
    space: ColourSpace
    text: Mapping[str, str] = field(default_factory=dict)
    has_alpha: bool = False
    bands: ExrBands | None = None

    @property
    def channels(self) -> list[str]:
        """Names in the order of a pixel's numbers."""
        colours = [*("RGBA" if self.has_alpha else "RGB")]
        if self.bands is None:
            return colours
        return colours + spectral_channels("emissive", self.bands.wavelengths_nm)

    def packed(self) -> bytes:
        """The header as it stands in the file."""
        width, height = self.size
        window = struct.pack("<4i", 0, 0, width - 1, height - 1)
        channel = struct.pack("<iB3xii", _HALF, 0, 1, 1)
        channels = b"".join(name.encode() + b"\0" + channel for name in sorted(self.channels))
        told = chromaticities(self.space.primaries_xy, self.space.white_xy)
        texts = {f"volspec:{name}": text for name, text in self.text.items()}
        if self.bands is not None:
            texts |= spectral_header("emissive", self.bands.units)
        attributes = [
            ("channels", "chlist", channels + b"\0"),
            ("compression", "compression", bytes([_ZIP])),
            ("dataWindow", "box2i", window),
            ("displayWindow", "box2i", window),
            ("lineOrder", "lineOrder", bytes([_RISING])),
            ("pixelAspectRatio", "float", struct.pack("<f", 1.0)),
            ("screenWindowCenter", "v2f", struct.pack("<2f", 0.0, 0.0)),
            ("screenWindowWidth", "float", struct.pack("<f", 1.0)),
            ("chromaticities", "chromaticities", struct.pack("<8f", *told)),
            *((name, "string", text.encode()) for name, text in texts.items()),
        ]
        rows = (
            name.encode() + b"\0" + kind.encode() + b"\0" + struct.pack("<i", len(data)) + data
            for name, kind, data in attributes
        )
        return struct.pack("<ii", _MAGIC, _VERSION) + b"".join(rows) + b"\0"


class ExrWriter:
    """Writes one OpenEXR picture of half floats.

    Parameters
    ----------
    file : binary file
        Open for writing, at its beginning.
    header : ExrHeader
    threads : int
        That pack blocks; with 1 the caller's own does.
    """

    def __init__(self, file: BinaryIO, header: ExrHeader, threads: int = 1) -> None:
        width, height = header.size
        names = header.channels
        # A file has its channels in the order of their names.
        self._order = sorted(range(len(names)), key=names.__getitem__)
        self._block = np.empty((_LINES, len(names), width), "<f2")
        self._filled = 0
        self._threads = threads
        self._room = max(1, min(2 * threads, _WAITING_BYTES // self._block.nbytes))
        self._file = file
        self._offsets: list[int] = []
        file.write(header.packed())
        self._table = file.tell()
        file.write(bytes(8 * -(-height // _LINES)))

    def rows(self, pixels: NDArray[Any]) -> None:
        """Add rows; (R, W, C) linear."""
        if self._threads == 1:
            for plain in self._blocks(pixels):
                self._write(_packed(plain))
            return
        waiting: deque[Future[bytes]] = deque()
        # Only while rows are added: of many files that are open at once one has threads.
        with ThreadPoolExecutor(self._threads) as pool:
            for plain in self._blocks(pixels):
                if len(waiting) == self._room:
                    self._write(waiting.popleft().result())
                waiting.append(pool.submit(_packed, plain))
            while waiting:
                self._write(waiting.popleft().result())

    def close(self) -> None:
        """Write what is left, and where blocks begin; the file stays open."""
        if self._filled:
            self._write(_packed(self._block[: self._filled].tobytes()))
        self._file.seek(self._table)
        self._file.write(struct.pack(f"<{len(self._offsets)}Q", *self._offsets))

    def _blocks(self, pixels: NDArray[Any]) -> Iterator[bytes]:
        """The blocks that rows fill, as they stand in a file before they are packed."""
        at = 0
        while at < len(pixels):
            count = min(_LINES - self._filled, len(pixels) - at)
            lines = to_half(pixels[at : at + count])[..., self._order]
            self._block[self._filled : self._filled + count] = lines.transpose(0, 2, 1)
            at, self._filled = at + count, self._filled + count
            if self._filled == _LINES:
                self._filled = 0
                yield self._block.tobytes()

    def _write(self, packed: bytes) -> None:
        y = _LINES * len(self._offsets)
        self._offsets.append(self._file.tell())
        self._file.write(struct.pack("<ii", y, len(packed)) + packed)


def _packed(plain: bytes) -> bytes:
    """A block's data; as it is where ZIP makes it no smaller."""
    packed = zlib.compress(_predicted(plain), _LEVEL)
    return packed if len(packed) < len(plain) else plain


def _predicted(plain: bytes) -> NDArray[np.uint8]:
    """All low bytes, then all high ones, each as the step from the one before, plus 128."""
    pairs = np.frombuffer(plain, np.uint8).reshape(-1, 2)
    parted = pairs.T.ravel()
    steps = parted.copy()
    steps[1:] -= parted[:-1]
    steps[1:] += 128
    return steps


@contextmanager
def exr_file(path: str | os.PathLike[str], header: ExrHeader) -> Iterator[ExrWriter]:
    """An OpenEXR picture that takes its rows one after the other; it appears when all are there.

    Raises
    ------
    InputError
        If the folder cannot be written to.
    """
    with write_whole(path) as temporary, temporary.open("wb") as file:
        writer = ExrWriter(file, header, workers())
        yield writer
        writer.close()


def exr_bytes(pixels: NDArray[Any], header: ExrHeader) -> bytes:
    """The file of a whole picture; (H, W, C) linear. One thread packs it: `Encoders` has many."""
    file = io.BytesIO()
    writer = ExrWriter(file, header)
    writer.rows(pixels)
    writer.close()
    return file.getvalue()
