"""Write PNG files row by row, in 8 or 16 bits, with their colour space as an ICC profile.

    frames -> [png] -> FILE.png

Pillow cannot write 16-bit colour and needs whole pictures; this writer takes rows, so that pictures
may be larger than memory.

References
----------
[1] Portable Network Graphics (PNG) Specification, third edition, W3C 2025: 5 datastream, 9
    filtering, 11.3 ancillary chunks (cICP, mDCV, cLLI, iCCP, sRGB, iTXt).
[2] Recommendation ITU-T H.273: code points of primaries and transfer functions.
[3] ICC.1:2022, profile version 4: 7.2 header, 8.3 display profiles, 9.2 tags, 10.18
    parametricCurveType; annex E, Bradford adaptation to the connection space's D50.
"""

from __future__ import annotations

import struct
import zlib
from collections.abc import Mapping
from typing import BinaryIO

import numpy as np
from numpy.typing import ArrayLike, NDArray

from volspec.appearance.display import (
    D50_XYZ,
    SPACES,
    ColourSpace,
    ContentLight,
    D50_from_white,
    Hdr,
)

_SIGNATURE = b"\x89PNG\r\n\x1a\n"
_COLOUR_TYPES = {3: 2, 4: 6}
# H.273 code points of primaries and curve, for spaces whose curve is in the list.
_CODE_POINTS = {"Display P3": (12, 13)}
_HDR_POINTS = {"PQ": (9, 16), "HLG": (9, 18)}
# zlib settings. Filtered pictures have runs but hardly any repeated words: run-length coding alone
# takes a third of the time, and files are 2 % smaller than with the full search.
_LEVEL, _WINDOW_BITS, _MEMORY = 6, 15, 9
# Bytes filtered at once: few enough that a row's variants are in the cache when compared.
_BLOCK_BYTES = 2**18
# Filters tried on each row; the one with the least sum of magnitudes is used.
_SUB, _UP, _PAETH = 1, 2, 4


