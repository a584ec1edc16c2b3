"""Pages of TIFF files and other pictures as arrays, and the spacing stated in TIFF files.

    tiff, slices -> [pages] -> (Y, X) or (Y, X, S) arrays, millimetres along x, y, z

tifffile supports microscopes' dialects. Without imagecodecs, a large package, it cannot decode LZW
and JPEG: such pages are read by Pillow, which supports no dialects and few types. Types that it
would silently narrow or read in the wrong byte order are refused.

References
----------
[1] OME-XML 2016-06, Pixels: PhysicalSizeX and its unit, micrometres by default; each Image has its
    own. OME-TIFF: the file names ``.ome.tf2 .ome.tf8 .ome.btf`` of BigTIFF.
[2] TIFF 6.0, XResolution, YResolution and ResolutionUnit: pixels per inch or centimetre. ImageJ
    writes pixels per its own unit; the unit and the slices' distance, which may be negative, are
    in its description.
"""

from __future__ import annotations

import logging
import math
import re
import struct
import sys
import zlib
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from logging.handlers import BufferingHandler
from pathlib import Path
from typing import Any
from xml.etree.ElementTree import Element

import numpy as np
from numpy.typing import NDArray

from volspec._files import captured_output
from volspec._parse import parse_xml
from volspec.errors import VolumeError, one_line
from volspec.volume.channels import Channel, channels_of_imagej
from volspec.volume.files.lattice import mm_per_unit, spacing_text
from volspec.volume.files.query import Query
from volspec.volume.metadata import NO_SPACING, Metadata

PICTURES = {
    "TIFF": (".tif", ".tiff", ".tf2", ".tf8", ".btf"),
    "PNG": (".png",),
    "BMP": (".bmp",),
    "JPEG 2000": (".jp2",),
    "JPEG": (".jpg", ".jpeg"),
}
"""Endings of the names of pictures, by their format; of one that loses nothing first."""
_DAMAGE = (
    *(ValueError, OSError, RuntimeError, LookupError, TypeError, AttributeError, ArithmeticError),
    *(EOFError, SyntaxError, MemoryError, ImportError, struct.error, zlib.error),
)
Reserve = Callable[[Sequence[int], int], None]
"""Called with a picture's shape and bytes per value before it is decoded."""
# Types that Pillow reads correctly, with the file's byte order; fewer for multi-sample pixels.
_PILLOWS = ("<b1", ">b1", "<u1", ">u1", "<u2", ">u2", "<i2", "<i4", "<u4", "<f4")
_PILLOWS_COLOURS = ("<u1", ">u1")
# TIFF 6.0: PhotometricInterpretation, PlanarConfiguration.
_WHITE_IS_ZERO, _CONTIGUOUS = 0, 1
# Bits per sample in the headers of PNG and JPEG 2000, where one less is stored.
_BITS = re.compile(rb"(IHDR.{8}|ihdr.{10})(.)", re.DOTALL)
# Dots per inch that programs write by default, unrelated to the voxels.
_FOR_PRINT = (1, 72, 96, 100, 150, 200, 240, 300, 360, 400, 600, 720, 1200, 2400)
_INCH, _CENTIMETRE = 2, 3


@contextmanager
def picture_errors(path: Path) -> Iterator[None]:
    """Turn exceptions and logged errors of picture readers into one VolumeError.

    tifffile logs an error and continues with what it could read.
    """
    log, handler = logging.getLogger("tifffile"), BufferingHandler(sys.maxsize)
    handler.setLevel(logging.ERROR)
    log.addHandler(handler)
    propagated, log.propagate = log.propagate, False
    try:
        yield
    except _DAMAGE as error:
        if isinstance(error, VolumeError) and not handler.buffer:
            raise
        if _lacks_codec(error):
            raise VolumeError(
                f"{path}: decoding its pages needs another package; "
                "pip install imagecodecs, or save the stack without compression",
                code="unsupported",
            ) from error
        raise _damage_error(path, handler.buffer, error) from error
    finally:
        log.removeHandler(handler)
        log.propagate = propagated
    if handler.buffer:
        raise _damage_error(path, handler.buffer)


