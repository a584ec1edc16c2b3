"""Faults of callers and files: one SpectrumError of one line, with its code."""

import errno
from collections.abc import Callable
from pathlib import Path
from typing import Any, NoReturn

import numpy as np
import pytest

from tests.spectra._files import constant, fails, saved
from tests.support.errors import raises
from volspec.errors import SpectrumError
from volspec.spectra import (
    DEFAULT_GRID,
    SpectralGrid,
    SpectralImage,
    Spectrum,
    XYZ_from_spectra,
    colour_matching_functions,
    light,
    light_set,
    read_spectrum,
    reflectance,
    reflectance_set,
    white_XYZ,
)
from volspec.spectra.library.lamps import (
    flux_lm,
    irradiance,
    lamp,
    lamp_illuminance_lux,
    monochromatic_lm,
)
from volspec.spectra.observers import cone_fundamentals, standard_eye

FLAT = Spectrum([380, 780], [1, 1])
IMAGE = SpectralImage(np.ones((2, 3, 3)), [380, 500, 780], "reflective")
DARK = Spectrum([400, 700], [0, 0], "dark").on(DEFAULT_GRID)
UNEVEN = Spectrum([400, 410, 430], [1, 1, 1])
GREY = "".join(f"{w},{{}}\n" for w in range(380, 781, 5)).format


def probe(wavelengths: Any, values: Any, **more: Any) -> Spectrum:
    return Spectrum(wavelengths, values, "probe", **more)


def table(folder: Path, text: str, read: Callable[[str], object] = read_spectrum) -> object:
    return read(saved(folder, "table.csv", text))


@pytest.mark.parametrize(
    ("fault", "call"),
    [
        ("range grid", lambda f: SpectralGrid(400, 700, 0)),
        ("range grid", lambda f: SpectralGrid(400, 705, 10)),
        ("range grid", lambda f: SpectralGrid(400, np.nan, 10)),
        ("size grid", lambda f: SpectralGrid(1e-300, 1e300, 1e-300)),
        ("range", lambda f: DEFAULT_GRID.band_means([420, 690], [1, 1])),
        ("shape", lambda f: probe([400, 500], [1, 2, 3])),
        ("shape", lambda f: probe([400], [1])),
        ("range", lambda f: probe([400, 400], [1, 1])),
        ("range", lambda f: probe([400, 500], [1, np.nan])),
        ("type", lambda f: probe([400, 500], ["a", "b"])),
        ("type", lambda f: probe([400, 500], [1, 1], notes={"a": 1})),
        ("duplicate", lambda f: probe([400, 500], [1, 1], notes={"": "x"})),
        ("duplicate", lambda f: probe([400, 500], [1, 1], notes={"A": "", "a": ""})),
        ("conflict", lambda f: UNEVEN.grid),
        ("conflict", lambda f: FLAT + UNEVEN),
        ("unknown", lambda f: light("D66")),
        ("unknown", lambda f: light("D65*0.7+Q")),
        ("unknown", lambda f: light("Q*0+A")),
        ("unknown", lambda f: light("A*0_1")),
        ("range", lambda f: light("A*-1")),
        ("range", lambda f: light("A*0+E*0")),
        ("range", lambda f: light("planck:499")),
        ("syntax", lambda f: light("planck:warm")),
        ("range", lambda f: light("daylight:3999")),
        ("missing", lambda f: light("")),
        # Nothing of it is on 380 to 780 nm.
        ("range", lambda f: light("led:365")),
        ("range", lambda f: light("ISO 7589 Sensitometric Printer")),
        ("unknown", lambda f: light_set("all")),
        ("unknown", lambda f: reflectance("golden")),
        ("unknown", lambda f: reflectance("fluorophore:EFGP")),
        ("range", lambda f: reflectance("grey:1.5")),
        ("range", lambda f: reflectance("grey:0.1_8")),
        *(
            ("syntax", lambda f, text=text: reflectance(text))
            for text in ("longpass:blue", "bandpass:525", "longpass:500/20", "bandpass:525/-50")
        ),
        ("unknown", lambda f: reflectance_set("all")),
        ("range", lambda f: colour_matching_functions(SpectralGrid(300, 830, 10))),
        ("range field_deg", lambda f: cone_fundamentals(standard_eye(), 4)),
        ("shape", lambda f: XYZ_from_spectra(light("D65"), np.ones(30))),
        ("conflict", lambda f: white_XYZ(DARK)),
        ("unknown", lambda f: light("lamp:halogen-3301")),
        ("unknown", lambda f: lamp("candel-1900")),
        ("missing", lambda f: flux_lm("candle-1900", 40.0)),
        ("range", lambda f: flux_lm("halogen-3000", 0.0)),
        ("range", lambda f: lamp_illuminance_lux("halogen-3000", 50.0, 1.0, 361.0)),
        ("range", lambda f: monochromatic_lm(1.0, 300.0)),
        ("range", lambda f: irradiance(light("D65"), 0.0)),
        ("unsupported", lambda f: read_spectrum("lamp.ies")),
        ("syntax", lambda f: read_spectrum("a\0b.exr")),
        ("syntax", lambda f: light("a\0b.csv*1+A")),
        ("unknown", lambda f: read_spectrum(saved(f, "a.csv", constant(1)), kind="foo")),
        # Before any warning that the file ends: warnings are errors in this suite.
        ("range", lambda f: light(saved(f, "a.csv", constant(1)), SpectralGrid(300, 900, 10))),
        # What the eye sees is never filled.
        ("range", lambda f: table(f, constant(0.5, 450, 650), light)),
        ("conflict", lambda f: table(f, constant(0), light)),
        ("range", lambda f: table(f, constant(-1), light)),
        ("range", lambda f: table(f, constant("nan"), light)),
        ("range", lambda f: table(f, constant(50), reflectance)),
        ("range", lambda f: table(f, constant(-0.02), reflectance)),
        # The peak lies far outside of the grid.
        ("conflict", lambda f: table(f, "300,1e308\n" + constant("1e-312", 320), light)),
        # Whole numbers in unnamed columns may be decimal commas.
        ("missing", lambda f: table(f, constant("0,20007"))),
        ("missing", lambda f: table(f, "nm,warm,cold\n" + constant("0,20007"))),
        *(
            (code, lambda f, text=text: table(f, text))
            for text, code in (
                ("380,1\n390,0,5\n", "shape"),
                ("nm,value\n400,1\nx,2\n", "syntax"),
                ("400,1,7\n500,2\n", "shape"),
                ("400,1,7\n500,2,7\n", "missing"),
                ("400\n500\n", "missing"),
                ("400,2,1\n500,2,7\n600,,7\n", "syntax"),
                ("400,1 W\n500,2\n600,2\n", "syntax"),
                ("4_00,1\n5_00,1\n", "syntax"),
                ("400,1\n", "missing"),
                ("", "missing"),
                ("500,1\n400,1\n", "range"),
                ("400,1\n500,nan\n", "range"),
            )
        ),
    ],
)
def test_bad_calls_are_refused(tmp_path, call, fault):
    fails(call, tmp_path, fault)


