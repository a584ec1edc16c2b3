"""Spectra of instruments: CGATS and Argyll text, CxF3, renderers' tables."""

from collections.abc import Callable
from functools import partial
from pathlib import Path

import pytest

from tests.spectra._files import fails, saved
from tests.support.errors import raises
from volspec.errors import RoomError
from volspec.room.paints import paint_set
from volspec.spectra import PAPERS_GRID, Spectrum, light, read_spectrum, reflectance, write_spectrum

Write = Callable[[str, str], str]

CHART = """CGATS.17
ORIGINATOR "Mülller & Co"
KEYWORD "SAMPLE_ID"
INSTRUMENTATION "i1Pro 2; M1"
NUMBER_OF_FIELDS 6
BEGIN_DATA_FORMAT
SAMPLE_ID SAMPLE_NAME LAB_L SPECTRAL_NM400 SPECTRAL_NM550 SPECTRAL_NM700
END_DATA_FORMAT
NUMBER_OF_SETS 2
BEGIN_DATA
A1 "dark skin" 37.9 0.05 0.10 0.40
A2 white 96.5 0.70 0.90 0.92
END_DATA
"""
TI3 = """CTI3

DESCRIPTOR "Argyll Calibration Target chart information 3"
DEVICE_CLASS "OUTPUT"
COLOR_REP "CMYK_XYZ"
SPECTRAL_BANDS "3"
SPECTRAL_START_NM "380.000000"
SPECTRAL_END_NM "731.000000"
{norm}
NUMBER_OF_FIELDS 5
BEGIN_DATA_FORMAT
SAMPLE_ID CMYK_C SPEC_380 SPEC_556 SPEC_731
END_DATA_FORMAT

NUMBER_OF_SETS 2
BEGIN_DATA
1 100.0 40.0 20.0 10.0
2 0.0 0.5 0.6 0.7
END_DATA
CAL
BEGIN_DATA_FORMAT
RGB_I RGB_R
END_DATA_FORMAT
BEGIN_DATA
0 0
END_DATA
"""
SP = """SPECT

DESCRIPTOR "Argyll Spectral power/reflectance information"
MEAS_TYPE "{measured}"
SPECTRAL_BANDS "4"
SPECTRAL_START_NM "380.000000"
SPECTRAL_END_NM "780.000000"
SPECTRAL_NORM "{norm}"

NUMBER_OF_FIELDS 4
BEGIN_DATA_FORMAT
SPEC_380 SPEC_513 SPEC_647 SPEC_780
END_DATA_FORMAT

NUMBER_OF_SETS 1
BEGIN_DATA
50 60 70 80
END_DATA
"""
CXF = """<?xml version="1.0" encoding="UTF-8"?>
<cc:CxF xmlns:cc="http://colorexchangeformat.com/CxF3-core"><cc:FileInformation>
<cc:Creator>Press room</cc:Creator><cc:CreationDate>2024-05-06T07:08:09</cc:CreationDate>
</cc:FileInformation><cc:Resources><cc:ObjectCollection>{objects}</cc:ObjectCollection>
<cc:ColorSpecificationCollection><cc:ColorSpecification Id="M1"><cc:MeasurementSpec>
<cc:MeasurementType>Spectrum_Reflectance</cc:MeasurementType>
<cc:WavelengthRange StartWL="400" Increment="150"/><cc:Device><cc:Model>eXact</cc:Model></cc:Device>
</cc:MeasurementSpec></cc:ColorSpecification></cc:ColorSpecificationCollection></cc:Resources>
</cc:CxF>"""


def cxf_object(
    values: str, name: str = "Pantone 485 C", tag: str = "Reflectance", **own: str
) -> str:
    keys = {"ColorSpecification": "M1"} | own
    given = "".join(f' {key}="{value}"' for key, value in keys.items())
    return (
        f'<cc:Object ObjectType="Standard" Name="{name}" Id="c1"><cc:ColorValues>'
        f"<cc:{tag}Spectrum{given}>{values}</cc:{tag}Spectrum>"
        "</cc:ColorValues></cc:Object>"
    )


@pytest.fixture
def write(tmp_path: Path) -> Write:
    return partial(saved, tmp_path)


@pytest.mark.parametrize("selector", ["dark skin", "DARK  skin", "a1", "1"])
def test_a_sample_is_chosen_by_name_id_or_number(write, selector):
    s = read_spectrum(f"{write('chart.cgats', CHART)}#{selector}")
    assert s.wavelengths_nm.tolist() == [400, 550, 700]
    assert (s.name, s.values.tolist()) == ("chart#dark skin", [0.05, 0.10, 0.40])
    assert s.notes["originator"] == "Mülller & Co"
    assert s.notes["instrumentation"] == "i1Pro 2; M1"


