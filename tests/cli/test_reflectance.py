"""``volspec reflectance``: what it prints and writes, and what it says to bad input."""

import json
from functools import partial

import imageio.v3 as iio
import numpy as np
import pytest
from PIL import Image

from tests.support.commands import call as command
from tests.support.commands import figures
from volspec.spectra import SpectralImage, XYZ_from_spectra, light, reflectance, white_XYZ
from volspec.spectra.construct.colours import XYZ_from_sRGB

call = partial(command, "reflectance")


def test_json_holds_the_mix_the_lights_and_the_spectrum(capsys):
    said = figures(capsys, "reflectance", 30, 27, 9, "--light", "A", "--under", "FL11")
    assert [said[key] for key in "XYZ"] == [30, 27, 9]
    assert [row["light"] for row in said["lights"]] == ["A", "FL11"]
    assert said["lights"][0]["delta_e"] < 1e-6
    assert sum(part["share"] for part in said["mix"]) == pytest.approx(1)
    np.testing.assert_allclose(
        XYZ_from_spectra(light("A"), said["reflectance"]), [30, 27, 9], atol=1e-6
    )


@pytest.mark.filterwarnings("default")
def test_a_colour_outside_is_extended_and_one_beyond_is_warned_of(capsys):
    assert figures(capsys, "reflectance", "red")["constructed"] == "extended"
    assert call("95", "100", "20", "--json") == 0
    said = capsys.readouterr()
    assert json.loads(said.out)["constructed"] == "nearest"
    assert said.err.startswith("volspec: warning: ")


def test_the_spectrum_file_is_what_scenes_read(tmp_path):
    file, figure = tmp_path / "paint.csv", tmp_path / "paint.png"
    assert call("tomato", "-o", str(file), "--figure", str(figure)) == 0
    paint = reflectance(str(file))
    wanted = XYZ_from_sRGB(np.array([255, 99, 71]) / 255, white_XYZ(light("D65")))
    np.testing.assert_allclose(XYZ_from_spectra(light("D65"), paint), wanted, atol=1e-5)
    height, width = iio.imread(figure).shape[:2]
    assert (width, height) == (1024, 544)


def test_a_photograph_becomes_a_spectral_picture(tmp_path, capsys):
    photo, picture = tmp_path / "photo.png", tmp_path / "photo.exr"
    codes = np.random.default_rng(3).integers(0, 256, (8, 12, 3), dtype=np.uint8)
    codes[:4] = codes[0, 0]
    iio.imwrite(photo, codes)
    assert call("--image", str(photo), "-o", str(picture)) == 0
    assert "12×8, 81 bands; 49 colours: " in capsys.readouterr().out
    image = SpectralImage.load(picture)
    assert image.kind == "reflective" and image.size == (12, 8)
    assert image.values.min() >= 0 and image.values.max() <= 1
    wanted = XYZ_from_sRGB(codes / 255, white_XYZ(light("D65")))
    # float32 holds seven digits.
    np.testing.assert_allclose(XYZ_from_spectra(light("D65"), image.values), wanted, atol=1e-4)


@pytest.mark.filterwarnings("default")
def test_transparency_and_profiles_are_left_out_with_a_word(tmp_path, capsys):
    photo = tmp_path / "photo.png"
    Image.new("RGBA", (2, 2), (90, 80, 70, 9)).save(photo, icc_profile=b"of a wide display")
    assert call("--image", str(photo), "-o", str(tmp_path / "p.exr")) == 0
    assert capsys.readouterr().err.count("volspec: warning: ") == 2
