"""Spectra as numbers in a scene's own file."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from tests.support.errors import raises
from tests.support.scenes import BALL, DAY, write_scene_text
from volspec.errors import SceneError, VolspecWarning
from volspec.scene import Scene, write_scene
from volspec.scene.tables.specs import SpectrumNumbers
from volspec.spectra import DEFAULT_GRID, Spectrum, light, reflectance
from volspec.transfer import TransferFunction

LAMP = "power_W = 100\ndistance_m = 1\n"
RAMP = "{ wavelengths_nm = [390, 710], values = [0.2, 0.8] }"


def load(folder: Path, spectrum: str = '"D65"', paint: str = '"copper"', more: str = "") -> Scene:
    text = BALL.replace('"copper"', paint) + DAY.replace('"D65"', spectrum) + more
    return Scene.load(write_scene_text(folder, text))


@pytest.mark.not_quick
def test_numbers_are_what_a_file_of_them_is(tmp_path):
    (tmp_path / "ramp.csv").write_text("nm,value\n390,0.2\n710,0.8\n")
    named, numbers = load(tmp_path, '"ramp.csv"', '"ramp.csv"'), load(tmp_path, RAMP, RAMP)
    assert np.array_equal(named.materials["ball"].values, numbers.materials["ball"].values)
    one, other = named.lights[0].spectrum, numbers.lights[0].spectrum
    assert np.array_equal(one.values, other.values)
    assert (other.name, numbers.materials["ball"].name) == ("day", "ball")
    assert np.array_equal(named.render().coefficients, numbers.render().coefficients)


def test_a_filter_may_be_numbers(tmp_path):
    scene = load(tmp_path, paint=f'"copper"\nfilter = {RAMP}')
    numbers = SpectrumNumbers(wavelengths_nm=(390, 710), values=(0.2, 0.8))
    assert scene.file.material[0].filter == numbers
    assert isinstance(scene.transfer, TransferFunction)
    found, ramp = scene.transfer.filters["ball"], Spectrum([390, 710], [0.2, 0.8])
    assert found.values == pytest.approx(ramp.on(found.grid).values)


def test_a_spectrum_on_the_scene_s_bands_comes_back_to_the_last_bit(tmp_path):
    scene = load(tmp_path)
    lamp = light("FL2")
    paint = Spectrum(
        DEFAULT_GRID.wavelengths_nm,
        reflectance("ColorChecker/orange").values,
        "orange",
        {"designed": "by hand", "instrument": "a mouse"},
    )
    file = replace(
        scene.file,
        light=[replace(scene.file.light[0], spectrum=SpectrumNumbers.of(lamp))],
        material=[replace(scene.file.material[0], reflectance=SpectrumNumbers.of(paint))],
    )
    again = Scene.load(write_scene(file, tmp_path / "numbers.toml", scene))
    # A light is scaled to its luminous energy again: one rounding.
    np.testing.assert_allclose(again.lights[0].spectrum.values, lamp.values, rtol=1e-15)
    back = again.materials["ball"]
    assert np.array_equal(back.values, paint.values)
    assert back.name == "orange" and back.notes == paint.notes
    assert back.designed and again.file == file


def test_numbers_have_a_header_of_their_own_and_eight_to_a_line(tmp_path):
    scene = load(tmp_path)
    table = SpectrumNumbers(wavelengths_nm=tuple(range(400, 410)), values=(0.5,) * 10)
    file = replace(scene.file, light=[replace(scene.file.light[0], spectrum=table)])
    text = write_scene(file, tmp_path / "new.toml", scene).read_text()
    assert text.endswith(
        """[[light]]
name = "day"

[light.spectrum]
wavelengths_nm = [
    400, 401, 402, 403, 404, 405, 406, 407,
    408, 409,
]
values = [
    0.5, 0.5, 0.5, 0.5, 0.5, 0.5, 0.5, 0.5,
    0.5, 0.5,
]
"""
    )


def test_a_reflectance_above_one_is_warned_about(tmp_path):
    with pytest.warns(VolspecWarning) as said:
        load(tmp_path, paint=RAMP.replace("0.8", "1.2"))
    assert str(said[0].message).startswith("values: reflectance 1.2 at 710 nm is above 1")


def ramp(old: str, new: str) -> str:
    return RAMP.replace(old, new)


# Text for the numbers, the error's code, the place below them; of the light, and of the material.
NO_SPECTRUM = [
    (ramp("0.8", "0.8, 1"), None, ""),
    ("{ wavelengths_nm = [500], values = [1] }", None, ""),
    (ramp("390", "720"), None, ""),
    (ramp("0.8", "nan"), None, ""),
    (ramp("0.8", '"0.8"'), "type", ".values[1]"),
    ("{ values = [1, 2] }", "missing", ".wavelengths_nm"),
    (ramp("values", "value"), "unknown", ".value"),
    ("7", "type", ""),
]
WRONG = [
    *(({"spectrum": text}, code, f"light[0].spectrum{key}") for text, code, key in NO_SPECTRUM),
    *(({"paint": text}, code, f"material[0].reflectance{key}") for text, code, key in NO_SPECTRUM),
    # Nothing shines or reflects with these.
    ({"spectrum": ramp("0.2", "-0.5")}, "range", "light[0]"),
    ({"spectrum": ramp("710", "500")}, "range", "light[0]"),
    ({"paint": ramp("0.8", "80")}, "range", "material[0].reflectance"),
    ({"spectrum": RAMP, "more": LAMP}, "conflict", "light[0].power_W"),
]


@pytest.mark.parametrize(("words", "code", "field"), WRONG)
def test_numbers_that_are_no_spectrum_are_refused_by_name(tmp_path, words, code, field):
    with raises(SceneError, code, field) as caught:
        load(tmp_path, **words)
    assert "scene.toml: " in str(caught.value)
