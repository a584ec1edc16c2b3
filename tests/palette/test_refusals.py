"""Palettes that cannot be are refused in one line, with the place in the file."""

from dataclasses import replace
from pathlib import Path

import pytest

import volspec as vs
from tests.palette.test_linearisation import below, subspace_palette
from tests.palette.test_palette_file import SMALL, changed, written
from tests.support.errors import raises
from tests.support.palettes import GREY, free_light, lamp, must, palette_of, surface
from volspec.errors import ImageError, PaletteError, SpectrumError
from volspec.palette import Cell, Palette, PaletteSpectrum, design, load_palette, save_palette
from volspec.palette.figure import save_palette_figure

# What of the small palette is changed to what, the code, and the field.
MISTAKES = [
    ("rounds = 2", "round = 2", "unknown", "criteria.round"),
    ("rounds = 2", "grid_nm = [400, 700, 0.01]", "size", ""),
    ("[criteria]", "[criteria]\ngrid_nm = [400, 700]", "shape", "criteria.grid_nm"),
    ("[criteria]", "[criteria]\nsubspace = 1.0", "missing", "basis"),
    ("[criteria]", "[viewing]\nmodel = 'CAT2'\n[criteria]", "unknown", "viewing.model"),
    ('"D65"', '"D66"', "unknown", ""),
    ('spectrum = "D65"', 'spectrum = "D65"\nupper = 3', "conflict", "light[0].design"),
    ('name = "day"', 'name = "day"\nvalues = [1.0]', "conflict", "light[0].values"),
    ("upper = 4", 'upper = "all"', "unknown", "light[1].upper"),
    ("upper = 4", "upper = 0", "conflict", "[[light]] split 1 lower"),
    ("[420, 680]", "[680, 420]", "range", "[[light]] split 1 band_nm"),
    ('name = "red"', 'name = "red"\nvalues = [1.0]', "shape", ""),
    ('name = "red"', 'name = "blue"', "unknown", ""),
    ('name = "red"', 'name = " "', "missing", "reflectance[0].name"),
    ('name = "red"', "", "missing", "reflectance[0].name"),
    ('"#ca0020"', '"#ca00"', "syntax", ""),
    ('"#ca0020"', '"crimsom"', "unknown", ""),
    ('"#ca0020"', "[202, 0, 32]", "range", "cell 1 colour"),
    ('"#ca0020"', "[0.1, 0.2]", "type", "cell 1 colour"),
    ("weight = 4", "weight = 0", "range", "cell 2 weight"),
    ("weight = 4", "weight = 4\nmust = true", "conflict", "cell[1].weight"),
    ("weight = 4", "black = true", "conflict", "cell[1]"),
    ("weight = 4", "distance = 4", "conflict", "cell[1].distance"),
    ('free = "m"', 'same = ["red", "day"]', "conflict", "cell[1].high"),
    ('reflectance = "*"', 'at = ["red", "day"]', "conflict", "cell[1].at"),
    ('"*"\nlight = "split 1"', '["red", "rod"]\nlight = "day"', "unknown", ""),
    ('light = "split 1"', 'light = ["day", "split 1"]', "duplicate", ""),
    ("weight = 4", '[[cell]]\nat = ["blue", "day"]\nfree = "m"', "conflict", ""),
    ("[criteria]", '[viewing]\ndeficiency = "deutan"\n[criteria]', "unknown", "viewing.deficiency"),
    (SMALL, "", "missing", "light"),
    *(
        ("[criteria]", f"[viewing.display]\n{text}\n[criteria]", code, f"viewing.display.{field}")
        for text, code, field in (
            ('gamut = "cut"', "unknown", "gamut"),
            ('gamma = "cut"', "unknown", "gamma"),
            ("space = { white_xy = [0.3, 0.3], transfer = 2.2 }", "missing", "space.primaries_xy"),
            ('space = "gone.icc"', "not-found", "space"),
        )
    ),
    *(
        ("[criteria]", f"[[apart]]\n{row}\n[criteria]", code, field)
        for row, code, field in (
            ('reflectance = ["red", "bone"]', "unknown", "apart"),
            ('reflectance = "red"', "missing", "apart"),
            ('light = "moon"', "unknown", "apart"),
            ("light = []", "unknown", "apart"),
            ('deficiency = "green"', "unknown", "apart[0].deficiency"),
            ("deficiency = []", "type", "apart[0].deficiency"),
            ("distance = 101", "range", "apart[0].distance"),
        )
    ),
]


@pytest.mark.parametrize(("old", "new", "code", "field"), MISTAKES)
def test_mistakes_are_refused(tmp_path, old, new, code, field):
    path = written(tmp_path, changed(old, new))
    with raises(PaletteError, code) as caught:
        load_palette(path)
    assert caught.value.field.removeprefix(str(path)).lstrip(": ") == field
    assert str(caught.value).startswith(str(path))


