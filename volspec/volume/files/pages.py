"""Pages of TIFF files and PNG pictures as arrays, and the spacing stated in TIFF files.

    tiff -> [pages] -> (Y, X) or (Y, X, S) arrays, millimetres along x, y, z

tifffile supports microscopes' dialects. Without imagecodecs, a large package, it cannot decode LZW
and JPEG: such pages are read by Pillow, which supports no dialects and few types. Types that it
would silently narrow or read in the wrong byte order are refused.

References
----------
[1] OME-XML 2016-06, Pixels: PhysicalSizeX and its unit, micrometres by default.
[2] TIFF 6.0, XResolution, YResolution and ResolutionUnit: pixels per inch or centimetre. ImageJ
    writes pixels per its own unit; the unit and the slices' distance are in its description.
"""

from __future__ import annotations

import logging
import math
import struct
import zlib
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from volspec._files import captured_output
from volspec._parse import parse_xml
from volspec.errors import VolumeError, one_line
from volspec.volume.channels import Channel, channels_of_imagej
from volspec.volume.files.lattice import mm_per_unit, spacing_text
from volspec.volume.files.query import Query

_DAMAGE = (
    *(ValueError, OSError, RuntimeError, LookupError, TypeError, AttributeError, ArithmeticError),
    *(EOFError, SyntaxError, MemoryError, ImportError, struct.error, zlib.error),
)
Reserve = Callable[[Sequence[int], int], None]
"""`Query.reserve`, or a wrapper for one picture of several."""
# Types that Pillow reads correctly, with the file's byte order; fewer for multi-sample pixels.
_PILLOWS = ("<b1", ">b1", "<u1", ">u1", "<u2", ">u2", "<i2", "<i4", "<u4", "<f4")
_PILLOWS_COLOURS = ("<u1", ">u1")
# TIFF 6.0: PhotometricInterpretation, PlanarConfiguration.
_WHITE_IS_ZERO, _CONTIGUOUS = 0, 1
# Offset of the bits per sample in a PNG file.
_PNG_BITS = 24
# Dots per inch that programs write by default, unrelated to the voxels.
_FOR_PRINT = (1, 72, 96, 100, 150, 200, 240, 300, 360, 400, 600, 720, 1200, 2400)
_INCH, _CENTIMETRE = 2, 3


class _LogRecorder(logging.Handler):
    """Collects logged messages."""

    def __init__(self, level: int) -> None:
        super().__init__(level)
        self.messages: list[str] = []

    def emit(self, record: logging.LogRecord) -> None:
        """Collect a message."""
        self.messages.append(record.getMessage())


@contextmanager
def picture_errors(path: Path) -> Iterator[None]:
    """Turn exceptions and logged errors of picture readers into one VolumeError.

    tifffile logs an error and continues with what it could read.
    """
    log, handler = logging.getLogger("tifffile"), _LogRecorder(logging.ERROR)
    messages = handler.messages
    log.addHandler(handler)
    propagated, log.propagate = log.propagate, False
    try:
        yield
    except _DAMAGE as error:
        if isinstance(error, VolumeError) and not messages:
            raise
        if _lacks_codec(error):
            raise VolumeError(
                f"{path}: decoding its pages needs another package; "
                "pip install imagecodecs, or save the stack without compression",
                code="unsupported",
            ) from error
        raise _damage_error(path, [*messages, str(error)]) from error
    finally:
        log.removeHandler(handler)
        log.propagate = propagated
    if messages:
        raise _damage_error(path, messages)


def _damage_error(path: Path, messages: list[str]) -> VolumeError:
    return VolumeError(
        f"{path}: cannot be read ({one_line(messages[0])[:120]}); is it complete and of the type "
        "its name says?",
        code="damaged",
    )


def _lacks_codec(error: Exception) -> bool:
    return isinstance(error, ImportError) or "imagecodecs" in str(error)


def page_values(page: Any) -> NDArray[Any]:
    """Decode a tifffile ``TiffPage``, in its axes' order, with tifffile or else with Pillow."""
    try:
        return np.asarray(page.asarray())
    except (ValueError, ImportError) as error:
        if not _lacks_codec(error) or not _pillow_can(page.keyframe):
            raise
    from PIL import Image, UnidentifiedImageError

    try:
        # libtiff prints its errors, and Pillow raises them.
        with captured_output([]), Image.open(page.parent.filehandle.path) as image:
            image.seek(page.index)
            values = np.array(image)
    except UnidentifiedImageError as error:
        raise ImportError("imagecodecs") from error
    # Pillow inverts these, tifffile does not.
    if page.keyframe.photometric == _WHITE_IS_ZERO and values.dtype.itemsize == 1:
        values = ~values
    # Pillow's 32-bit integers are signed.
    return values.view(np.uint32) if page.dtype == np.uint32 else values


