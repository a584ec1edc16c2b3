"""A palette's display: all that a scene's may be, a measured one and a profile too."""

from __future__ import annotations

from pathlib import Path

import pytest

import volspec as vs
from tests.support.errors import raises
from volspec.appearance.spaces import SPACES
from volspec.errors import PaletteError
from volspec.export.png import icc_profile

TEXT = """
[viewing.display]
DISPLAY

[[light]]
name = "day"
spectrum = "D65"

[[reflectance]]
name = "leaf"

[[cell]]
at = ["leaf", "day"]
colour = "#4f8f1f"
"""
MEASURED = """white_cd_m2 = 120
space = { primaries_xy = [[0.68, 0.32], [0.265, 0.69], [0.15, 0.06]], white_xy = [0.313, 0.329], transfer = 2.4 }
"""  # noqa: E501


def load(folder: Path, display: str) -> vs.Palette:
    path = folder / "palette.toml"
    path.write_text(TEXT.replace("DISPLAY", display), encoding="utf-8")
    return vs.load_palette(path)


def test_a_colour_is_what_a_measured_display_shows(tmp_path: Path) -> None:
    """The same codes are another colour there: more of green, so the leaf reflects otherwise."""
    usual, measured = load(tmp_path, ""), load(tmp_path, MEASURED)
    space = measured.viewing.display.colours
    assert (space.name, space.primaries_xy[0]) == ("display", (0.68, 0.32))
    one, other = (vs.design(each) for each in (usual, measured))
    assert vs.DesignReport.of(other).max < 1
    assert abs(one.reflectance("leaf").values - other.reflectance("leaf").values).max() > 0.02


@pytest.mark.parametrize(
    "display", [MEASURED, 'space = "Display P3"\ngamut = "reduce"', "white_cd_m2 = 200\nY_b = 18"]
)
def test_a_new_palette_file_has_the_same_display(tmp_path: Path, display: str) -> None:
    palette = load(tmp_path, display)
    vs.save_palette(palette, tmp_path / "new.toml")
    again = vs.load_palette(tmp_path / "new.toml").viewing.display
    assert again.colours == palette.viewing.display.colours
    assert again.conditions == palette.viewing.display.conditions
    assert again.gamut == palette.viewing.display.gamut


def test_a_profile_is_found_next_to_the_palette_and_from_another_folder(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "mine.icc").write_bytes(icc_profile(SPACES["Display P3"]))
    monkeypatch.chdir("/")
    palette = load(tmp_path, 'space = "mine.icc"')
    x, _ = palette.viewing.display.colours.primaries_xy[0]
    assert x == pytest.approx(0.68, abs=1e-3)  # ICC's numbers have 16 bits
    target = tmp_path / "sub" / "made.toml"
    vs.save_palette(vs.design(palette), target, source=tmp_path / "palette.toml")
    again = vs.load_palette(target).viewing.display.colours
    assert again == palette.viewing.display.colours


@pytest.mark.parametrize(
    ("display", "code", "field"),
    [
        ('gamut = "cut"', "unknown", "gamut"),
        ('gamma = "cut"', "unknown", "gamma"),
        ("space = { white_xy = [0.3, 0.3], transfer = 2.2 }", "missing", "space.primaries_xy"),
        ('space = "gone.icc"', "not-found", "space"),
    ],
)
def test_a_wrong_display_is_refused(tmp_path: Path, display: str, code: str, field: str) -> None:
    with raises(PaletteError, code, f"viewing.display.{field}"):
        load(tmp_path, display)
