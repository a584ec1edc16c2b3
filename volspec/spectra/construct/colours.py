"""Parse colours (names, hex codes, numbers) to the XYZ of a surface under a light.

tables, spectrum -> [colours] -> construct, palette, command line
"""

from __future__ import annotations

import re

import numpy as np
from numpy.typing import ArrayLike, NDArray

from volspec.errors import SpectrumError, nearest, quote
from volspec.spectra.datasets import colour_science
from volspec.spectra.files.tables import read_number
from volspec.spectra.spectrum import real_array

Array = NDArray[np.float64]

_HEX = re.compile(r"#(?:[0-9a-f]{3}|[0-9a-f]{6})")
# Numbers brighter than this, relative to white, are on another scale, such as 0-255.
_MAX_OF_WHITE = 2.0


def colour_XYZ(colour: str | ArrayLike, white_XYZ: ArrayLike) -> Array:
    """Return the XYZ (3,) of a colour word or three numbers, as a surface under a light.

    ``colour`` is X Y Z with Y = 100 for white; ``"#rrggbb"``, ``"#rgb"`` or a CSS Color 3 name in
    any case; or a text of three numbers. The white of sRGB is adapted to ``white_XYZ``, the perfect
    diffuser's. Raises SpectrumError if the name is unknown; see also `checked_XYZ`.

    >>> colour_XYZ("20 19.5 8", [95, 100, 109]).tolist()
    [20.0, 19.5, 8.0]
    """
    white = np.asarray(white_XYZ, dtype=np.float64)
    if isinstance(colour, str):
        numbers = _numbers(colour)
        if numbers is None:
            return XYZ_from_sRGB(sRGB_from_word(colour), white)
        colour = numbers
    XYZ = checked_XYZ(colour, white)
    if XYZ.shape != (3,):
        raise SpectrumError(
            f"colour has shape {XYZ.shape}; give X Y Z, or use reflectances_from_colours",
            code="shape",
        )
    return XYZ


def checked_XYZ(XYZ: ArrayLike, white_XYZ: Array) -> Array:
    """Convert (..., 3) colours of surfaces to float64; Y = 100 for white.

    Raises SpectrumError, naming the first bad colour, if the last axis is not 3, or a number is
    not finite, negative, or more than twice the white's.
    """
    array = real_array(XYZ, "colours")
    if array.ndim == 0 or array.shape[-1] != 3:
        raise SpectrumError(
            f"colours have shape {array.shape}; expected (..., 3), X Y Z", code="shape"
        )
    rows = array.reshape(-1, 3)
    bright = rows > _MAX_OF_WHITE * white_XYZ
    for wrong, fault in (
        (~np.isfinite(rows), "is not finite; give finite numbers"),
        (rows < 0, "is negative, impossible for a surface; clip it, or reduce its chroma first"),
        (bright, _too_bright(bright, rows, white_XYZ)),
    ):
        if wrong.any():
            number = int(wrong.any(1).argmax())
            which = "colour" if len(rows) == 1 else f"colour number {number + 1}:"
            X, Y, Z = rows[number]
            raise SpectrumError(f"{which} X Y Z {X:g} {Y:g} {Z:g} {fault}")
    return array


def _too_bright(wrong: NDArray[np.bool_], rows: Array, white_XYZ: Array) -> str:
    """Describe the first colour that is too bright, if any."""
    if not wrong.any():
        return ""
    row, channel = divmod(int(wrong.argmax()), 3)
    return (
        f"has {'XYZ'[channel]} {rows[row, channel]:g}, over twice the {white_XYZ[channel]:.3g} of "
        "white under this light; give Y = 100 for white, and codes of 0-255 as #rrggbb"
    )


def XYZ_from_sRGB(encoded: ArrayLike, white_XYZ: ArrayLike) -> Array:
    """Return the XYZ (..., 3) under a light of surfaces in a picture of sRGB codes, 0 to 1.

    The picture's white is adapted (Bradford) to ``white_XYZ``, the white of a perfect diffuser
    under the light.
    """
    linear = np.asarray(colour_science().models.eotf_sRGB(np.asarray(encoded, dtype=np.float64)))
    # Adaptation to a very red light makes saturated blues negative.
    return np.maximum(linear @ XYZ_from_linear_sRGB(white_XYZ).T, 0.0)


def XYZ_from_linear_sRGB(white_XYZ: ArrayLike) -> Array:
    """Return the (3, 3) matrix from linear sRGB to XYZ, adapted to another white (Bradford)."""
    colour = colour_science()
    matrix = 100.0 * np.asarray(colour.RGB_COLOURSPACES["sRGB"].matrix_RGB_to_XYZ)
    adapted = colour.adaptation.matrix_chromatic_adaptation_VonKries(
        matrix.sum(1), np.asarray(white_XYZ, dtype=np.float64), transform="Bradford"
    )
    return np.asarray(adapted @ matrix, dtype=np.float64)


def _numbers(text: str) -> list[float] | None:
    words = text.replace(",", " ").split()
    try:
        numbers = [read_number(word) for word in words]
    except ValueError:
        return None
    if len(numbers) != 3:
        raise SpectrumError(
            f"colour {text!r}: {len(numbers)} numbers; give three, X Y Z", code="shape"
        )
    return numbers


def sRGB_from_word(text: str, other_forms: str = "X Y Z with Y = 100 for white") -> Array:
    """Return (3,) encoded sRGB, 0 to 1, for ``#rrggbb``, ``#rgb`` or a CSS Color 3 name.

    Other words raise a SpectrumError with the nearest names and ``other_forms``.
    """
    word = "".join(text.split()).casefold()
    if word.startswith("#"):
        if not _HEX.fullmatch(word):
            raise SpectrumError(
                f"colour {quote(text)}: expected #rrggbb or #rgb, with digits 0-f", code="syntax"
            )
    else:
        names = {name.casefold(): code for name, code in _css_names().items()}
        if word not in names:
            raise SpectrumError(
                f"colour {quote(text)} is unknown; {nearest(word, names)}write a CSS name, "
                f"#rrggbb, or {other_forms}",
                code="unknown",
            )
        word = names[word].casefold()
    digits = word[1:] if len(word) == 7 else "".join(2 * digit for digit in word[1:])
    return np.array([int(digits[i : i + 2], 16) for i in (0, 2, 4)]) / 255.0


def _css_names() -> dict[str, str]:
    table = colour_science().notation.CSS_COLOR_3
    return {str(name): str(table[name]) for name in table}
