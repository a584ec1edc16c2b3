"""``volspec reflectance``: what it prints and writes, and what it says to bad input."""

from __future__ import annotations

import json
import re
import warnings
from pathlib import Path

import imageio.v3 as iio
import numpy as np
import pytest
from PIL import Image

from volspec import cli
from volspec.spectra import SpectralImage, XYZ_from_spectra, light, reflectance, white_XYZ
from volspec.spectra.construct.colours import XYZ_from_sRGB

DOCS = Path(__file__).resolve().parents[2] / "docs"


def call(*words: str) -> int:
    """The command in this process; returns the exit code."""
    try:
        cli.main(["reflectance", *words])
    except SystemExit as stop:
        return int(stop.code or 0)
    return 0


def test_it_tells_the_mixture_and_the_colour_under_each_light(
    capsys: pytest.CaptureFixture[str],
) -> None:
    assert call("#c08040") == 0
    said = capsys.readouterr().out
    assert "#c08040: X Y Z 30.3634 27.0144 8.44826 under D65, 2 degrees" in said
    assert "mixed from the Delaunay tetrahedron" in said and said.count(" %  ") == 4
    rows = [line.split() for line in said.splitlines()]
    assert [row[0] for row in rows if row[:1] in (["D65"], ["A"])] == ["D65", "A"]
    assert next(row for row in rows if row[:1] == ["D65"])[-1] == "0.000"


def test_the_guide_shows_what_the_command_prints(capsys: pytest.CaptureFixture[str]) -> None:
    guide = (DOCS / "reflectance.md").read_text(encoding="utf-8")
    shown = re.search(r"```\n\$ volspec reflectance \"(.*?)\"\n(.*?)```", guide, re.DOTALL)
    assert shown is not None and call(shown[1]) == 0
    printed = [line.rstrip() for line in capsys.readouterr().out.splitlines()]
    assert printed == shown[2].splitlines()


def test_json_holds_the_mix_the_lights_and_the_spectrum(capsys: pytest.CaptureFixture[str]) -> None:
    assert call("30", "27", "9", "--light", "A", "--under", "FL11", "--json") == 0
    said = json.loads(capsys.readouterr().out)
    assert [said[key] for key in "XYZ"] == [30, 27, 9]
    assert [row["light"] for row in said["lights"]] == ["A", "FL11"]
    assert said["lights"][0]["delta_e"] < 1e-6
    assert sum(part["share"] for part in said["mix"]) == pytest.approx(1)
    np.testing.assert_allclose(
        XYZ_from_spectra(light("A"), said["reflectance"]), [30, 27, 9], atol=1e-6
    )


def test_a_colour_outside_is_extended_and_one_beyond_is_warned_of(
    capsys: pytest.CaptureFixture[str],
) -> None:
    assert call("red") == 0
    assert "extended as smoothly as can be from the mixture" in capsys.readouterr().out
    with warnings.catch_warnings():
        warnings.simplefilter("default")
        assert call("95", "100", "20", "--json") == 0
    said = capsys.readouterr()
    assert json.loads(said.out)["constructed"] == "nearest"
    assert "volspec: warning: colour '95 100 20': no reflectance within 0 to 1" in said.err


def test_the_spectrum_file_is_what_scenes_read(tmp_path: Path) -> None:
    file, figure = tmp_path / "paint.csv", tmp_path / "paint.png"
    assert call("tomato", "-o", str(file), "--figure", str(figure)) == 0
    paint = reflectance(str(file))
    wanted = XYZ_from_sRGB(np.array([255, 99, 71]) / 255, white_XYZ(light("D65")))
    np.testing.assert_allclose(XYZ_from_spectra(light("D65"), paint), wanted, atol=1e-5)
    height, width = iio.imread(figure).shape[:2]
    assert (width, height) == (1024, 544)


def test_a_photograph_becomes_a_spectral_picture(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    photo, picture = tmp_path / "photo.png", tmp_path / "photo.exr"
    codes = np.random.default_rng(3).integers(0, 256, (8, 12, 3), dtype=np.uint8)
    codes[:4] = codes[0, 0]
    iio.imwrite(photo, codes)
    assert call("--image", str(photo), "-o", str(picture)) == 0
    assert "12×8, 31 bands; 49 colours: " in capsys.readouterr().out
    image = SpectralImage.load(picture)
    assert image.kind == "reflective" and image.size == (12, 8)
    assert image.values.min() >= 0 and image.values.max() <= 1
    wanted = XYZ_from_sRGB(codes / 255, white_XYZ(light("D65")))
    # float32 holds seven digits.
    np.testing.assert_allclose(XYZ_from_spectra(light("D65"), image.values), wanted, atol=1e-4)


def test_transparency_and_profiles_are_left_out_with_a_word(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    photo = tmp_path / "photo.png"
    Image.new("RGBA", (2, 2), (90, 80, 70, 9)).save(photo, icc_profile=b"of a wide display")
    with warnings.catch_warnings():
        warnings.simplefilter("default")
        assert call("--image", str(photo), "-o", str(tmp_path / "p.exr")) == 0
    said = capsys.readouterr().err
    assert "photo.png: its transparency is left out" in said
    assert "photo.png: its colour profile is left out; it is read as sRGB" in said


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["tomatoe"], "did you mean 'tomato'"),
        (["-1", "2", "3"], "X Y Z -1 2 3 is negative"),
        ([], "no colour; give #rrggbb"),
        (["red", "--method", "otus-2018"], "did you mean 'otsu-2018'"),
        (["red", "--light", "D56"], "light 'D56' is unknown"),
        (["red", "-o", "red.txt"], "red.txt: written as .csv; name it .csv"),
        (["red", "--figure", "red.bmp"], "red.bmp: written as .png, .pdf, .svg"),
        (["--image", "none.png", "-o", "x.exr"], "none.png: no such file"),
        (["--image", "none.png"], "none.png: becomes a spectral picture; give -o FILE.exr"),
        (["--image", "none.png", "--json"], "--image takes --light"),
        (["--image", __file__, "-o", "x.exr"], "no picture that can be read"),
    ],
)
def test_bad_input_is_one_line_and_leaves_nothing(
    words: list[str],
    said: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.chdir(tmp_path)
    assert call(*words) == 1
    error = capsys.readouterr().err
    assert said in error and len(error.splitlines()) == 1
    assert list(tmp_path.iterdir()) == []
