"""What callers and files get wrong: one SpectrumError of one line that says what it is."""

from __future__ import annotations

import errno
from collections.abc import Callable
from pathlib import Path
from typing import Any, NoReturn

import numpy as np
import pytest

from volspec._exr import read_exr, write_exr
from volspec.errors import ImageError, SpectrumError
from volspec.spectra import (
    SpectralGrid,
    SpectralImage,
    Spectrum,
    light,
    light_set,
    read_spectrum,
    reflectance,
)

FLAT = Spectrum([380, 780], [1, 1])
IMAGE = SpectralImage(np.ones((2, 3, 3)), [380, 500, 780], "reflective")


def rows(level: object, start: int = 380, stop: int = 780) -> str:
    return "".join(f"{w},{level}\n" for w in range(start, stop + 1, 20))


@pytest.fixture
def lamp(tmp_path: Path) -> Path:
    path = tmp_path / "lamp.csv"
    path.write_text(rows(1))
    return path


@pytest.mark.parametrize(
    ("call", "part"),
    [
        (lambda p: light("D65", None), "grid None is no SpectralGrid; give one"),
        (lambda p: light("D65", (400, 700, 10)), r"grid \(400, 700, 10\) is no SpectralGrid"),
        (lambda p: light_set("smooth", None), "grid None is no"),
        (lambda p: reflectance("white", None), "grid None is no"),
        (lambda p: FLAT.on(None), "grid None is no"),
        (lambda p: IMAGE.on((400, 700, 10)), "is no SpectralGrid"),
        (lambda p: SpectralGrid("a", 700, 10), "start_nm is 'a'; give a number"),
        (lambda p: SpectralGrid(400, 700, None), "step_nm is None; give a number"),
        (lambda p: SpectralGrid(1e-300, 1e300, 1e-300), "too many steps"),
        (lambda p: read_spectrum(None), "path None is no path"),
        (lambda p: read_spectrum(5), "path 5 is no path"),
        (lambda p: read_spectrum(b"lamp.csv"), "is no path; give text"),
        (lambda p: read_spectrum(p, kind="foo"), r"lamp\.csv: kind 'foo' is unknown; choose refl"),
        (lambda p: SpectralImage.load(p, "foo"), "kind 'foo' is unknown"),
        (lambda p: SpectralImage.load(None), "path None is no path"),
        (lambda p: IMAGE.save(None), "path None is no path"),
        (lambda p: IMAGE.save("a\0.exr"), "NUL"),
        (lambda p: light("lamp.csv", folder=None), "folder None is no path"),
        (lambda p: reflectance("paint.csv", folder=None), "folder None is no path"),
        (lambda p: light("a\0b.csv"), r"'a\\x00b.csv' holds a NUL"),
        (lambda p: light("a\0b.csv*1+A"), "NUL"),
        (lambda p: read_spectrum("a\0b.exr"), "NUL"),
        (lambda p: IMAGE.mean("abc"), r"box 'abc' is not four whole numbers; give \(x0, y0"),
        (lambda p: IMAGE.mean((1, 2)), "is not four"),
        (lambda p: IMAGE.mean(5), "is not four"),
        (lambda p: IMAGE.mean((0.5, 0, 2, 2)), "is not four"),
        (lambda p: Spectrum([400, 500], [1, 1], notes=None), "notes are None; give a dict"),
        (lambda p: Spectrum([400, 500], [1, 1], notes=[1]), r"notes are \[1\]; give a dict"),
    ],
)
def test_what_callers_get_wrong_is_one_clear_line(
    lamp: Path, call: Callable[[Path], Any], part: str
) -> None:
    with pytest.raises(SpectrumError, match=part) as caught:
        call(lamp)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("name", ["lamp.csv", "lamp.spdx", "lamp.exr"])
def test_a_file_that_may_not_be_read_says_so(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, name: str
) -> None:
    """Root may read anything, so that the refusal is made up."""

    def refuse(*args: object, **kwargs: object) -> NoReturn:
        raise PermissionError(errno.EACCES, "Permission denied")

    for method in ("open", "stat", "read_bytes"):
        monkeypatch.setattr(Path, method, refuse)
    with pytest.raises(SpectrumError, match=rf"{name}: cannot be read: Permission denied"):
        light(name, folder=tmp_path)


@pytest.mark.parametrize("text", [rows("0,20007"), "nm,power\n" + rows("0,20007")])
def test_whole_numbers_in_unnamed_columns_may_be_decimal_commas(lamp: Path, text: str) -> None:
    lamp.write_text(text)
    with pytest.raises(SpectrumError, match="are the commas decimal marks"):
        light(str(lamp))
    lamp.write_text("nm,warm,cold\n" + rows("0,20007"))
    with pytest.raises(SpectrumError, match=r"2 columns .*lamp\.csv#warm$"):
        light(str(lamp))
    lamp.write_text("380,1\n390,0,5\n")
    with pytest.raises(SpectrumError, match=r"line 2: 3 cells, .*decimal points, not commas"):
        light(str(lamp))


def test_blanks_inside_file_and_column_names_are_kept_apart(tmp_path: Path) -> None:
    (tmp_path / "my  lamp.csv").write_text("nm,very  warm,cold\n" + rows("1,2"))
    for read in (light, reflectance):
        for column in ("very  warm", "very warm"):
            found = read(f" my  lamp.csv#{column} ", folder=tmp_path)
            assert found.values == pytest.approx(1.0)
    mix = light("my  lamp.csv#1*0.5 + 60  A/W\n(soft white)*0.5", folder=tmp_path)
    assert mix.name == "my  lamp.csv#1*0.5+60 A/W (Soft White)*0.5"
    assert reflectance("ColorChecker/dark  skin").name == "ColorChecker/dark skin"


