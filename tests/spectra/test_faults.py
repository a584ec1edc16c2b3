"""Faults of callers and files: one SpectrumError of one line, with its code."""

from __future__ import annotations

import errno
from collections.abc import Callable
from pathlib import Path
from typing import Any, NoReturn

import numpy as np
import pytest

from tests.support.errors import raises
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
    ("call", "code", "field"),
    [
        (lambda p: light("D65", None), "type", "grid"),
        (lambda p: light("D65", (400, 700, 10)), "type", "grid"),
        (lambda p: light_set("smooth", None), "type", "grid"),
        (lambda p: reflectance("white", None), "type", "grid"),
        (lambda p: FLAT.on(None), "type", "grid"),
        (lambda p: IMAGE.on((400, 700, 10)), "type", "grid"),
        (lambda p: SpectralGrid("a", 700, 10), "type", "grid.start_nm"),
        (lambda p: SpectralGrid(400, 700, None), "type", "grid.step_nm"),
        (lambda p: SpectralGrid(1e-300, 1e300, 1e-300), "size", "grid"),
        (lambda p: read_spectrum(None), "type", None),
        (lambda p: read_spectrum(b"lamp.csv"), "type", None),
        (lambda p: read_spectrum("lamp.ies"), "unsupported", None),
        (lambda p: IMAGE.save("a.tif"), "unsupported", None),
        (lambda p: read_spectrum(p, kind="foo"), "unknown", None),
        (lambda p: SpectralImage.load(p, "foo"), "unknown", None),
        (lambda p: SpectralImage.load(None), "type", None),
        (lambda p: IMAGE.save(None), "type", None),
        (lambda p: IMAGE.save("a\0.exr"), "syntax", None),
        (lambda p: light("lamp.csv", folder=None), "type", None),
        # Before any warning that the file ends: warnings are errors in this suite.
        (lambda p: light(str(p), SpectralGrid(300, 900, 10)), "range", None),
        (lambda p: reflectance("paint.csv", folder=None), "type", None),
        (lambda p: light("a\0b.csv"), "syntax", None),
        (lambda p: light("a\0b.csv*1+A"), "syntax", None),
        (lambda p: read_spectrum("a\0b.exr"), "syntax", None),
        (lambda p: IMAGE.mean("abc"), "type", None),
        (lambda p: IMAGE.mean((1, 2)), "type", None),
        (lambda p: IMAGE.mean(5), "type", None),
        (lambda p: IMAGE.mean((0.5, 0, 2, 2)), "type", None),
        (lambda p: Spectrum([400, 500], [1, 1], notes=None), "type", "spectrum: notes"),
        (lambda p: Spectrum([400, 500], [1, 1], notes=[1]), "type", "spectrum: notes"),
    ],
)
def test_what_callers_get_wrong_is_one_clear_line(
    lamp: Path, call: Callable[[Path], Any], code: str, field: str | None
) -> None:
    with raises(SpectrumError, code, field):
        call(lamp)


@pytest.mark.parametrize("name", ["lamp.csv", "lamp.spdx", "lamp.exr"])
def test_a_file_that_may_not_be_read_says_so(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, name: str
) -> None:
    """Root may read anything, so that the refusal is made up."""

    def refuse(*args: object, **kwargs: object) -> NoReturn:
        raise PermissionError(errno.EACCES, "Permission denied")

    for method in ("open", "stat", "read_bytes"):
        monkeypatch.setattr(Path, method, refuse)
    with raises(SpectrumError, "damaged"):
        light(name, folder=tmp_path)


@pytest.mark.parametrize("text", [rows("0,20007"), "nm,power\n" + rows("0,20007")])
def test_whole_numbers_in_unnamed_columns_may_be_decimal_commas(lamp: Path, text: str) -> None:
    lamp.write_text(text)
    with raises(SpectrumError, "missing"):
        light(str(lamp))
    lamp.write_text("nm,warm,cold\n" + rows("0,20007"))
    with raises(SpectrumError, "missing"):
        light(str(lamp))
    lamp.write_text("380,1\n390,0,5\n")
    with raises(SpectrumError, "shape"):
        light(str(lamp))


