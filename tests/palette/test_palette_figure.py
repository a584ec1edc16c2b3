"""The palette's picture: its squares have the report's colours, its names are whole."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from matplotlib.colors import to_hex
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle

import volspec as vs
from tests.support.errors import raises
from tests.support.palettes import free_light, given
from volspec.errors import ImageError
from volspec.palette import Cell, Criteria, Design, DesignReport, Palette, design
from volspec.palette.figure import palette_figure, save_palette_figure
from volspec.palette.model import hexadecimal

ROOT = Path(__file__).resolve().parents[2]


@pytest.fixture(scope="module")
def sodium() -> Design:
    return design(vs.load_palette(ROOT / "data/palettes/figure-1.toml"))


def many(count: int) -> Design:
    rows = tuple(given(f"reflectance {i}", 0.3) for i in range(count))
    columns = tuple(given(f"a light called {j}", 1.0) for j in range(count - 1))
    cells = {("reflectance 0", "open"): Cell(colour=(0.5, 0.4, 0.3))}
    criteria = Criteria(rounds=1)
    return design(Palette(rows, (*columns, free_light("open")), cells, criteria=criteria))


def colours(figure: Figure) -> list[str]:
    squares = (patch for axes in figure.axes for patch in axes.patches)
    return [to_hex(square.get_facecolor()) for square in squares if isinstance(square, Rectangle)]


def texts(figure: Figure) -> list[str]:
    return [t.get_text() for t in [*figure.texts, *(t for a in figure.axes for t in a.texts)]]


def test_squares_have_the_colours_of_the_report(sodium: Design) -> None:
    report = DesignReport.of(sodium)
    drawn = colours(palette_figure(sodium, report))
    for cell in report.cells:
        assert hexadecimal(cell.obtained) in drawn
        assert cell.wanted is None or hexadecimal(cell.wanted) in drawn


def test_it_says_what_is_what(sodium: Design) -> None:
    figure = palette_figure(sodium, title="Flames")
    words = texts(figure)
    assert {"Flames", "flame", "paint", "sodium", "D65"} <= set(words)
    assert any("dashed" in each and "outside" not in each for each in words)
    report = DesignReport.of(sodium)
    assert f"{report.cell(('paint', 'sodium')).error:.1f}" in words


@pytest.mark.parametrize("count", [1, 4, 12])
def test_names_are_whole_and_inside_whatever_the_size(count: int) -> None:
    figure = palette_figure(many(count), title="Many")
    assert {f"reflectance {count - 1}", "open"} <= set(texts(figure))
    wide, tall = figure.get_size_inches() * figure.dpi
    for text in [*figure.texts, *(t for axes in figure.axes for t in axes.texts)]:
        box = text.get_window_extent()
        assert box.x0 >= 0 and box.y0 >= 0 and box.x1 <= wide and box.y1 <= tall, text.get_text()


def test_files_are_what_their_names_say(sodium: Design, tmp_path: Path) -> None:
    import imageio.v3 as iio

    picture, drawing = tmp_path / "p.png", tmp_path / "p.svg"
    save_palette_figure(sodium, picture)
    assert len(np.unique(iio.imread(picture).reshape(-1, 4), axis=0)) > 100
    save_palette_figure(sodium, drawing)
    assert "<svg" in drawing.read_text(encoding="utf-8")
    with raises(ImageError, "unsupported"):
        save_palette_figure(sodium, tmp_path / "p.jpg")
