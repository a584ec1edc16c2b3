"""Text in pictures: a font for every letter, in the order in which it is read."""

import warnings

import numpy as np
import pytest
from matplotlib import font_manager
from numpy.typing import NDArray
from PIL import Image, ImageDraw, features

from volspec import _text
from volspec._text import BOX, TextLine, fit_text, text_runs
from volspec.errors import VolspecWarning

DEFAULT = text_runs("a")[0][1]
STIX, LAST = (DEFAULT.with_name(f"{name}.ttf") for name in ("STIXGeneral", "LastResortHE-Regular"))
NO, LOST, ALEF, BET = "\u306e", "\u65e5", "\u05d0", "\u05d1"


@pytest.fixture(autouse=True)
def system_fonts(tmp_path, monkeypatch):
    """A damaged font, one that has a sign for every letter, and one with the hiragana NO."""
    (tmp_path / "broken.ttf").write_bytes(b"no font")
    paths = [*map(str, (tmp_path / "broken.ttf", LAST, STIX))]
    monkeypatch.setattr(font_manager, "findSystemFonts", lambda: paths)
    _text._other_fonts.cache_clear()
    yield
    _text._other_fonts.cache_clear()


def drawn(text: str) -> NDArray[np.bool_]:
    sheet = Image.new("L", (99, 40), 0)
    TextLine.of(text, 20).draw(ImageDraw.Draw(sheet), 5, 5, 255)
    return np.asarray(sheet) > 0


def test_letters_are_of_the_first_font_that_has_them():
    assert text_runs("5 µm Å \u03b2 \u0416 e\u0301") == [("5 µm Å \u03b2 \u0416 é", DEFAULT)]
    assert text_runs(f"a {NO}{NO}-b") == [("a ", DEFAULT), (NO + NO + "-", STIX), ("b", DEFAULT)]
    assert (drawn(NO) != drawn(BOX)).any() and drawn(NO).any()
    assert 80.0 < fit_text(NO * 30, 20, 100.0).width <= 100.0


def test_letters_that_cannot_be_drawn_are_boxes_and_named_once(monkeypatch):
    monkeypatch.setattr(features, "check", lambda feature: False)  # no FriBiDi
    with pytest.warns(VolspecWarning, match=r"U\+65E5"), pytest.warns(match=r"U\+05D0"):
        assert text_runs(f"a{LOST}{ALEF}") == [(f"a{BOX}{BOX}", DEFAULT)]
    with warnings.catch_warnings(action="error"):
        assert text_runs(f"{LOST} {ALEF}") == [(f"{BOX} {BOX}", DEFAULT)]


@pytest.mark.skipif(not features.check("raqm"), reason="Pillow without FriBiDi")
def test_right_to_left_script_runs_from_the_right():
    first, both = drawn(ALEF), drawn(ALEF + BET)
    moved = np.roll(first, round(TextLine.of(BET, 20).width), axis=1)
    assert (moved & both).sum() > 0.9 * first.sum()
