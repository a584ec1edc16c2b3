"""Write AVIF files of high dynamic range: 10 or 12 bits, with their curve and primaries.

    frames -> [avif] -> FILE.avif

ffmpeg's AV1 encoder codes the picture. It gets Y'CbCr, computed here, so that no conversion of its
own is in between; 4:4:4 and full range.

References
----------
[1] AV1 Image File Format (AVIF), version 1.1.0, AOMedia: colr box, nclx.
[2] Recommendation ITU-T H.273: code points of primaries, transfer functions and matrices.
[3] Recommendation ITU-R BT.2100-2: Y'CbCr with constants 0.2627 and 0.0593.
[4] ISO/IEC 14496-12:2022, 12.1.5 and 12.1.6: mdcv and clli; 8.11: meta, iloc, iprp.
"""

from __future__ import annotations

import math
import struct
import subprocess
import tempfile
from collections.abc import Sequence
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np
from numpy.typing import NDArray

from volspec.appearance.display import ContentLight, Hdr
from volspec.errors import InputError
from volspec.export.ffmpeg import ffmpeg

BITS = (10, 12)
_CURVES = {"PQ": "smpte2084", "HLG": "arib-std-b67"}
_RED, _BLUE = 0.2627, 0.0593
# Lossless; a seventh of a PNG's size, or less.
_CODEC = "-c:v libaom-av1 -still-picture 1 -crf 0 -cpu-used 6 -threads 4"
_BITEXACT = "-map_metadata -1 -fflags +bitexact -flags:v +bitexact"


class AvifWriter:
    """Writer of one AVIF: R'G'B' codes of 16 bits, in 10 or 12 bits."""

    def __init__(self, file: BinaryIO, size: tuple[int, int], bits: int, hdr: Hdr) -> None:
        ffmpeg()  # before the frame is made
        self._file, self._size, self._bits, self._hdr = file, size, bits, hdr
        self._rows: list[NDArray[Any]] = []
        self._light = ContentLight(hdr)

    def rows(self, pixels: NDArray[Any]) -> None:
        """Append (R, W, 3) rows of uint16."""
        self._rows.append(pixels)
        self._light.add(pixels)

    def close(self) -> None:
        """Encode the picture; the file stays open."""
        planes = YCbCr_codes(np.concatenate(self._rows), self._bits)
        self._rows.clear()
        layout = f"-pix_fmt yuv444p{self._bits}le -color_range pc -colorspace bt2020nc"
        layout += f" -color_primaries bt2020 -color_trc {_CURVES[self._hdr.transfer]}"
        with tempfile.TemporaryDirectory() as folder:
            path = Path(folder) / "frame.avif"
            command = [
                ffmpeg(),
                *["-y", "-nostdin", "-loglevel", "error", "-f", "rawvideo"],
                *layout.split(),
                *f"-s {self._size[0]}x{self._size[1]} -i - -frames:v 1".split(),
                *f"{_CODEC} {layout} {_BITEXACT} -f avif".split(),
                str(path),
            ]
            done = subprocess.run(command, input=planes.tobytes(), capture_output=True, check=False)
            if done.returncode != 0:
                lines = done.stderr.decode(errors="replace").strip().splitlines()
                reason = (lines or ["no reason given"])[-1]
                raise InputError(
                    f"AVIF: ffmpeg could not write it: {reason}",
                    "its AV1 encoder, libaom, is needed; or write .png",
                    code="unwritable",
                )
            self._file.write(_with_properties(path.read_bytes(), self._properties()))

    def _properties(self) -> list[bytes]:
        """Return the boxes of the display's colours and of how bright the picture is [4]."""
        (red, green, blue, white), peak = self._hdr.mastering_display()
        colours = struct.pack(">8H2I", *green, *blue, *red, *white, peak, 0)
        light = (math.ceil(cd_m2) for cd_m2 in (self._light.most_cd_m2, self._light.mean_cd_m2))
        return [_box(b"mdcv", colours), _box(b"clli", struct.pack(">2H", *light))]


def _box(kind: bytes, content: bytes) -> bytes:
    return struct.pack(">I4s", 8 + len(content), kind) + content


def _with_properties(data: bytes, added: Sequence[bytes]) -> bytes:
    """Return an AVIF of one item, as ffmpeg writes it, with more properties; itself if it differs.

    The boxes around them grow, and the item's data are moved by as much.
    """
    start = {kind: data.find(kind) - 4 for kind in (b"meta", b"iloc", b"iprp", b"ipco", b"ipma")}
    # Versions 0: offsets and lengths of 4 bytes, one item, one extent; one row of associations.
    heads = {b"iloc": b"\0\0\0\0D\0\0\1", b"ipma": b"\0\0\0\0\0\0\0\1"}
    if any(data[start[kind] + 8 :][:8] != head for kind, head in heads.items()):
        return data
    sizes = {kind: struct.unpack_from(">I", data, place)[0] for kind, place in start.items()}
    first, place, end = 1, start[b"ipco"] + 8, start[b"ipco"] + sizes[b"ipco"]
    while place < end:
        place += struct.unpack_from(">I", data, place)[0]
        first += 1
    properties, count_at, offset_at = b"".join(added), start[b"ipma"] + 18, start[b"iloc"] + 22
    total = len(properties) + len(added)
    grown = dict.fromkeys((b"meta", b"iprp"), total)
    grown |= {b"ipco": len(properties), b"ipma": len(added)}
    buffer = bytearray(data)
    for kind, more in grown.items():
        struct.pack_into(">I", buffer, start[kind], sizes[kind] + more)
    struct.pack_into(">I", buffer, offset_at, struct.unpack_from(">I", data, offset_at)[0] + total)
    buffer[count_at] += len(added)
    end_of_row = count_at + 1 + data[count_at]
    buffer[end_of_row:end_of_row] = bytes(range(first, first + len(added)))
    buffer[end:end] = properties
    return bytes(buffer)


def YCbCr_codes(pixels: NDArray[np.uint16], bits: int) -> NDArray[np.uint16]:
    """Return (3, H, W) full-range Y'CbCr of (H, W, 3) R'G'B', 16 bits to ``bits``."""
    top, middle = (1 << bits) - 1, 1 << (bits - 1)
    codes = pixels.astype(np.float32) * (top / 65535.0)
    Y = codes @ np.array([_RED, 1.0 - _RED - _BLUE, _BLUE], np.float32)
    Cb = (codes[..., 2] - Y) / (2.0 * (1.0 - _BLUE)) + middle
    Cr = (codes[..., 0] - Y) / (2.0 * (1.0 - _RED)) + middle
    return np.clip(np.rint(np.stack([Y, Cb, Cr])), 0, top).astype("<u2")
