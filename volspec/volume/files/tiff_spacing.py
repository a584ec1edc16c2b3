"""What TIFF files state of the distance of their voxels.

    TiffFile -> [tiff_spacing] -> millimetres along x, y, z

References
----------
[1] OME-XML 2016-06, Pixels: PhysicalSizeX and its unit, micrometres where it has none.
[2] TIFF 6.0, XResolution, YResolution and ResolutionUnit: pixels an inch or a centimetre. ImageJ
    writes pixels per unit of its own and says the unit and the slices' distance in its description.
"""

from __future__ import annotations

import math
from typing import Any
from xml.etree import ElementTree

from volspec.volume.files.query import Query
from volspec.volume.files.units import mm_per

# Dots an inch that programs write of pictures for paper and screens, whatever they show.
_FOR_PRINT = (1, 72, 96, 100, 150, 200, 240, 300, 360, 400, 600, 720, 1200, 2400)
_INCH, _CENTIMETRE = 2, 3


def spacing_of(
    stated: tuple[float | None, ...], query: Query, remarks: list[str]
) -> tuple[float, float, float]:
    """The spacing to take, and what has to be said of it.

    Parameters
    ----------
    stated : (x, y, z)
        In millimetres; None of what is not stated.
    query : Query
        What it gives goes before.
    remarks : list of str
        Grows where something is guessed.
    """
    x, y, z = stated
    if query.spacing_mm is not None:
        return query.spacing_mm
    remedy = f"give {query.name}?spacing=x,y,z in mm"
    if x is None or y is None:
        remarks.append(f"{query.path}: states no spacing, voxels are taken for 1 mm; {remedy}")
        return 1.0, 1.0, 1.0
    if z is None:
        remarks.append(
            f"{query.path}: states {x:.4g} × {y:.4g} mm in the plane and no distance of slices, "
            f"{x:.4g} mm is taken; {remedy}"
        )
        return x, y, x
    return x, y, z


def stated_mm(tiff: Any, page: Any) -> tuple[float | None, float | None, float | None]:
    """What a tifffile ``TiffFile`` states along x, y and z; None of what it does not."""
    if tiff.ome_metadata:
        x, y, z = _of_ome(tiff.ome_metadata)
        return x, y, z
    if tiff.imagej_metadata:
        kept = tiff.imagej_metadata
        unit = kept.get("unit")
        x_mm, y_mm, z_mm = (
            mm_per(u) for u in (unit, kept.get("yunit", unit), kept.get("zunit", unit))
        )
        distance = _positive(kept.get("spacing"))
        z = None if z_mm is None or distance is None else z_mm * distance
        return _pixel(page, "XResolution", x_mm), _pixel(page, "YResolution", y_mm), z
    tag = page.tags.get("ResolutionUnit")
    unit = {_INCH: "inch", _CENTIMETRE: "cm"}.get(int(tag.value) if tag is not None else 0)
    x, y = (_pixel(page, name, mm_per(unit)) for name in ("XResolution", "YResolution"))
    if x is None or y is None or round(25.4 / x, 1) in _FOR_PRINT:
        return None, None, None
    return x, y, None


def _of_ome(text: str) -> list[float | None]:
    try:
        pixels = ElementTree.fromstring(text).find("{*}Image/{*}Pixels")
    except ElementTree.ParseError:
        pixels = None
    found: list[float | None] = []
    for axis in "XYZ":
        size = _positive(None if pixels is None else pixels.get(f"PhysicalSize{axis}"))
        mm = None if pixels is None else mm_per(pixels.get(f"PhysicalSize{axis}Unit", "µm"))
        found.append(None if size is None or mm is None else size * mm)
    return found


def _pixel(page: Any, name: str, mm: float | None) -> float | None:
    """Millimetres a pixel, of a tag that holds pixels per unit as a fraction."""
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