@pytest.mark.parametrize(
    ("old", "new"),
    [
        ("\n", "\r\n"),
        ("END_DATA\n", ""),
        ("_DATA", "_data"),
        ("CGATS.17", "cgats.17"),
        (" SPECTRAL_NM", "\tSPECTRAL_NM"),
        (' "dark skin" 37.9 0.05 0.10 0.40', "\tdark skin\t37.9\t0.05\t0.10\t0.40\t"),
        (' "dark skin" 37.9 0.05 0.10 0.40', ",dark skin,37.9,0.05,0.10,0.40,"),
        ("37.9 0.05", "37.9\n0.05"),
        ("SPECTRAL_NM", "NM_"),
        ("SPECTRAL_NM", "nm"),
        ("SPECTRAL_NM", "SPEC_"),
        ("SPECTRAL_NM400", "400_NM"),
        ("0.92\n", "0.92   \t\n\n"),
        ("NUMBER_OF_SETS 2\n", ""),
        ("KEYWORD", "# a comment\nKEYWORD"),
    ],
)
def test_the_dialects_of_programs_are_read_alike(write, old, new):
    text = CHART.replace(old, new)
    if "37.9\n" in new:
        text = text.replace("96.5 ", "96.5\n")
    assert text != CHART
    for name in ("chart.cie", "chart.txt"):
        s = read_spectrum(f"{write(name, text)}#dark skin")
        assert s.wavelengths_nm.tolist() == [400, 550, 700]
        assert s.values.tolist() == [0.05, 0.10, 0.40]


def test_pairs_of_wavelength_and_percentage_are_read(write):
    fields = "SAMPLE_ID " + "SPECTRAL_NM SPECTRAL_PCT " * 3
    data = "BEGIN_DATA\n1 700 1.5 550 0.5 400 1\nEND_DATA\n"
    text = f"CGATS.17\nBEGIN_DATA_FORMAT\n{fields}\nEND_DATA_FORMAT\n{data}"
    s = read_spectrum(write("a.cgats", text))
    assert s.wavelengths_nm.tolist() == [400, 550, 700]
    assert s.values.tolist() == [0.01, 0.005, 0.015]
    assert s.notes["spectral quantity"] == "reflectance"


def test_percentages_are_recognised_by_the_whole_chart(write):
    text = CHART.replace("0.05 0.10 0.40", "1.0 1.2 1.5").replace("0.70 0.90 0.92", "70 90 92")
    path = write("chart.txt", text)
    paint = reflectance(f"{path}#dark skin")
    assert paint.values.max() == pytest.approx(0.015, abs=1e-3)
    # A lamp's values are left alone, as are those of which nothing is said.
    assert read_spectrum(f"{path}#A1").values.tolist() == [1.0, 1.2, 1.5]


@pytest.mark.parametrize(("norm", "whole"), [("", 100.0), ('SPECTRAL_NORM "50.0"', 50.0)])
def test_argyll_s_charts_have_wavelengths_and_norm(write, norm, whole):
    path = write("chart.ti3", TI3.format(norm=norm))
    for k, values in enumerate(([40.0, 20.0, 10.0], [0.5, 0.6, 0.7]), start=1):
        s = read_spectrum(f"{path}#{k}", kind="reflective")
        assert s.wavelengths_nm.tolist() == [380.0, 555.5, 731.0]
        assert s.values == pytest.approx([each / whole for each in values])


def test_argylls_spectra_say_what_they_are(write):
    paint = write("paint.sp", PAINT)
    assert reflectance(paint).values.max() < 0.8
    assert read_spectrum(paint).wavelengths_nm == pytest.approx([380, 380 + 400 / 3, 646.667, 780])
    lamp = write("lamp.sp", EMISSION)
    assert read_spectrum(lamp).values.tolist() == [50, 60, 70, 80]
    assert light(f"{lamp}*0.5+A*0.5").values.min() > 0


def test_objects_of_cxf_have_the_wavelengths_of_their_specification(write):
    path = write("inks.cxf", CXF.format(objects=cxf_object("0.1 0.2\n 0.9")))
    s = read_spectrum(f"{path}#pantone 485 c", kind="reflective")
    assert (s.wavelengths_nm.tolist(), s.values.tolist()) == ([400, 550, 700], [0.1, 0.2, 0.9])
    assert s.notes["model"] == "eXact" and s.notes["creator"] == "Press room"
    assert s.notes["creation date"] == "2024-05-06T07:08:09"
    assert read_spectrum(f"{path}#c1").name == "inks#Pantone 485 C"
    own = cxf_object("0.1 0.2 0.9", StartWL="390", EndWL="690", ColorSpecification="none")
    assert read_spectrum(write("a.cxf", CXF.format(objects=own))).wavelengths_nm[-1] == 690


def test_of_an_object_the_spectra_that_fit_the_use_are_offered(write):
    path = write("both.cxf", CXF.format(objects=INK + LAMP))
    assert reflectance(path, PAPERS_GRID).values.max() == pytest.approx(0.8125)
    assert light(path).values.min() > 0
    twice = '<cc:ReflectanceSpectrum Name="M0" ColorSpecification="M1" StartWL="400">0.3 0.3 0.3'
    end = "</cc:ColorValues>"
    ink = INK.replace(end, f"{twice}</cc:ReflectanceSpectrum>{end}").replace("10 20 90", ".1 .2 .9")
    path = write("two.cxf", CXF.format(objects=ink))
    assert read_spectrum(f"{path}#A/M0").values.tolist() == [0.3, 0.3, 0.3]


