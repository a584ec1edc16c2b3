"""PNG files row by row: 8 and 16 bits, with and without opacity, their colours told.

    frames -> [png]

Pillow writes no 16-bit colour, and wants whole pictures; this writer takes rows as they come, so
that a picture may be larger than memory.

References
----------
[1] Portable Network Graphics (PNG) Specification, third edition, W3C 2025: 5 datastream, 9
    filtering, 11.3 ancillary chunks (cICP, iCCP, sRGB, iTXt).
[2] Recommendation ITU-T H.273: code points of primaries and transfer functions.
"""

from __future__ import annotations

import struct
import zlib
from collections.abc import Mapping
from typing import BinaryIO

import numpy as np
from numpy.typing import NDArray

from volspec.appearance.spaces import SPACES, ColourSpace
from volspec.export.icc import icc_profile

_SIGNATURE = b"\x89PNG\r\n\x1a\n"
_COLOUR_TYPES = {3: 2, 4: 6}
# Primaries and curve by H.273; only spaces whose curve is one of its.
_CODE_POINTS = {"Display P3": (12, 13)}
# Of zlib. What filters leave of pictures has runs, and hardly ever words: looking for runs alone
# takes a third of the time, and leaves 2 % less than looking for all.
_LEVEL, _WINDOW_BITS, _MEMORY = 6, 15, 9
# What is filtered at once, so that a row's variants are still in the cache when they are compared.
_BLOCK_BYTES = 2**18
# Filters that are tried on each row; the one with the least sum of magnitudes is taken.
_SUB, _UP, _PAETH = 1, 2, 4


class PngWriter:
    """Writes one PNG.

    Parameters
    ----------
    file : binary file
        Open for writing.
    size : (width, height)
    channels : {3, 4}
        RGB, or RGB and opacity, which is not multiplied in.
    bits : {8, 16}
    space : ColourSpace
    text : {keyword: text}
    """

    def __init__(
        self,
        file: BinaryIO,
        size: tuple[int, int],
        channels: int,
        bits: int,
        space: ColourSpace,
        text: Mapping[str, str],
    ) -> None:
        self._file = file
        self._zip = zlib.compressobj(_LEVEL, zlib.DEFLATED, _WINDOW_BITS, _MEMORY, zlib.Z_RLE)
        self._wide = bits == 16
        self._step = channels * bits // 8
        self._before = np.zeros((1, size[0] * self._step), np.uint8)
        file.write(_SIGNATURE)
        self._chunk(b"IHDR", struct.pack(">IIBBBBB", *size, bits, _COLOUR_TYPES[channels], 0, 0, 0))
        if space == SPACES["sRGB"]:
            self._chunk(b"sRGB", b"\0")  # perceptual intent, IEC 61966-2-1
        else:
            if points := _CODE_POINTS.get(space.name if SPACES.get(space.name) == space else ""):
                self._chunk(b"cICP", bytes((*points, 0, 1)))
            self._chunk(b"iCCP", b"ICC profile\0\0" + zlib.compress(icc_profile(space), 9))
        for keyword, value in text.items():
            self._chunk(b"iTXt", keyword.encode("latin-1") + bytes(5) + value.encode("utf-8"))

    def rows(self, pixels: NDArray[np.uint8] | NDArray[np.uint16]) -> None:
        """Add rows; (R, W, C) of the writer's bits."""
        kind = ">u2" if self._wide else "u1"
        lines = np.ascontiguousarray(pixels, kind).view(np.uint8).reshape(len(pixels), -1)
        block = max(1, _BLOCK_BYTES // lines.shape[1])
        for start in range(0, len(lines), block):
            part = lines[start : start + block]
            packed = self._zip.compress(_filtered(part, self._before, self._step).tobytes())
            self._before = part[-1:].copy()
            if packed:
                self._chunk(b"IDAT", packed)

    def close(self) -> None:
        """End the datastream; the file stays open."""
        self._chunk(b"IDAT", self._zip.flush())
        self._chunk(b"IEND", b"")

    def _chunk(self, name: bytes, data: bytes) -> None:
        self._file.write(struct.pack(">I", len(data)) + name + data)
        self._file.write(struct.pack(">I", zlib.crc32(data, zlib.crc32(name))))


def _filtered(lines: NDArray[np.uint8], before: NDArray[np.uint8], step: int) -> NDArray[np.uint8]:
    """(R, 1 + N): each row after the number of the filter that leaves it smallest."""
    up = np.concatenate([before, lines[:-1]])
    left, corner = (np.pad(each[:, :-step], ((0, 0), (step, 0))) for each in (lines, up))
    filters = np.array([_SUB, _UP, _PAETH], np.uint8)
    tried = np.stack([lines - left, lines - up, lines - _paeth(left, up, corner)])
    # A byte's magnitude as a signed one.
    costs = np.abs(tried.view(np.int8).astype(np.int16)).sum(axis=-1)
    best = np.argmin(costs, axis=0)
    return np.hstack([filters[best][:, None], tried[best, np.arange(len(lines))]])


def _paeth(
    left: NDArray[np.uint8], up: NDArray[np.uint8], corner: NDArray[np.uint8]
) -> NDArray[np.uint8]:
    """The neighbour nearest to left + up − corner; ties in that order."""
    a, b, c = (each.astype(np.int16) for each in (left, up, corner))
    to_a, to_b, to_c = np.abs(b - c), np.abs(a - c), np.abs(a + b - 2 * c)
    nearest = np.where(to_b <= to_c, up, corner)
    return np.where((to_a <= to_b) & (to_a <= to_c), left, nearest)