@pytest.mark.parametrize("name", ["lamp.csv", "lamp.spdx", "lamp.exr"])
def test_a_locked_file_says_so(tmp_path, monkeypatch, name):
    """Root may read anything, so that the refusal is made up."""

    def refuse(*args: object, **kwargs: object) -> NoReturn:
        raise PermissionError(errno.EACCES, "Permission denied")

    for method in ("open", "stat", "read_bytes"):
        monkeypatch.setattr(Path, method, refuse)
    with raises(SpectrumError, "damaged"):
        light(name, folder=tmp_path)


def test_blanks_inside_file_and_column_names_are_kept_apart(tmp_path):
    (tmp_path / "my  lamp.csv").write_text("nm,very  warm,cold\n" + constant("1,2"))
    for read in (light, reflectance):
        for column in ("very  warm", "very warm"):
            found = read(f" my  lamp.csv#{column} ", folder=tmp_path)
            assert found.values == pytest.approx(1.0)
    mix = light("my  lamp.csv#1*0.5 + 60  A/W\n(soft white)*0.5", folder=tmp_path)
    parts = light("my  lamp.csv#1", folder=tmp_path) + light("60 A/W (Soft White)")
    assert mix.values == pytest.approx(0.5 * parts.values)
    assert reflectance("ColorChecker/dark  skin").name == reflectance("ColorChecker/dark skin").name


@pytest.mark.parametrize("level", ["1e308", "1.7e308", "1e-310", "5e-324"])
def test_lights_of_any_magnitude_are_scaled(tmp_path, level):
    # Numpy's warnings of overflow are errors in this suite.
    assert light(saved(tmp_path, "lamp.csv", constant(level))).values == pytest.approx(1.0)


def test_a_light_whose_peak_lies_far_outside_the_grid_is_scaled(tmp_path):
    path = saved(tmp_path, "lamp.csv", "300,1\n" + constant("1e-312", 320, step=20))
    assert light(path, SpectralGrid(400, 700, 20)).values == pytest.approx(1.0)


UNITS = {
    "metres": (3.8e-7, 5e-7, 7.8e-7),
    "micrometres": (0.38, 0.5, 0.78),
    "electronvolts": (1.6, 2.2, 3.3),
    "Ångström": (3800, 5000, 7800),
    "wavenumbers": (26300, 20000, 12800),
}


@pytest.mark.parametrize("unit", UNITS)
def test_other_units_are_recognised(tmp_path, unit):
    read = read_spectrum(saved(tmp_path, "lamp.csv", "250,1\n2500,1\n"))
    assert read.wavelengths_nm.tolist() == [250, 2500]
    with raises(SpectrumError, "range") as caught:
        table(tmp_path, "".join(f"{w},1\n" for w in UNITS[unit]))
    assert unit in caught.value.remedy


def test_a_part_of_weight_0_is_not_read(tmp_path):
    dark = saved(tmp_path, "lamp.csv", constant(0))
    assert np.array_equal(light(f"{dark}*0+A").values, light("A").values)
