"""Text in pictures: a font for every letter, in the order in which it is read."""

import warnings
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from fontTools.fontBuilder import FontBuilder
from fontTools.pens.ttGlyphPen import TTGlyphPen
from matplotlib import font_manager
from numpy.typing import NDArray
from PIL import Image, ImageDraw, features

from volspec import _text
from volspec._text import BOX, TextLine, fit_text, text_runs
from volspec.errors import VolspecWarning

DEFAULT = text_runs("a")[0][1]


@pytest.fixture
def system_font(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    """The system's only font, in which U+65E5 and U+E000 are squares."""
    pen = TTGlyphPen(None)
    pen.moveTo((50, 0))
    for corner in ((50, 700), (750, 700), (750, 0)):
        pen.lineTo(corner)
    pen.closePath()
    font = FontBuilder(1000)
    font.setupGlyphOrder([".notdef", "square"])
    font.setupCharacterMap({0x65E5: "square", 0xE000: "square"})
    font.setupGlyf(dict.fromkeys((".notdef", "square"), pen.glyph()))
    font.setupHorizontalMetrics(dict.fromkeys((".notdef", "square"), (800, 50)))
    font.setupHorizontalHeader(ascent=800, descent=-200)
    font.setupNameTable({"familyName": "Squares", "styleName": "Regular"})
    font.setupOS2()
    font.setupPost()
    font.save(tmp_path / "squares.ttf")
    (tmp_path / "broken.ttf").write_bytes(b"no font")
    paths = [str(tmp_path / name) for name in ("broken.ttf", "squares.ttf")]
    monkeypatch.setattr(font_manager, "findSystemFonts", lambda: paths)
    _text._other_fonts.cache_clear()
    yield tmp_path / "squares.ttf"
    _text._other_fonts.cache_clear()


def drawn(line: TextLine) -> NDArray[np.bool_]:
    sheet = Image.new("L", (200, 40), 0)
    line.draw(ImageDraw.Draw(sheet), 5, 5, 255)
    return np.asarray(sheet) > 0


def test_letters_are_of_the_first_font_that_has_them(system_font):
    assert text_runs("5 µm Å \u03b2 \u0416 e\u0301") == [("5 µm Å \u03b2 \u0416 é", DEFAULT)]
    assert text_runs("a \u65e5\ue000-b") == [
        *(("a ", DEFAULT), ("\u65e5\ue000", system_font), ("-b", DEFAULT))
    ]
    wide, left = drawn(TextLine.of("\u65e5\ue000", 20)).any(axis=0).nonzero()[0], 5
    assert wide[0] == left + 1 and wide[-1] == left + 30  # 50 and 1550 of 1000 units
    shown = fit_text("\u65e5" * 30, 20, 100.0)
    assert 80.0 < shown.width <= 100.0


def test_letters_that_no_font_has_are_boxes_and_named_once(system_font):
    with pytest.warns(VolspecWarning, match=r"U\+E001.*U\+E002"):
        assert text_runs("a\ue002\ue001") == [(f"a{BOX}{BOX}", DEFAULT)]
    with warnings.catch_warnings(action="error"):
        assert text_runs("\ue001 \ue002") == [(f"{BOX} {BOX}", DEFAULT)]


@pytest.mark.skipif(not features.check("raqm"), reason="Pillow without FriBiDi")
def test_right_to_left_script_runs_from_the_right():
    alef, bet = "\u05d0", "\u05d1"
    parts = [TextLine.of(each, 20) for each in (alef, bet)]
    both = drawn(TextLine.of(alef + bet, 20))
    right = drawn(parts[0])
    shift = round(parts[1].width)
    assert (np.roll(right, shift, axis=1) & both).sum() > 0.9 * right.sum()


def test_without_fribidi_right_to_left_script_is_not_drawn(monkeypatch):
    monkeypatch.setattr(features, "check", lambda feature: False)
    _text._other_fonts.cache_clear()
    with pytest.warns(VolspecWarning, match=r"U\+05D0"):
        assert text_runs("a \u05d0") == [(f"a {BOX}", DEFAULT)]
    _text._other_fonts.cache_clear()
