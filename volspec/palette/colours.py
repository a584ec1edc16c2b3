"""Colours as people write them, to the display's codes.

text or numbers -> [colours] -> Cell
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence

from volspec.errors import PaletteError, SpectrumError, quoted
from volspec.spectra.construct.colours import sRGB_from_word

Codes = tuple[float, float, float]


def parsed_colour(given: str | Sequence[float]) -> Codes:
    """A colour in hexadecimal, by its CSS name, or as three codes.

    Parameters
    ----------
    given : str or three floats
        ``"#ca0020"``, ``"#fff"``, ``"steelblue"`` or ``(0.79, 0.0, 0.13)``: the display's codes,
        0 to 1.

    Returns
    -------
    (3,) floats
        The display's codes.

    Raises
    ------
    PaletteError
        If it is none of these, or lies outside the display.

    Examples
    --------
    >>> parsed_colour("#f00"), parsed_colour("white")
    ((1.0, 0.0, 0.0), (1.0, 1.0, 1.0))
    """
    if not isinstance(given, str):
        return _codes(given)
    try:
        return _codes(sRGB_from_word(given, "[r, g, b] with codes 0 to 1"))
    except SpectrumError as error:
        raise PaletteError(str(error)) from None


def hexadecimal(codes: Sequence[float]) -> str:
    """Codes as ``#rrggbb``; what lies outside the display is clipped.

    >>> hexadecimal((1.0, 0.5, -0.1))
    '#ff8000'
    """
    return "#" + "".join(f"{round(255 * min(max(code, 0.0), 1.0)):02x}" for code in codes)


def _codes(given: Iterable[float]) -> Codes:
    try:
        red, green, blue = (float(code) for code in given)
    except (TypeError, ValueError):
        raise PaletteError(
            f"colour {quoted(given)} is not three numbers; give [r, g, b] with codes 0 to 1"
        ) from None
    outside = [code for code in (red, green, blue) if not 0.0 <= code <= 1.0]
    if outside:
        remedy = "divide by 255" if 1.0 < max(outside) <= 255.0 else "give codes 0 to 1"
        raise PaletteError(
            f"colour {quoted(given)} has a code of {outside[0]:g}, which no display shows; {remedy}"
        )
    return red, green, blue
