"""Write OpenEXR files row by row: linear half floats with primaries, optionally spectra.

    pixels -> [exr] -> FILE.exr

OpenEXR's own library needs whole pictures in Python; this writer takes rows, so that pictures may
be larger than memory. Blocks of lines are independent, so that all cores can compress them.
Colours are premultiplied, as compositors expect in this format.

References
----------
[1] "OpenEXR File Layout", openexr.com: header, attributes, scan line blocks, ZIP compression.
"""

from __future__ import annotations

import os
import struct
import zlib
from collections import deque
from collections.abc import Iterator, Mapping
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass, field, replace
from types import MappingProxyType
from typing import Any, BinaryIO

import numpy as np
from numpy.typing import NDArray

from volspec._exr import chromaticities, to_half
from volspec.appearance.display import SPACES, ColourSpace, D50_from_white, Transfer
from volspec.spectra.files import spectral_channels, spectral_header

_MAGIC, _VERSION = 20000630, 2
_HALF, _ZIP, _RISING = 1, 3, 0  # pixel type, compression, order of lines
# Lines of a ZIP block; and zlib's level, as in OpenEXR's own library.
_LINES, _LEVEL = 16, 4
# Bytes of blocks that may wait for a core.
_WAITING_BYTES = 2**27
# More cores than this would have to wait for frames.
_MAX_THREADS = 16
_LINEAR = Transfer.gamma(1.0)
_ACES_WHITE_XY = (0.32168, 0.33767)
# Colour spaces of linear files, by their primaries.
PRIMARIES: Mapping[str, ColourSpace] = MappingProxyType(
    {
        "Rec. 709": replace(SPACES["Rec. 709"], transfer=_LINEAR),
        # SMPTE ST 2065-1 and the Academy's S-2014-004.
        "ACES AP0": ColourSpace(
            "ACES AP0", ((0.7347, 0.2653), (0.0, 1.0), (0.0001, -0.077)), _ACES_WHITE_XY, _LINEAR
        ),
        "ACES AP1": ColourSpace(
            "ACES AP1", ((0.713, 0.293), (0.165, 0.830), (0.128, 0.044)), _ACES_WHITE_XY, _LINEAR
        ),
    }
)


def encoding_threads() -> int:
    """Return the number of threads that encode files."""
    return min(os.cpu_count() or 1, _MAX_THREADS)


def white_adaptation(space: ColourSpace, to: ColourSpace) -> NDArray[np.float64]:
    """Return the (3, 3) Bradford matrix from XYZ under one space's white to another's."""
    if space.white_xy == to.white_xy:
        return np.eye(3)
    return np.asarray(
        np.linalg.solve(D50_from_white(to.white_XYZ / 100.0), D50_from_white(space.white_XYZ / 100))
    )


@dataclass(frozen=True, slots=True, eq=False)
class ExrBands:
    """Spectral channels of a picture: radiances in the layout of `spectral_image`."""

    wavelengths_nm: NDArray[np.float64]
    units: str  # unit of a value of 1


@dataclass(frozen=True, slots=True, eq=False)
class ExrHeader:
    """Metadata of an OpenEXR picture."""

    size: tuple[int, int]  # (width, height)
    space: ColourSpace  # written as its primaries and white
    text: Mapping[str, str] = field(default_factory=dict)  # written as ``volspec:name``
    has_alpha: bool = False
    bands: ExrBands | None = None  # channels after the colours (and opacity)

    @property
    def channels(self) -> list[str]:
        """Names of the channels, in the order of a pixel's values."""
        colours = [*("RGBA" if self.has_alpha else "RGB")]
        if self.bands is None:
            return colours
        return colours + spectral_channels("emissive", self.bands.wavelengths_nm)

    def to_bytes(self) -> bytes:
        """Return the header as bytes."""
        width, height = self.size
        window = struct.pack("<4i", 0, 0, width - 1, height - 1)
        channel = struct.pack("<iB3xii", _HALF, 0, 1, 1)
        channels = b"".join(name.encode() + b"\0" + channel for name in sorted(self.channels))
        white_and_primaries = chromaticities(self.space.primaries_xy, self.space.white_xy)
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
            ("chromaticities", "chromaticities", struct.pack("<8f", *white_and_primaries)),
            *((name, "string", text.encode()) for name, text in texts.items()),
        ]
        rows = (
            name.encode() + b"\0" + kind.encode() + b"\0" + struct.pack("<i", len(data)) + data
            for name, kind, data in attributes
        )
        return struct.pack("<ii", _MAGIC, _VERSION) + b"".join(rows) + b"\0"


class ExrWriter:
    """Writer of one OpenEXR picture of half floats to a binary file, from its beginning.

    ``threads`` threads compress blocks; if 1, the caller's own.
    """

    def __init__(self, file: BinaryIO, header: ExrHeader, threads: int = 1) -> None:
        width, height = header.size
        names = header.channels
        # Channels are sorted by name in the file.
        self._order = sorted(range(len(names)), key=names.__getitem__)
        self._block = np.empty((_LINES, len(names), width), "<f2")
        self._filled = 0
        self._threads = threads
        self._room = max(1, min(2 * threads, _WAITING_BYTES // self._block.nbytes))
        self._file = file
        self._offsets: list[int] = []
        file.write(header.to_bytes())
        self._table = file.tell()
        file.write(bytes(8 * -(-height // _LINES)))

    def rows(self, pixels: NDArray[Any]) -> None:
        """Append (R, W, C) linear rows."""
        if self._threads == 1:
            for block in self._blocks(pixels):
                self._write(_compress_block(block))
            return
        waiting: deque[Future[bytes]] = deque()
        # Threads exist only while rows are added, so that only one of many open files has any.
        with ThreadPoolExecutor(self._threads) as pool:
            for block in self._blocks(pixels):
                if len(waiting) == self._room:
                    self._write(waiting.popleft().result())
                waiting.append(pool.submit(_compress_block, block))
            while waiting:
                self._write(waiting.popleft().result())

    def close(self) -> None:
        """Write the last block and the table of offsets; the file stays open."""
        if self._filled:
            self._write(_compress_block(self._block[: self._filled].tobytes()))
        self._file.seek(self._table)
        self._file.write(struct.pack(f"<{len(self._offsets)}Q", *self._offsets))

    def _blocks(self, pixels: NDArray[Any]) -> Iterator[bytes]:
        """Yield the blocks filled by rows, before compression."""
        row = 0
        while row < len(pixels):
            count = min(_LINES - self._filled, len(pixels) - row)
            lines = to_half(pixels[row : row + count])[..., self._order]
            self._block[self._filled : self._filled + count] = lines.transpose(0, 2, 1)
            row, self._filled = row + count, self._filled + count
            if self._filled == _LINES:
                self._filled = 0
                yield self._block.tobytes()

    def _write(self, packed: bytes) -> None:
        y = _LINES * len(self._offsets)
        self._offsets.append(self._file.tell())
        self._file.write(struct.pack("<ii", y, len(packed)) + packed)


def _compress_block(block: bytes) -> bytes:
    """Return a block compressed, or unchanged if ZIP does not make it smaller."""
    packed = zlib.compress(_differences(block), _LEVEL)
    return packed if len(packed) < len(block) else block


def _differences(block: bytes) -> NDArray[np.uint8]:
    """Return all low bytes, then all high bytes, each as the difference to the last plus 128."""
    pairs = np.frombuffer(block, np.uint8).reshape(-1, 2)
    planes = pairs.T.ravel()
    steps = planes.copy()
    steps[1:] -= planes[:-1]
    steps[1:] += 128
    return steps
