"""Lines of text in pictures: letters of every script that the installed fonts have.

    text -> [_text] -> annotations, contact sheets, maps of errors, figures, the viewer's fonts

DejaVu Sans, which comes with matplotlib, is the first font; the others are the system's. A letter
that no font has is drawn as a box, with a warning.
"""

from __future__ import annotations

import unicodedata
import warnings
from dataclasses import dataclass
from functools import lru_cache
from itertools import groupby
from pathlib import Path
from typing import TYPE_CHECKING, Any

from volspec.errors import VolspecWarning

if TYPE_CHECKING:
    from PIL.ImageDraw import ImageDraw
    from PIL.ImageFont import FreeTypeFont

BOX = "\N{WHITE SQUARE}"
# Unicode categories of what is not drawn, and characters that change a letter's form.
_UNPRINTABLE = ("Cf", "Cc", "Cs")
_SELECTORS = {"\u200c", "\u200d", *map(chr, range(0xFE00, 0xFE10))}
# Words in the names of fonts that are not a script's usual ones.
_STYLES = ("bold", "italic", "oblique", "light", "thin", "black", "condensed", "mono")
_LISTED = 8


def printable(text: str, length: int = 60) -> str:
    """Return one line without control characters and direction marks, cut if it is too long.

    >>> printable("a\\u202eb\\nc"), printable("x" * 9, 4)
    ('ab c', 'xxx…')
    """
    line = "".join(
        c
        for c in " ".join(text.split())
        if c in _SELECTORS or unicodedata.category(c) not in _UNPRINTABLE
    )
    return line if len(line) <= length else f"{line[: length - 1]}…"


def clusters(text: str) -> list[str]:
    """Split text into letters with their marks.

    >>> clusters("e\\u0301a")
    ['é', 'a']
    """
    letters: list[str] = []
    for c in unicodedata.normalize("NFC", text):
        if letters and (c in _SELECTORS or unicodedata.category(c)[0] == "M"):
            letters[-1] += c
        else:
            letters.append(c)
    return letters


def text_runs(text: str) -> list[tuple[str, Path]]:
    """Split a line of text into parts, each with a font that has all its letters.

    Letters that no font has become boxes, with a warning that names them.
    """
    letters, default = clusters(printable(text, len(text))), _default_font()
    lacking = frozenset(c for c in letters if _turns(c) or not _has(default, c))
    fallbacks = _other_fonts(lacking) if lacking else {}
    placed: list[tuple[str, Path]] = []
    for letter in letters:
        font = fallbacks.get(letter) if letter in lacking else default
        if placed and not letter[0].isalnum() and _has(placed[-1][1], letter):
            font = placed[-1][1]  # spaces and signs belong to the words around them
        placed.append((letter, font) if font else (BOX, default))
    runs = groupby(placed, key=lambda pair: pair[1])
    return [("".join(letter for letter, _ in run), font) for font, run in runs]


@dataclass(frozen=True, slots=True)
class TextLine:
    """A line of text in a size of type; lengths are pixels."""

    runs: tuple[tuple[float, str, FreeTypeFont], ...]
    """Place, letters and font of each part, from the left."""
    width: float
    ascent: float
    """Distance of the line's top from the baseline."""
    height: float
    direction: str | None
    """Of the text, for Pillow; None if it knows only one."""

    @classmethod
    def of(cls, text: str, size: int) -> TextLine:
        """Lay out text without line breaks; right-to-left scripts run from the right."""
        from PIL import features

        runs, direction = text_runs(text), None
        if features.check("raqm"):
            sides = (unicodedata.bidirectional(c) for c in text)
            side = next((s for s in sides if s in ("L", "R", "AL")), "L")
            direction = "ltr" if side == "L" else "rtl"
            runs = runs if side == "L" else runs[::-1]
        placed, x = [], 0.0
        for letters, path in runs:
            font = _load_font(path, max(size, 1))
            placed.append((x, letters, font))
            x += font.getlength(letters, direction=direction)
        ascent, descent = _load_font(_default_font(), max(size, 1)).getmetrics()
        return cls(tuple(placed), x, ascent, ascent + descent, direction)

    def box(self, outline: int = 0) -> tuple[int, int, int, int]:
        """Return left, top, right and bottom of the inked pixels, from the line's upper left."""
        left, top, right, bottom = 0.0, 0.0, self.width, self.height
        for x, letters, font in self.runs:
            box = font.getbbox(letters, direction=self.direction, stroke_width=outline, anchor="ls")
            left, right = min(left, x + box[0]), max(right, x + box[2])
            top, bottom = min(top, self.ascent + box[1]), max(bottom, self.ascent + box[3])
        return int(left) - 1, int(top) - 1, int(right) + 2, int(bottom) + 2

    def draw(self, on: ImageDraw, x: float, y: float, ink: Any, outline: int = 0) -> None:
        """Draw the line; x and y are its upper left."""
        for offset, letters, font in self.runs:
            place = x + offset, y + self.ascent
            direction = self.direction
            on.text(place, letters, ink, font, "ls", direction=direction, stroke_width=outline)