def _pillow_can(page: Any) -> bool:
    """Return True if Pillow returns the stored values unchanged."""
    if page.dtype is None or page.planarconfig != _CONTIGUOUS or page.imagedepth > 1:
        return False
    known = _PILLOWS if page.samplesperpixel == 1 else _PILLOWS_COLOURS
    stored = 1 if page.dtype.kind == "b" else 8 * page.dtype.itemsize
    return page.parent.byteorder + page.dtype.str[1:] in known and page.bitspersample == stored


def png_values(path: Path, reserve: Reserve) -> NDArray[Any]:
    """Read the pixels of a PNG file, as indices if it has a palette.

    ``reserve`` is called before decoding. 16-bit colours, which Pillow narrows to 8, are refused.
    """
    from PIL import Image

    with Image.open(path) as image:
        with path.open("rb") as file:
            bits = file.read(_PNG_BITS + 1)[_PNG_BITS]
        if bits > 8 and len(image.getbands()) > 1:
            raise VolumeError(
                f"{path}: holds {bits}-bit colours, which would be cut to 8; save it grey, or "
                "as TIFF",
                code="unsupported",
            )
        reserve((*image.size, len(image.getbands())), 4 if image.mode == "I" else -(-bits // 8))
        return np.array(image)


def resolve_spacing(
    stated: tuple[float | None, ...], query: Query, remarks: list[str]
) -> tuple[float, float, float]:
    """Return the query's spacing, else the stated one; gaps (None) are filled and remarked on."""
    x, y, z = stated
    if query.spacing_mm is not None:
        return query.spacing_mm
    remedy = "if that is wrong, give it in mm as in"
    if x is None or y is None:
        remarks.append(
            f"{query.path}: states no spacing, 1 mm is assumed; {remedy} "
            f"{query.example(spacing='1,1,1')}"
        )
        return 1.0, 1.0, 1.0
    if z is None:
        remarks.append(
            f"{query.path}: states {x:.4g} × {y:.4g} mm in the plane but no slice distance, "
            f"{x:.4g} mm is assumed; {remedy} {query.example(spacing=spacing_text(x, y, x))}"
        )
        return x, y, x
    return x, y, z


def stated_spacing_mm(tiff: Any, page: Any) -> tuple[float | None, float | None, float | None]:
    """Return a tifffile ``TiffFile``'s stated spacing along x, y and z, each None if missing."""
    if tiff.ome_metadata:
        x, y, z = _ome_spacing_mm(tiff.ome_metadata)
        return x, y, z
    if tiff.imagej_metadata:
        imagej = tiff.imagej_metadata
        unit = imagej.get("unit")
        x_mm, y_mm, z_mm = (
            mm_per_unit(u) for u in (unit, imagej.get("yunit", unit), imagej.get("zunit", unit))
        )
        distance = _positive(imagej.get("spacing"))
        z = None if z_mm is None or distance is None else z_mm * distance
        return _pixel_mm(page, "XResolution", x_mm), _pixel_mm(page, "YResolution", y_mm), z
    tag = page.tags.get("ResolutionUnit")
    unit = {_INCH: "inch", _CENTIMETRE: "cm"}.get(int(tag.value) if tag is not None else 0)
    x, y = (_pixel_mm(page, name, mm_per_unit(unit)) for name in ("XResolution", "YResolution"))
    if x is None or y is None or round(25.4 / x, 1) in _FOR_PRINT:
        return None, None, None
    return x, y, None


def stated_channels(tiff: Any, count: int) -> list[Channel]:
    """Return what an OME-TIFF or ImageJ's file says of its channels; empty if it states none."""
    if tiff.imagej_metadata:
        return channels_of_imagej(tiff.imagej_metadata, count)
    try:
        root = parse_xml(tiff.ome_metadata or "")
    except ValueError:
        return []
    channels = root.findall("{*}Image/{*}Pixels/{*}Channel")
    return [Channel.of_ome(channel.attrib) for channel in channels]


def _ome_spacing_mm(text: str) -> list[float | None]:
    try:
        pixels = parse_xml(text).find("{*}Image/{*}Pixels")
    except ValueError:
        pixels = None
    spacing: list[float | None] = []
    for axis in "XYZ":
        size = _positive(None if pixels is None else pixels.get(f"PhysicalSize{axis}"))
        mm = None if pixels is None else mm_per_unit(pixels.get(f"PhysicalSize{axis}Unit", "µm"))
        spacing.append(None if size is None or mm is None else size * mm)
    return spacing


def _pixel_mm(page: Any, name: str, mm: float | None) -> float | None:
    """Return millimetres per pixel from a tag with pixels per unit as a fraction."""
    tag = page.tags.get(name)
    if tag is None or mm is None:
        return None
    pixels, units = tag.value
    per_unit = _positive(pixels / units if units else None)
    return None if per_unit is None else mm / per_unit


def _positive(given: Any) -> float | None:
    try:
        number = float(given)
    except (TypeError, ValueError):
        return None
    return number if 0 < number < math.inf else None
