"""Pages of TIFF files, and PNG pictures, as arrays; damage told in one line.

    tiff, stack -> [pages] -> (Y, X) or (Y, X, S) arrays

tifffile knows the dialects of microscopes. Without imagecodecs, a large package, it leaves LZW and
JPEG alone: such pages are read by Pillow, which knows no dialects and few types. Others it would
narrow or read in the wrong byte order without a word; they are refused.
"""

from __future__ import annotations

import logging
import struct
import zlib
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from volspec._files import captured_output
from volspec.errors import VolumeError, one_line

_DAMAGE = (
    *(ValueError, OSError, RuntimeError, LookupError, TypeError, AttributeError, ArithmeticError),
    *(EOFError, SyntaxError, MemoryError, ImportError, struct.error, zlib.error),
)
# `Query.reserve`, or one for a single picture of several.
Reserve = Callable[[Sequence[int], int], None]
# Types that Pillow reads as they are, with the file's byte order; of several samples a pixel one.
_PILLOWS = ("<b1", ">b1", "<u1", ">u1", "<u2", ">u2", "<i2", "<i4", "<u4", "<f4")
_PILLOWS_COLOURS = ("<u1", ">u1")
# TIFF 6.0: PhotometricInterpretation, PlanarConfiguration.
_WHITE_IS_ZERO, _CONTIGUOUS = 0, 1
# Where a PNG file says the bits of a sample.
_PNG_BITS = 24


class _Complaints(logging.Handler):
    """Keeps what is logged."""

    def __init__(self, level: int) -> None:
        super().__init__(level)
        self.said: list[str] = []

    def emit(self, record: logging.LogRecord) -> None:
        """Keep a message."""
        self.said.append(record.getMessage())


@contextmanager
def readable(path: Path) -> Iterator[None]:
    """Turn what readers of pictures raise and log into one line.

    Raises
    ------
    VolumeError
        If the body raises, or tifffile logs an error: it goes on with what it could read.
    """
    log, handler = logging.getLogger("tifffile"), _Complaints(logging.ERROR)
    said = handler.said
    log.addHandler(handler)
    heard, log.propagate = log.propagate, False
    try:
        yield
    except _DAMAGE as error:
        if isinstance(error, VolumeError) and not said:
            raise
        if _lacks_codec(error):
            raise VolumeError(
                f"{path}: its pages are compressed in a way that needs another package; "
                "pip install imagecodecs, or save the stack without compression",
                code="unsupported",
            ) from error
        raise VolumeError(_damaged(path, [*said, str(error)])) from error
    finally:
        log.removeHandler(handler)
        log.propagate = heard
    if said:
        raise VolumeError(_damaged(path, said))


def _damaged(path: Path, said: list[str]) -> str:
    return (
        f"{path}: cannot be read ({one_line(said[0])[:120]}); is it complete and of the type its "
        "name says?"
    )


def _lacks_codec(error: Exception) -> bool:
    return isinstance(error, ImportError) or "imagecodecs" in str(error)


def page_values(page: Any) -> NDArray[Any]:
    """The pixels of a tifffile ``TiffPage``, as its axes say, decoded by whom that can."""
    try:
        return np.asarray(page.asarray())
    except (ValueError, ImportError) as error:
        if not _lacks_codec(error) or not _pillow_can(page.keyframe):
            raise
    from PIL import Image, UnidentifiedImageError

    try:
        # libtiff prints its complaints, and Pillow raises them.
        with captured_output([]), Image.open(page.parent.filehandle.path) as image:
            image.seek(page.index)
            values = np.array(image)
    except UnidentifiedImageError as error:
        raise ImportError("imagecodecs") from error
    # Pillow inverts these, tifffile gives what is stored.
    if page.keyframe.photometric == _WHITE_IS_ZERO and values.dtype.itemsize == 1:
        values = ~values
    # Its integers of 32 bits are signed.
    return values.view(np.uint32) if page.dtype == np.uint32 else values


def _pillow_can(page: Any) -> bool:
    """Whether Pillow gives the values that are stored."""
    if page.dtype is None or page.planarconfig != _CONTIGUOUS or page.imagedepth > 1:
        return False
    known = _PILLOWS if page.samplesperpixel == 1 else _PILLOWS_COLOURS
    stored = 1 if page.dtype.kind == "b" else 8 * page.dtype.itemsize
    return page.parent.byteorder + page.dtype.str[1:] in known and page.bitspersample == stored


def png_values(path: Path, reserve: Reserve) -> NDArray[Any]:
    """The pixels of a PNG file; where it has a palette, their numbers in it.

    Parameters
    ----------
    path : Path
    reserve : callable
        Called with the picture's shape and the bytes of a value before it is unpacked.

    Raises
    ------
    VolumeError
        If it holds colours of 16 bits, which Pillow narrows to 8.
    """
    from PIL import Image

    with Image.open(path) as image:
        with path.open("rb") as file:
            bits = file.read(_PNG_BITS + 1)[_PNG_BITS]
        if bits > 8 and len(image.getbands()) > 1:
            raise VolumeError(
                f"{path}: holds colours of {bits} bits, of which 8 would be left; save it grey, or "
                "as TIFF"
            )
        reserve((*image.size, len(image.getbands())), 4 if image.mode == "I" else -(-bits // 8))
        return np.array(image)