def fit_text(text: str, size: int, width: float) -> TextLine:
    """Return a line of text, shortened with an ellipsis if it is wider than ``width`` pixels."""
    line, letters = TextLine.of(text, size), clusters(text)
    while line.width > width and len(letters) > 1:
        letters.pop()
        line = TextLine.of("".join(letters).rstrip() + "…", size)
    return line


def _turns(letter: str) -> bool:
    """Return True if a letter is of a right-to-left script, which Pillow cannot draw here."""
    from PIL import features

    return unicodedata.bidirectional(letter[0]) in ("R", "AL") and not features.check("raqm")


@lru_cache(maxsize=256)
def _other_fonts(letters: frozenset[str]) -> dict[str, Path]:
    """Return the system's first font that has each of some letters; warn of those without one."""
    fonts: dict[str, Path] = {}
    turned = set(filter(_turns, letters))
    missing = letters - turned
    for font in _system_fonts() if missing else ():
        fonts |= {letter: font for letter in missing if _has(font, letter)}
        missing -= fonts.keys()
        if not missing:
            break
    for undrawn, why in (
        (missing, "no installed font has {}; install one that has, such as Google's Noto fonts"),
        (turned, "{} are of a right-to-left script; install FriBiDi, by which Pillow draws them"),
    ):
        if undrawn:
            names = [f"{letter} (U+{ord(letter[0]):04X})" for letter in sorted(undrawn)]
            listed = ", ".join(names[:_LISTED]) + ", …" * (len(names) > _LISTED)
            message = f"text: {why.format(listed)}: drawn as {BOX}"
            warnings.warn(message, VolspecWarning, stacklevel=2)
    return fonts


def _system_fonts() -> list[Path]:
    """Return the system's fonts, the usual ones of each script first."""
    from matplotlib.font_manager import findSystemFonts  # its own list is of an earlier start

    def unusual(path: Path) -> tuple[object, ...]:
        name = path.stem.lower()
        return any(style in name for style in _STYLES), "sans" not in name, name

    return sorted(map(Path, findSystemFonts()), key=unusual)


@lru_cache(maxsize=1)
def _default_font() -> Path:
    from matplotlib import get_data_path

    return Path(get_data_path(), "fonts", "ttf", "DejaVuSans.ttf")


def _has(font: Path, letter: str) -> bool:
    """Return True if a font has a letter and its marks; a font of last resort has none."""
    opened = _open_font(font)
    signs = (c for c in letter if c not in _SELECTORS)
    return opened is not None and all(opened.get_char_index(ord(c)) for c in signs)


@lru_cache(maxsize=16)
def _open_font(font: Path) -> Any:
    """Return a font's table of letters; None if it cannot be drawn in any size."""
    from matplotlib.ft2font import FT2Font

    try:
        opened = FT2Font(str(font))
    except (OSError, RuntimeError):
        return None
    is_last = opened.family_name.lstrip(".").startswith("Last")
    return opened if opened.scalable and not is_last else None


@lru_cache(maxsize=32)
def _load_font(font: Path, size: int) -> FreeTypeFont:
    from PIL import ImageFont

    return ImageFont.truetype(font, size)