def test_a_measured_chart_is_an_atlas_of_paints(write):
    path = write("chart.ti3", CHART.replace("400", "380").replace("700", "780"))
    assert [paint.name for paint in paint_set([path])] == ["chart#dark skin", "chart#white"]
    twice = write("b.ti3", Path(path).read_text("latin-1").replace("white", '"dark skin"'))
    with raises(RoomError, "duplicate"):
        paint_set([twice])


def test_renderers_tables_are_written_and_read(tmp_path):
    s = Spectrum([400, 550.5, 700], [0.25, 0.5, 1], notes={"maker": "me"})
    write_spectrum(s, tmp_path / "a.spd")
    text = (tmp_path / "a.spd").read_text()
    assert text == "# maker: me\n400 0.25\n550.5 0.5\n700 1\n"
    for name in ("b.SPD", "b.ssp"):
        (tmp_path / name).write_text(text.replace("# m", "; m").replace(";", "#"))
        back = read_spectrum(tmp_path / name)
        assert (back.values.tolist(), dict(back.notes)) == ([0.25, 0.5, 1], {"maker": "me"})


INK = cxf_object("10 20 90", "A", Increment="160")
LAMP = cxf_object("5 6 7", "A", "Emissive", StartWL="390", Increment="160")
PAINT = SP.format(measured="REFLECTIVE", norm=100)
EMISSION = SP.format(measured="EMISSION", norm=1)
BANDS = 'X"\nSPECTRAL_BANDS 3\nSPECTRAL_START_NM 380\nSPECTRAL_END_NM 700\n'
# The code, what of the chart is changed to what, and the sample that is read.
CHARTS = [
    ("missing", "", "", ""),
    ("unknown", "", "", "#A3"),
    ("missing", "SPECTRAL_NM", "XYZ_", ""),
    ("damaged", "NUMBER_OF_SETS 2", "NUMBER_OF_SETS 3", "#1"),
    ("syntax", "NUMBER_OF_SETS 2", "NUMBER_OF_SETS two", "#1"),
    ("syntax", "96.5 0.70", "96.5 n/a", "#2"),
    ("syntax", "96.5 0.70", "96.5 7_0", "#2"),
    ("range", "96.5 0.70", "96.5 nan", "#2"),
    ("shape", "0.90 0.92", "0.92", "#2"),
    ("shape", '"dark skin"', "dark skin", "#2"),
    ("duplicate", "white", '"dark skin"', "#dark skin"),
    ("range", "NM550", "NM400", "#1"),
    ("unknown", "NM550", "NM40000", "#9"),
    ("damaged", "BEGIN_DATA\n", "BEGIN_DATA\n\0", "#1"),
    ("syntax", 'SAMPLE_ID"\n', 'X"\nSPECTRAL_NORM 0\n', "#1"),
    ("conflict", 'SAMPLE_ID"\n', BANDS, "#1"),
]
OBJECTS = [
    ("missing", ""),
    ("missing", cxf_object("0.1")),
    ("syntax", cxf_object("0.1 x 0.3")),
    ("range", cxf_object("0.1 nan 0.3")),
    ("missing", cxf_object("0.1 0.3", ColorSpecification="M9")),
    ("syntax", cxf_object("0.1 0.3", StartWL="blue")),
    ("syntax", cxf_object("0.1 0.3", Increment="-10")),
    ("range", cxf_object("0.1 0.3", Increment="1e-300")),
    ("missing", INK + LAMP),
]


def chart(folder: Path, old: str, new: str, selector: str) -> Spectrum:
    return read_spectrum(saved(folder, "chart.cgats", CHART.replace(old, new)) + selector)


def cxf(folder: Path, text: str = CXF, objects: str = "", selector: str = "") -> Spectrum:
    return read_spectrum(saved(folder, "a.cxf", text.format(objects=objects)) + selector)


def absurd(path: Path) -> Spectrum:
    """Read a file of a terabyte without data."""
    with path.open("wb") as file:
        file.truncate(1 << 40)
    return read_spectrum(path)


@pytest.mark.parametrize(
    ("fault", "call"),
    [
        *((code, lambda f, change=change: chart(f, *change)) for code, *change in CHARTS),
        *((code, lambda f, objects=objects: cxf(f, objects=objects)) for code, objects in OBJECTS),
        ("duplicate", lambda f: cxf(f, objects=INK + LAMP, selector="#A")),
        ("damaged", lambda f: cxf(f, CXF[:300])),
        ("unsupported", lambda f: cxf(f, "<IESTM2714/>")),
        ("damaged", lambda f: cxf(f, '<!DOCTYPE CxF [<!ENTITY a "b">]><CxF/>')),
        ("type", lambda f: light(saved(f, "paint.sp", PAINT))),
        ("type", lambda f: reflectance(saved(f, "lamp.sp", EMISSION))),
        *(
            ("size", lambda f, end=end: absurd(f / f"a.{end}"))
            for end in ("csv", "ti3", "cxf", "spdx")
        ),
    ],
)
def test_faulty_charts_are_refused(tmp_path, fault, call):
    fails(call, tmp_path, fault)