def _damage_error(
    path: Path, logged: list[logging.LogRecord], error: Exception | None = None
) -> VolumeError:
    cause = logged[0].getMessage() if logged else str(error)
    return VolumeError(
        f"{path}: cannot be read ({one_line(cause)[:120]}); is it complete and of the type "
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


def picture_values(path: Path, reserve: Reserve | None) -> NDArray[Any]:
    """Read the pixels of a picture other than TIFF, as indices if it has a palette.

    16-bit colours, which Pillow narrows to 8, are refused.
    """
    from PIL import Image

    try:
        opened = Image.open(path)
    except Image.DecompressionBombError as error:
        raise VolumeError(
            f"{path}: has more pixels than are read of its format; save it as TIFF", code="size"
        ) from error
    with opened as image:
        with path.open("rb") as file:
            header = _BITS.search(file.read(128))
        bits = 8 if header is None else header[2][0] + header[1].startswith(b"ihdr")
        if bits > 8 and len(image.getbands()) > 1:
            raise VolumeError(
                f"{path}: holds {bits}-bit colours, which would be cut to 8; save it grey, or "
                "as TIFF",
                code="unsupported",
            )
        if reserve is not None:
            itemsize = 4 if image.mode == "I" else -(-bits // 8)
            reserve((*image.size, len(image.getbands())), itemsize)
        return np.array(image)


def resolve_spacing(
    stated: tuple[float | None, ...], query: Query, remarks: list[str]
) -> tuple[tuple[float, float, float], Metadata]:
    """Return the query's spacing, else the stated one, and what is assumed in its gaps (None).

    Assumptions are remarked on.
    """
    x, y, z = stated
    if query.spacing_mm is not None:
        return query.spacing_mm, Metadata()
    remedy = "if that is wrong, give it in mm as in"
    if x is None or y is None:
        remarks.append(
            f"{query.path}: states no spacing, 1 mm is assumed; {remedy} "
            f"{query.example(spacing='1,1,1')}"
        )
        return (1.0, 1.0, 1.0), Metadata(assumed=(NO_SPACING,))
    if z is None:
        remarks.append(
            f"{query.path}: states {x:.4g} × {y:.4g} mm in the plane but no slice distance, "
            f"{x:.4g} mm is assumed; {remedy} {query.example(spacing=spacing_text(x, y, x))}"
        )
        return (x, y, x), Metadata(assumed=(f"slices {x:.4g} mm apart",))
    return (x, y, z), Metadata()


Spacing = tuple[float | None, float | None, float | None]
"""Millimetres along x, y, z; None if not stated."""


def stated_spacing_mm(tiff: Any, page: Any, series: Any = None) -> Spacing:
    """Return the spacing that a tifffile ``TiffFile`` states of a page of a series."""
    if (pixels := _ome_pixels(tiff, series)) is not None:
        x, y, z = (_ome_size_mm(pixels, f"PhysicalSize{axis}") for axis in "XYZ")
        if x is not None:
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


def stated_channels(tiff: Any, series: Any, count: int) -> list[Channel]:
    """Return what OME or ImageJ says of a series' channels; empty unless of as many as counted."""
    if tiff.imagej_metadata:
        return channels_of_imagej(tiff.imagej_metadata, count)
    pixels = _ome_pixels(tiff, series)
    rows = [] if pixels is None else pixels.findall("{*}Channel")
    return [Channel.of_ome(row.attrib) for row in rows] if len(rows) == count else []


def _ome_pixels(tiff: Any, series: Any) -> Element | None:
    """Return the OME Pixels of a series; without a series, or of one Image, the first."""
    try:
        images = parse_xml(tiff.ome_metadata or "").findall("{*}Image")
    except ValueError:
        return None
    if series is not None and len(images) > 1:
        if len(images) == len(tiff.series):
            images = [images[tiff.series.index(series)]]
        else:  # tifffile leaves out those whose planes are all in missing files
            images = [image for image in images if image.get("Name") == series.name]
    return images[0].find("{*}Pixels") if images else None


def _ome_size_mm(pixels: Element, key: str) -> float | None:
    size, mm = _positive(pixels.get(key)), mm_per_unit(pixels.get(f"{key}Unit", "µm"))
    return None if size is None or mm is None else size * mm


def _pixel_mm(page: Any, name: str, mm: float | None) -> float | None:
    """Return millimetres per pixel from a tag with pixels per unit as a fraction."""
    tag = page.tags.get(name)
    if tag is None or mm is None:
        return None
    pixels, units = tag.value
    per_unit = _positive(pixels / units if units else None)
    return None if per_unit is None else mm / per_unit


def _positive(given: Any) -> float | None:
    """Return a size without its sign, which ImageJ writes for stacks from below."""
    try:
        number = abs(float(given))
    except (TypeError, ValueError):
        return None
    return number if 0 < number < math.inf else None