@pytest.mark.parametrize("level", ["1e308", "1.7e308", "1e-310", "5e-324"])
def test_lights_of_any_magnitude_are_scaled(lamp: Path, level: str) -> None:
    lamp.write_text(rows(level))
    # Numpy's warnings of overflow are errors in this suite.
    assert light(str(lamp)).values == pytest.approx(1.0)


def test_a_light_whose_peak_lies_far_outside_the_grid_is_scaled(lamp: Path) -> None:
    lamp.write_text("300,1\n" + rows("1e-312", 320))
    assert light(str(lamp), SpectralGrid(400, 700, 20)).values == pytest.approx(1.0)
    lamp.write_text("300,1e308\n" + rows("1e-312", 320))
    with pytest.raises(SpectrumError, match=r"lamp\.csv has no luminous energy"):
        light(str(lamp))


@pytest.mark.parametrize(
    ("wavelengths", "part"),
    [
        ((3.8e-7, 5e-7, 7.8e-7), "are they metres"),
        ((0.38, 0.5, 0.78), r"are they micrometres\? multiply by 1000"),
        ((1.6, 2.2, 3.3), "are they electronvolts"),
        ((3800, 5000, 7800), r"are they Ångström\? divide by 10"),
        ((26300, 20000, 12800), "are they wavenumbers in 1/cm"),
    ],
)
def test_wavelengths_in_other_units_are_recognised(
    lamp: Path, wavelengths: tuple[float, ...], part: str
) -> None:
    lamp.write_text("".join(f"{w},1\n" for w in wavelengths))
    with pytest.raises(SpectrumError, match=rf"lamp\.csv: .*none visible; {part}"):
        read_spectrum(lamp)


def test_tables_that_begin_or_end_far_from_the_visible_are_nanometres(lamp: Path) -> None:
    lamp.write_text("250,1\n2500,1\n")
    assert read_spectrum(lamp).wavelengths_nm.tolist() == [250, 2500]


def test_underscores_make_no_numbers(lamp: Path) -> None:
    for text in ("grey:0.1_8", "grey:_1"):
        with pytest.raises(SpectrumError, match=r"not in 0\.\.1"):
            reflectance(text)
    for text, part in (("planck:5_000", "not a temperature"), ("A*0_1", "unknown")):
        with pytest.raises(SpectrumError, match=part):
            light(text)
    lamp.write_text("4_00,1\n5_00,1\n")
    with pytest.raises(SpectrumError, match=r"'4_00,1' is not a row of numbers"):
        light(str(lamp))
    IMAGE.save(lamp.with_suffix(".exr"))
    with pytest.raises(SpectrumError, match=r"'0_0,1' is no part of an image"):
        read_spectrum(f"{lamp.with_suffix('.exr')}#0_0,1")


def test_a_part_of_weight_0_is_not_read_but_must_be_a_name(lamp: Path) -> None:
    lamp.write_text(rows(0))
    assert np.array_equal(light(f"{lamp}*0+A").values, light("A").values)
    with pytest.raises(SpectrumError, match="'Q' in the mix"):
        light("Q*0+A")


def test_a_grid_beyond_the_eye_is_refused_before_any_warning(lamp: Path) -> None:
    # Warnings are errors in this suite.
    with pytest.raises(SpectrumError, match="colour-matching functions span 360-830 nm"):
        light(str(lamp), SpectralGrid(300, 900, 10))


def test_one_exr_channel_in_two_parts_is_refused(tmp_path: Path) -> None:
    import OpenEXR

    path = tmp_path / "two.exr"
    parts = [
        OpenEXR.Part({"name": name}, {"T.500nm": np.ones((2, 3), np.float32)})
        for name in ("left", "right")
    ]
    OpenEXR.File(parts).write(str(path))
    with pytest.raises(SpectrumError, match=r"two\.exr: two parts hold a channel 'T\.500nm'"):
        read_spectrum(path)


def test_exr_files_keep_header_and_channels(tmp_path: Path) -> None:
    path = tmp_path / "a.exr"
    depth = np.arange(6.0).reshape(2, 3)
    write_exr(path, {"volspec:format": 1}, {"Z": depth}, ImageError)
    header, channels = read_exr(path, ImageError)
    assert header["volspec:format"] == 1
    assert (list(channels), channels["Z"].dtype) == (["Z"], np.float32)
    assert np.array_equal(channels["Z"], depth)


def test_exr_faults_are_raised_as_the_callers_error_in_its_words(tmp_path: Path) -> None:
    path = tmp_path / "a.exr"
    with pytest.raises(ImageError, match=r"a\.exr: gone"):
        read_exr(path, ImageError, missing="gone")
    path.write_text("no image")
    with pytest.raises(ImageError, match="not a readable OpenEXR file, or truncated; render again"):
        read_exr(path, ImageError, again="render again")
    with pytest.raises(ImageError, match=r"a\.exr: is a folder"):
        path.unlink()
        path.mkdir()
        read_exr(path, ImageError)
    with pytest.raises(ImageError, match=r"b\.exr: cannot be written"):
        write_exr(tmp_path / "b.exr", {}, {"Z": np.ones((2, 3)), "A": np.ones((3, 2))}, ImageError)
    assert not (tmp_path / "b.exr").exists()