class PngWriter:
    """Writer of one PNG: RGB, or RGBA with straight alpha, in 8 or 16 bits."""

    def __init__(
        self,
        file: BinaryIO,
        size: tuple[int, int],
        channels: int,
        bits: int,
        space: ColourSpace | Hdr,
        text: Mapping[str, str],
    ) -> None:
        self._file = file
        self._zip = zlib.compressobj(_LEVEL, zlib.DEFLATED, _WINDOW_BITS, _MEMORY, zlib.Z_RLE)
        self._is_16_bit = bits == 16
        self._step = channels * bits // 8
        self._before = np.zeros((1, size[0] * self._step), np.uint8)
        self._light = ContentLight(space) if isinstance(space, Hdr) else None
        file.write(_SIGNATURE)
        self._chunk(b"IHDR", struct.pack(">IIBBBBB", *size, bits, _COLOUR_TYPES[channels], 0, 0, 0))
        if isinstance(space, Hdr):
            self._chunk(b"cICP", bytes((*_HDR_POINTS[space.transfer], 0, 1)))
            xy, peak = space.mastering_display()
            self._chunk(b"mDCV", struct.pack(">8H2I", *xy.ravel(), peak, 0))
            self._light_at = file.tell()
            self._put_light(0.0, 0.0)  # until all rows are known
        elif space == SPACES["sRGB"]:
            self._chunk(b"sRGB", b"\0")  # perceptual intent, IEC 61966-2-1
        else:
            if points := _CODE_POINTS.get(space.name if SPACES.get(space.name) == space else ""):
                self._chunk(b"cICP", bytes((*points, 0, 1)))
            self._chunk(b"iCCP", b"ICC profile\0\0" + zlib.compress(icc_profile(space), 9))
        for keyword, value in text.items():
            self._chunk(b"iTXt", keyword.encode("latin-1") + bytes(5) + value.encode("utf-8"))

    def rows(self, pixels: NDArray[np.uint8] | NDArray[np.uint16]) -> None:
        """Append (R, W, C) rows of the writer's bit depth."""
        if self._light is not None:
            self._light.add(pixels[..., :3])
        kind = ">u2" if self._is_16_bit else "u1"
        lines = np.ascontiguousarray(pixels, kind).view(np.uint8).reshape(len(pixels), -1)
        block = max(1, _BLOCK_BYTES // lines.shape[1])
        for start in range(0, len(lines), block):
            part = lines[start : start + block]
            packed = self._zip.compress(_filter(part, self._before, self._step).tobytes())
            self._before = part[-1:].copy()
            if packed:
                self._chunk(b"IDAT", packed)

    def close(self) -> None:
        """End the datastream; the file stays open."""
        self._chunk(b"IDAT", self._zip.flush())
        self._chunk(b"IEND", b"")
        if self._light is not None:
            end = self._file.tell()
            self._file.seek(self._light_at)
            self._put_light(self._light.most_cd_m2, self._light.mean_cd_m2)
            self._file.seek(end)

    def _put_light(self, *cd_m2: float) -> None:
        """Write how bright the picture is: its greatest luminance, and the mean."""
        self._chunk(b"cLLI", struct.pack(">2I", *(round(1e4 * luminance) for luminance in cd_m2)))

    def _chunk(self, name: bytes, data: bytes) -> None:
        self._file.write(struct.pack(">I", len(data)) + name + data)
        self._file.write(struct.pack(">I", zlib.crc32(data, zlib.crc32(name))))


def _filter(lines: NDArray[np.uint8], before: NDArray[np.uint8], step: int) -> NDArray[np.uint8]:
    """Return (R, 1 + N): each row, preceded by the number of the filter that makes it smallest."""
    up = np.concatenate([before, lines[:-1]])
    left, corner = (np.pad(pixels[:, :-step], ((0, 0), (step, 0))) for pixels in (lines, up))
    filters = np.array([_SUB, _UP, _PAETH], np.uint8)
    tried = np.stack([lines - left, lines - up, lines - _paeth(left, up, corner)])
    # Magnitudes of signed bytes.
    costs = np.abs(tried.view(np.int8).astype(np.int16)).sum(axis=-1)
    best = np.argmin(costs, axis=0)
    return np.hstack([filters[best][:, None], tried[best, np.arange(len(lines))]])


def _paeth(
    left: NDArray[np.uint8], up: NDArray[np.uint8], corner: NDArray[np.uint8]
) -> NDArray[np.uint8]:
    """Return the neighbour nearest to left + up − corner; ties in that order."""
    a, b, c = (pixels.astype(np.int16) for pixels in (left, up, corner))
    to_a, to_b, to_c = np.abs(b - c), np.abs(a - c), np.abs(a + b - 2 * c)
    nearest = np.where(to_b <= to_c, up, corner)
    return np.where((to_a <= to_b) & (to_a <= to_c), left, nearest)


def _encode_fixed(values: ArrayLike) -> bytes:
    """Encode s15Fixed16Numbers."""
    integers = np.rint(np.asarray(values, dtype=np.float64).ravel() * 65536.0)
    return integers.astype(">i4").tobytes()


def _text(text: str) -> bytes:
    """Encode a multiLocalizedUnicodeType with one record, in English."""
    encoded = text.encode("utf-16-be")
    return b"mluc" + struct.pack(">IIIHHII", 0, 1, 12, 0x656E, 0x5553, len(encoded), 28) + encoded


def _curve(space: ColourSpace) -> bytes:
    t = space.transfer
    if t.toe == 0.0:
        return b"para" + struct.pack(">IHH", 0, 0, 0) + _encode_fixed([1.0 / t.power])
    numbers = [1.0 / t.power, 1.0 / t.gain, (t.gain - 1.0) / t.gain, 1.0 / t.slope, t.slope * t.toe]
    return b"para" + struct.pack(">IHH", 0, 3, 0) + _encode_fixed(numbers)


def icc_profile(space: ColourSpace) -> bytes:
    """Return a version 4 display profile of a colour space, as in a ``.icc`` file or iCCP chunk.

    >>> icc_profile(SPACES["Display P3"])[36:40]
    b'acsp'
    """
    matrix = space.XYZ_from_RGB / 100.0
    adapted = D50_from_white(matrix.sum(axis=1))
    red, green, blue = (b"XYZ \0\0\0\0" + _encode_fixed(column) for column in (adapted @ matrix).T)
    curve = _curve(space)
    tags = {
        b"desc": _text(space.name),
        b"cprt": _text("No copyright, use freely"),
        b"wtpt": b"XYZ \0\0\0\0" + _encode_fixed(D50_XYZ),
        b"chad": b"sf32\0\0\0\0" + _encode_fixed(adapted),
        b"rXYZ": red,
        b"gXYZ": green,
        b"bXYZ": blue,
        **dict.fromkeys((b"rTRC", b"gTRC", b"bTRC"), curve),
    }
    start = 128 + 4 + 12 * len(tags)
    table, data = struct.pack(">I", len(tags)), b""
    places: dict[bytes, int] = {}  # channels share their curve
    for name, value in tags.items():
        if value not in places:
            places[value] = start + len(data)
            data += value + bytes(-len(value) % 4)
        table += name + struct.pack(">II", places[value], len(value))
    header = struct.pack(
        ">II4s4s4s4s12s4s28s12s48s",
        start + len(data),
        0,
        b"\x04\x40\0\0",
        b"mntr",
        b"RGB ",
        b"XYZ ",
        struct.pack(">6H", 2026, 1, 1, 0, 0, 0),  # fixed, so that equal spaces have equal bytes
        b"acsp",
        bytes(28),
        _encode_fixed(D50_XYZ),
        bytes(48),
    )
    return header + table + data
