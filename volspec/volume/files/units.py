"""Units of length as TIFF, OME-XML and OME-Zarr name them."""

from __future__ import annotations

_MM = {
    **dict.fromkeys(("angstrom", "å"), 1e-7),
    **dict.fromkeys(("nm", "nanometer", "nanometre"), 1e-6),
    **dict.fromkeys(("um", "µm", "micron", "microns", "micrometer", "micrometre"), 1e-3),
    **dict.fromkeys(("mm", "millimeter", "millimetre"), 1.0),
    **dict.fromkeys(("cm", "centimeter", "centimetre"), 10.0),
    **dict.fromkeys(("m", "meter", "metre"), 1000.0),
    **dict.fromkeys(("in", "inch", "inches"), 25.4),
}


def mm_per(unit: str | None) -> float | None:
    """Millimetres in a unit; None of one that is no length, such as ``pixel``.

    >>> mm_per("micrometer"), mm_per("\\u03bcm"), mm_per("pixel")
    (0.001, 0.001, None)
    """
    # Greek mu and the micro sign look alike, and ImageJ writes the latter escaped.
    name = (unit or "").strip().replace("\u03bc", "\u00b5").replace("\\u00B5", "\u00b5")
    return _MM.get(name.casefold().replace("\u03bc", "\u00b5"))