def address(folder: Path, text: str, selector: str = "a") -> object:
    """Look up a light in a palette file."""
    return vs.light(f"{written(folder, text, 'p.toml')}#{selector}")


def unnamed_lamp(folder: Path) -> None:
    """Write the palette of a mixture of a lamp that no name finds."""
    mixed = free_light(mixture=(vs.Spectrum([380, 780], [0, 1], "D65"),))
    save_palette(palette_of({("a", "L"): Cell("black")}, mixed), folder / "p.toml")


def with_dusk(folder: Path) -> None:
    """Write a palette over a source that has other spectra."""
    source = written(folder)
    palette = load_palette(source)
    other = replace(palette, lights=(*palette.lights, PaletteSpectrum("dusk", vs.light("A"))))
    save_palette(other, folder / "out.toml", source=source)


def of_another_observer() -> Palette:
    palette = subspace_palette("absolute")
    assert palette.basis is not None
    return replace(palette, basis=replace(palette.basis, observer_deg=10))


LOOP = 'light = [{ name = "a", spectrum = "p.toml#a" }]'
GREY_CELL = palette_of({("a", "D65"): Cell(colour=GREY)})
HUNT = replace(GREY_CELL, viewing=vs.Viewing("Hunt"))


@pytest.mark.parametrize(
    ("error", "fault", "call"),
    [
        (SpectrumError, "missing", lambda f: address(f, SMALL, "split 1")),  # not designed yet
        (SpectrumError, "unknown", lambda f: address(f, SMALL, "split")),
        (SpectrumError, "missing", lambda f: vs.light(str(written(f)))),
        (SpectrumError, "not-found", lambda f: vs.light("none.toml#x", folder=f)),
        (SpectrumError, "syntax", lambda f: address(f, "[[light]")),
        (SpectrumError, "missing", lambda f: address(f, "light = 3")),
        (SpectrumError, "shape", lambda f: address(f, 'light = [{ name = "a", values = [1.0] }]')),
        (SpectrumError, "conflict", lambda f: address(f, LOOP)),
        (PaletteError, "unknown PaletteSpectrum.mixture", unnamed_lamp),
        (PaletteError, "unsupported", lambda f: save_palette(GREY_CELL, f / "p.json")),
        (PaletteError, "conflict source", with_dusk),
        (PaletteError, "conflict Palette.cells", lambda f: below(0.4, 0.6, 0.6)),
        (PaletteError, "conflict Palette.basis", lambda f: of_another_observer()),
        (PaletteError, "unsupported viewing.model", lambda f: design(HUNT)),
        (ImageError, "unsupported", lambda f: save_palette_figure(design(GREY_CELL), f / "p.jpg")),
    ],
)
def test_what_cannot_be_made_or_written_is_refused(error, fault, call, tmp_path):
    code, _, field = fault.partition(" ")
    with raises(error, code, field or None):
        call(tmp_path)
    assert not (tmp_path / "out.toml").exists()


def bounded(side: str, bound: float, code: float) -> Palette:
    """Return a palette whose cell (a, D65) is beyond a bound."""
    rows = tuple(surface(name, **{side: bound}) for name in "ab")
    cells = {("a", "D65"): must(code, code, code), ("b", "D65"): must(0.3, 0.3, 0.3)}
    return palette_of(cells, *rows)


# Two names of one light: no spectrum at all has two colours under it.
NOON = PaletteSpectrum("noon", lamp("D65").spectrum)
TWO_COLOURS = {("a", "D65"): must(*GREY), ("a", "noon"): must(0.4, 0.5, 0.5)}
DIM = free_light("lamp", upper=0.5)


@pytest.mark.parametrize(
    ("palette", "problem", "remedy", "absent"),
    [
        (bounded("upper", 0.5, 0.9), ["(a, D65)"], ["upper", "'a'"], "'b'"),
        (bounded("lower", 0.05, 0.2), ["(a, D65)"], ["lower", "'a'"], "'b'"),
        (palette_of(TWO_COLOURS, NOON), ["(a, D65)", "(a, noon)"], [], "bound"),
        (palette_of({("a", "lamp"): Cell(colour=GREY)}, DIM), ["luminance"], ["upper"], "lower"),
    ],
)
def test_a_contradiction_names_its_cells_and_bounds_and_no_others(palette, problem, remedy, absent):
    with raises(PaletteError, "impossible") as caught:
        design(palette)
    error = caught.value
    assert all(part in error.problem for part in problem)
    assert all(part in error.remedy for part in remedy)
    assert "(b, D65)" not in error.problem and absent not in error.remedy