def test_blanks_inside_file_and_column_names_are_kept_apart(tmp_path: Path) -> None:
    (tmp_path / "my  lamp.csv").write_text("nm,very  warm,cold\n" + rows("1,2"))
    for read in (light, reflectance):
        for column in ("very  warm", "very warm"):
            found = read(f" my  lamp.csv#{column} ", folder=tmp_path)
            assert found.values == pytest.approx(1.0)
    mix = light("my  lamp.csv#1*0.5 + 60  A/W\n(soft white)*0.5", folder=tmp_path)
    assert mix.values.sum() == pytest.approx(
        0.5 * (light("my  lamp.csv#1", folder=tmp_path) + light("60 A/W (Soft White)")).values.sum()
    )
    dark = reflectance("ColorChecker/dark skin")
    assert reflectance("ColorChecker/dark  skin").name == dark.name


@pytest.mark.parametrize("level", ["1e308", "1.7e308", "1e-310", "5e-324"])
def test_lights_of_any_magnitude_are_scaled(lamp: Path, level: str) -> None:
    lamp.write_text(rows(level))
    # Numpy's warnings of overflow are errors in this suite.
    assert light(str(lamp)).values == pytest.approx(1.0)


def test_a_light_whose_peak_lies_far_outside_the_grid_is_scaled(lamp: Path) -> None:
    lamp.write_text("300,1\n" + rows("1e-312", 320))
    assert light(str(lamp), SpectralGrid(400, 700, 20)).values == pytest.approx(1.0)
    lamp.write_text("300,1e308\n" + rows("1e-312", 320))
    with raises(SpectrumError, "conflict"):
        light(str(lamp))


@pytest.mark.parametrize(
    ("wavelengths", "unit"),
    [
        ((3.8e-7, 5e-7, 7.8e-7), "metres"),
        ((0.38, 0.5, 0.78), "micrometres"),
        ((1.6, 2.2, 3.3), "electronvolts"),
        ((3800, 5000, 7800), "Ångström"),
        ((26300, 20000, 12800), "wavenumbers"),
    ],
)
def test_wavelengths_in_other_units_are_recognised(
    lamp: Path, wavelengths: tuple[float, ...], unit: str
) -> None:
    lamp.write_text("250,1\n2500,1\n")
    assert read_spectrum(lamp).wavelengths_nm.tolist() == [250, 2500]
    lamp.write_text("".join(f"{w},1\n" for w in wavelengths))
    with raises(SpectrumError, "range") as caught:
        read_spectrum(lamp)
    assert unit in caught.value.remedy


def test_underscores_make_no_numbers(lamp: Path) -> None:
    for text in ("grey:0.1_8", "grey:_1"):
        with raises(SpectrumError, "range"):
            reflectance(text)
    for text, code in (("planck:5_000", "syntax"), ("A*0_1", "unknown")):
        with raises(SpectrumError, code):
            light(text)
    lamp.write_text("4_00,1\n5_00,1\n")
    with raises(SpectrumError, "syntax"):
        light(str(lamp))
    IMAGE.save(lamp.with_suffix(".exr"))
    with raises(SpectrumError, "syntax"):
        read_spectrum(f"{lamp.with_suffix('.exr')}#0_0,1")


def test_a_part_of_weight_0_is_not_read_but_must_be_a_name(lamp: Path) -> None:
    lamp.write_text(rows(0))
    assert np.array_equal(light(f"{lamp}*0+A").values, light("A").values)
    with raises(SpectrumError, "unknown"):
        light("Q*0+A")


def test_one_exr_channel_in_two_parts_is_refused(tmp_path: Path) -> None:
    import OpenEXR

    path = tmp_path / "two.exr"
    parts = [
        OpenEXR.Part({"name": name}, {"T.500nm": np.ones((2, 3), np.float32)})
        for name in ("left", "right")
    ]
    OpenEXR.File(parts).write(str(path))
    with raises(SpectrumError, "duplicate"):
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
    with raises(ImageError, "not-found"):
        read_exr(path, ImageError, missing="gone")
    path.write_text("no image")
    with raises(ImageError, "damaged"):
        read_exr(path, ImageError, again="render again")
    with raises(ImageError, "type"):
        path.unlink()
        path.mkdir()
        read_exr(path, ImageError)
    with raises(ImageError, "unwritable"):
        write_exr(tmp_path / "b.exr", {}, {"Z": np.ones((2, 3)), "A": np.ones((3, 2))}, ImageError)
    assert not (tmp_path / "b.exr").exists()
