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
import sys
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from logging.handlers import BufferingHandler
from pathlib import Path
from typing import Any
from xml.etree.ElementTree import Element

import numpy as np
from numpy.typing import NDArray

from volspec._files import captured_output
from volspec._parse import parse_xml
from volspec.errors import VolspecError, VolumeError, one_line
from volspec.volume.channels import Channel, channels_of_imagej
from volspec.volume.files.lattice import mm_per_unit, spacing_text
from volspec.volume.files.layout import damage_error
from volspec.volume.files.query import ChoicesListed, Query
from volspec.volume.metadata import NO_SPACING, Metadata

PICTURES = {
    "TIFF": (".tif", ".tiff", ".tf2", ".tf8", ".btf"),
    "PNG": (".png",),
    "BMP": (".bmp",),
    "JPEG 2000": (".jp2",),
    "JPEG": (".jpg", ".jpeg"),
}
"""Endings of the names of pictures, by their format; of one that loses nothing first."""
# Types that Pillow reads correctly, with the file's byte order; fewer for multi-sample pixels.
_PILLOWS = ("<b1", ">b1", "<u1", ">u1", "<u2", ">u2", "<i2", "<i4", "<u4", "<f4")
_PILLOWS_COLOURS = ("<u1", ">u1")
# TIFF 6.0: PhotometricInterpretation, PlanarConfiguration.
_WHITE_IS_ZERO, _CONTIGUOUS = 0, 1
# Bits per sample in the headers of PNG and JPEG 2000, where one less is stored.
_BITS = re.compile(rb"(IHDR.{8}|ihdr.{10})(.)", re.DOTALL)
# Dots per inch that programs write by default, unrelated to the voxels.
_FOR_PRINT = (1, 72, 96, 100, 150, 200, 240, 300, 360, 400, 600, 720, 1200, 2400)


@contextmanager
def picture_errors(path: Path) -> Iterator[None]:
    """Turn exceptions and logged errors of picture readers into one VolumeError.

    tifffile logs an error and continues with what it could read.
    """
    log, handler = logging.getLogger("tifffile"), BufferingHandler(sys.maxsize)
    handler.setLevel(logging.ERROR)
    log.addHandler(handler)
    propagated, log.propagate = log.propagate, False
    fault: Exception | None = None
    try:
        yield
    except ChoicesListed:
        raise
    except Exception as error:  # of any kind: the bytes may be anything
        if isinstance(error, VolspecError) and not handler.buffer:
            raise
        if _lacks_codec(error):
            raise VolumeError(
                f"{path}: decoding its pages needs another package; "
                "pip install imagecodecs, or save the stack without compression",
                code="unsupported",
            ) from error
        fault = error
    finally:
        log.removeHandler(handler)
        log.propagate = propagated
    if fault or handler.buffer:
        cause = handler.buffer[0].getMessage() if handler.buffer else str(fault)
        raise damage_error(path, f"cannot be read ({one_line(cause)[:120]})") from fault


def _lacks_codec(error: Exception) -> bool:
    return isinstance(error, ImportError) or "imagecodecs" in str(error)


def is_stack(path: str) -> bool:
    """Return True for a TIFF of several pages, which is no slice; False if it cannot be read."""
    from tifffile import TiffFile

    with suppress(VolspecError), picture_errors(Path(path)), TiffFile(path) as tiff:
        return len(tiff.pages) > 1
    return False


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
    dtypes = _PILLOWS if page.samplesperpixel == 1 else _PILLOWS_COLOURS
    stored = 1 if page.dtype.kind == "b" else 8 * page.dtype.itemsize
    return page.parent.byteorder + page.dtype.str[1:] in dtypes and page.bitspersample == stored


def picture_values(path: Path) -> NDArray[Any]:
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
        return np.array(image)


def resolve_spacing(
    lengths: tuple[float | None, ...], query: Query, notes: list[str], slices: int
) -> tuple[tuple[float, float, float], Metadata]:
    """Return the query's spacing, else the stated one; note what is assumed in its gaps.

    That of a single slice is 0 along z if it is not stated.
    """
    x, y, z = lengths
    if query.spacing_mm is not None:
        return query.spacing_mm, Metadata()
    if x is None or y is None:
        spacing = 1.0, 1.0, 1.0
        why, assumed = "states no spacing, 1 mm is assumed", NO_SPACING
    elif z is None and slices == 1:
        return (x, y, 0.0), Metadata()
    elif z is None:
        spacing = x, y, x
        why = (
            f"states {x:.4g} × {y:.4g} mm in the plane but no slice distance, {x:.4g} mm is assumed"
        )
        assumed = f"slices {x:.4g} mm apart"
    else:
        return (x, y, z), Metadata()
    notes.append(
        f"{query.path}: {why}; if that is wrong, give it in mm as in "
        f"{query.example(spacing=spacing_text(*spacing))}"
    )
    return spacing, Metadata(assumed=(assumed,))


Spacing = tuple[float | None, float | None, float | None]
"""Millimetres along x, y, z; None if not stated."""


def stated_spacing_mm(tiff: Any, page: Any, series: Any = None) -> Spacing:
    """Return the spacing that a tifffile ``TiffFile`` states of a page of a series."""
    if (pixels := _ome_pixels(tiff, series)) is not None:
        sizes = [f"PhysicalSize{axis}" for axis in "XYZ"]
        x, y, z = (_mm(pixels.get(size), pixels.get(f"{size}Unit", "µm")) for size in sizes)
        if x is not None:
            return x, y, z
    if imagej := tiff.imagej_metadata:
        unit = imagej.get("unit")
        x, y = _pixel_mm(page, "X", unit), _pixel_mm(page, "Y", imagej.get("yunit", unit))
        return x, y, _mm(imagej.get("spacing"), imagej.get("zunit", unit))
    unit = {2: "inch", 3: "cm"}.get(page.tags.valueof("ResolutionUnit"))
    x, y = _pixel_mm(page, "X", unit), _pixel_mm(page, "Y", unit)
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


def ome_root(tiff: Any) -> Element:
    """Return a file's OME-XML; an empty element if it has none."""
    try:
        return parse_xml(tiff.ome_metadata or "")
    except ValueError:
        return Element("OME")


def _ome_pixels(tiff: Any, series: Any) -> Element | None:
    """Return the OME Pixels of a series; without a series, or of one Image, the first."""
    images = ome_root(tiff).findall("{*}Image")
    if series is not None and len(images) > 1:
        if len(images) == len(tiff.series):
            images = [images[tiff.series.index(series)]]
        else:  # tifffile leaves out those whose planes are all in missing files
            images = [image for image in images if image.get("Name") == series.name]
    return images[0].find("{*}Pixels") if images else None


def _pixel_mm(page: Any, axis: str, unit: str | None) -> float | None:
    """Return millimetres per pixel from a tag with pixels per unit as a fraction."""
    pixels, units = page.tags.valueof(f"{axis}Resolution", default=(0, 1))
    return _mm(units / pixels if pixels else None, unit)


def _mm(value: Any, unit: str | None) -> float | None:
    """Return a length in mm without its sign, which ImageJ writes for stacks from below."""
    try:
        length = abs(float(value)) * (mm_per_unit(unit) or 0)
    except (TypeError, ValueError):
        return None
    return length if 0 < length < math.inf else None
