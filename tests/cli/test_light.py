"""``volspec light``: a light in figures."""

import pytest

from tests.support.commands import call
from tests.support.commands import figures as command_figures
from tests.support.fixtures import Capture
from volspec.spectra.photometry import correlated_temperature

LAMP = "lamp:tungsten-2850"


def figures(capsys: Capture, *words: str) -> dict[str, float | None]:
    return dict(command_figures(capsys, "light", *words))


# x, y of CIE 15; the temperatures of D65 and FL2 (6500 and 4230 K) are given there to ten kelvin.
@pytest.mark.parametrize(
    ("name", "x", "y", "kelvin", "Duv"),
    [
        ("D65", 0.31272, 0.32903, 6503, 0.0032),
        ("A", 0.44758, 0.40745, 2856, 0.0),
        ("FL2", 0.3721, 0.3751, 4225, 0.0018),
    ],
)
def test_illuminants_have_their_colour_and_temperature(name, x, y, kelvin, Duv, capsys):
    found = figures(capsys, name)
    # CIE 15 sums the spiky FL2 at 5 nm.
    assert [found["x"], found["y"]] == pytest.approx([x, y], abs=2e-4)
    assert found["kelvin"] == pytest.approx(kelvin, abs=3)
    assert found["Duv"] == pytest.approx(Duv, abs=2e-4)
    assert found["Y"] == pytest.approx(100) and found["lamp_lm_per_W"] is None


def test_a_lamp_is_counted_from_its_watts(capsys):
    words = ("--power-W", "100", "--distance-m", "1")
    found = figures(capsys, LAMP, *words)
    assert found["lamp_lm_per_W"] == 15 and found["flux_lm"] == 1500
    assert found["illuminance_lux"] == pytest.approx(119.366, abs=1e-3), "1500 lm over 4π"
    half = figures(capsys, LAMP, *words, "--beam-deg", "180")
    assert half["illuminance_lux"] == pytest.approx(2 * 119.366, abs=2e-3)
    assert "illuminance_lux" not in figures(capsys, LAMP, "--power-W", "100")


def test_black_bodies_lie_on_their_locus_and_saturated_lights_have_no_temperature(tmp_path, capsys):
    for kelvin in (1200, 5000, 7500, 20_000):
        found = figures(capsys, f"planck:{kelvin}")
        # The table of the locus is at 1 nm, too: only bands against samples differ.
        assert found["kelvin"] == pytest.approx(kelvin, rel=2e-5)
        assert found["Duv"] == pytest.approx(0, abs=1e-6)
    assert figures(capsys, "planck:700")["kelvin"] is None, "colder than 1000 K"
    (tmp_path / "green.csv").write_text("380,0\n510,0\n520,1\n530,0\n780,0\n")
    assert figures(capsys, str(tmp_path / "green.csv"))["Duv"] is None
    assert correlated_temperature([1, 1, 1]) is not None


@pytest.mark.parametrize(
    ("command", "search", "known"),
    [
        ("light", "led-b", "LED-B3"),
        ("light", "lamp:", LAMP),
        ("reflectance", "banana", "PMC/Banana"),
    ],
)
def test_names_are_listed_for_people_and_programs(command, search, known, capsys):
    names = [row["name"] for row in command_figures(capsys, command, "--list", search)]
    assert call(command, "--list", search) == 0
    found = capsys.readouterr().out.splitlines()
    assert known in names and all(search in line.casefold() for line in found)
    assert all(line.startswith(name) for line, name in zip(found, names, strict=True))
    assert len(names) < len(command_figures(capsys, command, "--list"))


def test_rendition_and_metamerism_are_figures_for_programs(tmp_path, capsys):
    picture = tmp_path / "f.png"
    found = command_figures(capsys, "light", "FL2", "--figure", picture)
    assert picture.read_bytes().startswith(b"\x89PNG")
    assert (round(found["R_a"]), round(found["R_9"])) == (64, -84)
    assert (round(found["R_f"]), round(found["R_g"]), found["near_white"]) == (70, 86, True)
    lengths = [len(found[key]) for key in ("R", "R_f_samples", "R_f_hue", "R_cs_hue", "R_hs_hue")]
    assert lengths == [14, 99, 16, 16, 16]
    assert found["SSI_reference"] == "daylight:4225" and 50 < found["SSI"] < 70
    words = ("light", "A", "--pair", "ColorChecker/red", "TCS/9", "--against", "D50")
    pair = command_figures(capsys, *words)["metamerism"]
    assert pair["reference"] == "D50"
    assert list(pair["change_in_observer"]) == ["10", "CIE 2015 2", "CIE 2015 10"]
    assert pair["delta_E"] > 0 and 0 < pair["general"] < 1


def test_the_efficacy_counts_380_to_780_nm_exactly(tmp_path, capsys):
    """Power just within the range counts, and power just beyond does not."""
    found = {}
    for line in ("778,0\n779,2\n780,0", "780,0\n781,2\n782,0"):
        file = tmp_path / "lines.csv"
        file.write_text(f"360,0\n554,0\n555,1\n556,0\n{line}\n830,0\n")
        found[line] = figures(capsys, str(file))["radiation_lm_per_W"]
    within, beyond = found.values()
    assert within is not None and beyond == pytest.approx(3 * within, rel=1e-3)
